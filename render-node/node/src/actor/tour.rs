//! The tour of the agents for a display.

use std::sync::Arc;
use std::time::Duration;

use sg_proto::keys::{self, role};
use sg_proto::language::Reply;
use sg_runtime::bus::{Bus, LivelinessChange, Subscription};
use sg_runtime::context::Context;
use sg_viewer::display::StateWriter;
use tokio::sync::mpsc;

/// Timeout of a state query.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Period of queries while a tour is under way, or while the state is unknown. A tour also goes on, waits and ends by itself.
const PERIOD: Duration = Duration::from_millis(250);

/// Follows the tour of the core agent while one is there. A tour begins before the reply to the sentence that asked for it.
pub(super) async fn follow(
    bus: Bus,
    mut replies: Subscription<Reply>,
    mut liveliness: mpsc::Receiver<LivelinessChange>,
    writer: StateWriter,
) {
    let mut instances: Vec<String> = Vec::new();
    loop {
        let newest = if instances.is_empty() {
            None
        } else {
            bus.newest(&keys::CORE_STATE, &Context::root().deadline_in(TIMEOUT)).await.ok()
        };
        let is_unknown = !instances.is_empty() && newest.is_none();
        let known = writer.newest().tour.clone();
        // An agent that is busy keeps its last tour here.
        let tour = if is_unknown { known.clone() } else { newest.and_then(|state| state.tour).map(Arc::new) };
        let retries = is_unknown || tour.is_some();
        if tour != known {
            writer.update(|state| state.tour = tour);
        }
        tokio::select! {
            change = liveliness.recv() => match change {
                Some(change) if change.role == role::AGENT_CORE => {
                    instances.retain(|instance| *instance != change.instance);
                    if change.alive {
                        instances.push(change.instance);
                    }
                }
                Some(_) => (),
                None => return,
            },
            reply = replies.next() => if reply.is_none() { return },
            () = tokio::time::sleep(PERIOD), if retries => (),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use sg_edit::EditState;
    use sg_proto::language::{AgentState, Tour, TourStep, Utterance};
    use sg_runtime::bus::{RetainedValue, endpoint_of};
    use sg_scene::synthetic::test_scene;
    use sg_viewer::display::{Backend, Request, ViewPort, ViewState, tour_sentence};

    use super::super::request_executor;
    use super::*;

    /// Longest wait for anything.
    const PATIENCE: Duration = Duration::from_secs(20);

    /// A bus with a core agent of these tests, and a display.
    struct Session {
        _folder: tempfile::TempDir,
        _router: Bus,
        core: Bus,
        bus: Bus,
        port: ViewPort,
        backend: Backend,
    }

    async fn open() -> Session {
        let folder = tempfile::tempdir().unwrap();
        let socket = folder.path().join("bus.sock");
        let router = Bus::open_router("test", role::SUPERVISOR, &socket, None).await.unwrap();
        let endpoint = endpoint_of(&socket);
        let core = Bus::connect("test", role::AGENT_CORE, &endpoint).await.unwrap();
        let bus = Bus::connect("test", role::RENDER_VIEW, &endpoint).await.unwrap();
        let scene = Arc::new(EditState::of_scene(&test_scene(&[("bone", 9)]), "", ""));
        let (port, backend) = ViewPort::new(ViewState::of(scene));
        Session { _folder: folder, _router: router, core, bus, port, backend }
    }

    async fn until(what: &str, holds: impl Fn() -> bool) {
        let waiting = async {
            while !holds() {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        tokio::time::timeout(PATIENCE, waiting).await.unwrap_or_else(|_| panic!("{what}"));
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_tour_is_followed_from_its_begin_to_its_end() {
        let Session { _folder, _router, core, bus, port: _port, backend } = open().await;
        let writer = backend.writer;
        let replies = bus.subscribe(&keys::REPLY, role::AGENT_CORE, 16).await.unwrap();
        let liveliness = bus.watch_liveliness(16).await.unwrap();
        tokio::spawn(follow(bus.clone(), replies, liveliness, writer.clone()));
        let state: RetainedValue<AgentState> = core.retain(&keys::CORE_STATE, AgentState::default()).await.unwrap();
        let token = core.declare_liveliness("agent-core-1").await.unwrap();
        let set = async |tour: Option<Tour>| {
            let _ = state.set(AgentState { tour, ..AgentState::default() }, &Context::root()).await;
        };
        let shown = || writer.newest().tour.as_deref().map(|tour| (tour.at, tour.paused));
        let tour = |at, paused| Some(Tour { stops: vec!["bone".to_owned(), "skin".to_owned()], at, paused });
        set(tour(0, false)).await;
        // The reply to a sentence says that there is something new. It is repeated, since the display may not know the agent yet.
        let begun = async {
            while shown() != Some((0, false)) {
                core.publish(&keys::REPLY, &Reply::default(), &Context::root()).await.unwrap();
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        tokio::time::timeout(PATIENCE, begun).await.unwrap();
        // Nobody says anything when it goes on by itself, waits, or ends.
        set(tour(1, true)).await;
        until("the next stop", || shown() == Some((1, true))).await;
        set(None).await;
        until("the end of the tour", || shown().is_none()).await;
        // A tour ends with its agent.
        set(tour(1, false)).await;
        core.publish(&keys::REPLY, &Reply::default(), &Context::root()).await.unwrap();
        until("another tour", || shown() == Some((1, false))).await;
        drop(token);
        until("the end of the agent", || shown().is_none()).await;
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_change_of_a_tour_is_said_to_the_agents() {
        let Session { _folder, _router, core, bus, mut port, backend } = open().await;
        let said: Arc<Mutex<Vec<String>>> = Arc::default();
        let heard = Arc::clone(&said);
        let answer = move |utterance: Utterance, _: Context| {
            heard.lock().unwrap().push(utterance.text);
            async { Ok(Reply::default()) }
        };
        let _served = core.serve(&keys::UTTER, 4, answer).await.unwrap();
        request_executor::run(bus, backend.requests, backend.writer).unwrap();
        for step in [TourStep::Start, TourStep::Next, TourStep::End] {
            let expected = tour_sentence(step);
            assert!(port.send(Request::Tour(step)));
            until(expected, || said.lock().unwrap().last().is_some_and(|text| text == expected)).await;
        }
        assert_eq!(said.lock().unwrap().len(), 3);
    }
}
