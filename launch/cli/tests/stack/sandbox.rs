//! A test folder with launch files, fixture services and running stacks.

use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use sg_proto::keys::role;
use sg_runtime::bus::{Bus, endpoint_of};

/// Longest wait of a test.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(20);

pub(crate) struct Sandbox {
    folder: tempfile::TempDir,
}

impl Sandbox {
    /// A folder with the executables `fixture` and `other` (a service, see `fixture.rs`), `crash`, `refuse` and `stubborn`.
    pub(crate) fn new() -> Self {
        let sandbox = Self { folder: tempfile::tempdir().unwrap() };
        let this = std::env::current_exe().unwrap();
        let fixture = format!(
            "ARGUMENTS=\"$(printf '%s\\n' \"$@\")\"; export ARGUMENTS\nexec '{}' --exact fixture::fixture --ignored --nocapture",
            this.display()
        );
        sandbox.script("fixture", &fixture);
        sandbox.script("other", &fixture);
        sandbox.script("crash", "echo 'cannot go on' >&2; exit 1");
        sandbox.script("refuse", "echo '{\"level\":\"ERROR\",\"message\":\"no such scene\"}' >&2; exit 2");
        sandbox.script("stubborn", "trap '' TERM\nwhile :; do sleep 0.1; done");
        sandbox
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn script(&self, name: &str, text: &str) {
        let path = self.path().join(name);
        std::fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Writes a launch file.
    pub(crate) fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    /// The command under test, limited to sessions of this folder.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_supergaussian"));
        command.args(arguments).env("SUPERGAUSSIAN_RUN_ROOT", self.path().join("run")).env_remove("SUPERGAUSSIAN_LOG");
        command.env("XDG_DATA_HOME", self.path().join("data"));
        // Services may run programs on PATH: the fixture is this test executable.
        let this = std::env::current_exe().unwrap();
        let path = std::env::var_os("PATH").unwrap_or_default();
        let folders = std::iter::once(this.parent().unwrap().to_owned()).chain(std::env::split_paths(&path));
        command.env("PATH", std::env::join_paths(folders).unwrap());
        command.env_remove("RUST_BACKTRACE");
        command
    }

    /// Runs the command to its end: exit status, standard output, standard error.
    pub(crate) fn run(&self, arguments: &[&str]) -> (i32, String, String) {
        let Output { status, stdout, stderr } = self.command(arguments).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (status.code().unwrap_or(-1), text(stdout), text(stderr))
    }

    /// Starts a stack.
    pub(crate) fn up(&self, arguments: &[&str]) -> Up {
        let errors = self.path().join(format!("{}.err", arguments.concat().replace('/', "-")));
        let stderr = std::fs::File::create(&errors).unwrap();
        let child = self.command(&[&["up"], arguments].concat()).stdin(Stdio::null()).stderr(stderr).spawn().unwrap();
        Up { child, errors }
    }

    /// Copies the command to a folder with dummy services, where these helper scripts stand in for others.
    pub(crate) fn install_beside(&self, others: &[(&str, &str)]) -> PathBuf {
        let folder = self.path().join("installed");
        std::fs::create_dir_all(&folder).unwrap();
        let services =
            ["scene", "selection", "labeling", "speech", "render-node", "agent-intent", "agent-function", "agent-core"];
        for service in services {
            self.script(&format!("installed/supergaussian-{service}"), "exec sleep 60");
        }
        // The scene's executable knows where things are kept.
        let places =
            format!("[ \"$1\" = projects ] && exec echo '{{\"scenes\": \"{}/scenes\"}}'", self.path().display());
        self.script("installed/supergaussian-scene", &format!("{places}\nexec sleep 60"));
        for (name, does) in others {
            self.script(&format!("installed/{name}"), does);
        }
        let command = folder.join("supergaussian");
        std::fs::copy(env!("CARGO_BIN_EXE_supergaussian"), &command).unwrap();
        command
    }

    /// Starts a stack with another copy of the command, on a fake display, or none if empty.
    pub(crate) fn up_by(&self, command: &Path, file: &Path, display: &str) -> Up {
        let errors = self.path().join("up-by.err");
        let stderr = std::fs::File::create(&errors).unwrap();
        let mut up = Command::new(command);
        up.arg("up").arg(file).env("SUPERGAUSSIAN_RUN_ROOT", self.path().join("run")).env("DISPLAY", display);
        up.env("XDG_DATA_HOME", self.path().join("data"));
        Up { child: up.stdin(Stdio::null()).stderr(stderr).spawn().unwrap(), errors }
    }

    /// The services of a running stack, or nothing.
    pub(crate) fn ps(&self, session: &str) -> Vec<Value> {
        let (status, out, _) = self.run(&["ps", "--json", "--session", session]);
        if status != 0 {
            return Vec::new();
        }
        let ps: Value = serde_json::from_str(&out).unwrap();
        ps["services"].as_array().unwrap().clone()
    }

    /// Waits until a service fulfils a condition, and returns it.
    pub(crate) fn wait(&self, session: &str, service: &str, wish: impl Fn(&Value) -> bool) -> Value {
        let began = Instant::now();
        let mut last = Vec::new();
        while began.elapsed() < TIMEOUT {
            last = self.ps(session);
            if let Some(found) = last.iter().find(|s| s["name"] == service && wish(s)) {
                return found.clone();
            }
            std::thread::sleep(Duration::from_millis(30));
        }
        panic!("`{service}` of {session} is not as wished: {last:#?}");
    }

    /// Joins the bus of a stack in such a folder with the role of the command line.
    pub(crate) async fn join_in(folder: &Path, session: &str) -> Bus {
        let socket = folder.join("run").join(session).join("bus.sock");
        Bus::connect(session, role::CLI, &endpoint_of(&socket)).await.unwrap()
    }

    /// Waits until a process is gone.
    pub(crate) fn gone(&self, pid: i32) {
        let began = Instant::now();
        while runs(pid) {
            assert!(began.elapsed() < TIMEOUT, "process {pid} of {} does not go", self.path().display());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits until a service is ready.
    pub(crate) fn ready(&self, session: &str, service: &str) -> Value {
        self.wait(session, service, |s| s["state"] == "READY")
    }
}

/// A running `supergaussian up`.
pub(crate) struct Up {
    child: Child,
    errors: PathBuf,
}

impl Up {
    pub(crate) fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(i32::try_from(self.child.id()).unwrap()), signal).unwrap();
    }

    /// Waits for its end: exit status and standard error.
    pub(crate) fn end(&mut self) -> (i32, String) {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return (status.code().unwrap_or(-1), self.errors());
            }
            assert!(began.elapsed() < TIMEOUT, "`up` does not end: {}", self.errors());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    pub(crate) fn errors(&self) -> String {
        let mut text = String::new();
        std::fs::File::open(&self.errors).unwrap().read_to_string(&mut text).unwrap();
        text
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub(crate) fn pid(service: &Value) -> i32 {
    i32::try_from(service["pid"].as_i64().unwrap()).unwrap()
}

/// Whether a process runs (a zombie does not).
pub(crate) fn runs(pid: i32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(')').next().is_some_and(|rest| !rest.is_empty() && !rest.trim_start().starts_with('Z'))
}
