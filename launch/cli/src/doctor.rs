//! `doctor`: checks of this machine and this installation.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sg_confinement::Support;
use sg_input::file::read_text;
use sg_input::limits::SMALL_TEXT_BYTES;
use sg_runtime::session;
use sg_stack::control_group;
use sg_stack::file::ExecutableSearch;
use sg_stack::spawn::tied_to_parent;

use crate::certificate_expiry::check_expiry;
use crate::subcommands;
use crate::terminal::{self, Color, CommandResult, Failure, columns, format_count, paint};
use crate::up::FileArgs;

/// Longest run of a program that a check starts.
const PROGRAM_TIME: Duration = Duration::from_secs(60);
/// Longest output of such a program that is read, in bytes.
const PROGRAM_OUTPUT: u64 = 1 << 20;
/// Free space of a folder below which a check fails, in bytes.
const LEAST_SPACE: u64 = 64 << 20;
/// Free space of a folder below which a check has a note, in bytes.
const LITTLE_SPACE: u64 = 1 << 30;
/// Version of Landlock that confines everything that the services' rights name.
const COMPLETE: u32 = 6;
/// Services that no command runs.
const AGENTS: [&str; 3] = ["supergaussian-agent-core", "supergaussian-agent-function", "supergaussian-agent-intent"];
/// A scene of one Gaussian in the layout of 3DGS.
const SCENE: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
    property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n\
    property float scale_0\nproperty float scale_1\nproperty float scale_2\n\
    property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\nend_header\n\
    0 0 0 1 1 1 4 -1 -1 -1 1 0 0 0\n";

#[derive(Debug, clap::Args)]
pub(crate) struct DoctorArgs {
    /// Launch file to check too, with its executables and certificates
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Outcome of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Passed,
    /// Works, with a limitation.
    Limited,
    Failed,
}

impl Outcome {
    fn word(self) -> &'static str {
        match self {
            Self::Passed => "ok",
            Self::Limited => "note",
            Self::Failed => "FAILED",
        }
    }
}

/// One line of the report.
#[derive(Debug, PartialEq, Eq)]
struct Check {
    name: &'static str,
    outcome: Outcome,
    detail: String,
}

impl Check {
    fn passed(name: &'static str, detail: impl Into<String>) -> Self {
        Self { name, outcome: Outcome::Passed, detail: detail.into() }
    }

    fn limited(name: &'static str, detail: impl Into<String>) -> Self {
        Self { name, outcome: Outcome::Limited, detail: detail.into() }
    }

    fn failed(name: &'static str, detail: impl Into<String>) -> Self {
        Self { name, outcome: Outcome::Failed, detail: detail.into() }
    }
}

/// Runs every check and prints a table.
///
/// # Errors
/// A failed check.
pub(crate) fn doctor(arguments: &DoctorArgs) -> CommandResult {
    let search = ExecutableSearch::here_then_path();
    let mut checks = vec![
        executables(&search),
        cores_and_memory(),
        run_folder(&session::run_root()),
        confinement(),
        control_groups(),
    ];
    checks.extend(pictures(&search));
    checks.extend([window(), headset(), movies()]);
    if let Some(file) = &arguments.file {
        checks.push(launch_file(file));
    }
    if arguments.json {
        let rows: Vec<Value> = checks
            .iter()
            .map(|check| json!({ "check": check.name, "outcome": check.outcome.word(), "detail": check.detail }))
            .collect();
        terminal::print_line(&json!({ "version": VERSION, "checks": rows }).to_string());
    } else {
        print(&checks);
    }
    match checks.iter().filter(|check| check.outcome == Outcome::Failed).count() {
        0 => Ok(()),
        1 => Err(Failure::Work("one check failed; its line has the remedy".to_owned())),
        n => Err(Failure::Work(format!("{n} checks failed; their lines have the remedies"))),
    }
}

const VERSION: &str = env!("CARGO_PKG_VERSION");

fn print(checks: &[Check]) {
    let titles = ["CHECK", "RESULT", "DETAIL"].map(str::to_owned).to_vec();
    let rows = checks.iter().map(|c| vec![c.name.to_owned(), c.outcome.word().to_owned(), c.detail.clone()]);
    let rows: Vec<Vec<String>> = std::iter::once(titles).chain(rows).collect();
    let colored = terminal::stdout_colored();
    for line in columns(&rows) {
        let line = if line.contains(Outcome::Failed.word()) { paint(Color::Red, &line, colored) } else { line };
        terminal::print_line(&line);
    }
}

/// Every executable is there, in the version of this command.
fn executables(search: &ExecutableSearch) -> Check {
    const NAME: &str = "executables";
    let mut problems = Vec::new();
    let names: Vec<&str> = subcommands::executables().chain(AGENTS).collect();
    for name in &names {
        match search.find(name, Path::new("")) {
            Err(error) => problems.push(error.to_string()),
            Ok(path) => match output_of(&path, &["--version".as_ref()]) {
                Ok(text) if text.split_whitespace().last() == Some(VERSION) => {}
                Ok(text) => problems.push(format!("{} is `{}`, not {VERSION}", path.display(), text.trim())),
                Err(reason) => problems.push(format!("{}: {reason}", path.display())),
            },
        }
    }
    if problems.is_empty() {
        return Check::passed(NAME, format!("{} of version {VERSION}", names.len() + 1));
    }
    Check::failed(NAME, problems.join("; "))
}

fn cores_and_memory() -> Check {
    const NAME: &str = "cores, memory";
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let text = read_text(Path::new("/proc/meminfo"), SMALL_TEXT_BYTES).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let Some(kib) = line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok()) else {
        return Check::limited(NAME, format!("{cores} cores; /proc/meminfo does not tell the free memory"));
    };
    let detail = format!("{cores} cores, {} MiB free", format_count(kib / 1024));
    // A million Gaussians take about this in all processes together.
    if kib / 1024 < 2048 {
        Check::limited(NAME, detail + "; large scenes need 2,048")
    } else {
        Check::passed(NAME, detail)
    }
}

/// The folder of sessions belongs to this user alone and has room.
fn run_folder(root: &Path) -> Check {
    const NAME: &str = "run folder";
    let shown = root.display();
    // A session makes the folder at its start.
    let existing = root.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("/"));
    if existing == root
        && let Err(error) = session::check_private(root)
    {
        return Check::failed(NAME, format!("{error}, or run `chmod 700 {shown}` on a folder of your own"));
    }
    if nix::unistd::access(existing, nix::unistd::AccessFlags::W_OK).is_err() {
        return Check::failed(NAME, format!("{} cannot be written; set {}", existing.display(), session::RUN_ROOT));
    }
    let free = match rustix::fs::statvfs(existing) {
        Ok(space) => space.f_bavail.saturating_mul(space.f_frsize),
        Err(error) => return Check::failed(NAME, format!("{}: {error}", existing.display())),
    };
    let detail = format!("{shown}, {} MiB free", format_count(free >> 20));
    match free {
        free if free < LEAST_SPACE => Check::failed(NAME, detail + "; make room"),
        free if free < LITTLE_SPACE => Check::limited(NAME, detail + "; pictures and scenes need more"),
        _ => Check::passed(NAME, detail),
    }
}

/// The kernel can confine services.
fn confinement() -> Check {
    const NAME: &str = "confinement";
    match sg_confinement::support() {
        support @ Support::Version(version) if version < COMPLETE => Check::limited(
            NAME,
            format!("{support}; version {COMPLETE} (Linux 6.12) also confines sockets and signals"),
        ),
        support @ Support::Version(_) => Check::passed(NAME, support.to_string()),
        missing => Check::limited(NAME, format!("services are not confined: {missing}")),
    }
}

/// The kernel can end a service with everything that it has started.
fn control_groups() -> Check {
    const NAME: &str = "control groups";
    match control_group::delegated() {
        Some(folder) => Check::passed(NAME, folder.display().to_string()),
        None => Check::limited(NAME, "none delegated; a mark in the environment finds the children of services"),
    }
}

/// Draws one Gaussian on the cores and on the graphics device.
fn pictures(search: &ExecutableSearch) -> [Check; 2] {
    const NAMES: [&str; 2] = ["pictures, cores", "pictures, device"];
    let drawn = |backend: &str| -> Result<String, String> {
        let folder = scratch_folder()?;
        let drawn = draw(search, &folder, backend);
        // The folder holds nothing but the trial.
        let _ = std::fs::remove_dir_all(&folder);
        drawn
    };
    let cores = match drawn("cpu") {
        Ok(engine) => Check::passed(NAMES[0], engine),
        Err(reason) => Check::failed(NAMES[0], reason),
    };
    let device = match drawn("gpu") {
        Ok(engine) => Check::passed(NAMES[1], engine),
        Err(reason) => Check::limited(NAMES[1], format!("the cores draw; {reason}")),
    };
    [cores, device]
}

/// A new folder of this user.
fn scratch_folder() -> Result<PathBuf, String> {
    let stamp = std::time::SystemTime::UNIX_EPOCH.elapsed().map_or(0, |time| time.as_nanos());
    let folder = std::env::temp_dir().join(format!("supergaussian-doctor-{}-{stamp}", std::process::id()));
    let made = std::fs::create_dir(&folder).and_then(|()| std::fs::write(folder.join("one.ply"), SCENE));
    made.map(|()| folder.clone()).map_err(|e| format!("{}: {e}", folder.display()))
}

/// Draws the scene of a scratch folder. Returns the engine and the time.
fn draw(search: &ExecutableSearch, folder: &Path, backend: &str) -> Result<String, String> {
    let program = search.find("supergaussian-render-node", Path::new("")).map_err(|e| e.to_string())?;
    let (scene, out) = (folder.join("one.ply"), folder.join("one.png"));
    let words = ["--backend", backend, "--width", "64", "--height", "64", "--json", "--out"];
    let mut arguments: Vec<&std::ffi::OsStr> = words.iter().map(AsRef::as_ref).collect();
    arguments.extend([out.as_os_str(), scene.as_os_str()]);
    let begun = Instant::now();
    let report: Value = serde_json::from_str(&output_of(&program, &arguments)?).map_err(|e| e.to_string())?;
    if report["drawn"] != 1 {
        return Err("the picture of one Gaussian is empty; report this with `supergaussian doctor --json`".to_owned());
    }
    let engine = report["backend"].as_str().unwrap_or("unknown");
    Ok(format!("{engine}, ready in {:.1} s", begun.elapsed().as_secs_f64()))
}

fn window() -> Check {
    const NAME: &str = "window";
    match std::env::var("DISPLAY") {
        Ok(display) if !display.is_empty() => Check::passed(NAME, format!("X11 display {display}")),
        _ => Check::limited(NAME, "no X11 display (DISPLAY); use launch/headless.toml, or start an X server"),
    }
}

/// The active runtime of OpenXR, where its loader looks for it.
fn headset() -> Check {
    const NAME: &str = "headset";
    let named = std::env::var_os("XR_RUNTIME_JSON").map(PathBuf::from);
    let config = std::env::var_os("XDG_CONFIG_HOME").map(PathBuf::from);
    let config = config.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".config")));
    let below = |folder: PathBuf| folder.join("openxr/1/active_runtime.json");
    let system = ["/etc/xdg", "/etc"].map(|folder| below(PathBuf::from(folder)));
    let mut places = named.into_iter().chain(config.map(below)).chain(system);
    match places.find(|place| place.is_file()) {
        Some(place) => Check::passed(NAME, format!("OpenXR runtime {}", place.display())),
        None => Check::limited(NAME, "no OpenXR runtime is active; start SteamVR, Monado or another"),
    }
}

fn movies() -> Check {
    const NAME: &str = "movies";
    match ExecutableSearch::here_then_path().find("ffmpeg", Path::new("")) {
        Ok(path) => Check::passed(NAME, path.display().to_string()),
        Err(_) => Check::limited(NAME, "no ffmpeg on PATH; a movie is saved as pictures"),
    }
}

/// The launch file is valid, its executables are there, and its certificates have not expired.
fn launch_file(path: &Path) -> Check {
    const NAME: &str = "launch file";
    let checked = FileArgs::of(path).load().and_then(|file| {
        let listen = file.listen.iter().flat_map(|listen| [listen.authority.as_path(), listen.certificate.as_path()]);
        check_expiry(listen).map(|()| file.services.len())
    });
    match checked {
        Ok(services) => Check::passed(NAME, format!("{}: valid, {services} services", path.display())),
        Err(failure) => Check::failed(NAME, failure.text().replace('\n', " ")),
    }
}

/// Standard output of a program that succeeds in time, else the reason.
fn output_of(program: &Path, arguments: &[&std::ffi::OsStr]) -> Result<String, String> {
    let mut child = tied_to_parent(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| e.to_string())?;
    let collect = |stream: Option<Box<dyn std::io::Read + Send>>| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            // A broken pipe ends the text where it broke.
            let _ = stream.map(|stream| stream.take(PROGRAM_OUTPUT).read_to_end(&mut bytes));
            String::from_utf8_lossy(&bytes).into_owned()
        })
    };
    let out = collect(child.stdout.take().map(|s| Box::new(s) as Box<dyn std::io::Read + Send>));
    let errors = collect(child.stderr.take().map(|s| Box::new(s) as Box<dyn std::io::Read + Send>));
    let begun = Instant::now();
    let status = loop {
        match child.try_wait().map_err(|e| e.to_string())? {
            Some(status) => break status,
            None if begun.elapsed() > PROGRAM_TIME => {
                // It is past its time either way.
                let _ = child.kill().and_then(|()| child.wait());
                return Err(format!("no end within {} s", PROGRAM_TIME.as_secs()));
            }
            None => std::thread::sleep(Duration::from_millis(10)),
        }
    };
    let (out, errors) = (out.join().unwrap_or_default(), errors.join().unwrap_or_default());
    if status.success() {
        return Ok(out);
    }
    let last = errors.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
    Err(if last.is_empty() { status.to_string() } else { last.trim_start_matches("error: ").to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn a_run_folder_of_others_fails() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("run");
        assert_ne!(run_folder(&root).outcome, Outcome::Failed, "a session would make it");
        std::fs::create_dir(&root).unwrap();
        std::fs::set_permissions(&root, std::fs::Permissions::from_mode(0o777)).unwrap();
        let open = run_folder(&root);
        assert!(open.outcome == Outcome::Failed && open.detail.contains("chmod 700"), "{open:?}");
        std::fs::set_permissions(&root, std::fs::Permissions::from_mode(0o700)).unwrap();
        assert_ne!(run_folder(&root).outcome, Outcome::Failed);
    }

    #[test]
    fn a_missing_executable_fails_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let search = ExecutableSearch::in_folders(vec![folder.path().to_owned()]);
        let check = executables(&search);
        assert!(check.outcome == Outcome::Failed && check.detail.contains("supergaussian-scene"), "{check:?}");
        assert_eq!(pictures(&search).map(|check| check.outcome), [Outcome::Failed, Outcome::Limited]);
    }

    #[test]
    fn a_broken_launch_file_fails() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("stack.toml");
        std::fs::write(&file, "schema = 99\n").unwrap();
        let check = launch_file(&file);
        assert!(check.outcome == Outcome::Failed && check.detail.contains("stack.toml"), "{check:?}");
    }
}
