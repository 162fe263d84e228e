//! The bus between two clients of one router, in one process.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use prost::Message as _;
use sg_proto::bus::{Code, Health, StatusRequest};
use sg_proto::keys::{self, role};
use sg_proto::scene::{Command, CommandResult, Event, Mask, State};
use sg_runtime::bus::{Bus, endpoint_of};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

struct Session {
    _folder: tempfile::TempDir,
    endpoint: String,
    router: Bus,
}

impl Session {
    async fn open() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let socket = folder.path().join("bus.sock");
        let router = Bus::open_router("test", role::SUPERVISOR, &socket, None).await.unwrap();
        Self { _folder: folder, endpoint: endpoint_of(&socket), router }
    }

    async fn join(&self, role: &str) -> Bus {
        Bus::connect("test", role, &self.endpoint).await.unwrap()
    }
}

fn soon() -> Context {
    Context::root().deadline_in(Duration::from_secs(5))
}

async fn serve_scene(bus: &Bus) -> sg_runtime::bus::ServerHandle {
    bus.serve(&keys::SCENE_APPLY, 4, |command: Command, context| async move {
        match command.id.as_str() {
            "refuse" => Err(Fault::precondition("nothing is selected").with_details(["brush first".to_owned()])),
            "slow" => {
                tokio::time::sleep(Duration::from_millis(300)).await;
                Ok(CommandResult::default())
            }
            _ => Ok(CommandResult { id: command.id, summary: context.conversation, ..Default::default() }),
        }
    })
    .await
    .unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_request_is_answered_with_its_context() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let _serving = serve_scene(&scene).await;
    let cli = session.join(role::CLI).await;
    let command = Command { id: "one".into(), ..Default::default() };
    let result = cli.ask(&keys::SCENE_APPLY, &command, &soon().at_step("talk", 2)).await.unwrap();
    assert_eq!((result.id.as_str(), result.summary.as_str()), ("one", "talk"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_fault_keeps_its_code_message_and_details() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let _serving = serve_scene(&scene).await;
    let cli = session.join(role::CLI).await;
    let fault =
        cli.ask(&keys::SCENE_APPLY, &Command { id: "refuse".into(), ..Default::default() }, &soon()).await.unwrap_err();
    assert_eq!(fault.code, Code::FailedPrecondition);
    assert_eq!(
        (fault.message.as_str(), fault.details.as_slice()),
        ("nothing is selected", ["brush first".to_owned()].as_slice())
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_unserved_role_is_unavailable_within_the_deadline() {
    let session = Session::open().await;
    let cli = session.join(role::CLI).await;
    let before = Instant::now();
    let context = Context::root().deadline_in(Duration::from_millis(200));
    let fault = cli.ask(&keys::SCENE_APPLY, &Command::default(), &context).await.unwrap_err();
    assert!(matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded), "{fault:?}");
    assert!(fault.message.contains("scene"), "{fault}");
    assert!(before.elapsed() < Duration::from_secs(2));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_comes_late_still_answers() {
    let session = Session::open().await;
    let cli = session.join(role::CLI).await;
    let asking = tokio::spawn(async move {
        cli.ask(&keys::SCENE_APPLY, &Command { id: "late".into(), ..Default::default() }, &soon()).await
    });
    tokio::time::sleep(Duration::from_millis(150)).await;
    let scene = session.join(role::SCENE).await;
    let _serving = serve_scene(&scene).await;
    assert_eq!(asking.await.unwrap().unwrap().id, "late");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_slow_answer_is_late_and_a_full_queue_refuses_at_once() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let _serving = serve_scene(&scene).await;
    let cli = session.join(role::CLI).await;
    let slow = Command { id: "slow".into(), ..Default::default() };
    let short = Context::root().deadline_in(Duration::from_millis(50));
    assert_eq!(cli.ask(&keys::SCENE_APPLY, &slow, &short).await.unwrap_err().code, Code::DeadlineExceeded);

    let asks: Vec<_> = (0..12)
        .map(|_| {
            let (cli, slow) = (cli.clone(), slow.clone());
            tokio::spawn(async move { cli.ask(&keys::SCENE_APPLY, &slow, &soon()).await })
        })
        .collect();
    let mut refused = 0;
    for ask in asks {
        if ask.await.unwrap().is_err_and(|f| f.code == Code::ResourceExhausted) {
            refused += 1;
        }
    }
    assert!(refused >= 5, "a queue of 4 took all but {refused} of 12");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn senders_types_and_garbage_are_refused_and_counted() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let _serving = serve_scene(&scene).await;
    // The intent agent may not change the scene.
    let intent = session.join(role::AGENT_INTENT).await;
    let fault = intent.ask(&keys::SCENE_APPLY, &Command::default(), &soon()).await.unwrap_err();
    assert_eq!(fault.code, Code::PermissionDenied);

    // Other types, and bytes that are no message, under the same key.
    let raw = zenoh::open(client(&session.endpoint)).await.unwrap();
    let envelope = sg_proto::bus::Envelope { sender: role::CLI.into(), ..Default::default() }.encode_to_vec();
    let key = keys::key("test", role::SCENE, "cmd/apply");
    let oversized = vec![0_u8; sg_proto::limits::MAX_MESSAGE_BYTES + 1];
    let name = "application/protobuf;supergaussian.scene.v1.Command";
    for (encoding, payload, code) in [
        ("application/protobuf;supergaussian.scene.v1.Undo", vec![], Code::InvalidArgument),
        ("text/plain", b"undo".to_vec(), Code::InvalidArgument),
        (name, vec![0xff; 16], Code::InvalidArgument),
        (name, oversized, Code::ResourceExhausted),
    ] {
        let replies = raw
            .get(&key)
            .payload(payload)
            .encoding(encoding)
            .attachment(envelope.clone())
            .timeout(Duration::from_secs(5))
            .await
            .unwrap();
        let reply = replies.recv_async().await.unwrap();
        let error = reply.result().unwrap_err();
        let error = sg_proto::bus::Error::decode(&*error.payload().to_bytes()).unwrap();
        assert_eq!(Fault::from_wire(error).code, code, "{encoding}");
    }
    assert_eq!(scene.counters().refused(), 5);
}

fn client(endpoint: &str) -> zenoh::Config {
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"client\"").unwrap();
    config.insert_json5("connect/endpoints", &format!("[\"{endpoint}\"]")).unwrap();
    config.insert_json5("scouting/multicast/enabled", "false").unwrap();
    config
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_slow_subscriber_loses_the_oldest_and_counts_them() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let cli = session.join(role::CLI).await;
    let mut events = cli.subscribe(&keys::SCENE_EVENT, role::SCENE, 8).await.unwrap();
    tokio::time::sleep(Duration::from_millis(100)).await;
    for revision in 1..=100 {
        scene.publish(&keys::SCENE_EVENT, &Event { revision, ..Default::default() }, &soon()).await.unwrap();
    }
    tokio::time::sleep(Duration::from_millis(300)).await;
    let mut seen = Vec::new();
    while let Ok(Some((event, _))) = tokio::time::timeout(Duration::from_millis(100), events.next()).await {
        seen.push(event.revision);
    }
    assert_eq!(seen, (93..=100).collect::<Vec<_>>());
    assert_eq!(events.lost(), 92);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_late_reader_gets_the_newest_value() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let state = scene.retain(&keys::SCENE_STATE, State::default()).await.unwrap();
    state.set(State { revision: 7, ..Default::default() }, &soon()).await.unwrap();
    let cli = session.join(role::CLI).await;
    assert_eq!(cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision, 7);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn draining_finishes_accepted_requests() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let serving = serve_scene(&scene).await;
    let cli = session.join(role::CLI).await;
    let asking = tokio::spawn(async move {
        cli.ask(&keys::SCENE_APPLY, &Command { id: "slow".into(), ..Default::default() }, &soon()).await
    });
    tokio::time::sleep(Duration::from_millis(100)).await;
    serving.drain(Duration::from_secs(2)).await;
    assert!(asking.await.unwrap().is_ok());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn liveliness_changes_are_published() {
    let session = Session::open().await;
    let mut seen = session.router.watch_liveliness(16).await.unwrap();
    let scene = session.join(role::SCENE).await;
    let alive = scene.declare_liveliness("scene-1").await.unwrap();
    let came = tokio::time::timeout(Duration::from_secs(2), seen.recv()).await.unwrap().unwrap();
    assert_eq!((came.role.as_str(), came.instance.as_str(), came.alive), (role::SCENE, "scene-1", true));
    drop(alive);
    let went = tokio::time::timeout(Duration::from_secs(2), seen.recv()).await.unwrap().unwrap();
    assert!(!went.alive);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_oversized_message_is_not_sent() {
    let session = Session::open().await;
    let cli = session.join(role::CLI).await;
    let bits = vec![0; sg_proto::limits::MAX_MESSAGE_BYTES + 1];
    let commit = sg_proto::scene::CommitSelection { mask: Some(Mask { length: 1, bits }), ..Default::default() };
    let action = Some(sg_proto::scene::command::Action::CommitSelection(commit));
    let fault = cli.ask(&keys::SCENE_APPLY, &Command { action, ..Default::default() }, &soon()).await.unwrap_err();
    assert_eq!(fault.code, Code::ResourceExhausted);
    let short = soon().within(Duration::from_millis(50));
    let fault = cli.ask_role(&keys::STATUS, role::SCENE, &StatusRequest {}, &short).await.unwrap_err();
    assert!(matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded));
}

/// Health of a process of the given age at this moment.
async fn serve_status(bus: &Bus, age: Duration) -> sg_runtime::bus::ServerHandle {
    let begun = Instant::now();
    let health = move |_: StatusRequest, _| {
        let uptime = age + begun.elapsed();
        std::future::ready(Ok(Health { uptime_ms: uptime.as_millis() as u64, ..Health::default() }))
    };
    bus.serve(&keys::STATUS, 4, health).await.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_request_that_a_killed_process_took_along_is_sent_again() {
    let session = Session::open().await;
    let cli = session.join(role::CLI).await;
    // A process that gets the request, and neither answers nor ends it.
    let raw = zenoh::open(client(&session.endpoint)).await.unwrap();
    let open = Arc::new(Mutex::new(Vec::new()));
    let took = Arc::clone(&open);
    let take = move |query: zenoh::query::Query| took.lock().unwrap().push(query);
    let key = keys::key("test", role::SCENE, "cmd/apply");
    let first = raw.declare_queryable(key).complete(true).callback(take).await.unwrap();
    let command = Command { id: "one".into(), ..Default::default() };
    let asked = tokio::spawn(async move {
        cli.ask(&keys::SCENE_APPLY, &command, &Context::root().deadline_in(Duration::from_secs(30))).await
    });
    let begun = Instant::now();
    while open.lock().unwrap().is_empty() && begun.elapsed() < Duration::from_secs(10) {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    first.undeclare().await.unwrap();

    let scene = session.join(role::SCENE).await;
    let _status = serve_status(&scene, Duration::ZERO).await;
    let _serving = serve_scene(&scene).await;
    assert_eq!(asked.await.unwrap().unwrap().id, "one");
    assert_eq!(open.lock().unwrap().len(), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_slow_request_is_sent_once() {
    let session = Session::open().await;
    let (scene, cli) = (session.join(role::SCENE).await, session.join(role::CLI).await);
    let _status = serve_status(&scene, Duration::from_secs(60)).await;
    let count = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&count);
    let handler = move |command: Command, _| {
        counted.fetch_add(1, Ordering::Relaxed);
        async move {
            tokio::time::sleep(Duration::from_millis(2500)).await;
            Ok(CommandResult { id: command.id, ..Default::default() })
        }
    };
    let _serving = scene.serve(&keys::SCENE_APPLY, 4, handler).await.unwrap();
    let command = Command { id: "one".into(), ..Default::default() };
    let answer = cli.ask(&keys::SCENE_APPLY, &command, &Context::root().deadline_in(Duration::from_secs(30))).await;
    assert_eq!((answer.unwrap().id.as_str(), count.load(Ordering::Relaxed)), ("one", 1));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_standby_serves_its_instance_until_promotion() {
    let session = Session::open().await;
    let candidate = Bus::connect_instance("test", role::SCENE, "scene-2", 9, true, &session.endpoint).await.unwrap();
    let _serving = serve_scene(&candidate).await;
    let state = candidate.retain(&keys::SCENE_STATE, State { revision: 7, ..Default::default() }).await.unwrap();
    let cli = session.join(role::CLI).await;
    let command = Command { id: "one".into(), ..Default::default() };
    let short = || Context::root().deadline_in(Duration::from_millis(300));

    let away = cli.ask(&keys::SCENE_APPLY, &command, &short()).await.unwrap_err();
    assert!(matches!(away.code, Code::Unavailable | Code::DeadlineExceeded), "{away:?}");
    let own = keys::instance("scene-2");
    assert_eq!(cli.ask_role(&keys::SCENE_APPLY, &own, &command, &soon()).await.unwrap().id, "one");
    let mut events = cli.subscribe(&keys::SCENE_EVENT, role::SCENE, 8).await.unwrap();
    candidate.publish(&keys::SCENE_EVENT, &Event { revision: 1, ..Default::default() }, &soon()).await.unwrap();
    assert_eq!((candidate.epoch(), candidate.is_standby()), (0, true));

    candidate.promote(9).await.unwrap();
    assert_eq!((candidate.epoch(), candidate.is_standby()), (9, false));
    assert_eq!(candidate.declares(), ["cmd/apply", "state"]);
    assert_eq!(cli.ask(&keys::SCENE_APPLY, &command, &soon()).await.unwrap().id, "one");
    assert_eq!(cli.ask_role(&keys::SCENE_APPLY, &own, &command, &soon()).await.unwrap().id, "one");
    assert_eq!(cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision, 7);
    candidate.publish(&keys::SCENE_EVENT, &Event { revision: 2, ..Default::default() }, &soon()).await.unwrap();
    let (event, _) = tokio::time::timeout(Duration::from_secs(5), events.next()).await.unwrap().unwrap();
    assert_eq!(event.revision, 2, "events in standby are not under the role");
    drop(state);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn messages_of_an_older_epoch_are_refused_and_counted() {
    let session = Session::open().await;
    let connect =
        |instance, epoch| Bus::connect_instance("test", role::SCENE, instance, epoch, false, &session.endpoint);
    let (old, new) = (connect("scene-1", 4).await.unwrap(), connect("scene-2", 5).await.unwrap());
    let cli = session.join(role::CLI).await;
    let mut events = cli.subscribe(&keys::SCENE_EVENT, role::SCENE, 8).await.unwrap();
    let publish = async |bus: &Bus, revision| {
        bus.publish(&keys::SCENE_EVENT, &Event { revision, ..Default::default() }, &soon()).await.unwrap();
        tokio::time::sleep(Duration::from_millis(100)).await;
    };
    // The subscription takes a moment to be known.
    while tokio::time::timeout(Duration::from_millis(10), events.next()).await.is_err() {
        publish(&old, 0).await;
    }
    publish(&old, 1).await;
    publish(&new, 2).await;
    publish(&old, 3).await;
    publish(&new, 4).await;
    let mut heard = Vec::new();
    while let Ok(Some((event, _))) = tokio::time::timeout(Duration::from_millis(300), events.next()).await {
        heard.push(event.revision);
    }
    heard.retain(|revision| *revision > 0);
    assert_eq!(heard, [1, 2, 4]);
    assert_eq!(cli.counters().refused(), 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn waiting_and_running_requests_are_cancelled() {
    let session = Session::open().await;
    let scene = session.join(role::SCENE).await;
    let _serving = serve_scene(&scene).await;
    let bus = scene.clone();
    let _cancel = scene
        .serve(&keys::CANCEL, 4, move |request, context| {
            std::future::ready(Ok(sg_proto::bus::CancelReply { found: bus.cancel_pending(&request.id, &context) }))
        })
        .await
        .unwrap();
    let cli = session.join(role::CLI).await;
    let ask = |id: &str| {
        let (cli, id) = (cli.clone(), id.to_owned());
        tokio::spawn(async move {
            let slow = Command { id: "slow".into(), ..Default::default() };
            cli.ask(&keys::SCENE_APPLY, &slow, &soon().with_id(id)).await
        })
    };
    let running = ask("first");
    tokio::time::sleep(Duration::from_millis(50)).await;
    let (waiting, last) = (ask("second"), ask("third"));
    tokio::time::sleep(Duration::from_millis(50)).await;
    assert!(cli.cancel(role::SCENE, "first").await.unwrap());
    assert!(cli.cancel(role::SCENE, "second").await.unwrap());
    assert!(!cli.cancel(role::SCENE, "second").await.unwrap(), "already cancelled");
    assert!(!cli.cancel(role::SCENE, "never asked").await.unwrap());
    assert_eq!(running.await.unwrap().unwrap_err().code, Code::Cancelled);
    assert_eq!(waiting.await.unwrap().unwrap_err().code, Code::Cancelled);
    assert!(last.await.unwrap().is_ok(), "other requests continue");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_row_of_another_role_is_refused() {
    let session = Session::open().await;
    let selection = session.join(role::SELECTION).await;
    let error = selection.retain(&keys::SCENE_STATE, State::default()).await.unwrap_err().to_string();
    assert!(error.contains("belongs to `scene`, this process serves `selection`"), "{error}");
    let refused = selection.serve(&keys::SCENE_APPLY, 4, |_, _| std::future::ready(Err(Fault::internal("no")))).await;
    assert!(refused.is_err());
    assert!(selection.publish(&keys::SCENE_EVENT, &Event::default(), &soon()).await.is_err());
}
