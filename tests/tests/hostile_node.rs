//! A hostile machine with a valid certificate plays every row of the contract, with every field forged. Nothing changes.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use prost::Message as _;
use prost_reflect::{
    DescriptorPool, DynamicMessage, FieldDescriptor, Kind as FieldKind, MessageDescriptor, Value as Field,
};
use serde_json::Value;
use sg_proto::bus::{Code, ContentReply, Envelope, Health, Ready};
use sg_proto::keys::{self, Kind, role, rows};
use sg_proto::launch::{JoinRequest, SignalReply, StartReply, StartRequest};
use sg_proto::render::{CaptureRequest, Frame};
use sg_runtime::bus::{Bus, Certificates, Link, RawMessage, ServerHandle};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_tests::stack::{SERVICES, SESSION, Stack};
use sg_tests::{command, executable};
use tokio::runtime::Runtime;

/// The service on the hostile machine.
const AWAY: &str = "render-capture";
/// Its instance.
const INSTANCE: &str = "render-capture.1";

struct Trial {
    stack: Stack,
    port: u16,
    tls: PathBuf,
    _folder: tempfile::TempDir,
}

impl Trial {
    fn begin() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let tls = folder.path().join("tls");
        let mut certificates = command(folder.path()).unwrap();
        certificates.arg("certificates").arg(&tls).args(["--home", "127.0.0.1", "--node", "gpu1,gpu2"]);
        assert!(certificates.stdout(Stdio::null()).status().unwrap().success());
        // The port is free at this moment; the stack takes it soon.
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let pem = |name: &str| tls.join(name).display().to_string();
        let settings = [
            format!("bus.listen=tls/127.0.0.1:{port}"),
            format!("bus.authority={}", pem("authority.pem")),
            format!("bus.certificate={}", pem("home.pem")),
            format!("bus.key={}", pem("home-key.pem")),
            "node.gpu1.lease=5".to_owned(),
            "node.gpu2.lease=5".to_owned(),
            format!("service.{AWAY}.on=gpu1"),
            // A process with more memory is restarted. Nobody here needs it.
            "service.scene.memory_mib=8192".to_owned(),
            "service.selection.memory_mib=8192".to_owned(),
            "service.render-view.params.width=64".to_owned(),
            "service.render-view.params.height=64".to_owned(),
        ];
        Self { stack: Stack::begin(&settings, &[], None).unwrap(), port, tls, _folder: folder }
    }

    fn link(&self, node: &str) -> Link {
        Link {
            endpoint: format!("tls/127.0.0.1:{}", self.port),
            certificates: Some(Certificates {
                authority: self.tls.join("authority.pem"),
                certificate: self.tls.join(format!("{node}.pem")),
                key: self.tls.join(format!("{node}-key.pem")),
            }),
        }
    }

    /// Process, number of restarts and state of each service at home.
    fn at_home(&self) -> BTreeMap<String, Value> {
        let services = self.stack.ps().into_iter().filter(|s| s["name"] != AWAY);
        let facts = |s: Value| {
            (s["name"].as_str().unwrap().to_owned(), serde_json::json!([s["pid"], s["restarts"], s["state"]]))
        };
        services.map(facts).collect()
    }
}

/// The hostile machine: a node that joins and starts processes as it should, so that it is believed at first.
struct Hostile {
    node: Bus,
    capture: Bus,
    /// Path in the next picture, and its hash.
    picture: Arc<Mutex<(String, String)>>,
    _serving: Vec<ServerHandle>,
}

impl Hostile {
    async fn join(trial: &Trial) -> Self {
        let begun = Instant::now();
        let node = loop {
            let instance = keys::node_instance("gpu1");
            match Bus::connect_instance(SESSION, role::NODE, &instance, 0, true, trial.link("gpu1")).await {
                Ok(bus) => break bus,
                Err(error) if begun.elapsed() > Duration::from_secs(30) => panic!("{error}\n{}", trial.stack.log()),
                Err(_) => tokio::time::sleep(Duration::from_millis(200)).await,
            }
        };
        let (started, mut starts) = tokio::sync::mpsc::channel(4);
        let start = move |request: StartRequest, _| {
            started.try_send(request).unwrap();
            std::future::ready(Ok(StartReply { pid: 1, number: 1, executable: "hostile".into() }))
        };
        let signal = |_, _| std::future::ready(Ok(SignalReply {}));
        let mut serving = vec![
            node.serve(&keys::NODE_START, 4, start).await.unwrap(),
            node.serve(&keys::NODE_SIGNAL, 4, signal).await.unwrap(),
        ];
        let reporting = node.clone();
        tokio::spawn(async move {
            loop {
                let report = JoinRequest {
                    node: "gpu1".into(),
                    process_id: "hostile".into(),
                    running: vec![INSTANCE.into()],
                    ..JoinRequest::default()
                };
                let _ = reporting.ask(&keys::JOIN, &report, &within(1000)).await;
                tokio::time::sleep(Duration::from_millis(500)).await;
            }
        });
        let request = tokio::time::timeout(Duration::from_secs(60), starts.recv()).await.unwrap().unwrap();
        assert_eq!(request.instance, INSTANCE);
        let link = trial.link("gpu1");
        let capture = Bus::connect_instance(SESSION, AWAY, INSTANCE, request.epoch, false, link).await.unwrap();
        let picture = Arc::new(Mutex::new((String::new(), String::new())));
        let next = Arc::clone(&picture);
        let draw = move |_: CaptureRequest, _| {
            let (path, hash) = next.lock().unwrap().clone();
            let (npy_path, png_path, png_hash) = (path.clone(), path, hash.clone());
            std::future::ready(Ok(Frame { npy_path, png_path, hash, png_hash, ..Frame::default() }))
        };
        serving.push(capture.serve(&keys::CAPTURE, 4, draw).await.unwrap());
        let content = |_, _| std::future::ready(Err::<ContentReply, _>(Fault::not_found("nothing")));
        serving.push(capture.serve(&keys::CAPTURE_CONTENT, 4, content).await.unwrap());
        // The only message in which it tells the truth.
        let announced = capture.clone();
        tokio::spawn(async move {
            loop {
                let health = Health { role: AWAY.into(), instance: INSTANCE.into(), ..Health::default() };
                let ready = Ready { role: AWAY.into(), instance: INSTANCE.into(), ..Ready::default() };
                let _ = announced.publish(&keys::READY, &ready, &Context::root()).await;
                let _ = announced.publish(&keys::HEALTH, &health, &Context::root()).await;
                tokio::time::sleep(Duration::from_millis(500)).await;
            }
        });
        Self { node, capture, picture, _serving: serving }
    }
}

fn within(milliseconds: u64) -> Context {
    Context::root().deadline_in(Duration::from_millis(milliseconds))
}

/// What a forger writes into a field: names of others, a file of the home machine, the largest numbers.
fn forged_values(field: &FieldDescriptor, names: &[String]) -> Vec<Field> {
    let values: Vec<Field> = match field.kind() {
        _ if field.is_map() => Vec::new(),
        FieldKind::String => names.iter().cloned().map(Field::String).collect(),
        FieldKind::Bytes => vec![Field::Bytes(vec![0xff; 64].into())],
        FieldKind::Bool => vec![Field::Bool(true)],
        FieldKind::Float => vec![Field::F32(f32::NAN), Field::F32(f32::MAX)],
        FieldKind::Double => vec![Field::F64(f64::NAN), Field::F64(f64::MAX)],
        FieldKind::Int32 | FieldKind::Sint32 | FieldKind::Sfixed32 => vec![Field::I32(i32::MAX), Field::I32(i32::MIN)],
        FieldKind::Int64 | FieldKind::Sint64 | FieldKind::Sfixed64 => vec![Field::I64(i64::MAX)],
        FieldKind::Uint32 | FieldKind::Fixed32 => vec![Field::U32(u32::MAX)],
        FieldKind::Uint64 | FieldKind::Fixed64 => vec![Field::U64(u64::MAX), Field::U64(1 << 63)],
        FieldKind::Enum(kind) => kind.values().map(|v| Field::EnumNumber(v.number())).collect(),
        FieldKind::Message(kind) => {
            let within = NESTED.map(|number| forged_whole(&kind, names, number, DEPTH));
            [DynamicMessage::new(kind)].into_iter().chain(within).map(Field::Message).collect()
        }
    };
    values.into_iter().map(|value| as_field(field, value)).collect()
}

/// A value as a field takes it.
fn as_field(field: &FieldDescriptor, value: Field) -> Field {
    if field.is_list() { Field::List(vec![value]) } else { value }
}

/// Messages within messages that are forged: as many levels.
const DEPTH: usize = 3;
/// Their values: places in the list of names. A role at home, an agent, a file of the home machine, an instance at home.
const NESTED: [usize; 4] = [2, 3, 4, 7];

/// A message with all fields forged, and so are those of the messages in it. `number` chooses the value of each field, and
/// of each choice the field.
fn forged_whole(kind: &MessageDescriptor, names: &[String], number: usize, depth: usize) -> DynamicMessage {
    let mut message = DynamicMessage::new(kind.clone());
    for field in kind.fields() {
        if let Some(choice) = field.containing_oneof() {
            let members: Vec<FieldDescriptor> = choice.fields().collect();
            if members.get(number % members.len()) != Some(&field) {
                continue;
            }
        }
        let value = match field.kind() {
            FieldKind::Message(inner) if !field.is_map() => {
                (depth > 0).then(|| as_field(&field, Field::Message(forged_whole(&inner, names, number, depth - 1))))
            }
            FieldKind::Message(_) => None,
            _ => {
                let values = forged_values(&field, names);
                values.get(number % values.len()).cloned()
            }
        };
        if let Some(value) = value {
            message.set_field(&field, value);
        }
    }
    message
}

/// A message with each field forged in turn, those of messages in it together, and two messages with all fields forged.
fn forged_messages(pool: &DescriptorPool, name: &str, names: &[String]) -> Vec<Vec<u8>> {
    let kind = pool.get_message_by_name(name).unwrap();
    let mut all = vec![Vec::new(), vec![0xff; 64]];
    let mut whole = [DynamicMessage::new(kind.clone()), DynamicMessage::new(kind.clone())];
    for field in kind.fields() {
        for value in forged_values(&field, names) {
            let mut message = DynamicMessage::new(kind.clone());
            message.set_field(&field, value.clone());
            all.push(message.encode_to_vec());
            let [first, last] = &mut whole;
            if !first.has_field(&field) {
                first.set_field(&field, value.clone());
            }
            last.set_field(&field, value);
        }
    }
    all.extend(whole.iter().map(prost::Message::encode_to_vec));
    all
}

/// Envelopes with each field forged: every sender with the highest epoch, and the rest with the true sender.
fn forged_envelopes(names: &[String], truth: &str) -> Vec<Vec<u8>> {
    let forged = |sender: &str| Envelope {
        id: names.first().cloned().unwrap_or_default(),
        cause: "forged".into(),
        conversation: "forged".into(),
        step: u32::MAX,
        traceparent: "forged".into(),
        deadline_ms: u32::MAX,
        schema_hash: "forged".into(),
        sequence: u64::MAX,
        sender: sender.to_owned(),
        epoch: 1 << 63,
    };
    let senders = role::ALL.iter().copied().filter(|r| *r != truth).chain(["", "stranger"]);
    let mut all: Vec<_> = senders.map(|s| forged(s).encode_to_vec()).collect();
    // Under its own name it keeps its epoch: a node may disturb its own role, and nothing else.
    all.push(Envelope { epoch: 0, ..forged(truth) }.encode_to_vec());
    all.push(vec![0xff; 32]);
    all.push(Vec::new());
    all
}

/// Plays every row, forged in its key, its envelope and its payload. Returns the number of messages.
async fn forge_everything(hostile: &Hostile, names: &[String]) -> usize {
    let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).unwrap();
    let mut sent = 0;
    let senders = [
        (&hostile.capture, AWAY, String::new()),
        (&hostile.capture, AWAY, format!("@node/gpu1/{AWAY}/{INSTANCE}/")),
        (&hostile.capture, AWAY, format!("@node/gpu1/{AWAY}/scene.1/")),
        (&hostile.capture, AWAY, "@node/gpu1/scene/scene.1/".to_owned()),
        (&hostile.capture, AWAY, "@node/gpu2/node/node:gpu2/".to_owned()),
        (&hostile.node, role::NODE, "@node/gpu1/node/node:gpu1/".to_owned()),
    ];
    for row in rows() {
        let (Kind::Request { request: name, .. } | Kind::Stream { message: name } | Kind::Retained { message: name }) =
            &row.kind;
        let is_request = matches!(row.kind, Kind::Request { .. });
        let payloads = forged_messages(&pool, name, names);
        for (bus, truth, key) in &senders {
            let mut envelopes = forged_envelopes(names, truth);
            // The router drops a false key whatever the message says, so a few messages suffice there.
            let own = key.contains(INSTANCE) || key.contains("node:gpu1");
            let payloads = if own { payloads.as_slice() } else { payloads.get(..3).unwrap_or_default() };
            envelopes.truncate(if own { usize::MAX } else { 2 });
            let roles: Vec<&str> = match row.role {
                keys::ANY => role::ALL.to_vec(),
                role => vec![role],
            };
            let own_instance = if *truth == role::NODE { keys::node_instance("gpu1") } else { INSTANCE.to_owned() };
            let instances = [keys::instance("scene.1"), keys::instance(&own_instance)];
            let honest = Envelope { sender: (*truth).to_owned(), ..Envelope::default() }.encode_to_vec();
            let each_payload = payloads.iter().map(|p| (p, &honest));
            let each_envelope = payloads.first().into_iter().flat_map(|p| envelopes.iter().map(move |e| (p, e)));
            for (payload, envelope) in each_payload.chain(each_envelope) {
                for segment in roles.iter().copied().chain(instances.iter().map(String::as_str)) {
                    let raw = RawMessage {
                        encoding: format!("application/protobuf;{name}"),
                        payload: Some(payload.clone()),
                        attachment: Some(envelope.clone()),
                    };
                    let segment = format!("{key}{segment}");
                    sent += 1;
                    if is_request {
                        bus.ask_raw(&segment, row.name, &raw, Duration::from_millis(1)).await;
                    } else {
                        bus.put_raw(&segment, row.name, &raw).await.unwrap();
                    }
                }
            }
        }
    }
    sent
}

/// `capture` copies no file that the hostile machine names.
fn captures_leak_nothing(trial: &Trial, hostile: &Hostile) {
    let secret = trial.stack.folder().join("secret.npy");
    std::fs::write(&secret, b"the key of the house").unwrap();
    let hash = blake3::hash(b"the key of the house").to_hex().to_string();
    let out = trial.stack.folder().join("stolen.npy");
    let relative = format!("../../../..{}", secret.display());
    for (path, hash) in [
        (secret.display().to_string(), hash.clone()),
        (secret.display().to_string(), String::new()),
        (String::new(), relative.trim_end_matches(".npy").to_owned()),
        ("/dev/zero".to_owned(), hash.clone()),
        ("/etc/hostname".to_owned(), secret.display().to_string()),
    ] {
        *hostile.picture.lock().unwrap() = (path.clone(), hash.clone());
        let (status, _, all) = trial.stack.run(&["capture", &out.display().to_string()]).unwrap();
        assert!(matches!(status, Some(1 | 2)), "{path} {hash}: {all}");
        assert!(!out.exists(), "{path} {hash}: {all}");
    }
    let blobs = std::fs::read_dir(trial.stack.session_folder().join("blobs")).into_iter().flatten().flatten();
    for file in blobs.filter(|f| f.path().is_file()) {
        assert_ne!(std::fs::read(file.path()).unwrap(), b"the key of the house", "{:?}", file.path());
    }
}

/// While somebody else's readiness and health are forged, a swap succeeds.
async fn forge_readiness(hostile: &Hostile) {
    for key in ["agent-function", "@instance/agent-function.2", AWAY] {
        for sender in ["", "@node/gpu1/render-capture/render-capture.1/", "@node/gpu1/agent-function/agent-function.2/"]
        {
            for (role, standby) in [("agent-function", true), ("scene", true), ("agent-function", false)] {
                let ready = Ready {
                    role: role.into(),
                    instance: "agent-function.2".into(),
                    standby,
                    epoch: u64::MAX,
                    ..Ready::default()
                };
                let raw = RawMessage {
                    encoding: "application/protobuf;supergaussian.bus.v1.Ready".into(),
                    payload: Some(ready.encode_to_vec()),
                    attachment: Some(Envelope { sender: AWAY.into(), ..Envelope::default() }.encode_to_vec()),
                };
                hostile.capture.put_raw(&format!("{sender}{key}"), keys::READY.name, &raw).await.unwrap();
            }
        }
    }
}

#[test]
fn a_hostile_node_changes_nothing() {
    let runtime = Runtime::new().unwrap();
    let trial = Trial::begin();
    let hostile = runtime.block_on(Hostile::join(&trial));
    if let Err(error) = trial.stack.wait() {
        panic!("{error}");
    }
    let cli = runtime.block_on(trial.stack.join(role::CLI)).unwrap();
    let revision = || runtime.block_on(cli.newest(&keys::SCENE_STATE, &within(5000))).unwrap().revision;
    let (before, first) = (trial.at_home(), revision());
    assert_eq!(before.len(), SERVICES - 1, "{before:?}");

    let mut names: Vec<String> =
        ["gpu1", "gpu2", "scene", "agent-function", "/etc/hostname", "\u{1b}[2J", ""].map(str::to_owned).to_vec();
    names.extend(before.keys().map(|service| format!("{service}.1")));
    let sent = runtime.block_on(forge_everything(&hostile, &names));
    assert!(sent > 5000, "{sent}");
    // Longer than silence may last.
    std::thread::sleep(Duration::from_secs(6));
    assert_eq!(trial.at_home(), before, "{}", trial.stack.log());
    assert_eq!(revision(), first);
    let log = trial.stack.log();
    assert!(!log.contains("gpu2"), "{log}");
    // The forgeries have arrived, and each receiver has counted them.
    let (_, metrics, _) = trial.stack.run(&["metrics"]).unwrap();
    let refused =
        |line: &&str| line.starts_with("supergaussian_refused_total{") && line.contains("role=\"supervisor\"");
    for row in ["event/health", "event/ready", "event/log", "cmd/join"] {
        let counted = metrics.lines().filter(refused).any(|l| l.contains(row));
        assert!(counted, "{row}: {:?}", metrics.lines().filter(|l| l.contains("refused")).collect::<Vec<_>>());
    }

    // gpu1 cannot join as gpu2, nor gpu2 as gpu1.
    let join = |node: &str| JoinRequest { node: node.into(), process_id: "forged".into(), ..JoinRequest::default() };
    let fault = runtime.block_on(hostile.node.ask(&keys::JOIN, &join("gpu2"), &within(2000))).unwrap_err();
    assert_eq!(fault.code, Code::PermissionDenied, "{fault}");
    let other = runtime.block_on(async {
        let instance = keys::node_instance("gpu2");
        let bus = Bus::connect_instance(SESSION, role::NODE, &instance, 0, true, trial.link("gpu2")).await.unwrap();
        bus.ask(&keys::JOIN, &join("gpu1"), &within(2000)).await.unwrap_err()
    });
    assert_eq!(other.code, Code::PermissionDenied, "{other}");
    refused_on_the_command_line(&trial);

    captures_leak_nothing(&trial, &hostile);

    // Everything works as before: no epoch is poisoned, and readiness comes from whoever is ready.
    let (status, _, all) = trial.stack.run(&["say", "make body red", "--timeout", "20"]).unwrap();
    assert!(revision() > first, "{status:?} {all}");
    let agent = executable("supergaussian-agent-function").unwrap().display().to_string();
    let swapping = std::thread::scope(|scope| {
        let swap = scope.spawn(|| trial.stack.run(&["swap", "agent-function", &agent]).unwrap());
        while !swap.is_finished() {
            runtime.block_on(forge_readiness(&hostile));
        }
        swap.join().unwrap()
    });
    assert_eq!(swapping.0, Some(0), "{}\n{}", swapping.2, trial.stack.log());
    let second = revision();
    let (status, _, all) = trial.stack.run(&["say", "make body blue", "--timeout", "20"]).unwrap();
    assert!(revision() > second, "{status:?} {all}");
    // It does not end its process, but the stack ends without it.
    let (status, _, all) = trial.stack.run(&["down"]).unwrap();
    assert_eq!(status, Some(0), "{all}");
}

/// `join` refuses a certificate of another machine before it connects.
fn refused_on_the_command_line(trial: &Trial) {
    let pem = |name: &str| trial.tls.join(name).display().to_string();
    let mut join = command(Path::new(trial.stack.folder())).unwrap();
    join.args(["join", &trial.link("gpu1").endpoint, "--session", SESSION, "--name", "gpu2"]);
    join.args(["--authority", &pem("authority.pem"), "--certificate", &pem("gpu1.pem"), "--key", &pem("gpu1-key.pem")]);
    let output = join.output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("gpu1.pem: the certificate of `gpu1`, not of `gpu2`"), "{text}");
}
