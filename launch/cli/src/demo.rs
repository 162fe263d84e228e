//! The demo: makes or loads a scene, starts the full stack and plays a script. It leaves pictures and a transcript.

mod outputs;
mod staging;
mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;
use sg_proto::keys::role;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::session::{self, SessionDir};
use sg_stack::StackError;
use sg_stack::console::Verbosity;
use sg_stack::file::ExecutableSearch;
use sg_stack::reconcile::Outcome;
use sg_stack::suggestion::suggestion;
use sg_stack::supervisor::{Stack, Supervisor};

use crate::display::has_display;
use crate::input::{GAUSSIANS, Input, Scene};
use crate::opener::CommandOpener;
use crate::playback::{Player, Settings};
use crate::shipped::{self, DESKTOP, HEADLESS, Shipped};
use crate::strokes::read_script;
use crate::supervisor_client::wait_until_ready;
use crate::terminal::{self, CommandResult, Failure};
use crate::up::outcome;
use outputs::{OutputFolder, PROJECT};
use staging::Staging;
use summary::Summary;
use supergaussian::script::Step;

/// Prefix of the names of demo sessions. The process id follows.
const SESSION: &str = "demo-";
/// Longest time of one step, restarts of services included.
const STEP_TIME: Duration = Duration::from_secs(180);
#[derive(Debug, clap::Args)]
pub(crate) struct DemoArgs {
    /// Volume or scene; by default a synthetic vessel tree with an aneurysm
    #[arg(value_name = "VOLUME|SCENE")]
    input: Option<PathBuf>,
    /// Script to play, or `generic` for any scene; by default the one shipped for the input
    #[arg(long, value_name = "FILE|generic")]
    script: Option<String>,
    /// Folder for the scene, the pictures and the transcript
    #[arg(long, value_name = "DIR", default_value = "supergaussian-demo")]
    out: PathBuf,
    /// Kill this service with SIGKILL in the middle of the script
    #[arg(long, value_name = "SERVICE")]
    chaos: Option<String>,
    /// Transfer function of a volume; by default the shipped one, else one from its histogram
    #[arg(long, value_name = "TF.json")]
    transfer_function: Option<PathBuf>,
    /// Number of Gaussians for a volume
    #[arg(long, value_name = "N", default_value_t = GAUSSIANS)]
    gaussians: u32,
    /// Seed of the synthetic volume and of the Gaussians' placement
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u64,
    /// Width and height of the pictures, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(16..=4096))]
    size: u32,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) async fn demo(arguments: DemoArgs, session_name: Option<&str>) -> CommandResult {
    // Check all inputs before slow work.
    let input = Input::of(arguments.input.as_deref())?;
    let search = ExecutableSearch::here_then_path();
    // A script or a service to kill asks for files, not for a window.
    let shipped_file = match arguments.script.is_none() && arguments.chaos.is_none() && has_display() {
        true => DESKTOP,
        false => HEADLESS,
    };
    let windowed = shipped_file == DESKTOP;
    let plan = shipped::launch_file(shipped_file, &[], &search)?;
    if let Some(name) = &arguments.chaos
        && !plan.services.iter().any(|s| s.name == *name)
    {
        let hint = suggestion(name, plan.services.iter().map(|s| s.name.as_str()));
        return Err(Failure::Input(format!("--chaos {name}: no such service{hint}")));
    }
    let folder = OutputFolder::check(&arguments.out)?;
    // A script of the person's own is checked before anything is written.
    let own = arguments.script.as_deref().filter(|script| *script != "generic").map(Path::new);
    let own_steps = match own {
        Some(path) if shipped::replaces(&arguments.out, path) => {
            return Err(Failure::Input(format!(
                "{}: the demo replaces its scripts in --out; copy this one elsewhere",
                path.display()
            )));
        }
        Some(path) => Some(read_script(path)?),
        None => None,
    };
    let session = SessionDir::named(session_name.unwrap_or(&format!("{SESSION}{}", std::process::id())))?;
    must_not_run(&session)?;
    let steps_of = |files: &Shipped| match &own_steps {
        Some(steps) => Ok(steps.clone()),
        None if arguments.script.is_some() => read_script(&files.generic),
        None => read_script(&files.script),
    };
    let how = match (windowed, &arguments.script) {
        (true, _) => Some("a window shows the scene; close it to end; --script plays a script without a window"),
        (false, None) => Some("DISPLAY is not set: the demo plays a script without a window"),
        (false, Some(_)) => None,
    };
    how.into_iter().for_each(terminal::print_status);
    let begun = Staging::begin(&input)?;
    let steps = steps_of(&begun.1)?;
    let function = arguments.transfer_function.as_deref();
    let staging = Staging::make(begun, &input, function, (arguments.gaussians, arguments.seed), &steps)?;
    let (out, files, scene) = staging.finish(folder, &input)?;
    let mut steps = steps_of(&files)?;
    if let Some(service) = &arguments.chaos
        && !steps.contains(&Step::Chaos)
    {
        terminal::print_status(&format!("the script has no step to kill {service}: it is killed in the middle"));
        steps.insert(steps.len() / 2, Step::Chaos);
    }
    let project = out.join(PROJECT);
    let overrides = [
        format!("service.scene.params.scene={}", toml::Value::String(scene.path.display().to_string())),
        format!("service.scene.params.project={}", toml::Value::String(project.display().to_string())),
    ];
    forget_dead_demos();
    // A session that was there before may hold a person's project.
    let is_new = !session.path().exists();
    let remove_session = || {
        if is_new {
            // After success the logs are of no further use.
            let _ = std::fs::remove_dir_all(session.path());
        }
    };
    let stack = |shipped_file: (&str, &str)| -> Result<Stack, Failure> {
        Ok(Stack {
            file: shipped::launch_file(shipped_file, &overrides, &search)?,
            path: PathBuf::from(shipped_file.0),
            session: session.clone(),
            verbosity: Verbosity::Quiet,
            opener: Box::new(CommandOpener),
        })
    };
    let failed = |_: &Failure| {
        terminal::print_status(&format!("logs of the services: supergaussian logs --session {}", session.name()));
    };
    if windowed {
        match Supervisor::open(stack(shipped_file)?).await?.run().await? {
            // For example a screen without a Vulkan driver. The rest of the demo still works.
            Outcome::Failed { service, reason } if service == role::RENDER_VIEW => {
                terminal::print_status(&format!("{reason}; the demo plays a script without a window"));
            }
            ended => {
                outcome(ended).inspect_err(failed)?;
                remove_session();
                terminal::print_status(&format!("edits are saved in {}", project.display()));
                return Ok(());
            }
        }
    }
    outputs::list(&out, &steps)?;
    let settings = Settings {
        out,
        conversation: format!("demo-{}", Context::root().id),
        step_time: STEP_TIME,
        size: arguments.size,
        chaos: arguments.chaos,
        counts: Arc::default(),
    };
    let summary = run(stack(HEADLESS)?, scene, steps, settings).await.inspect_err(failed)?;
    remove_session();
    summary.tell(arguments.json);
    if summary.failed_utterances.is_empty() {
        return Ok(());
    }
    Err(Failure::Work(format!("not everything was done: {}", summary.failed_utterances.join("; "))))
}

/// Supervises the stack and plays the script at the same time. The first end stops the other.
async fn run(stack: Stack, scene: Scene, steps: Vec<Step>, settings: Settings) -> Result<Summary, Failure> {
    let session = stack.session.clone();
    let supervisor = Supervisor::open(stack).await?;
    let handle = supervisor.handle();
    let supervising = supervisor.run();
    let playing = play(&session, scene, steps, settings);
    tokio::pin!(supervising, playing);
    tokio::select! {
        ended = &mut supervising => {
            outcome(ended?)?;
            Err(Failure::Work("stopped before the end of the script".to_owned()))
        }
        played = &mut playing => {
            handle.down();
            let ended = supervising.await;
            let summary = played?;
            outcome(ended?)?;
            Ok(summary)
        }
    }
}

async fn play(session: &SessionDir, scene: Scene, steps: Vec<Step>, settings: Settings) -> Result<Summary, Failure> {
    let began = Instant::now();
    let bus = Bus::connect(session.name(), role::CLI, &session.endpoint()).await?;
    let ready = wait_until_ready(&bus).await?;
    let start_seconds = began.elapsed().as_secs_f64();
    terminal::print_status(&format!("{} services ready after {start_seconds:.1} s", ready.services.len()));
    let mut player = Player::new(bus.clone(), settings).await?;
    let played = player.play(&steps).await;
    // The transcript matters most after a failure.
    let transcript = player.write_transcript();
    played?;
    let transcript = transcript?;
    let summary = Summary::gather(&bus, player, transcript, &scene, start_seconds).await?;
    bus.close().await;
    Ok(summary)
}

/// Refuses a session that runs, while nothing is written yet. Later the supervisor's lock would refuse it too.
fn must_not_run(session: &SessionDir) -> Result<(), Failure> {
    if !session.is_running() {
        return Ok(());
    }
    let pid = file::read_text(&session.lock_file(), SMALL_TEXT_BYTES).unwrap_or_default().trim().to_owned();
    Err(StackError::SessionRuns { session: session.name().to_owned(), pid }.into())
}

/// Removes the sessions of killed and failed demos, because their pictures are large.
fn forget_dead_demos() {
    let sessions = std::fs::read_dir(session::run_root()).into_iter().flatten().flatten();
    for entry in sessions {
        let name = entry.file_name().to_string_lossy().into_owned();
        let Some(pid) = name.strip_prefix(SESSION) else { continue };
        let Ok(dead) = SessionDir::named(&name) else { continue };
        // A supervisor writes its id after it locks its session. A session without an id is starting.
        let written = file::read_text(&dead.lock_file(), SMALL_TEXT_BYTES).is_ok_and(|text| text.trim() == pid);
        if written && !dead.is_running() {
            // A leftover folder only takes disk space.
            let _ = std::fs::remove_dir_all(dead.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::SHIPPED_VOLUMES;
    use crate::shipped::DENSEST;
    use crate::strokes::read_strokes;
    use supergaussian::script;

    #[test]
    fn every_shipped_script_is_good_and_complete() {
        for known in SHIPPED_VOLUMES.into_iter().chain(["vessel", "generic"]) {
            let folder = tempfile::tempdir().unwrap();
            let files = shipped::unpack(folder.path(), Some(known)).unwrap();
            assert!(files.script.ends_with(format!("{known}.toml")), "no script for {known}");
            let text = std::fs::read_to_string(&files.script).unwrap();
            let steps = script::read(&files.script, &text).unwrap();
            let mut brushes = 0;
            for step in &steps {
                if let Step::Strokes { file, .. } = step {
                    brushes += 1;
                    if !file.ends_with(DENSEST) {
                        assert!(!read_strokes(file).unwrap().is_empty());
                    }
                }
            }
            assert!(brushes > 0, "{known} brushes nothing");
            let captures = steps.iter().filter(|s| matches!(s, Step::Capture { .. })).count();
            assert!(captures >= 4 && steps.contains(&Step::Chaos), "{known}");
        }
    }
}
