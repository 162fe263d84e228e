//! Carries out what a person asks for at a display, one thing after another; what is said to the agents takes its own time.

use std::sync::Arc;
use std::time::Duration;

use sg_proto::keys::{self, role};
use sg_proto::language::{Source, Utterance};
use sg_proto::scene::{Command, command};
use sg_proto::selection::{SampleReply, SampleRequest, StrokesRequest};
use sg_render_node::display::Request;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_scene::mask::Mask;
use tokio::sync::mpsc;

use super::news::{Newest, change, notice};
use super::preview;

/// How long a change or a stroke may take; a service that is being started again is waited for.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long a sample of a stroke may take: after that the hand is elsewhere.
const GLANCE: Duration = Duration::from_millis(500);

/// How long the agents may think.
const THOUGHT: Duration = Duration::from_secs(120);

/// Carries requests out for as long as there is a display.
pub(super) async fn run(bus: Bus, mut requests: mpsc::Receiver<Request>, newest: Newest) {
    let mut preview = Arc::new(Mask::empty(0));
    let mut said: Option<String> = None;
    while let Some(request) = requests.recv().await {
        match request {
            Request::Change(action) => refused(&newest, apply(&bus, *action).await),
            Request::Sample(sample) => {
                // A preview that did not come is followed by another, or by the stroke itself.
                if let Ok(reply) = self::sample(&bus, &sample).await {
                    show(&newest, &mut preview, &reply);
                }
            }
            Request::Select(strokes) => refused(&newest, select(&bus, &strokes).await),
            Request::Say(text) => said = Some(say(&bus, &newest, text)),
            Request::Withdraw => {
                if let Some(id) = said.take() {
                    let outcome = bus.cancel(role::AGENT_CORE, &id).await;
                    if !outcome.unwrap_or(false) {
                        notice(&newest, "it was answered already; nothing was withdrawn", false);
                    }
                }
            }
        }
    }
}

/// Tells the person of what was not done.
fn refused(newest: &Newest, outcome: Result<(), Fault>) {
    if let Err(fault) = outcome {
        notice(newest, fault.message, true);
    }
}

async fn apply(bus: &Bus, action: command::Action) -> Result<(), Fault> {
    let context = Context::root().deadline_in(PATIENCE);
    // The same id however often the question is put: it takes effect once.
    let id = format!("display-{}", context.id);
    let command = Command { id: id.clone(), expected_revision: 0, action: Some(action) };
    bus.ask(&keys::SCENE_APPLY, &command, &context.with_id(id)).await.map(drop)
}

async fn select(bus: &Bus, strokes: &StrokesRequest) -> Result<(), Fault> {
    bus.ask(&keys::SELECTION_STROKES, strokes, &Context::root().deadline_in(PATIENCE)).await.map(drop)
}

async fn sample(bus: &Bus, sample: &SampleRequest) -> Result<SampleReply, Fault> {
    bus.ask(&keys::SELECTION_SAMPLE, sample, &Context::root().deadline_in(GLANCE)).await
}

/// Shows what a stroke under way would select. Each answer says what differs from the one before.
fn show(newest: &Newest, before: &mut Arc<Mask>, reply: &SampleReply) {
    change(newest, |shown| {
        let committed = shown.scene.selection();
        if reply.selection_hash != committed.hash() {
            return;
        }
        let from = if reply.anew || before.len() != committed.mask().len() { committed.mask() } else { &*before };
        let after = Arc::new(preview::changed(from, &reply.changed));
        *before = Arc::clone(&after);
        shown.selected = after;
        shown.tentative = true;
    });
}

/// Says something to the agents, beside everything else; the id by which it can be withdrawn.
fn say(bus: &Bus, newest: &Newest, text: String) -> String {
    let context = Context::root().deadline_in(THOUGHT);
    let id = context.id.clone();
    let (bus, newest) = (bus.clone(), Arc::clone(newest));
    tokio::spawn(async move {
        let utterance = Utterance { text, source: Source::Text.into() };
        // The answer comes as every stage of the conversation does.
        refused(&newest, bus.ask(&keys::UTTER, &utterance, &context).await.map(drop));
    });
    id
}
