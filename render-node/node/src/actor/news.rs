//! Keeps what a display shows up to date: the scene, the selection, clusters, the conversation, who is there.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use sg_proto::keys::{self, role};
use sg_proto::language::{ActionResult, Intent, Reply, Utterance};
use sg_proto::launch::OpenFailed;
use sg_proto::selection::Preview;
use sg_runtime::blobs::Blobs;
use sg_runtime::bus::{Bus, BusError, Following};
use sg_runtime::context::Context;
use sg_runtime::process::Host;
use sg_viewer::display::{Conversation, Entry, News, Offered, Walks};
use tokio::sync::watch;

use super::clusters::Clusters;
use super::following::Followed;
use super::preview;

/// Messages of a conversation that may wait.
const WAITING: usize = 64;

/// How long a question about what is there may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// How often a service that is there, but has not told its state, is asked again.
const AGAIN: Duration = Duration::from_secs(1);

/// Begins to follow everything.
pub(super) async fn follow(host: &Host, state: watch::Receiver<Followed>, news: &News) -> Result<(), BusError> {
    let bus = host.bus();
    let previews = preview::follow(bus).await?;
    tokio::spawn(history(bus.clone(), state.clone(), news.clone()));
    tokio::spawn(scene(state, previews, news.clone()));
    let here = bus.watch_alive(WAITING).await?;
    tokio::spawn(services(bus.clone(), host.blobs().clone(), here, news.clone()));
    let talk = Talk {
        utterances: bus.follow(&keys::UTTERANCE, role::AGENT_CORE, WAITING).await?,
        intents: bus.follow(&keys::INTENT, role::AGENT_INTENT, WAITING).await?,
        actions: bus.follow(&keys::ACTION, role::AGENT_FUNCTION, WAITING).await?,
        replies: bus.follow(&keys::REPLY, role::AGENT_CORE, WAITING).await?,
    };
    tokio::spawn(conversation(talk, news.clone()));
    tokio::spawn(opened(bus.follow(&keys::OPEN_FAILED, role::SUPERVISOR, WAITING).await?, news.clone()));
    Ok(())
}

/// The scene as it is told of, and what is selected in it.
async fn scene(mut state: watch::Receiver<Followed>, mut previews: watch::Receiver<Option<Preview>>, news: News) {
    loop {
        let (now, selected) = {
            let followed = state.borrow_and_update();
            (Arc::clone(&followed.state), followed.highlighted(previews.borrow_and_update().as_ref()))
        };
        news.change(|shown| {
            shown.tentative = !Arc::ptr_eq(&selected, now.selection().mask());
            shown.selected = selected;
            shown.tried = None;
            shown.scene = now;
        });
        tokio::select! {
            changed = state.changed() => if changed.is_err() { return },
            changed = previews.changed() => if changed.is_err() { return },
        }
    }
}

/// What can be taken back and brought back, which is told with the scene's state alone; beside the rest, since a scene that
/// does not answer is not to hold a preview up.
async fn history(bus: Bus, mut state: watch::Receiver<Followed>, news: News) {
    loop {
        let revision = state.borrow_and_update().state.revision();
        if let Ok(told) = bus.newest(&keys::SCENE_STATE, &Context::root().deadline_in(PATIENCE)).await
            && told.revision >= revision
        {
            news.change(|shown| (shown.undo, shown.redo) = (told.undo.into(), told.redo.into()));
        }
        if state.changed().await.is_err() {
            return;
        }
    }
}

/// Who is there, and the clusters once the selection is.
async fn services(
    bus: Bus,
    blobs: Blobs,
    mut here: tokio::sync::mpsc::Receiver<sg_runtime::bus::Liveliness>,
    news: News,
) {
    let mut instances: HashMap<String, Vec<String>> = HashMap::new();
    let mut clusters = Clusters::default();
    let gaussians = news.newest().scene.count();
    loop {
        let is_there = |role: &str| instances.get(role).is_some_and(|all| !all.is_empty());
        let offered = Offered {
            scene: is_there(role::SCENE),
            selection: is_there(role::SELECTION),
            agents: is_there(role::AGENT_CORE) && is_there(role::AGENT_INTENT) && is_there(role::AGENT_FUNCTION),
        };
        news.change(|shown| {
            shown.offered = offered;
            shown.walks = shown.walks.filter(|_| offered.selection);
        });
        let mut asks_again = false;
        if offered.selection {
            let context = Context::root().deadline_in(PATIENCE);
            match clusters.newest(&bus, &blobs, gaussians, &context).await {
                Ok(labels) => {
                    let told = bus.newest(&keys::SELECTION_STATE, &context.next()).await;
                    asks_again = told.is_err();
                    news.change(|shown| {
                        shown.clusters = Some(labels);
                        shown.walks = told.ok().map(|t| Walks { tuning: t.tuning, most_proposals: t.most_proposals });
                    });
                }
                Err(fault) => {
                    tracing::warn!(%fault, "the clusters are not known yet");
                    asks_again = true;
                }
            }
        }
        let next = if asks_again {
            match tokio::time::timeout(AGAIN, here.recv()).await {
                Ok(next) => next,
                Err(_) => continue,
            }
        } else {
            here.recv().await
        };
        let Some(seen) = next else { return };
        let all = instances.entry(seen.role).or_default();
        all.retain(|i| *i != seen.instance);
        if seen.alive {
            all.push(seen.instance);
        }
    }
}

/// What was opened from here and failed.
async fn opened(mut failed: Following<OpenFailed>, news: News) {
    while let Some((OpenFailed { path, session, reason }, _)) = failed.next().await {
        news.notice(format!("{path} (session {session}): {reason}"), true);
    }
}

/// The stages of a conversation.
struct Talk {
    utterances: Following<Utterance>,
    intents: Following<Intent>,
    actions: Following<ActionResult>,
    replies: Following<Reply>,
}

/// What is said and answered, whoever says it.
async fn conversation(mut talk: Talk, news: News) {
    loop {
        tokio::select! {
            // An answer that overtakes what led to it is put with it all the same: turns are known by their id.
            Some((utterance, context)) = talk.utterances.next() => on(&news, &context, |c, id| c.say(id, utterance.text)),
            Some((intent, context)) = talk.intents.next() => on(&news, &context, |c, id| {
                let Some(turn) = c.turn(id) else { return };
                intent.clauses.into_iter().for_each(|clause| turn.add(Entry::Command(clause.words)));
                for words in intent.not_understood {
                    turn.add(Entry::Result(format!("not understood: {words}"), false));
                }
            }),
            Some((action, context)) = talk.actions.next() => on(&news, &context, |c, id| {
                if let Some(turn) = c.turn(id) {
                    turn.add(Entry::Result(action.text, action.ok));
                }
            }),
            Some((reply, context)) = talk.replies.next() => on(&news, &context, |c, id| {
                if let Some(turn) = c.turn(id) {
                    turn.answer = Some((reply.text, reply.ok));
                }
            }),
            else => return,
        }
    }
}

fn on(news: &News, context: &Context, what: impl FnOnce(&mut Conversation, &str)) {
    if context.conversation.is_empty() {
        return;
    }
    news.change(|shown| what(Arc::make_mut(&mut shown.conversation), &context.conversation));
}
