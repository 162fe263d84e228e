//! Runs one input and compares what happened with what must happen.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use sg_input::printable_lines;

use crate::case::{Case, Content, Ending};

/// Longest time of a command.
const TIME: Duration = Duration::from_secs(1);
/// Time after which a command is killed.
const HANGS: Duration = Duration::from_secs(20);
/// Most memory of a command.
const MEMORY_KIB: i64 = 300 << 10;
/// Runs of a command that was slow; the machine may have been busy.
const TRIES: usize = 3;

struct Outcome {
    status: Option<ExitStatus>,
    time: Duration,
    out: String,
    errors: String,
}

/// The lines about a case that went wrong.
pub(crate) fn complaints(case: &Case) -> Vec<String> {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("inputs");
    std::fs::create_dir(&folder).unwrap();
    let sockets: Vec<UnixListener> =
        case.files.iter().filter_map(|(name, content)| make(&folder.join(name), content)).collect();
    let mut complaints = Vec::new();
    let before = listing(&folder);
    let memory = memory_kib();
    let mut outcome = run(case, &folder, place.path());
    for _ in 1..TRIES {
        if case.ending == Ending::Done || (TIME..HANGS).contains(&outcome.time) {
            if outcome.time < TIME {
                break;
            }
            outcome = run(case, &folder, place.path());
        }
    }
    drop(sockets);
    let Outcome { status, time, out, errors } = outcome;
    let said: String = errors.chars().take(600).collect();
    match (status.and_then(|s| s.code()), case.ending) {
        (None, _) if time >= HANGS => complaints.push("hangs".to_owned()),
        (Some(0), Ending::Done) => {}
        (Some(2), Ending::Refused | Ending::Mistakes) => {}
        (code, _) => complaints.push(format!("exit status {code:?}, {status:?}: {said}")),
    }
    if time >= TIME {
        complaints.push(format!("takes {:.1} s", time.as_secs_f64()));
    }
    if memory_kib() > MEMORY_KIB && memory <= MEMORY_KIB {
        complaints.push(format!("takes {} MiB, or the input beside it does", memory_kib() >> 10));
    }
    let text = format!("{out}{errors}");
    if printable_lines(&text) != text {
        complaints.push(format!("writes {said:?}"));
    }
    if case.ending != Ending::Done {
        if !out.is_empty() {
            complaints.push(format!("says on standard output: {}", out.chars().take(200).collect::<String>()));
        }
        let lines: Vec<&str> = errors.lines().collect();
        let fits = match case.ending {
            Ending::Mistakes => {
                let own = lines.iter().filter(|l| !l.starts_with("  ")).count();
                (1..=21).contains(&own) && lines.first().is_some_and(|l| !l.starts_with("  "))
            }
            _ => lines.len() == 1,
        };
        if !fits || lines.first().is_none_or(|l| l.trim().len() < 10) {
            complaints.push(format!("{} lines: {said}", lines.len()));
        }
        if errors.contains("panicked") {
            complaints.push("panics".to_owned());
        }
        let after = listing(&folder);
        if after != before {
            let new: Vec<_> =
                after.iter().filter(|(name, _)| !before.contains_key(*name)).map(|(name, _)| name).collect();
            complaints.push(format!("changes the folder; new: {new:?}"));
        }
    }
    complaints
}

/// A complaint about memory that no case was blamed for.
pub(crate) fn memory_complaint() -> Option<String> {
    let most = memory_kib();
    eprintln!("most memory of a command: {} MiB", most >> 10);
    (most > MEMORY_KIB).then(|| format!("a command took {} MiB", most >> 10))
}

/// The most memory that an ended child took.
fn memory_kib() -> i64 {
    getrusage(UsageWho::RUSAGE_CHILDREN).unwrap().max_rss()
}

fn make(path: &Path, content: &Content) -> Option<UnixListener> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).unwrap();
    }
    match content {
        Content::Bytes(bytes) => std::fs::write(path, bytes).unwrap(),
        Content::Pipe => mkfifo(path, Mode::S_IRWXU).unwrap(),
        Content::Socket => return Some(UnixListener::bind(path).unwrap()),
        Content::Folder => std::fs::create_dir(path).unwrap(),
        Content::Link(to) => std::os::unix::fs::symlink(to, path).unwrap(),
        Content::Holes(length) => File::create(path).unwrap().set_len(*length).unwrap(),
    }
    None
}

/// Everything below a folder, with what a change would change.
fn listing(folder: &Path) -> BTreeMap<PathBuf, (u64, u64, i64, i64)> {
    let mut all = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let entry = entry.unwrap();
            let is = entry.metadata().unwrap();
            if is.is_dir() {
                folders.push(entry.path());
            }
            all.insert(entry.path(), (is.ino(), is.len(), is.mtime(), is.mtime_nsec()));
        }
    }
    all
}

fn run(case: &Case, folder: &Path, place: &Path) -> Outcome {
    let [out, errors] = ["out", "errors"].map(|name| place.join(name));
    let mut command: Command = sg_tests::command(&place.join("runs")).unwrap();
    command.args(&case.words).current_dir(folder).stdin(Stdio::null());
    command.env("HOME", place).env("XDG_RUNTIME_DIR", place).env("XDG_DATA_HOME", place).env("XDG_CACHE_HOME", place);
    command.env_remove("SUPERGAUSSIAN_READ_MIB").env_remove("RUST_BACKTRACE");
    command.stdout(File::create(&out).unwrap()).stderr(File::create(&errors).unwrap());
    let began = Instant::now();
    let mut child = command.spawn().unwrap();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break Some(status);
        }
        if began.elapsed() > HANGS {
            child.kill().unwrap();
            child.wait().unwrap();
            break None;
        }
        std::thread::sleep(Duration::from_millis(3));
    };
    let time = began.elapsed();
    let read = |path: &Path| {
        let mut bytes = Vec::new();
        File::open(path).unwrap().take(1 << 20).read_to_end(&mut bytes).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    Outcome { status, time, out: read(&out), errors: read(&errors) }
}
