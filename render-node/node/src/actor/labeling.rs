//! The labeling service for a display: its state, and a person's questions to it.

use std::sync::Arc;
use std::time::Duration;

use sg_edit::Replica;
use sg_proto::keys::{self, role};
use sg_proto::labeling::{Embedding, FindRequest, ViewsRequest};
use sg_runtime::bus::{Bus, LivelinessChange, Subscription};
use sg_runtime::context::Context;
use sg_runtime::scene_replica::SceneRevision;
use sg_viewer::display::{Answer, REGION_VIEWS, RegionViews, StateWriter};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

/// Timeout of a state query.
const STATE_TIMEOUT: Duration = Duration::from_secs(5);

/// Tries while the service takes in a revision, and their period.
const SOON: u32 = 20;
const SOON_AFTER: Duration = Duration::from_millis(25);

/// Period of tries after that, and while embeddings are to come.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// Timeout of a question for units, long enough for a service's restart.
const FIND_TIMEOUT: Duration = Duration::from_secs(10);

/// Timeout of a question for views: the service draws some dozens of pictures, for a large unit in some seconds.
const VIEWS_TIMEOUT: Duration = Duration::from_secs(60);

/// Side of a view's picture, pixels.
const PIXELS: u32 = 128;

/// Follows the state of the labeling service while one is there.
pub(super) async fn follow(
    bus: Bus,
    mut embeddings: Subscription<Embedding>,
    mut liveliness: mpsc::Receiver<LivelinessChange>,
    mut revisions: watch::Receiver<SceneRevision<Replica>>,
    writer: StateWriter,
) {
    let mut instances: Vec<String> = Vec::new();
    let mut tries = 0;
    loop {
        let revision = revisions.borrow_and_update().replica.state().revision();
        let newest = if instances.is_empty() {
            None
        } else {
            bus.newest(&keys::LABELING_STATE, &Context::root().deadline_in(STATE_TIMEOUT)).await.ok()
        };
        let is_behind = newest.as_ref().is_none_or(|state| state.revision < revision);
        let is_waiting = newest.as_ref().is_some_and(|state| state.pending > 0);
        // A service that is busy keeps its last state here.
        let known = writer.newest().labeling.state.clone();
        let shown = if instances.is_empty() { None } else { newest.map(Arc::new).or_else(|| known.clone()) };
        if shown != known {
            writer.update(|state| Arc::make_mut(&mut state.labeling).state = shown);
        }
        tries = if is_behind { tries + 1 } else { 0 };
        let pause = if is_behind && tries < SOON { SOON_AFTER } else { RETRY_AFTER };
        let retries = !instances.is_empty() && (is_behind || is_waiting);
        tokio::select! {
            change = liveliness.recv() => match change {
                Some(change) if change.role == role::LABELING => {
                    instances.retain(|instance| *instance != change.instance);
                    if change.alive {
                        instances.push(change.instance);
                    }
                    tries = 0;
                }
                Some(_) => (),
                None => return,
            },
            event = embeddings.next() => if event.is_none() { return },
            changed = revisions.changed() => {
                if changed.is_err() {
                    return;
                }
                tries = 0;
            }
            () = tokio::time::sleep(pause), if retries => (),
        }
    }
}

/// Asks the service beside all other requests. A newer question supersedes the one of its kind that is under way.
pub(super) struct Questions {
    bus: Bus,
    writer: StateWriter,
    find: Option<Pending>,
    views: Option<Pending>,
}

/// A question under way.
struct Pending {
    /// Id of its request.
    id: String,
    task: JoinHandle<()>,
}

impl Questions {
    pub(super) fn new(bus: Bus, writer: StateWriter) -> Self {
        Self { bus, writer, find: None, views: None }
    }

    /// Asks which units a text means.
    pub(super) fn find(&mut self, number: u64, text: String) {
        supersede(&self.bus, self.find.take());
        let request = FindRequest { text, at_least_revision: self.revision(), regions: true, ..FindRequest::default() };
        let context = Context::root().deadline_in(FIND_TIMEOUT);
        let id = context.id.clone();
        let (bus, writer) = (self.bus.clone(), self.writer.clone());
        let task = tokio::spawn(async move {
            let reply = bus.ask(&keys::LABELING_FIND, &request, &context).await;
            let answer = Answer { number, result: reply.map_err(|fault| fault.message) };
            writer.update(|state| Arc::make_mut(&mut state.labeling).take_found(answer));
        });
        self.find = Some(Pending { id, task });
    }

    /// Asks for the best views of a unit; of the selection where the name is empty.
    pub(super) fn views(&mut self, number: u64, unit: String) {
        supersede(&self.bus, self.views.take());
        let request = ViewsRequest {
            unit,
            at_least_revision: self.revision(),
            count: REGION_VIEWS as u32,
            pixels: PIXELS,
            pictures: true,
            ..ViewsRequest::default()
        };
        let context = Context::root().deadline_in(VIEWS_TIMEOUT);
        let id = context.id.clone();
        let (bus, writer) = (self.bus.clone(), self.writer.clone());
        let task = tokio::spawn(async move {
            let reply = bus.ask(&keys::LABELING_VIEWS, &request, &context).await;
            let result = reply.map(|reply| RegionViews::of(&reply)).map_err(|fault| fault.message);
            writer.update(|state| Arc::make_mut(&mut state.labeling).take_views(Answer { number, result }));
        });
        self.views = Some(Pending { id, task });
    }

    /// Revision of the scene that a person sees.
    fn revision(&self) -> u64 {
        self.writer.newest().scene.revision()
    }
}

/// Gives a question up that has no answer yet, here and in the service.
fn supersede(bus: &Bus, pending: Option<Pending>) {
    let Some(Pending { id, task }) = pending.filter(|pending| !pending.task.is_finished()) else { return };
    task.abort();
    let bus = bus.clone();
    tokio::spawn(async move {
        // One that was answered meanwhile is unknown there, and a service that is away has none.
        let _ = bus.cancel(role::LABELING, &id).await;
    });
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use sg_edit::EditState;
    use sg_proto::labeling::{Candidate, FindReply, Outcome, State, ViewsReply};
    use sg_runtime::bus::{RetainedValue, ServerHandle, endpoint_of};
    use sg_runtime::fault::Fault;
    use sg_scene::synthetic::test_scene;
    use sg_viewer::display::{ViewPort, ViewState};

    use super::*;

    /// Longest wait for anything.
    const PATIENCE: Duration = Duration::from_secs(20);

    /// A bus with a labeling service of these tests, and the state of a display.
    struct Session {
        _folder: tempfile::TempDir,
        _router: Bus,
        endpoint: String,
        bus: Bus,
        writer: StateWriter,
        _port: ViewPort,
        first: Arc<EditState>,
    }

    impl Session {
        async fn open() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let socket = folder.path().join("bus.sock");
            let router = Bus::open_router("test", role::SUPERVISOR, &socket, None).await.unwrap();
            let endpoint = endpoint_of(&socket);
            let bus = Bus::connect("test", role::RENDER_VIEW, &endpoint).await.unwrap();
            let first = Arc::new(EditState::of_scene(&test_scene(&[("bone", 9)]), "", ""));
            let (port, backend) = ViewPort::new(ViewState::of(Arc::clone(&first)));
            let writer = backend.writer;
            Self { _folder: folder, _router: router, endpoint, bus, writer, _port: port, first }
        }

        async fn labeling(&self) -> Bus {
            Bus::connect("test", role::LABELING, &self.endpoint).await.unwrap()
        }

        /// Waits until the display's state is as it should be.
        async fn until(&self, what: &str, holds: impl Fn(&ViewState) -> bool) {
            let waiting = async {
                while !holds(&self.writer.newest()) {
                    tokio::time::sleep(Duration::from_millis(10)).await;
                }
            };
            let state = || self.writer.newest().labeling.clone();
            tokio::time::timeout(PATIENCE, waiting).await.unwrap_or_else(|_| panic!("{what}: {:?}", state()));
        }
    }

    /// Texts that a service of these tests was asked for.
    type Texts = Arc<Mutex<Vec<(String, bool)>>>;

    /// Answers each text with a unit of its name. "slow" takes a while, and "none" is refused.
    async fn serve(bus: &Bus) -> (ServerHandle, Texts) {
        let texts = Texts::default();
        let asked = Arc::clone(&texts);
        let answer = move |request: FindRequest, _: Context| {
            asked.lock().unwrap().push((request.text.clone(), request.regions));
            async move {
                match request.text.as_str() {
                    "slow" => tokio::time::sleep(Duration::from_millis(500)).await,
                    "none" => return Err(Fault::precondition("nothing is labelled")),
                    _ => (),
                }
                let unit = Candidate { unit: request.text, ..Candidate::default() };
                Ok(FindReply { outcome: Outcome::Match.into(), units: vec![unit], ..FindReply::default() })
            }
        };
        (bus.serve(&keys::LABELING_FIND, 4, answer).await.unwrap(), texts)
    }

    fn found(state: &ViewState, number: u64) -> Option<Result<String, String>> {
        let answer = state.labeling.found.as_ref().filter(|answer| answer.number == number)?;
        let unit = |reply: &FindReply| reply.units.first().map(|unit| unit.unit.clone()).unwrap_or_default();
        Some(answer.result.as_ref().map(unit).map_err(String::clone))
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_newer_question_replaces_one_that_is_under_way() {
        let session = Session::open().await;
        let service = session.labeling().await;
        let (_served, texts) = serve(&service).await;
        let mut questions = Questions::new(session.bus.clone(), session.writer.clone());
        questions.find(1, "slow".to_owned());
        let is_asked = || texts.lock().unwrap().iter().any(|(text, _)| text == "slow");
        while !is_asked() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        questions.find(2, "sac".to_owned());
        session.until("the newer question", |state| found(state, 2) == Some(Ok("sac".to_owned()))).await;
        assert_eq!(found(&session.writer.newest(), 1), None, "the answer to the older one is not shown");
        assert!(texts.lock().unwrap().iter().all(|(_, regions)| *regions), "parts without a name are wanted too");
        questions.find(3, "none".to_owned());
        let refused = Some(Err("nothing is labelled".to_owned()));
        session.until("the refusal", |state| found(state, 3) == refused).await;
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn views_come_with_their_pictures() {
        let session = Session::open().await;
        let service = session.labeling().await;
        let (sender, mut requests) = mpsc::channel(4);
        let answer = move |request: ViewsRequest, _: Context| {
            let sender = sender.clone();
            async move {
                let _ = sender.send(request).await;
                let view = sg_proto::labeling::RegionView { entropy: 0.5, ..Default::default() };
                Ok(ViewsReply { views: vec![view], ..ViewsReply::default() })
            }
        };
        let _served = service.serve(&keys::LABELING_VIEWS, 4, answer).await.unwrap();
        Questions::new(session.bus.clone(), session.writer.clone()).views(7, "sac".to_owned());
        session.until("views", |state| state.labeling.views.as_ref().is_some_and(|views| views.number == 7)).await;
        let request = requests.recv().await.unwrap();
        let expected = ("sac", REGION_VIEWS as u32, PIXELS, true);
        assert_eq!((request.unit.as_str(), request.count, request.pixels, request.pictures), expected);
        let views = session.writer.newest().labeling.views.clone().unwrap();
        assert_eq!(views.result.as_ref().unwrap().views.len(), 1);
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn the_state_is_followed_while_the_service_is_there() {
        let session = Session::open().await;
        let revision = |state: EditState| {
            let replica = Arc::new(Replica::new(state));
            SceneRevision { replica, context: Context::root() }
        };
        let (_revisions, receiver) = watch::channel(revision((*session.first).clone()));
        let embeddings = session.bus.subscribe(&keys::LABELING_EMBEDDING, role::LABELING, 16).await.unwrap();
        let liveliness = session.bus.watch_liveliness(16).await.unwrap();
        tokio::spawn(follow(session.bus.clone(), embeddings, liveliness, receiver, session.writer.clone()));
        let units = |state: &ViewState| state.labeling.state.as_ref().map(|state| state.units);

        let service = session.labeling().await;
        let waiting = State { units: 1, pending: 1, ..State::default() };
        let retained: RetainedValue<State> = service.retain(&keys::LABELING_STATE, waiting).await.unwrap();
        let token = service.declare_liveliness("labeling-1").await.unwrap();
        session.until("the first state", |state| units(state) == Some(1)).await;
        // An event says that there is something new.
        let _ = retained.set(State { units: 2, ..State::default() }, &Context::root()).await;
        service.publish(&keys::LABELING_EMBEDDING, &Embedding::default(), &Context::root()).await.unwrap();
        session.until("the state after an event", |state| units(state) == Some(2)).await;
        drop(token);
        session.until("the end of the service", |state| state.labeling.state.is_none()).await;
    }
}
