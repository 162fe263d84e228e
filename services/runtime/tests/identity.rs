//! Nodes over TLS: each is itself, whatever its messages say.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test's helpers fail the test")]

#[path = "fixture/nodes.rs"]
mod nodes;

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use nodes::{SESSION, Session, view};
use prost::Message as _;
use sg_proto::bus::{
    CancelReply, Code, ContentReply, ContentRequest, Envelope, Error as WireError, Health, StatusRequest,
};
use sg_proto::keys::{self, ANY, Kind, Row, role, rows};
use sg_proto::limits::NODE_OPEN_REQUESTS;
use sg_proto::render::{Frame, State as ViewState};
use sg_proto::scene::{Command, CommandResult, Event};
use sg_runtime::blobs::{Blobs, StoredFile};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use zenoh::query::ReplyKeyExpr;

/// An epoch that no later one exceeds.
const LAST_EPOCH: u64 = 1 << 63;

fn soon() -> Context {
    Context::root().deadline_in(Duration::from_secs(5))
}

fn shortly() -> Context {
    Context::root().deadline_in(Duration::from_millis(500))
}

/// Waits for the next message.
async fn heard<M>(events: &mut sg_runtime::bus::Subscription<M>) -> Option<(M, Context)>
where
    M: prost::Message + prost::Name + Default + Clone + 'static,
{
    tokio::time::timeout(Duration::from_secs(5), events.next()).await.ok().flatten()
}

async fn serve_scene(bus: &Bus) -> sg_runtime::bus::ServerHandle {
    let apply = |command: Command, context: Context| async move {
        if command.id == "slow" {
            tokio::time::sleep(Duration::from_secs(2)).await;
        }
        let node = context.identity.map_or("home".to_owned(), |i| format!("{} of {}", i.instance, i.node));
        Ok(CommandResult { id: command.id, summary: node, ..CommandResult::default() })
    };
    bus.serve(&keys::SCENE_APPLY, 128, apply).await.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_serve_ask_and_publish_as_themselves() {
    let session = Session::open().await;
    let mut alive = session.router.watch_liveliness(16).await.unwrap();
    let away = session.away("gpu1", role::RENDER_VIEW, "view.1", 3).await;
    let cli = session.home(role::CLI).await;
    let scene = session.home(role::SCENE).await;
    let _scene = serve_scene(&scene).await;

    // Requests of a node carry its identity, also to another node.
    let applied = away.ask(&keys::SCENE_APPLY, &Command { id: "1".into(), ..Command::default() }, &soon()).await;
    assert_eq!(applied.unwrap().summary, "view.1 of gpu1");
    let peer = session.away("gpu2", role::SELECTION, "selection.1", 4).await;
    let status = |_, context: Context| {
        std::future::ready(Ok(Health { instance: context.identity.unwrap().node, ..Health::default() }))
    };
    let _status = peer.serve(&keys::STATUS, 4, status).await.unwrap();
    let health = away.ask_role(&keys::STATUS, role::SELECTION, &StatusRequest {}, &soon()).await;
    assert_eq!(health.unwrap().instance, "gpu1");

    // So do its replies and errors.
    let content = |request: ContentRequest, _| {
        std::future::ready(match request.offset {
            0 => Ok(ContentReply { data: b"part".to_vec(), total: 4 }),
            _ => Err(Fault::not_found("no such part")),
        })
    };
    let _content = away.serve(&keys::VIEW_CONTENT, 4, content).await.unwrap();
    let (part, sender) = cli.ask_identified(&keys::VIEW_CONTENT, &ContentRequest::default(), &soon()).await.unwrap();
    assert_eq!((part.total, sender), (4, Some(view())));
    let missing = ContentRequest { offset: 9, ..ContentRequest::default() };
    let fault = cli.ask(&keys::VIEW_CONTENT, &missing, &soon()).await.unwrap_err();
    assert_eq!((fault.code, fault.message.as_str()), (Code::NotFound, "no such part"));

    // So do streams, retained values and tokens.
    let mut frames = cli.subscribe(&keys::VIEW_FRAME, role::RENDER_VIEW, 8).await.unwrap();
    let mut at_peer = peer.subscribe(&keys::VIEW_FRAME, role::RENDER_VIEW, 8).await.unwrap();
    let mut all = cli.watch_all(8).await.unwrap();
    tokio::time::sleep(Duration::from_millis(300)).await;
    away.publish(&keys::VIEW_FRAME, &Frame { revision: 7, ..Frame::default() }, &soon()).await.unwrap();
    for events in [&mut frames, &mut at_peer] {
        let (frame, context) = heard(events).await.unwrap();
        assert_eq!((frame.revision, context.identity), (7, Some(view())));
    }
    let watched = all.next().await.unwrap();
    assert_eq!(watched.key, keys::key(SESSION, role::RENDER_VIEW, "event/frame"), "people see the usual key");
    let state = away.retain(&keys::VIEW_STATE, ViewState::default()).await.unwrap();
    let (_, sender) = cli.newest_identified(&keys::VIEW_STATE, &soon()).await.unwrap();
    assert_eq!(sender, Some(view()));
    assert!(peer.newest(&keys::VIEW_STATE, &soon()).await.is_ok());
    let token = away.declare_liveliness("view.1").await.unwrap();
    let came = tokio::time::timeout(Duration::from_secs(2), alive.recv()).await.unwrap().unwrap();
    assert_eq!((came.instance.as_str(), came.identity, came.alive), ("view.1", Some(view()), true));
    drop((state, token));
}

/// Whether a request of a process finds an answer before long.
async fn is_answered(bus: &Bus, id: &str) -> bool {
    let began = std::time::Instant::now();
    while began.elapsed() < Duration::from_secs(6) {
        let command = Command { id: id.into(), ..Command::default() };
        if bus.ask(&keys::SCENE_APPLY, &command, &shortly()).await.is_ok() {
            return true;
        }
    }
    false
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_excluded_machine_is_cut_off_and_others_go_on() {
    let mut session = Session::open().await;
    let scene = session.home(role::SCENE).await;
    let _scene = serve_scene(&scene).await;
    let excluded = session.away("gpu1", role::RENDER_VIEW, "view.1", 3).await;
    let other = session.away("gpu2", role::SELECTION, "selection.1", 4).await;
    let mut events = excluded.subscribe(&keys::SCENE_EVENT, role::SCENE, 8).await.unwrap();
    let mut at_other = other.subscribe(&keys::SCENE_EVENT, role::SCENE, 8).await.unwrap();
    assert!(is_answered(&excluded, "1").await && is_answered(&other, "1").await);

    session.exclude("gpu1").await;
    assert!(is_answered(&other, "2").await, "the other machine connects again by itself");
    // The connection is there again, but nothing passes: neither requests nor streams.
    assert!(!is_answered(&excluded, "2").await);
    scene.publish(&keys::SCENE_EVENT, &Event { revision: 7, ..Event::default() }, &soon()).await.unwrap();
    assert_eq!(heard(&mut at_other).await.unwrap().0.revision, 7);
    assert!(tokio::time::timeout(Duration::from_millis(500), events.next()).await.is_err());
    // Neither does a new connection help.
    let again = session.away("gpu1", role::RENDER_VIEW, "view.2", 5).await;
    assert!(!is_answered(&again, "3").await);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_certificate_on_a_new_key_is_accepted_beside_the_old_one() {
    let session = Session::open().await;
    let scene = session.home(role::SCENE).await;
    let _scene = serve_scene(&scene).await;
    let old = session.away("gpu1", role::RENDER_VIEW, "view.1", 3).await;
    session.rotate("gpu1");
    let new = session.away("gpu1", role::RENDER_VIEW, "view.2", 3).await;
    assert!(is_answered(&new, "1").await && is_answered(&old, "2").await);
}

/// What a hostile program on gpu1 tries as sender and as address, and whether the contract grants it.
struct Forgery {
    sender: &'static str,
    segment: String,
    row: Row,
}

impl Forgery {
    fn all() -> Vec<Self> {
        let senders = [
            "",
            "@node/gpu1/render-view/view.1/",
            "@node/gpu1/node/node:gpu1/",
            "@node/gpu1/render-view/scene.1/",
            "@node/gpu1/render-view/viewer.1/",
            "@node/gpu1/scene/scene.1/",
            "@node/gpu1/scene/view.1/",
            "@node/gpu1/selection/selection.1/",
            "@node/gpu1/supervisor/view.1/",
            "@node/gpu1/cli/view.1/",
            "@node/gpu1/node/node:gpu2/",
            "@node/gpu2/selection/selection.1/",
            "@node/gpu2/render-view/view.1/",
            "@node/gpu2/node/node:gpu2/",
            "@node/gpu3/scene/scene.1/",
        ];
        let instances = ["view.1", "viewer.1", "scene.1", "selection.1", "node:gpu1", "node:gpu2"];
        let segments: Vec<String> =
            role::ALL.iter().map(|r| (*r).to_owned()).chain(instances.map(keys::instance)).collect();
        let mut all = Vec::new();
        for row in rows() {
            for sender in senders {
                all.extend(segments.iter().map(|s| Self { sender, segment: s.clone(), row: row.clone() }));
            }
        }
        all
    }

    fn key(&self) -> String {
        format!("sg/{SESSION}/{}{}/{}", self.sender, self.segment, self.row.name)
    }

    fn may_put(&self) -> bool {
        let Self { sender, segment, row } = self;
        let published = !matches!(row.kind, Kind::Request { .. });
        published
            && match *sender {
                "@node/gpu1/render-view/view.1/" => {
                    row.belongs_to(role::RENDER_VIEW) && [role::RENDER_VIEW, "@instance/view.1"].contains(&&**segment)
                }
                "@node/gpu1/node/node:gpu1/" => row.role == role::NODE && segment == "@instance/node:gpu1",
                _ => false,
            }
    }

    fn may_query(&self) -> bool {
        let Self { sender, segment, row } = self;
        let as_role = match *sender {
            "@node/gpu1/render-view/view.1/" => role::RENDER_VIEW,
            "@node/gpu1/node/node:gpu1/" => role::NODE,
            _ => return false,
        };
        let addressed = row.role == *segment || (row.role == ANY && !segment.starts_with('@'));
        addressed && (matches!(row.kind, Kind::Retained { .. }) || (!row.local_only && row.may_ask(as_role)))
    }
}

/// Everything that arrived at home: kind and key.
type Arrived = Arc<Mutex<BTreeSet<(&'static str, String)>>>;

/// Listens at home to every key that a message could have.
async fn listen(home: &zenoh::Session) -> Arrived {
    let arrived = Arrived::default();
    for tail in ["", "@node/*/*/*/"] {
        for rest in ["**", "@instance/**", "@alive/**", "@node/**"] {
            let pattern = format!("sg/{SESSION}/{tail}{rest}");
            let note = |kind: &'static str| {
                let arrived = Arc::clone(&arrived);
                move |key: String| {
                    arrived.lock().unwrap().insert((kind, key));
                }
            };
            let (put, deleted, asked, token) = (note("put"), note("delete"), note("query"), note("token"));
            let receive = move |sample: zenoh::sample::Sample| match sample.kind() {
                zenoh::sample::SampleKind::Put => put(sample.key_expr().to_string()),
                zenoh::sample::SampleKind::Delete => deleted(sample.key_expr().to_string()),
            };
            home.declare_subscriber(&pattern).callback(receive).background().await.unwrap();
            let answer = move |query: zenoh::query::Query| asked(query.key_expr().to_string());
            home.declare_queryable(&pattern).callback(answer).background().await.unwrap();
            let seen = move |sample: zenoh::sample::Sample| token(sample.key_expr().to_string());
            home.liveliness().declare_subscriber(&pattern).callback(seen).background().await.unwrap();
        }
    }
    tokio::time::sleep(Duration::from_millis(300)).await;
    arrived
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_row_can_be_forged_in_its_key() {
    let session = Session::open().await;
    let home = session.raw_home().await;
    let arrived = listen(&home).await;
    let hostile = session.raw_away("gpu1").await;
    let forgeries = Forgery::all();
    let mut granted = BTreeSet::new();
    for (number, forgery) in forgeries.iter().enumerate() {
        // A flood would close the connection, and lose what shall be refused.
        if number % 50 == 0 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        let key = forgery.key();
        let blocking = zenoh::qos::CongestionControl::Block;
        hostile.put(&key, "forged").congestion_control(blocking).await.unwrap();
        hostile.delete(&key).congestion_control(blocking).await.unwrap();
        let asking = hostile.get(&key).payload("forged").timeout(Duration::from_millis(200)).callback(|_| ());
        asking.congestion_control(blocking).await.unwrap();
        granted.extend(forgery.may_put().then(|| ("put", key.clone())));
        granted.extend(forgery.may_query().then(|| ("query", key.clone())));
    }
    let mut tokens = Vec::new();
    for sender in Forgery::all().iter().map(|f| f.sender).collect::<BTreeSet<_>>() {
        for token in ["scene/scene.1", "render-view/view.1", "render-view/viewer.1", "node/node:gpu1"] {
            let key = format!("sg/{SESSION}/{sender}@alive/{token}");
            tokens.push(hostile.liveliness().declare_token(&key).await.unwrap());
            let own = sender == "@node/gpu1/render-view/view.1/" && token == "render-view/view.1";
            granted.extend(own.then_some(("token", key)));
        }
    }
    // Wildcards stand for the keys of others.
    for key in ["**", "*/event/health", "@node/**", "@node/*/scene/scene.1/scene/event/change", "@node/gpu1/**"] {
        let key = format!("sg/{SESSION}/{key}");
        hostile.put(&key, "forged").await.unwrap();
        hostile.get(&key).timeout(Duration::from_millis(200)).callback(|_| ()).await.unwrap();
    }
    tokio::time::sleep(Duration::from_secs(1)).await;
    let arrived = arrived.lock().unwrap().clone();
    assert_eq!(arrived.difference(&granted).collect::<Vec<_>>(), Vec::<&(_, String)>::new(), "forged");
    assert_eq!(granted.difference(&arrived).collect::<Vec<_>>(), Vec::<&(_, String)>::new(), "lost");
    assert!(forgeries.len() > 5000 && granted.len() > 20, "{} of {}", granted.len(), forgeries.len());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_row_of_another_role_can_be_answered() {
    let session = Session::open().await;
    let hostile = session.raw_away("gpu1").await;
    let home = session.raw_home().await;
    let reached = Arc::new(Mutex::new(BTreeSet::new()));
    let mut served = Vec::new();
    for forgery in Forgery::all() {
        let note = Arc::clone(&reached);
        let answer = move |query: zenoh::query::Query| {
            note.lock().unwrap().insert(query.key_expr().to_string());
        };
        served.push(hostile.declare_queryable(forgery.key()).callback(answer).await.unwrap());
    }
    let wild = Arc::clone(&reached);
    let answer = move |query: zenoh::query::Query| {
        wild.lock().unwrap().insert(query.key_expr().to_string());
    };
    let _wild = hostile.declare_queryable(format!("sg/{SESSION}/**")).callback(answer).await.unwrap();
    tokio::time::sleep(Duration::from_millis(500)).await;
    let mut granted = BTreeSet::new();
    for forgery in Forgery::all() {
        let Forgery { sender, segment, row } = &forgery;
        let own_role =
            row.belongs_to(role::RENDER_VIEW) && [role::RENDER_VIEW, "@instance/view.1"].contains(&segment.as_str());
        let own_node = row.role == role::NODE && segment == "@instance/node:gpu1";
        let is_stream = matches!(row.kind, Kind::Stream { .. });
        if !is_stream && (own_role || own_node) {
            granted.insert(forgery.key());
        }
        // Home asks under its own keys, and so do other nodes under theirs.
        if sender.is_empty() || sender.starts_with("@node/gpu2/selection") {
            home.get(forgery.key()).timeout(Duration::from_millis(200)).callback(|_| ()).await.unwrap();
        }
    }
    tokio::time::sleep(Duration::from_secs(1)).await;
    let reached = reached.lock().unwrap().clone();
    assert_eq!(reached.difference(&granted).collect::<Vec<_>>(), Vec::<&String>::new());
    assert!(reached.len() > 10, "{reached:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn envelopes_cannot_name_another_sender_or_poison_its_epoch() {
    let session = Session::open().await;
    let scene = session.home_instance(role::SCENE, "scene.1", 3).await;
    let _scene = serve_scene(&scene).await;
    let cli = session.home(role::CLI).await;
    let mut health = cli.subscribe(&keys::HEALTH, ANY, 64).await.unwrap();
    let mut changes = cli.subscribe(&keys::SCENE_EVENT, role::SCENE, 8).await.unwrap();
    let hostile = session.raw_away("gpu1").await;
    tokio::time::sleep(Duration::from_millis(300)).await;

    let encoding = |name: &str| format!("application/protobuf;supergaussian.{name}");
    for sender in role::ALL.iter().filter(|r| **r != role::RENDER_VIEW).chain(&["", "stranger"]) {
        let envelope =
            Envelope { sender: (*sender).to_owned(), epoch: LAST_EPOCH, ..Envelope::default() }.encode_to_vec();
        let key = view().key(SESSION, "render-view/event/health");
        let payload = Health { instance: "scene.1".into(), ..Health::default() }.encode_to_vec();
        let put = hostile.put(&key, payload).encoding(encoding("bus.v1.Health").as_str());
        let blocking = zenoh::qos::CongestionControl::Block;
        put.attachment(envelope.clone()).congestion_control(blocking).await.unwrap();
        let asked = hostile.get(view().key(SESSION, "scene/cmd/apply")).payload(Command::default().encode_to_vec());
        let asked = asked.encoding(encoding("scene.v1.Command").as_str()).attachment(envelope);
        let reply = asked.timeout(Duration::from_secs(5)).await.unwrap().recv_async().await.unwrap();
        let error = WireError::decode(&*reply.result().unwrap_err().payload().to_bytes()).unwrap();
        assert_eq!(error.code(), Code::PermissionDenied, "as `{sender}`");
    }
    let counted = || cli.counters().refused() >= 10 && scene.counters().refused() >= 10;
    let begun = std::time::Instant::now();
    while !counted() {
        assert!(begun.elapsed() < Duration::from_secs(5), "they are not counted");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let arrived = tokio::time::timeout(Duration::from_millis(200), health.next()).await;
    assert!(arrived.is_err(), "a forged health has arrived");

    // The agent and the scene are heard as before.
    let agent = session.home_instance(role::AGENT_FUNCTION, "agent-function.1", 2).await;
    let applied = agent.ask(&keys::SCENE_APPLY, &Command { id: "1".into(), ..Command::default() }, &soon()).await;
    assert_eq!(applied.unwrap().summary, "home");
    scene.publish(&keys::SCENE_EVENT, &Event { revision: 1, ..Event::default() }, &soon()).await.unwrap();
    assert_eq!(heard(&mut changes).await.unwrap().0.revision, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn replies_carry_their_sender_and_its_epoch() {
    let session = Session::open().await;
    let cli = session.home(role::CLI).await;
    let hostile = session.raw_away("gpu1").await;
    let attempt = Arc::new(AtomicUsize::new(0));
    let current = Arc::clone(&attempt);
    let encoding = "application/protobuf;supergaussian.bus.v1.ContentReply";
    let answer = move |query: zenoh::query::Query| {
        let part = ContentReply { data: vec![1], total: 1 }.encode_to_vec();
        let envelope = |sender: &str, epoch| Envelope { sender: sender.into(), epoch, ..Envelope::default() };
        let own = view().key(SESSION, "render-view/cmd/content");
        let other = own.replace("gpu1", "gpu2");
        let (key, envelope) = match current.load(Ordering::Relaxed) {
            // The key of home, of another node, of another row; another sender; the truth.
            0 => (query.key_expr().to_string(), envelope(role::RENDER_VIEW, 0)),
            1 => (other, envelope(role::RENDER_VIEW, 0)),
            2 => (own.replace("cmd/content", "state"), envelope(role::RENDER_VIEW, 0)),
            3 => (own, envelope(role::SCENE, LAST_EPOCH)),
            4 => (own, Envelope::default()),
            _ => (own, envelope(role::RENDER_VIEW, 7)),
        };
        zenoh::Wait::wait(query.reply(key, part).encoding(encoding).attachment(envelope.encode_to_vec())).unwrap();
    };
    let key = keys::key(SESSION, role::RENDER_VIEW, "cmd/content");
    let _served = hostile.declare_queryable(key).complete(true).callback(answer).await.unwrap();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let ask = async || cli.ask_identified(&keys::VIEW_CONTENT, &ContentRequest::default(), &shortly()).await;
    for forged in 0..5 {
        attempt.store(forged, Ordering::Relaxed);
        assert!(ask().await.is_err(), "attempt {forged}");
    }
    attempt.store(5, Ordering::Relaxed);
    assert_eq!(ask().await.unwrap().1.unwrap().node, "gpu1");

    // Nothing of that has raised the epoch of the scene.
    let scene = session.home_instance(role::SCENE, "scene.1", 5).await;
    let serving = serve_scene(&scene).await;
    let apply = async |context| cli.ask(&keys::SCENE_APPLY, &Command::default(), &context).await;
    assert_eq!(apply(soon()).await.unwrap().summary, "home");
    // A process that has lost its role, and comes back, is not believed.
    drop(serving);
    let late = session.home_instance(role::SCENE, "scene.0", 4).await;
    let serving = serve_scene(&late).await;
    let lost = apply(shortly()).await.unwrap_err().code;
    assert!(matches!(lost, Code::Unavailable | Code::DeadlineExceeded), "{lost:?}");
    drop(serving);
    let _serving = serve_scene(&scene).await;
    assert!(apply(soon()).await.is_ok());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_node_cancels_its_own_requests_only_and_has_a_quota_of_open_ones() {
    let session = Session::open().await;
    let scene = session.home(role::SCENE).await;
    let _scene = serve_scene(&scene).await;
    let bus = scene.clone();
    let cancel = move |request: sg_proto::bus::CancelRequest, context: Context| {
        std::future::ready(Ok(CancelReply { found: bus.cancel_pending(&request.id, &context) }))
    };
    let _cancel = scene.serve(&keys::CANCEL, 4, cancel).await.unwrap();
    let cli = session.home(role::CLI).await;
    let away = session.away("gpu1", role::RENDER_VIEW, "view.1", 3).await;
    let slow = |bus: &Bus, id: String| {
        let bus = bus.clone();
        tokio::spawn(async move {
            let command = Command { id: "slow".into(), ..Command::default() };
            bus.ask(&keys::SCENE_APPLY, &command, &soon().with_id(id)).await
        })
    };
    let running = slow(&cli, "of home".into());
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert!(!away.cancel(role::SCENE, "of home").await.unwrap());
    let own = slow(&away, "of gpu1".into());
    tokio::time::sleep(Duration::from_millis(200)).await;
    assert!(away.cancel(role::SCENE, "of gpu1").await.unwrap());
    assert_eq!(own.await.unwrap().unwrap_err().code, Code::Cancelled);
    assert!(running.await.unwrap().is_ok());

    let many: Vec<_> = (0..NODE_OPEN_REQUESTS + 8).map(|i| slow(&away, i.to_string())).collect();
    tokio::time::sleep(Duration::from_millis(500)).await;
    let refused = many.iter().filter(|a| a.is_finished()).count();
    assert_eq!((refused, scene.counters().dropped()), (8, 8));
    // Home is served all the same.
    let status = Command { id: "1".into(), ..Command::default() };
    let asked = tokio::time::timeout(Duration::from_millis(100), cli.ask(&keys::SCENE_APPLY, &status, &soon())).await;
    assert!(asked.is_err(), "it waits in the queue, it is not refused");
    many.iter().for_each(tokio::task::JoinHandle::abort);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_path_from_a_node_is_not_opened() {
    let session = Session::open().await;
    let away = session.away("gpu1", role::RENDER_VIEW, "view.1", 3).await;
    let shared = Blobs::open(&session.folder().join("away")).unwrap();
    let (hash, path) = shared.put(b"picture", "png").unwrap();
    let content = move |request: ContentRequest, _| std::future::ready(shared.part(&request));
    let _content = away.serve(&keys::VIEW_CONTENT, 4, content).await.unwrap();
    let cli = session.home(role::CLI).await;
    let blobs = Blobs::open(&session.folder().join("home")).unwrap();
    let secret = session.folder().join("home-key.pem");
    let secret_hash = blake3::hash(&std::fs::read(&secret).unwrap()).to_hex().to_string();
    let sender = view();
    let fetch = async |path: &str, hash: &str, sender| {
        blobs.fetch(&cli, &keys::VIEW_CONTENT, StoredFile { path, hash, sender }, &soon()).await
    };
    let path = path.display().to_string();
    let fetched = fetch(&path, &hash, Some(&sender)).await.unwrap();
    assert!(fetched.starts_with(session.folder().join("home")), "{fetched:?}");
    assert_eq!(std::fs::read(&fetched).unwrap(), b"picture");

    let secret = secret.display().to_string();
    let kept = || std::fs::read_dir(session.folder().join("home")).unwrap().count();
    for (hash, code) in [
        (secret_hash.as_str(), Code::NotFound),
        ("", Code::InvalidArgument),
        ("../../../../etc/hostname", Code::InvalidArgument),
        ("/etc/hostname", Code::InvalidArgument),
    ] {
        assert_eq!(fetch(&secret, hash, Some(&sender)).await.unwrap_err().code, code, "{hash}");
    }
    // Not even a path of this machine is believed without its hash.
    assert_eq!(fetch(&secret, &hash, None).await.unwrap_err().code, Code::DataLoss);
    assert_eq!(kept(), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_process_needs_an_instance_and_a_certificate_of_its_own() {
    let session = Session::open().await;
    let error = Bus::connect(SESSION, role::CLI, session.link("gpu1")).await.unwrap_err().to_string();
    assert!(error.contains("needs an instance"), "{error}");
    // gpu2's service on gpu1 reaches nobody.
    let scene = session.home(role::SCENE).await;
    let _scene = serve_scene(&scene).await;
    let borrowed = session.away("gpu1", role::SELECTION, "selection.1", 9).await;
    let outcome = borrowed.ask(&keys::SCENE_APPLY, &Command::default(), &shortly()).await;
    assert!(outcome.is_err());
    let raw = session.raw_away("gpu1").await;
    let get = raw.get(view().key(SESSION, "scene/cmd/status")).accept_replies(ReplyKeyExpr::Any);
    let none = get.timeout(Duration::from_millis(300)).await.unwrap().recv_async().await;
    assert!(none.is_err() || none.unwrap().result().is_err(), "the scene here serves no status");
}
