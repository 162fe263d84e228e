//! `chaos`: plays a scripted session twice, with and without faults, and compares the results.

mod inject;
mod plan;
mod report;
mod session;
mod stack;
mod stalled_disk;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use sg_input::limits::SMALL_TEXT_BYTES;
use sg_proto::keys::role;
use sg_runtime::bus::Bus;
use sg_runtime::session::SessionDir;
use sg_stack::file::{ExecutableSearch, LaunchFile, Source, read};
use tokio::sync::watch;

use crate::densest_strokes;
use crate::input::Input;
use crate::playback::Counts;
use crate::shipped::{self, DENSEST, HEADLESS};
use crate::strokes::read_script;
use crate::supervisor_client::wait_until_ready;
use crate::terminal::{self, CommandResult, Failure};
use crate::text_file::read_text;
use inject::{FaultLog, Injector};
use plan::Fault;
use report::{Report, Verdict};
use session::{FaultGate, SessionResult, SessionSettings, SessionStep};
use stack::Stack;
use supergaussian::script;

/// Longest time for a supervisor to open its session.
const OPEN_TIME: Duration = Duration::from_secs(30);
/// Launch file of the demo's stack, in the output folder.
const LAUNCH_FILE: &str = "stack.toml";
/// Output of the supervisors, in the output folder.
const LOG: &str = "supervisor.log";
/// Name of the session without faults, and of the one with faults.
const CALM: &str = "calm";
const SHAKEN: &str = "shaken";
/// Overrides for every launch file: faults are more frequent than any realistic restart intensity.
const OVERRIDES: [&str; 4] = [
    "defaults.intensity={ restarts = 1000, within_s = 1 }",
    "defaults.backoff={ initial_ms = 20, max_ms = 200 }",
    "defaults.liveness=2.5",
    "defaults.stop=3",
];
/// Script for the synthetic volume. It uses the demo's strokes.
const SCRIPT: &str = include_str!("session.toml");
/// Override for the demo's stack: the window is small, because it is not shown.
const SMALL_VIEW: &str = "service.render-view.params={ width = 96, height = 96 }";

#[derive(Debug, clap::Args)]
pub(crate) struct ChaosArgs {
    /// Launch file with a scene; by default the demo's stack on the synthetic volume
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// Number of faults
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    faults: u32,
    /// Seed of the faults, their targets and their moments
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u64,
    /// Folder for the scene, the pictures and the transcripts
    #[arg(long, value_name = "DIR", default_value = "supergaussian-chaos")]
    out: PathBuf,
    /// Script to play in rounds, or `generic`; by default one for the synthetic volume, `generic` with a launch file
    #[arg(long, value_name = "FILE|generic")]
    script: Option<String>,
    /// Gaussians of the synthetic volume
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    gaussians: u32,
    /// Width and height of the pictures, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 96, value_parser = clap::value_parser!(u32).range(16..=4096))]
    size: u32,
    /// Time limit for the whole run in seconds; by default two minutes and twelve seconds per fault
    #[arg(long, value_name = "SECONDS")]
    within: Option<u64>,
    /// Print the plan and stop
    #[arg(long)]
    plan: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// All inputs of a run, checked before the start.
struct Prepared {
    out: PathBuf,
    /// The launch file for the supervisor.
    file: PathBuf,
    overrides: Vec<String>,
    /// Launch-file parameter with the path of the project.
    project: String,
    executables: HashMap<String, PathBuf>,
    steps: Vec<SessionStep>,
    round: usize,
    rounds: usize,
    plan: Vec<Fault>,
}

impl Prepared {
    /// The project of one of both sessions.
    fn project_of(&self, session: &str) -> PathBuf {
        self.out.join(project_name(session))
    }
}

/// File name of the project of one of both sessions.
fn project_name(session: &str) -> String {
    format!("{session}.sgproj")
}

pub(crate) async fn chaos(arguments: ChaosArgs, session_name: Option<&str>) -> CommandResult {
    let prepared = prepare(&arguments)?;
    if arguments.plan {
        for (fault, number) in prepared.plan.iter().zip(1..) {
            let act = prepared.steps.get(fault.step).map_or_else(String::new, SessionStep::name);
            terminal::print_line(&format!("{number:>6}  {fault} ({act})"));
        }
        return Ok(());
    }
    let name = session_name.map_or_else(|| format!("chaos-{}", std::process::id()), str::to_owned);
    let session = SessionDir::named(&name)?;
    let within = arguments.within.unwrap_or(120 + 12 * u64::from(arguments.faults));
    let running = run(&prepared, &arguments, &session);
    let outcome = match tokio::time::timeout(Duration::from_secs(within), running).await {
        Ok(outcome) => outcome,
        Err(_) => Err(Failure::Work(format!("not done after {within} s"))),
    };
    match outcome {
        Ok(()) => {
            // After success the logs are of no further use.
            let _ = std::fs::remove_dir_all(session.path());
            Ok(())
        }
        Err(failure @ (Failure::Work(_) | Failure::Faults(_))) => {
            let (seed, faults) = (arguments.seed, arguments.faults);
            let kept = format!(
                "seed {seed}, {faults} faults; kept for inspection: {} and {} (supergaussian logs --session {name})",
                session.path().display(),
                prepared.out.display()
            );
            Err(Failure::Faults(failure.text().lines().map(str::to_owned).chain([kept]).collect()))
        }
        Err(other) => Err(other),
    }
}

fn prepare(arguments: &ChaosArgs) -> Result<Prepared, Failure> {
    let search = ExecutableSearch::here_then_path();
    let launch = |path: &Path, text: &str, overrides: &[String]| -> Result<LaunchFile, Failure> {
        read(Source { path, text, overrides }, &search).map_err(|p| Failure::Mistakes(p.lines().collect()))
    };
    let mut overrides: Vec<String> = OVERRIDES.map(str::to_owned).to_vec();
    // Check all inputs before slow work.
    let given = match &arguments.file {
        Some(path) => Some((path, launch(path, &read_text(path, SMALL_TEXT_BYTES)?, &overrides)?)),
        None => None,
    };
    let own = arguments.script.as_deref().filter(|name| *name != "generic");
    let own = own.map(|path| read_script(Path::new(path))).transpose()?;
    let out = fresh_folder(&arguments.out)?;
    let shipped = shipped::unpack(&out, given.is_none().then_some("vessel"))?;
    let steps = match own {
        Some(steps) => steps,
        None if arguments.script.is_some() || given.is_some() => read_script(&shipped.generic)?,
        None => {
            let path = shipped.script.with_file_name("chaos.toml");
            let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", path.display()));
            std::fs::write(&path, SCRIPT).map_err(fail)?;
            read_script(&path)?
        }
    };

    let (file, launch) = match given {
        Some((path, launch)) => (std::path::absolute(path).unwrap_or_else(|_| path.clone()), launch),
        None => {
            let file = out.join(LAUNCH_FILE);
            let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", file.display()));
            std::fs::write(&file, HEADLESS.1).map_err(fail)?;
            overrides.push(SMALL_VIEW.to_owned());
            let launch = launch(&file, HEADLESS.1, &overrides)?;
            (file, launch)
        }
    };
    let no_scene = || Failure::Input(format!("{}: no service of the role `{}`", file.display(), role::SCENE));
    let keeper = launch.services.iter().find(|s| s.role == role::SCENE).ok_or_else(no_scene)?;
    let scene = match &arguments.file {
        None if arguments.plan => None,
        None => Some(Input::Synthetic.scene(&out, None, arguments.gaussians, 0)?.path),
        // Paths in parameters are relative to the launcher's working folder.
        Some(_) => keeper.start.params.get("scene").and_then(serde_json::Value::as_str).map(PathBuf::from),
    };
    if let Some(scene) = &scene {
        let densest = |s: &script::Step| matches!(s, script::Step::Strokes { file, .. } if file.ends_with(DENSEST));
        if steps.iter().any(densest) && !arguments.plan {
            densest_strokes::write(scene, &out, &shipped.densest)?;
        }
        if arguments.file.is_none() {
            let path = toml::Value::String(scene.display().to_string());
            overrides.push(format!("service.{}.params.scene={path}", keeper.name));
        }
    }

    let (round, between) = session::round(steps);
    let services: Vec<_> = launch.services.iter().map(|s| s.name.clone()).collect();
    let commands = |steps: &[SessionStep]| steps.iter().map(SessionStep::is_command).collect::<Vec<_>>();
    let (of_round, of_between) = (commands(&round), commands(&between));
    let shape = plan::Session { round: &of_round, between: &of_between, services: &services, scene: &keeper.name };
    let (rounds, plan) = plan::plan(&shape, arguments.faults as usize, arguments.seed);
    let mut steps = round.clone();
    for _ in 1..rounds {
        steps.extend(between.iter().chain(&round).cloned());
    }
    let project = format!("service.{}.params.project", keeper.name);
    let executables = launch.services.iter().map(|s| (s.name.clone(), s.start.executable.clone())).collect();
    Ok(Prepared { out, file, overrides, project, executables, steps, round: round.len(), rounds, plan })
}

async fn run(prepared: &Prepared, arguments: &ChaosArgs, session: &SessionDir) -> CommandResult {
    let began = Instant::now();
    let calm = play(prepared, arguments, session, CALM, None).await?;
    let peaceful = began.elapsed();
    terminal::print_status(&format!(
        "without faults: {} steps in {} rounds, revision {}, {} pictures",
        prepared.steps.len(),
        prepared.rounds,
        calm.state.revision,
        calm.pictures.len()
    ));
    let began = Instant::now();
    let counts = Arc::new(Counts::default());
    let mut log = FaultLog::default();
    let faults = Faults { calm: &calm.times, counts: Arc::clone(&counts), log: &mut log };
    let shaken = play(prepared, arguments, session, SHAKEN, Some(faults)).await?;
    let verdict = Verdict::of(&calm, &shaken).with(&log);
    let report = Report {
        seed: arguments.seed,
        rounds: prepared.rounds,
        steps: prepared.steps.len(),
        calm: peaceful,
        shaken: began.elapsed(),
        retries: counts.retries.load(Ordering::Relaxed),
        refused_for_room: counts.refused_for_room.load(Ordering::Relaxed),
        acknowledged: shaken.acknowledged.len(),
        revision: shaken.state.revision,
        pictures: shaken.pictures.len(),
        log: &log,
        verdict: &verdict,
    };
    report.tell(arguments.json);
    if verdict.wrong.is_empty() { Ok(()) } else { Err(Failure::Faults(verdict.wrong)) }
}

/// Extra inputs of a session with faults.
struct Faults<'a> {
    calm: &'a [Duration],
    counts: Arc<Counts>,
    log: &'a mut FaultLog,
}

/// Starts the stack on a new project, plays the session, and stops the stack.
async fn play(
    prepared: &Prepared,
    arguments: &ChaosArgs,
    session: &SessionDir,
    name: &str,
    faults: Option<Faults<'_>>,
) -> Result<SessionResult, Failure> {
    let project = prepared.project_of(name);
    let mut overrides = prepared.overrides.clone();
    overrides.push(format!("{}={}", prepared.project, toml::Value::String(project.display().to_string())));
    let mut stack = Stack::new(prepared.file.clone(), overrides, session.clone(), prepared.out.join(LOG));
    let out = prepared.out.join(name);
    let played = over(&mut stack, prepared, arguments, out, faults).await;
    if played.is_err() {
        stack.kill_all().await;
    }
    played
}

async fn over(
    stack: &mut Stack,
    prepared: &Prepared,
    arguments: &ChaosArgs,
    out: PathBuf,
    faults: Option<Faults<'_>>,
) -> Result<SessionResult, Failure> {
    stack.up()?;
    let bus = join(stack).await?;
    wait_until_ready(&bus).await?;
    let mut playing = SessionSettings {
        bus: &bus,
        steps: &prepared.steps,
        round: prepared.round,
        out,
        size: arguments.size,
        counts: Arc::default(),
    };
    let played = match faults {
        None => session::play(playing, None).await?,
        Some(Faults { calm, counts, log }) => {
            let (begun, begun_seen) = watch::channel(0);
            let (answered, answered_seen) = watch::channel(0);
            let (set_up, set_up_seen) = watch::channel(0);
            let steps = prepared.plan.iter().map(|f| f.step).collect();
            playing.counts = Arc::clone(&counts);
            let gate = FaultGate { steps, begun, answered, set_up: set_up_seen };
            let injector = Injector {
                stack: &mut *stack,
                bus: &bus,
                executables: &prepared.executables,
                plan: &prepared.plan,
                project: &prepared.project_of(SHAKEN),
                steps: &prepared.steps,
                calm,
                begun: begun_seen,
                answered: answered_seen,
                set_up,
                counts,
                log,
            };
            // A failed recovery ends the session at once. Its remains are kept for inspection.
            tokio::try_join!(session::play(playing, Some(gate)), injector.run())?.0
        }
    };
    stack.down(&bus).await?;
    bus.close().await;
    let left = stack.processes();
    let (_, left) = stack.wait_gone(&left).await;
    match left.first() {
        None => Ok(played),
        Some(process) => Err(Failure::Work(format!("process {} outlives its stack", process.pid))),
    }
}

/// Joins the bus once the supervisor has opened it.
async fn join(stack: &mut Stack) -> Result<Bus, Failure> {
    let began = Instant::now();
    let session = stack.session().clone();
    loop {
        stack.check()?;
        if session.is_running() && session.socket().exists() {
            match Bus::connect(session.name(), role::CLI, &session.endpoint()).await {
                Ok(bus) => return Ok(bus),
                // The socket may belong to a killed supervisor. The next one replaces it.
                Err(error) if began.elapsed() > OPEN_TIME => return Err(error.into()),
                Err(_) => {}
            }
        }
        if began.elapsed() > OPEN_TIME {
            return Err(Failure::Work(format!("no supervisor after {} s", OPEN_TIME.as_secs())));
        }
        tokio::time::sleep(stack::POLL_PERIOD).await;
    }
}

/// Creates the folder, and removes the output of an earlier run. A folder with other files is refused.
fn fresh_folder(out: &Path) -> Result<PathBuf, Failure> {
    let is_used = std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
    if is_used && !out.join("script/generic.toml").is_file() {
        let text = format!("{}: holds files of something else; give --out a new folder", out.display());
        return Err(Failure::Input(text));
    }
    let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}; give a folder that can be written", out.display()));
    std::fs::create_dir_all(out).map_err(fail)?;
    let out = std::fs::canonicalize(out).map_err(fail)?;
    for entry in std::fs::read_dir(&out).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name == CALM || name == SHAKEN {
            std::fs::remove_dir_all(entry.path()).map_err(fail)?;
        } else if name == LOG || [CALM, SHAKEN].iter().any(|session| name.starts_with(&project_name(session))) {
            std::fs::remove_file(entry.path()).map_err(fail)?;
        }
    }
    Ok(out)
}
