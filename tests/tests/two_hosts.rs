//! A stack over two hosts, in network namespaces, through a proxy that imitates the faults of networks.

#![allow(
    clippy::panic,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it measures or skips"
)]

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use sg_proto::bus::{Code, StatusRequest};
use sg_proto::keys::{self, role};
use sg_proto::launch::DownRequest;
use sg_proto::scene::{Stroke, StrokeKind, StrokeMode};
use sg_proto::selection::StrokesRequest;
use sg_runtime::bus::{Bus, Certificates, Link};
use sg_runtime::context::Context;
use sg_tests::hosts::Host;
use sg_tests::proxy::{Proxy, Weather};
use sg_tests::stack::{SESSION, Stack};
use sg_tests::{Picture, command, small_scene, two_hosts};

const PORT: u16 = 7447;
/// Seconds of the node's lease.
const LEASE: u64 = 3;
/// The services on the other host.
const AWAY: [&str; 3] = ["selection", "render-view", "render-capture"];

/// The process that has joined, ended with the test.
struct Joined {
    process: Child,
    log: PathBuf,
}

impl Drop for Joined {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

struct Trial {
    stack: Stack,
    joined: Joined,
    tls: PathBuf,
    away: Host,
    home: Host,
    _folder: tempfile::TempDir,
}

impl Trial {
    /// Both hosts, the stack on one of them and the other one joined; not ready yet.
    fn begin([home, away]: [Host; 2]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let tls = folder.path().join("tls");
        let mut certificates = command(folder.path()).unwrap();
        // The other host reaches home under this machine's address on its own cable.
        certificates.arg("certificates").arg(&tls).args(["--home", &away.gateway.to_string(), "--node", "gpu1,gpu9"]);
        assert!(certificates.stdout(Stdio::null()).status().unwrap().success());
        let pem = |name: &str| tls.join(name).display().to_string();
        let mut settings = vec![
            format!("bus.listen=tls/{}:{PORT}", home.address),
            format!("bus.authority={}", pem("authority.pem")),
            format!("bus.certificate={}", pem("home.pem")),
            format!("bus.key={}", pem("home-key.pem")),
            format!("node.gpu1.lease={LEASE}"),
            "service.render-view.params.width=64".to_owned(),
            "service.render-view.params.height=64".to_owned(),
        ];
        settings.extend(AWAY.map(|name| format!("service.{name}.on=gpu1")));
        let stack = Stack::begin(&settings, &[], Some(&home)).unwrap();

        let there = folder.path().join("there");
        let mut join = command(&there).unwrap();
        join.arg("join").arg(format!("tls/{}:{PORT}", away.gateway)).args(["--session", SESSION, "--name", "gpu1"]);
        join.args([
            "--authority",
            &pem("authority.pem"),
            "--certificate",
            &pem("gpu1.pem"),
            "--key",
            &pem("gpu1-key.pem"),
        ]);
        // Files that the stack keeps on its own host must not be visible on the other one.
        let mut join = away.on(&join, &[stack.folder()]);
        let log = folder.path().join("join.log");
        let to = std::fs::File::create(&log).unwrap();
        let process = join.stdin(Stdio::null()).stdout(Stdio::null()).stderr(to).spawn().unwrap();
        Self { stack, joined: Joined { process, log }, tls, away, home, _folder: folder }
    }

    fn service(&self, name: &str) -> Value {
        self.stack.ps().into_iter().find(|s| s["name"] == name).unwrap_or_default()
    }

    fn pids(&self) -> Vec<u32> {
        AWAY.map(|name| u32::try_from(self.service(name)["pid"].as_u64().unwrap()).unwrap()).to_vec()
    }

    /// The picture of the scene as it is now.
    fn capture(&self, name: &str) -> Result<Picture, String> {
        let path = self.stack.folder().join(format!("{name}.npy"));
        let (status, _, all) = self
            .stack
            .run(&["capture", &path.display().to_string(), "--width", "96", "--height", "96", "--highlight"])
            .unwrap();
        if status == Some(0) { Ok(Picture::read(&path).unwrap()) } else { Err(all) }
    }

    fn say(&self, words: &str) -> (Option<i32>, String) {
        let (status, _, all) = self.stack.run(&["say", words, "--timeout", "20"]).unwrap();
        (status, all)
    }

    fn told(&self) -> String {
        format!("{}\n{}", std::fs::read_to_string(&self.joined.log).unwrap_or_default(), self.stack.log())
    }
}

fn is_alive(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    !stat.is_empty() && !stat.contains(") Z ")
}

fn until(what: &str, limit: Duration, mut holds: impl FnMut() -> bool) -> Duration {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < limit, "{what}: not within {limit:?}");
        std::thread::sleep(Duration::from_millis(50));
    }
    begun.elapsed()
}

/// Brushes through the sac.
async fn brush(bus: &Bus) -> u64 {
    let [x, y, z] = small_scene::SAC;
    let stroke = Stroke {
        mode: StrokeMode::Walk.into(),
        kind: StrokeKind::Foreground.into(),
        radius: small_scene::STROKE,
        points: vec![x - 0.05, y, z, x + 0.05, y, z],
        pressure: Vec::new(),
        depth: None,
    };
    let request = StrokesRequest { strokes: vec![stroke], restart: true, ..StrokesRequest::default() };
    let context = Context::root().deadline_in(Duration::from_secs(10));
    bus.ask(&keys::SELECTION_STROKES, &request, &context).await.unwrap().selected
}

/// The result of the same on a stack on one host alone.
fn alone() -> (u64, Picture) {
    let stack = Stack::up().unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let selected = runtime.block_on(async { brush(&stack.join(role::CLI).await.unwrap()).await });
    let (status, _, all) = stack.run(&["say", "make body red"]).unwrap();
    assert_eq!(status, Some(0), "{all}");
    let path = stack.folder().join("alone.npy");
    let out = path.display().to_string();
    let (status, _, all) = stack.run(&["capture", &out, "--width", "96", "--height", "96", "--highlight"]).unwrap();
    assert_eq!(status, Some(0), "{all}");
    (selected, Picture::read(&path).unwrap())
}

#[test]
fn a_stack_on_two_hosts_equals_one_host_and_survives_network_faults() {
    let Some(hosts) = two_hosts().unwrap() else {
        println!("SKIPPED: network namespaces cannot be made here; run as root with iproute2");
        return;
    };
    let (selected_alone, picture_alone) = alone();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let address = |ip| SocketAddr::new(std::net::IpAddr::V4(ip), PORT);
    let (listen, to) = (address(hosts[1].gateway), address(hosts[0].address));
    let proxy = runtime.block_on(Proxy::open(listen, to)).unwrap();
    let mut trial = Trial::begin(hosts);
    if let Err(error) = trial.stack.wait() {
        panic!("{error}\n{}", trial.told());
    }
    let bus = runtime.block_on(trial.stack.join(role::CLI)).unwrap();

    // The services assigned to that host run there, and nothing else does.
    for service in trial.stack.ps() {
        let name = service["name"].as_str().unwrap().to_owned();
        let (there, pid) = (AWAY.contains(&name.as_str()), u32::try_from(service["pid"].as_u64().unwrap()).unwrap());
        assert_eq!(service["node"], if there { "gpu1" } else { "" }, "{service}");
        assert_eq!((trial.away.runs(pid), trial.home.runs(pid)), (there, !there), "{service}");
    }
    // The same strokes and the same words make the same picture, number by number.
    assert_eq!(runtime.block_on(brush(&bus)), selected_alone);
    let (status, all) = trial.say("make body red");
    assert_eq!(status, Some(0), "{all}");
    assert_eq!(trial.capture("calm").unwrap(), picture_alone);
    let (_, logged, _) = trial.stack.run(&["logs", "render-capture"]).unwrap();
    assert!(logged.contains("ready"), "what is logged there is read here: {logged}");

    // Delay, a stall shorter than the lease, and a reset are sat out.
    let pids = trial.pids();
    proxy.set(Weather::Delay(Duration::from_millis(40)));
    assert_eq!(trial.capture("late").unwrap(), picture_alone);
    proxy.set(Weather::Stall);
    let healing = std::thread::spawn(|| std::thread::sleep(Duration::from_millis(1200)));
    std::thread::scope(|scope| {
        scope.spawn(|| {
            healing.join().unwrap();
            proxy.heal();
        });
        assert_eq!(trial.capture("stalled").unwrap(), picture_alone);
    });
    let before = proxy.connections();
    proxy.reset();
    assert_eq!(trial.capture("reset").unwrap(), picture_alone);
    until("everybody is connected again", Duration::from_secs(10), || proxy.connections() >= before + 4);
    std::thread::sleep(Duration::from_secs(LEASE + 2));
    assert_eq!(trial.pids(), pids, "nobody was started again\n{}", trial.told());

    rules(&runtime, &trial);

    // A cut: services there end with the lease. Here the stack waits for them, and no caller hangs.
    proxy.set(Weather::Cut);
    let gone = until("what ran there is gone", Duration::from_secs(LEASE + 3), || !pids.iter().any(|p| is_alive(*p)));
    until("the stack knows", Duration::from_secs(LEASE + 5), || trial.service("selection")["state"] == "WAITING");
    let reason = trial.service("selection")["reason"].as_str().unwrap().to_owned();
    assert!(reason.contains("node `gpu1`"), "{reason}");
    let begun = Instant::now();
    let (status, all) = trial.say("make body blue");
    assert_eq!(status, Some(0), "what needs no picture is done: {all}");
    assert!(begun.elapsed() < Duration::from_secs(15), "{:?}", begun.elapsed());
    let (begun, context) = (Instant::now(), Context::root().deadline_in(Duration::from_secs(1)));
    let fault =
        runtime.block_on(bus.ask_role(&keys::STATUS, role::SELECTION, &StatusRequest {}, &context)).unwrap_err();
    // The router may take the cut link for a slow one for some seconds more.
    assert!(matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded), "{fault}");
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());

    // It heals: everything is there again, and the scene is as it was left.
    proxy.heal();
    let back = {
        let begun = Instant::now();
        trial.stack.wait().unwrap();
        begun.elapsed()
    };
    println!("cut: processes gone after {gone:.1?}; healed: all ready after {back:.1?}");
    assert_eq!(trial.say("make body red").0, Some(0));
    assert_eq!(trial.capture("healed").unwrap(), picture_alone);

    // The stack stops, and so do its services there. The node stays, and leaves when asked.
    let pids = trial.pids();
    let (status, _, all) = trial.stack.run(&["down"]).unwrap();
    assert_eq!(status, Some(0), "{all}");
    assert!(!pids.iter().any(|p| is_alive(*p)), "{}", trial.told());
    assert_eq!(trial.joined.process.try_wait().unwrap(), None, "{}", trial.told());
    kill(Pid::from_raw(trial.joined.process.id().try_into().unwrap()), Signal::SIGINT).unwrap();
    assert_eq!(trial.joined.process.wait().unwrap().code(), Some(0), "{}", trial.told());
}

/// A caller from elsewhere may do exactly as much as its certificate allows, under any name it claims.
fn rules(runtime: &tokio::runtime::Runtime, trial: &Trial) {
    let link = |authority: &Path, name: &str| Link {
        endpoint: format!("tls/{}:{PORT}", trial.away.gateway),
        certificates: Some(Certificates {
            authority: authority.to_owned(),
            certificate: trial.tls.join(format!("{name}.pem")),
            key: trial.tls.join(format!("{name}-key.pem")),
        }),
    };
    let authority = trial.tls.join("authority.pem");
    runtime.block_on(async {
        let short = || Context::root().deadline_in(Duration::from_millis(700));
        let connect =
            |role, instance, node| Bus::connect_instance(SESSION, role, instance, 0, false, link(&authority, node));
        let node = connect(role::RENDER_VIEW, "render-view.77", "gpu1").await.unwrap();
        let status = node.ask_role(&keys::STATUS, role::SCENE, &StatusRequest {}, &short()).await;
        assert!(status.is_ok(), "anybody may ask how somebody is: {status:?}");
        let claimed = connect(role::CLI, "cli.1", "gpu1").await.unwrap();
        for bus in [&node, &claimed] {
            let down = bus.ask(&keys::DOWN, &DownRequest {}, &short()).await;
            assert!(down.is_err(), "a node may not stop the stack");
        }
        claimed.close().await;
        // A caller with a good certificate that is no node of this stack receives and sends nothing.
        let stranger = connect(role::RENDER_VIEW, "render-view.77", "gpu9").await.unwrap();
        assert!(stranger.ask_role(&keys::STATUS, role::SCENE, &StatusRequest {}, &short()).await.is_err());
        assert!(stranger.newest(&keys::SCENE_STATE, &short()).await.is_err());
        node.close().await;
        stranger.close().await;
        // A certificate of another authority does not even come in.
        let other = trial.tls.join("../other");
        let mut made = command(&trial.tls).unwrap();
        made.arg("certificates").arg(&other).args(["--home", "x", "--node", "gpu1"]).stdout(Stdio::null());
        assert!(made.status().unwrap().success());
        let forged = Link {
            certificates: Some(Certificates {
                authority: authority.clone(),
                certificate: other.join("gpu1.pem"),
                key: other.join("gpu1-key.pem"),
            }),
            ..link(&authority, "gpu1")
        };
        assert!(Bus::connect_instance(SESSION, role::CLI, "cli.1", 0, false, forged).await.is_err());
    });
    // Beside its socket in a folder of its own the home listens at the address that it was given, and nowhere else.
    let listening = Command::new("ip")
        .args(["netns", "exec", trial.home.namespace(), "sh", "-c", "cat /proc/net/tcp /proc/net/tcp6 /proc/net/udp"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&listening.stdout).into_owned();
    let listens: Vec<_> = text.lines().filter(|l| l.split_whitespace().nth(3) == Some("0A")).collect();
    assert_eq!(listens.len(), 1, "{text}");
    assert!(listens[0].contains(&format!(":{PORT:04X} ")), "{text}");
    assert!(!text.lines().any(|l| l.split_whitespace().nth(3) == Some("07")), "no UDP: {text}");
}
