//! Keeps a display's state up to date: the scene, the selection, clusters, the conversation, a
//! tour, and the available services.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use sg_edit::Replica;
use sg_proto::keys::{self, role};
use sg_proto::language::{ActionResult, Intent, Reply, Utterance};
use sg_proto::launch::OpenFailed;
use sg_proto::scene::State;
use sg_proto::selection::Preview;
use sg_proto::speech;
use sg_runtime::blobs::Blobs;
use sg_runtime::bus::{Bus, BusError, Subscription};
use sg_runtime::context::Context;
use sg_runtime::process::Host;
use sg_runtime::scene_replica::{SceneReplica, SceneRevision};
use sg_viewer::display::{Conversation, Entry, ServiceAvailability, StateWriter, WalkCapabilities};
use tokio::sync::watch;

use super::clusters::ClusterLabels;
use super::{labeling, preview, tour};

/// Most waiting messages of a conversation.
const QUEUE: usize = 64;

/// Timeout of a state query.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Retry period for an available service without a known state.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// Tries of a service that takes in a revision later, and their period.
const SOON: u32 = 20;
const SOON_AFTER: Duration = Duration::from_millis(25);
/// First pause before a late or missing answer about the steps of undo is asked for again.
const FIRST_RETRY: Duration = Duration::from_millis(50);

/// Begins to follow everything.
pub(super) async fn follow(host: &Host, replica: &SceneReplica<Replica>, writer: &StateWriter) -> Result<(), BusError> {
    let bus = host.bus();
    let previews = preview::follow(bus).await?;
    let asked = bus.clone();
    let ask = move || {
        let bus = asked.clone();
        async move { bus.newest(&keys::SCENE_STATE, &Context::root().deadline_in(TIMEOUT)).await.ok() }
    };
    tokio::spawn(history(ask, replica.receiver(), writer.clone()));
    tokio::spawn(scene(replica.receiver(), previews, writer.clone()));
    tokio::spawn(answers(bus.clone(), replica.receiver(), writer.clone()));
    let liveliness = bus.watch_liveliness(QUEUE).await?;
    tokio::spawn(services((bus.clone(), host.blobs().clone()), liveliness, replica.receiver(), writer.clone()));
    let feeds = ConversationFeeds {
        utterances: bus.subscribe(&keys::UTTERANCE, role::AGENT_CORE, QUEUE).await?,
        intents: bus.subscribe(&keys::INTENT, role::AGENT_INTENT, QUEUE).await?,
        actions: bus.subscribe(&keys::ACTION, role::AGENT_FUNCTION, QUEUE).await?,
        replies: bus.subscribe(&keys::REPLY, role::AGENT_CORE, QUEUE).await?,
    };
    tokio::spawn(conversation(feeds, writer.clone()));
    let speech = bus.subscribe(&keys::SPEECH_CHANGE, role::SPEECH, QUEUE).await?;
    tokio::spawn(self::speech(bus.clone(), speech, bus.watch_liveliness(QUEUE).await?, writer.clone()));
    let embeddings = bus.subscribe(&keys::LABELING_EMBEDDING, role::LABELING, QUEUE).await?;
    let liveliness = bus.watch_liveliness(QUEUE).await?;
    tokio::spawn(labeling::follow(bus.clone(), embeddings, liveliness, replica.receiver(), writer.clone()));
    let replies = bus.subscribe(&keys::REPLY, role::AGENT_CORE, QUEUE).await?;
    tokio::spawn(tour::follow(bus.clone(), replies, bus.watch_liveliness(QUEUE).await?, writer.clone()));
    tokio::spawn(opened(bus.subscribe(&keys::OPEN_FAILED, role::SUPERVISOR, QUEUE).await?, writer.clone()));
    Ok(())
}

/// The scene and its selection.
async fn scene(
    mut revisions: watch::Receiver<SceneRevision<Replica>>,
    mut previews: watch::Receiver<Option<Preview>>,
    writer: StateWriter,
) {
    loop {
        let newest = Arc::clone(&revisions.borrow_and_update().replica);
        let selected = preview::highlighted(&newest, previews.borrow_and_update().as_ref());
        let now = Arc::clone(newest.state());
        let answers = preview::answers(&newest, previews.borrow().as_ref());
        writer.update(|state| {
            if answers.is_some() {
                state.answers = answers;
            }
            state.uncommitted = !Arc::ptr_eq(&selected, now.selection().mask());
            state.selected = selected;
            state.trial_tuning = None;
            state.scene = now;
        });
        tokio::select! {
            changed = revisions.changed() => if changed.is_err() { return },
            changed = previews.changed() => if changed.is_err() { return },
        }
    }
}

/// The undo and redo steps, published with the scene's state alone. It runs as a separate task, so that a silent scene does
/// not delay a preview.
async fn history<A: Future<Output = Option<State>>>(
    ask: impl Fn() -> A,
    mut revisions: watch::Receiver<SceneRevision<Replica>>,
    writer: StateWriter,
) {
    let mut pause = FIRST_RETRY;
    loop {
        let revision = revisions.borrow_and_update().replica.state().revision();
        let newest = ask().await.filter(|newest| newest.revision >= revision);
        let is_new = newest.is_some();
        if let Some(State { revision, undo, redo, .. }) = newest {
            writer.update(|state| (state.steps_at, state.undo, state.redo) = (revision, undo.into(), redo.into()));
        }
        pause = if is_new { FIRST_RETRY } else { RETRY_AFTER.min(2 * pause) };
        // Without an answer, or with an older one, no step is shown until another answer comes.
        let changed = if is_new {
            revisions.changed().await
        } else {
            tokio::time::timeout(pause, revisions.changed()).await.unwrap_or(Ok(()))
        };
        if changed.is_err() {
            return;
        }
    }
}

/// The answers to the walk strokes of the selection. A preview has those of a stroke earlier.
async fn answers(bus: Bus, mut revisions: watch::Receiver<SceneRevision<Replica>>, writer: StateWriter) {
    let mut tries = 0;
    loop {
        let revision = revisions.borrow_and_update().replica.state().revision();
        let newest = bus.newest(&keys::SELECTION_STATE, &Context::root().deadline_in(TIMEOUT)).await;
        let newest = newest.ok().filter(|newest| newest.revision >= revision);
        tries = if newest.is_some() { 0 } else { tries + 1 };
        let changed = match newest {
            Some(newest) => {
                let answers = newest.answers.map(Arc::new);
                writer.update(|state| {
                    if state.answers != answers {
                        state.answers = answers;
                    }
                });
                revisions.changed().await
            }
            // The service takes in a revision after this process, or it is away.
            None => {
                let pause = if tries < SOON { SOON_AFTER } else { RETRY_AFTER };
                tokio::time::timeout(pause, revisions.changed()).await.unwrap_or(Ok(()))
            }
        };
        if changed.is_err() {
            return;
        }
    }
}

/// The available services, and the clusters once the selection service answers.
async fn services(
    (bus, blobs): (Bus, Blobs),
    mut liveliness: tokio::sync::mpsc::Receiver<sg_runtime::bus::LivelinessChange>,
    mut revisions: watch::Receiver<SceneRevision<Replica>>,
    writer: StateWriter,
) {
    let mut instances: HashMap<String, Vec<String>> = HashMap::new();
    let mut clusters = ClusterLabels::default();
    loop {
        let gaussians = revisions.borrow_and_update().replica.state().count();
        let is_there = |role: &str| instances.get(role).is_some_and(|all| !all.is_empty());
        let services = ServiceAvailability {
            scene: is_there(role::SCENE),
            selection: is_there(role::SELECTION),
            agents: is_there(role::AGENT_CORE) && is_there(role::AGENT_INTENT) && is_there(role::AGENT_FUNCTION),
            labeling: is_there(role::LABELING),
        };
        writer.update(|state| {
            state.services = services;
            state.walk_capabilities = state.walk_capabilities.filter(|_| services.selection);
        });
        let mut retry = false;
        if services.selection {
            let context = Context::root().deadline_in(TIMEOUT);
            match clusters.newest(&bus, &blobs, gaussians, &context).await {
                Ok(newest) => {
                    let told = bus.newest(&keys::SELECTION_STATE, &context.next()).await;
                    retry = told.is_err();
                    writer.update(|state| {
                        state.clusters = Some(newest);
                        state.walk_capabilities =
                            told.ok().map(|t| WalkCapabilities { tuning: t.tuning, most_proposals: t.most_proposals });
                    });
                }
                Err(fault) => {
                    tracing::warn!(%fault, "the clusters are not known yet");
                    retry = true;
                }
            }
        }
        let others = async {
            // Duplicated Gaussians have Super-Gaussians too.
            revisions.wait_for(|newest| newest.replica.state().count() != gaussians).await.is_ok()
        };
        let again = async {
            if retry {
                tokio::time::sleep(RETRY_AFTER).await;
            } else {
                std::future::pending::<()>().await;
            }
        };
        let next = tokio::select! {
            next = liveliness.recv() => next,
            is_there = others => if is_there { continue } else { return },
            () = again => continue,
        };
        let Some(seen) = next else { return };
        let all = instances.entry(seen.role).or_default();
        all.retain(|i| *i != seen.instance);
        if seen.alive {
            all.push(seen.instance);
        }
    }
}

/// The state of the speech service while one is there.
async fn speech(
    bus: Bus,
    mut changes: Subscription<speech::State>,
    mut liveliness: tokio::sync::mpsc::Receiver<sg_runtime::bus::LivelinessChange>,
    writer: StateWriter,
) {
    let mut instances = Vec::new();
    loop {
        let newest = tokio::select! {
            change = changes.next() => match change {
                Some((state, _)) => Some(state),
                None => return,
            },
            change = liveliness.recv() => match change {
                Some(change) if change.role == role::SPEECH => {
                    instances.retain(|instance| *instance != change.instance);
                    if change.alive {
                        instances.push(change.instance);
                    }
                    if instances.is_empty() {
                        None
                    } else {
                        bus.newest(&keys::SPEECH_STATE, &Context::root().deadline_in(TIMEOUT)).await.ok()
                    }
                }
                Some(_) => continue,
                None => return,
            },
        };
        writer.update(|state| state.speech = newest.map(Arc::new));
    }
}

/// Files that failed to open.
async fn opened(mut failed: Subscription<OpenFailed>, writer: StateWriter) {
    while let Some((OpenFailed { path, session, reason }, _)) = failed.next().await {
        writer.notice(format!("{path} (session {session}): {reason}"), true);
    }
}

/// The stages of a conversation.
struct ConversationFeeds {
    utterances: Subscription<Utterance>,
    intents: Subscription<Intent>,
    actions: Subscription<ActionResult>,
    replies: Subscription<Reply>,
}

/// The conversation of all users.
async fn conversation(mut feeds: ConversationFeeds, writer: StateWriter) {
    loop {
        tokio::select! {
            // An answer may arrive before its cause. Both still join one turn, by its id.
            Some((utterance, context)) = feeds.utterances.next() => on(&writer, &context, |c, id| c.say(id, utterance.text)),
            Some((intent, context)) = feeds.intents.next() => on(&writer, &context, |c, id| {
                let Some(turn) = c.turn(id) else { return };
                intent.clauses.into_iter().for_each(|clause| turn.add(Entry::Command(clause.words)));
                // An answer says itself what is missing.
                let unread = if intent.answer.is_empty() { intent.not_understood } else { Vec::new() };
                for words in unread {
                    turn.add(Entry::Result(format!("not understood: {words}"), false));
                }
            }),
            Some((action, context)) = feeds.actions.next() => on(&writer, &context, |c, id| {
                if let Some(turn) = c.turn(id) {
                    turn.add(Entry::Result(action.text, action.ok));
                }
            }),
            Some((reply, context)) = feeds.replies.next() => on(&writer, &context, |c, id| {
                if let Some(turn) = c.turn(id) {
                    turn.answer = Some((reply.text, reply.ok));
                }
            }),
            else => return,
        }
    }
}

fn on(writer: &StateWriter, context: &Context, what: impl FnOnce(&mut Conversation, &str)) {
    if context.conversation.is_empty() {
        return;
    }
    writer.update(|state| what(Arc::make_mut(&mut state.conversation), &context.conversation));
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::Mutex;

    use sg_edit::{EditState, Editor};
    use sg_proto::replica::Replica as _;
    use sg_proto::scene::command::Action;
    use sg_proto::scene::{Color, Command, SetColor, Target};
    use sg_scene::synthetic::test_scene;
    use sg_viewer::display::{ViewPort, ViewState};

    use super::scene as scene_task;
    use super::*;

    fn paint(editor: &mut Editor, name: &str, red: f32) -> sg_proto::scene::Event {
        let target = Some(Target { units: vec![name.to_owned()], ..Target::default() });
        let action = Action::SetColor(SetColor { target, color: Some(Color { red, green: 0.0, blue: 0.0 }) });
        let command = Command { id: format!("{name} {red}"), expected_revision: 0, action: Some(action) };
        editor.apply(&command).unwrap().event
    }

    async fn until(writer: &StateWriter, holds: impl Fn(&ViewState) -> bool) {
        let waited = async {
            while !holds(&writer.newest()) {
                tokio::time::sleep(Duration::from_millis(2)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(10), waited).await.unwrap();
    }

    /// An answer that came late, of an earlier revision, once stayed on the undo button until the next change.
    #[tokio::test]
    async fn no_step_of_an_earlier_revision_is_shown_however_late_the_answer() {
        let scene = Arc::new(test_scene(&[("bone", 5), ("skin", 7)]));
        let opened = EditState::of_scene(&scene, "scene.toml", "hash");
        let mut editor = Editor::new(Arc::clone(&scene), opened.clone());
        let mut replica = Replica::new(opened);
        let first = paint(&mut editor, "bone", 1.0);
        replica.apply(&first).unwrap();
        let of = |replica: &Replica| SceneRevision { replica: Arc::new(replica.clone()), context: Context::root() };
        let (sender, revisions) = watch::channel(of(&replica));
        let (_port, backend) = ViewPort::new(ViewState::of(Arc::clone(replica.state())));
        let writer = backend.writer;
        let told = |editor: &Editor| Some(editor.message(false));
        let answers = Arc::new(Mutex::new(VecDeque::from([told(&editor)])));
        let asked = Arc::clone(&answers);
        // No answer is left: none comes.
        let ask = move || {
            let answer = asked.lock().unwrap().pop_front().flatten();
            async move { answer }
        };
        let (_previews, no_previews) = watch::channel(None);
        tokio::spawn(history(ask, revisions.clone(), writer.clone()));
        tokio::spawn(scene_task(revisions, no_previews, writer.clone()));
        until(&writer, |state| state.undo_step().is_some_and(|step| step == "coloured bone #ff0000")).await;

        // The answer about the next revision is of the one before, then none comes, then one of two revisions later.
        let late = told(&editor);
        let second = paint(&mut editor, "skin", 0.5);
        let third = paint(&mut editor, "bone", 0.25);
        answers.lock().unwrap().extend([late, None]);
        replica.apply(&second).unwrap();
        sender.send_replace(of(&replica));
        until(&writer, |state| state.scene.revision() == 2).await;
        for _ in 0..20 {
            let state = writer.newest();
            assert_eq!((state.undo_step(), state.knows_steps()), (None, false), "{:?}", state.undo);
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        answers.lock().unwrap().push_back(told(&editor));
        until(&writer, |state| state.undo_step().is_some_and(|step| step == "coloured bone #400000")).await;
        // The missed revision comes after its steps: they stay.
        replica.apply(&third).unwrap();
        sender.send_replace(of(&replica));
        until(&writer, |state| state.scene.revision() == 3).await;
        assert_eq!(writer.newest().undo_step().map(String::as_str), Some("coloured bone #400000"));
    }
}
