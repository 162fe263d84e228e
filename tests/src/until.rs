//! Waits until the reports of a running stack are as a test needs them.

#![allow(clippy::unwrap_used, reason = "a test that cannot ask has failed")]

use std::time::{Duration, Instant};

use prost::{Message, Name};
use sg_proto::keys::{self, Retained};
use sg_proto::speech::{self, Recognition};
use sg_proto::{labeling, render, scene::State};
use sg_runtime::bus::{Bus, Subscription};
use sg_runtime::context::Context;

/// How long anything may take on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// How often it is looked.
const LOOKS: Duration = Duration::from_millis(50);

/// The time limit of one question.
#[must_use]
pub fn soon() -> Context {
    Context::root().deadline_in(Duration::from_secs(10))
}

/// The scene once it is as it has to be.
///
/// # Panics
/// It cannot be asked for, or is not so after [`PATIENCE`]; `what` is in the message.
pub async fn scene(bus: &Bus, what: &str, holds: impl Fn(&State) -> bool) -> State {
    let begun = Instant::now();
    loop {
        let state = bus.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
        if holds(&state) {
            return state;
        }
        assert!(begun.elapsed() < PATIENCE, "{what}: {state:?}");
        tokio::time::sleep(LOOKS).await;
    }
}

/// The view once it is as it has to be. It may be away meanwhile.
///
/// # Panics
/// It is not so after [`PATIENCE`]; `what` is in the message.
pub async fn view(bus: &Bus, what: &str, holds: impl Fn(&render::State) -> bool) -> render::State {
    retained(bus, &keys::VIEW_STATE, what, holds).await
}

/// The speech service once it is as it has to be. It may be away meanwhile.
///
/// # Panics
/// It is not so after [`PATIENCE`]; `what` is in the message.
pub async fn speech(bus: &Bus, what: &str, holds: impl Fn(&speech::State) -> bool) -> speech::State {
    retained(bus, &keys::SPEECH_STATE, what, holds).await
}

/// The labeling service once it is as it has to be. It may be away meanwhile.
///
/// # Panics
/// It is not so after [`PATIENCE`]; `what` is in the message.
pub async fn labeling(bus: &Bus, what: &str, holds: impl Fn(&labeling::State) -> bool) -> labeling::State {
    retained(bus, &keys::LABELING_STATE, what, holds).await
}

/// A retained value once it is as it has to be. Its owner may be away meanwhile.
async fn retained<M>(bus: &Bus, row: &Retained<M>, what: &str, holds: impl Fn(&M) -> bool) -> M
where
    M: Message + Name + Default + std::fmt::Debug,
{
    let begun = Instant::now();
    loop {
        match bus.newest(row, &soon()).await {
            Ok(state) if holds(&state) => return state,
            other => assert!(begun.elapsed() < PATIENCE, "{what}: {other:?}"),
        }
        tokio::time::sleep(LOOKS).await;
    }
}

/// The next text that is final.
///
/// # Panics
/// None comes within [`PATIENCE`]; the state of the speech service is in the message.
pub async fn recognized(bus: &Bus, texts: &mut Subscription<Recognition>) -> Recognition {
    let next = async {
        loop {
            let (text, _) = texts.next().await.unwrap();
            if text.r#final {
                return text;
            }
        }
    };
    let text = tokio::time::timeout(PATIENCE, next).await.ok();
    assert!(text.is_some(), "no text: {:?}", bus.newest(&keys::SPEECH_STATE, &soon()).await);
    text.unwrap()
}

/// Gaussians that are selected.
#[must_use]
pub fn selected(state: &State) -> u64 {
    state.selection.as_ref().map_or(0, |s| s.count)
}
