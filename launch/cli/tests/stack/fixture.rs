//! A service that misbehaves on purpose. A script of the sandbox runs this test executable itself, so no extra
//! executable is built.

use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Parser;
use nix::sys::signal::{SigSet, SigmaskHow, Signal, sigprocmask};
use serde::Deserialize;
use sg_proto::keys;
use sg_proto::language::{AgentState, Reply, Utterance};
use sg_runtime::actor::{Actor, ActorError};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{EXIT_INPUT, Host, ServeArgs, StartError, run};
use sg_runtime::progress;

#[derive(Parser)]
struct Fixture {
    #[command(flatten)]
    serve: ServeArgs,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct Params {
    /// Milliseconds before it is ready.
    start_ms: u64,
    /// Fails while it loads.
    crash: bool,
    /// Milliseconds after which it dies.
    crash_ms: Option<u64>,
    /// Milliseconds after which it hangs and ignores all requests.
    hang_ms: Option<u64>,
    /// Never gets ready.
    never_ready: bool,
    /// Ignores SIGTERM.
    deaf: bool,
    /// Messages that it publishes, as fast as it can.
    flood: u64,
    /// Sends malformed messages: under its own keys, to others and to the bus itself.
    garbage: bool,
    /// Mebibytes that it allocates each second.
    leak_mib: usize,
    /// Answers utterances (role agent-core): all but "fail" with success.
    answers: bool,
    /// Milliseconds for an answer.
    late_ms: u64,
    /// File that collects the id of each request that takes effect.
    ledger: Option<PathBuf>,
    /// An actor that works this long, milliseconds, beside a process that sends signs of life.
    work_ms: u64,
    /// Milliseconds between two parts of that work; 0 for work that reports no progress.
    part_ms: u64,
    /// Milliseconds of loading in parts of 100 ms, each reported.
    load_ms: u64,
    /// Panics in the handler of an utterance (role agent-core).
    panics: bool,
    /// A value that nobody else may see.
    secret: Option<String>,
    /// Milliseconds from its start in which its serving threads answer nothing.
    blocked_ms: u64,
    /// Milliseconds of work before it takes its role.
    promotion_ms: u64,
}

/// An actor that works for long.
struct Worker {
    work: Duration,
    part: Duration,
}

impl Actor for Worker {
    type Message = ();
    type State = String;

    fn name(&self) -> &'static str {
        "worker"
    }

    fn state(&self) -> String {
        String::new()
    }

    async fn handle(&mut self, (): ()) -> Result<(), ActorError> {
        let began = Instant::now();
        while began.elapsed() < self.work {
            if self.part.is_zero() {
                tokio::time::sleep(self.work).await;
            } else {
                tokio::time::sleep(self.part).await;
                progress::current().step();
            }
        }
        tracing::info!("the work is done");
        Ok(())
    }
}

#[test]
#[ignore = "not a test: the services that the other tests start"]
fn fixture() {
    let arguments = std::env::var("ARGUMENTS").expect("started by a script of the sandbox");
    let mut fixture = Fixture::parse_from(arguments.lines());
    fixture.serve.read_params().unwrap();
    let params: serde_json::Value = serde_json::from_str(&fixture.serve.params).unwrap();
    if params["deaf"] == true {
        // Before the first thread, so that all threads inherit the mask.
        let mut signals = SigSet::empty();
        signals.add(Signal::SIGTERM);
        sigprocmask(SigmaskHow::SIG_BLOCK, Some(&signals), None).unwrap();
    }
    let status = run(fixture.serve, "fixture", load);
    std::process::exit(match status {
        ExitCode::SUCCESS => 0,
        status if status == ExitCode::from(EXIT_INPUT) => 2,
        _ => 1,
    });
}

/// Says what this process may do with the paths and the port in its environment.
fn try_rights() {
    let said =
        |outcome: std::io::Result<()>| outcome.map_or_else(|e| format!("{:?}", e.kind()), |()| "done".to_owned());
    let paths = std::env::var_os("TRIED_PATHS").map_or_else(Vec::new, |paths| std::env::split_paths(&paths).collect());
    for path in paths {
        let read = said(std::fs::read(&path).map(drop));
        let written = said(std::fs::write(&path, "changed"));
        tracing::info!(read, written, "tried {}", path.file_name().unwrap().to_string_lossy());
    }
    if let Ok(address) = std::env::var("TRIED_ADDRESS") {
        let connected = said(std::net::TcpStream::connect(address).map(drop));
        tracing::info!(connected, "tried a connection");
    }
    if let Ok(pid) = std::env::var("TRIED_PROCESS") {
        let pid = nix::unistd::Pid::from_raw(pid.parse().unwrap());
        let signalled = said(nix::sys::signal::kill(pid, None).map_err(Into::into));
        tracing::info!(signalled, "tried a process");
    }
}

async fn load(host: Host) -> Result<(), StartError> {
    try_rights();
    let params: Params = host.params()?;
    if params.crash {
        return Err(StartError::Failed("crashed on purpose".to_owned()));
    }
    tokio::time::sleep(Duration::from_millis(params.start_ms)).await;
    for _ in 0..params.load_ms / 100 {
        tokio::time::sleep(Duration::from_millis(100)).await;
        progress::current().step();
    }
    if params.work_ms > 0 {
        let worker =
            Worker { work: Duration::from_millis(params.work_ms), part: Duration::from_millis(params.part_ms) };
        let (mailbox, _) = host.spawn(worker, 4);
        mailbox.tell(())?;
        mailbox.tell(())?;
        forever(mailbox);
    }
    if params.panics {
        host.serve(&keys::UTTER, 4, |_: Utterance, _| async { panic!("broke\non purpose") }).await?;
    }
    if let Some(secret) = &params.secret {
        tracing::info!(length = secret.len(), "the secret is known");
    }
    if params.never_ready {
        std::future::pending::<()>().await;
    }
    if params.answers {
        let state = host.bus().retain(&keys::CORE_STATE, AgentState::default()).await?;
        let (bus, late, ledger) = (host.bus().clone(), Duration::from_millis(params.late_ms), params.ledger);
        host.serve(&keys::UTTER, 64, move |utterance, context| {
            let (bus, ledger) = (bus.clone(), ledger.clone());
            async move {
                tokio::time::sleep(late).await;
                answer(bus, utterance, context, ledger).await
            }
        })
        .await?;
        forever(state);
    }
    if let Some(ms) = params.crash_ms {
        tokio::spawn(async move {
            tokio::time::sleep(Duration::from_millis(ms)).await;
            std::process::abort();
        });
    }
    if let Some(ms) = params.hang_ms {
        // More than the number of bus threads.
        for _ in 0..8 {
            tokio::spawn(async move {
                tokio::time::sleep(Duration::from_millis(ms)).await;
                std::thread::sleep(Duration::from_secs(3600));
            });
        }
    }
    if params.blocked_ms > 0 {
        let until = Instant::now() + Duration::from_millis(params.blocked_ms);
        // More than the number of bus threads.
        for _ in 0..8 {
            tokio::spawn(async move { std::thread::sleep(until.saturating_duration_since(Instant::now())) });
        }
    }
    if params.promotion_ms > 0 {
        host.before_promotion(move || async move {
            tokio::time::sleep(Duration::from_millis(params.promotion_ms)).await;
            Ok(())
        });
    }
    if params.flood > 0 {
        tokio::spawn(flood(host.bus().clone(), params.flood));
    }
    if params.garbage {
        let socket = host.run_dir().join("bus.sock");
        tokio::spawn(garbage(host.bus().clone(), socket));
    }
    if params.leak_mib > 0 {
        tokio::spawn(leak(params.leak_mib));
    }
    tracing::info!(greeting = "hello there", "loaded");
    Ok(())
}

/// Keeps a value alive for the whole process.
fn forever<T: Send + 'static>(kept: T) {
    tokio::spawn(async move {
        std::future::pending::<()>().await;
        drop(kept);
    });
}

async fn answer(bus: Bus, utterance: Utterance, context: Context, ledger: Option<PathBuf>) -> Result<Reply, Fault> {
    if let Some(path) = ledger {
        let mut file = std::fs::File::options().append(true).create(true).open(path).unwrap();
        // One write, so that lines of two processes could not mix.
        file.write_all(format!("{} {}\n", context.id, utterance.text).as_bytes()).unwrap();
    }
    bus.publish(&keys::UTTERANCE, &utterance, &context.next()).await?;
    let ok = utterance.text != "fail";
    let reply = Reply { text: format!("you said: {}", utterance.text), ok, ..Reply::default() };
    bus.publish(&keys::REPLY, &reply, &context.next()).await?;
    Ok(reply)
}

async fn flood(bus: Bus, count: u64) {
    let utterance = Utterance { text: "x".repeat(1000), ..Utterance::default() };
    for i in 0..count {
        // Excess messages are dropped and counted.
        let _ = bus.publish(&keys::UTTERANCE, &utterance, &Context::root()).await;
        if i % 64 == 0 {
            tokio::task::yield_now().await;
        }
    }
}

async fn garbage(bus: Bus, socket: PathBuf) {
    // Wrong types under its own keys reach every subscriber.
    let mut ready = keys::UTTERANCE;
    (ready.role, ready.name) = (keys::ANY, keys::READY.name);
    let mut health = ready;
    health.name = keys::HEALTH.name;
    // Requests of a wrong type, or from a forbidden role.
    let mut ps = keys::UTTER;
    (ps.role, ps.name) = (keys::PS.role, keys::PS.name);
    let mut down = ps;
    down.name = keys::DOWN.name;
    let utterance = Utterance { text: "\u{1}".repeat(1 << 20), ..Utterance::default() };
    for round in 0..20_u8 {
        for row in [&ready, &health] {
            let _ = bus.publish(row, &utterance, &Context::root()).await;
        }
        for row in [&ps, &down] {
            let context = Context::root().deadline_in(Duration::from_millis(200));
            let refused = bus.ask(row, &utterance, &context).await.unwrap_err();
            tracing::info!(%refused, "garbage was refused");
        }
        // Bytes outside the bus's protocol, to the bus's socket.
        if let Ok(mut stream) = UnixStream::connect(&socket) {
            let bytes: Vec<u8> =
                (0..100_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8 ^ round).collect();
            let _ = stream.set_write_timeout(Some(Duration::from_millis(200)));
            let _ = stream.write_all(&bytes);
        }
    }
    tracing::info!("garbage was sent");
}

async fn leak(mib_each_second: usize) {
    let mut kept: Vec<Vec<u8>> = Vec::new();
    loop {
        // Write to the memory, so that it counts as resident.
        kept.push(vec![kept.len() as u8 | 1; mib_each_second << 18]);
        tokio::time::sleep(Duration::from_millis(250)).await;
    }
}
