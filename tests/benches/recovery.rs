//! How long each service is away after `kill -9`. Three times are measured. They end when its supervisor notices, when it is
//! ready again, and at its first answer to a caller that asked at the moment of the kill.
//!
//!     cargo bench --workspace --bench recovery -- --rounds 20 --gaussians 170000

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::labeling::FindRequest;
use sg_proto::language::{IntentRequest, Source, Utterance};
use sg_proto::launch::{PsRequest, ServiceState};
use sg_proto::render::{CaptureRequest, Quality};
use sg_proto::scene::{ChangesRequest, Stroke, StrokeKind, StrokeMode};
use sg_proto::selection::StrokesRequest;
use sg_runtime::bus::{Bus, Subscription, endpoint_of};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_tests::bench::{argument, quantile};
use sg_tests::{command, made_scene};

/// Services, and the time limit for the next answer of each, milliseconds.
const SERVICES: [(&str, f64); 9] = [
    (role::SCENE, 1000.0),
    (role::SELECTION, 1000.0),
    (role::LABELING, 1000.0),
    (role::SPEECH, 1000.0),
    (role::RENDER_VIEW, 300.0),
    (role::RENDER_CAPTURE, 300.0),
    (role::AGENT_INTENT, 300.0),
    (role::AGENT_FUNCTION, 300.0),
    (role::AGENT_CORE, 300.0),
];
/// The time limit for noticing a crash, milliseconds.
const NOTICED: f64 = 50.0;
/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(120);
/// Health for this long makes a pause before a restart begin anew; put over the launch file, so that rounds are short.
const WELL: Duration = Duration::from_millis(800);

struct Stack {
    supervisor: Child,
    bus: Bus,
    events: Subscription<sg_proto::launch::ServiceEvent>,
}

impl Drop for Stack {
    fn drop(&mut self) {
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
    }
}

/// One service, killed once; milliseconds.
struct Round {
    noticed: f64,
    ready: f64,
    answered: f64,
    /// Of the process itself: from its start to readiness.
    start: f64,
}

fn main() {
    let (rounds, gaussians) = (argument("--rounds", 20), argument("--gaussians", 170_000));
    let folder = tempfile::tempdir().unwrap();
    let scene = made_scene::write(folder.path(), gaussians).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let mut stack = Stack::up(folder.path(), &scene).await;
        println!("{gaussians} Gaussians, {rounds} rounds a service; milliseconds, median / p99 (aim)\n");
        println!("| service | noticed | ready again | answers again | start of the process |");
        println!("| --- | --- | --- | --- | --- |");
        for (service, aim) in SERVICES {
            let mut measured = Vec::new();
            for _ in 0..rounds {
                measured.push(stack.kill(service).await);
            }
            let of = |what: fn(&Round) -> f64| {
                let mut list: Vec<f64> = measured.iter().map(what).collect();
                format!("{:.0} / {:.0}", quantile(&mut list, 0.5), quantile(&mut list, 0.99))
            };
            println!(
                "| {service} | {} (≤ {NOTICED:.0}) | {} | {} (≤ {aim:.0}) | {} |",
                of(|r| r.noticed),
                of(|r| r.ready),
                of(|r| r.answered),
                of(|r| r.start)
            );
        }
    });
}

impl Stack {
    async fn up(folder: &Path, scene: &Path) -> Self {
        let file = folder.join("stack.toml");
        let headless = include_str!("../../launch/headless.toml");
        std::fs::write(&file, headless).unwrap();
        // The file's own first pause; only its longest is shorter, and with it the health that makes it begin anew.
        let table: toml::Table = headless.parse().unwrap();
        let initial = table["defaults"]["backoff"]["initial_ms"].as_integer().unwrap();
        let mut up: Command = command(&folder.join("run")).unwrap();
        up.arg("up").arg(&file).args(["--session", "recovery", "--quiet"]).stdin(Stdio::null()).stderr(Stdio::null());
        for (key, value) in [
            ("service.scene.params.scene", format!("{:?}", scene.display().to_string())),
            ("defaults.intensity", "{ restarts = 1000, within_s = 1 }".to_owned()),
            ("defaults.backoff", format!("{{ initial_ms = {initial}, max_ms = {} }}", WELL.as_millis())),
        ] {
            up.args(["--set", &format!("{key}={value}")]);
        }
        let supervisor = up.spawn().unwrap();
        let endpoint = endpoint_of(&folder.join("run/recovery/bus.sock"));
        let began = Instant::now();
        let bus = loop {
            match Bus::connect("recovery", role::CLI, &endpoint).await {
                Ok(bus) => break bus,
                Err(error) => assert!(began.elapsed() < PATIENCE, "{error}"),
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        };
        let events = bus.subscribe(&keys::SERVICE, role::SUPERVISOR, 256).await.unwrap();
        let stack = Self { supervisor, bus, events };
        stack.all_ready().await;
        stack
    }

    async fn all_ready(&self) {
        let began = Instant::now();
        loop {
            let ps = self.bus.ask(&keys::PS, &PsRequest {}, &soon()).await.unwrap();
            if ps.services.iter().all(|s| s.state() == ServiceState::Ready) {
                return;
            }
            assert!(began.elapsed() < PATIENCE, "{ps:#?}");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    async fn kill(&mut self, service: &str) -> Round {
        self.all_ready().await;
        tokio::time::sleep(WELL + Duration::from_millis(200)).await;
        let ps = self.bus.ask(&keys::PS, &PsRequest {}, &soon()).await.unwrap();
        let pid = ps.services.iter().find(|s| s.name == service).unwrap().pid;
        while tokio::time::timeout(Duration::ZERO, self.events.next()).await.is_ok() {}

        let killed = Instant::now();
        let since = || killed.elapsed().as_secs_f64() * 1e3;
        let status = Command::new("kill").args(["-9", &pid.to_string()]).status().unwrap();
        assert!(status.success());
        let bus = self.bus.clone();
        let (role, asked) = (service.to_owned(), killed);
        let answered = tokio::spawn(async move {
            ask(&bus, &role).await.unwrap();
            asked.elapsed().as_secs_f64() * 1e3
        });
        let mut noticed = None;
        let (ready, start) = loop {
            let event = tokio::time::timeout(PATIENCE, self.events.next()).await.unwrap().unwrap().0;
            let Some(now) = event.service.filter(|s| s.name == service) else { continue };
            if now.pid != pid || now.state() != ServiceState::Ready {
                noticed.get_or_insert_with(since);
            }
            if now.pid != pid && now.state() == ServiceState::Ready {
                break (since(), now.start_ms as f64);
            }
        };
        Round { noticed: noticed.unwrap_or(ready), ready, answered: answered.await.unwrap(), start }
    }
}

fn soon() -> Context {
    Context::root().deadline_in(PATIENCE)
}

/// A question that a service cannot answer before it has loaded.
async fn ask(bus: &Bus, role: &str) -> Result<(), Fault> {
    match role {
        role::SCENE => {
            bus.ask(&keys::SCENE_CHANGES, &ChangesRequest { from: 0, snapshot: true }, &soon()).await.map(drop)
        }
        role::SELECTION => {
            let stroke = Stroke {
                mode: StrokeMode::Walk.into(),
                kind: StrokeKind::Foreground.into(),
                radius: 0.05,
                points: vec![0.816, 0.465, 0.435, 0.735, 0.465, 0.516],
                pressure: vec![],
                depth: None,
            };
            let request = StrokesRequest { strokes: vec![stroke], restart: true, ..StrokesRequest::default() };
            bus.ask(&keys::SELECTION_STROKES, &request, &soon()).await.map(drop)
        }
        role::LABELING => {
            let request = FindRequest { text: "the sac".to_owned(), ..FindRequest::default() };
            bus.ask(&keys::LABELING_FIND, &request, &soon()).await.map(drop)
        }
        role::SPEECH => bus.newest(&keys::SPEECH_STATE, &soon()).await.map(drop),
        role::RENDER_VIEW => bus.newest(&keys::VIEW_STATE, &soon()).await.map(drop),
        role::RENDER_CAPTURE => {
            let request =
                CaptureRequest { width: 128, height: 128, quality: Quality::Fast.into(), ..CaptureRequest::default() };
            bus.ask(&keys::CAPTURE, &request, &soon()).await.map(drop)
        }
        role::AGENT_INTENT => {
            let request = IntentRequest { text: "undo".to_owned(), ..IntentRequest::default() };
            bus.ask(&keys::PARSE, &request, &soon()).await.map(drop)
        }
        role::AGENT_FUNCTION => bus.newest(&keys::FUNCTION_STATE, &soon()).await.map(drop),
        _ => {
            let utterance = Utterance { text: "help".to_owned(), source: Source::Text.into(), ..Utterance::default() };
            bus.ask(&keys::UTTER, &utterance, &soon()).await.map(drop)
        }
    }
}
