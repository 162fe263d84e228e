//! A stack under a service manager such as systemd, played by a socket of the test.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::sandbox::{Sandbox, pid};

/// Receives what the stack says.
struct Manager(UnixDatagram);

impl Manager {
    fn listen(sandbox: &Sandbox) -> Self {
        let socket = UnixDatagram::bind(sandbox.path().join("notify")).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        Self(socket)
    }

    /// Lines that come in a while.
    fn during(&self, time: Duration) -> Vec<String> {
        let began = Instant::now();
        let mut lines = Vec::new();
        while began.elapsed() < time {
            let mut buffer = [0; 4096];
            if let Ok(length) = self.0.recv(&mut buffer) {
                lines.extend(String::from_utf8_lossy(&buffer[..length]).lines().map(str::to_owned));
            }
        }
        lines
    }

    /// Lines up to this one.
    fn until(&self, wanted: &str) -> Vec<String> {
        let began = Instant::now();
        let mut lines = Vec::new();
        while !lines.iter().any(|line| line == wanted) {
            assert!(began.elapsed() < Duration::from_secs(20), "no {wanted}: {lines:?}");
            lines.extend(self.during(Duration::from_millis(20)));
        }
        lines
    }
}

/// Whether the environment of a process names the service manager.
fn speaks(pid: u32) -> bool {
    let environment = std::fs::read(format!("/proc/{pid}/environ")).unwrap();
    let text = String::from_utf8_lossy(&environment);
    ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"].iter().any(|name| text.contains(name))
}

fn children(parent: u32) -> Vec<u32> {
    let text = std::fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).unwrap();
    text.split_whitespace().map(|pid| pid.parse().unwrap()).collect()
}

const FILE: &str = r#"
schema = 1
name = "f"
[service.one]
exec = "./fixture"
critical = true
params = { start_ms = 800 }
[service.slow]
exec = "./fixture"
params = { start_ms = 2500 }
"#;

#[test]
fn the_service_manager_learns_of_readiness_life_reload_and_end() {
    let sandbox = Sandbox::new();
    let manager = Manager::listen(&sandbox);
    let file = sandbox.file("f.toml", FILE);
    let mut command = sandbox.command(&["up", file.to_str().unwrap()]);
    command.env("NOTIFY_SOCKET", sandbox.path().join("notify")).env("WATCHDOG_USEC", "1200000");
    let mut up = command.stdin(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let supervisor = up.id();

    // The critical service is ready by then, and the other one is not.
    let said = manager.until("READY=1");
    assert_eq!(sandbox.ready("f", "one")["state"], "READY");
    assert!(said.contains(&"STATUS=session f: waits for one, slow".to_owned()), "{said:?}");
    manager.until("STATUS=session f: all 2 services ready");
    assert!(speaks(supervisor));
    let of_service = u32::try_from(pid(&sandbox.ready("f", "one"))).unwrap();
    assert!(!speaks(of_service) && children(supervisor).iter().all(|child| !speaks(*child)));

    // Signs of life come while the loop turns, and only then.
    let signs = |lines: Vec<String>| lines.iter().filter(|line| *line == "WATCHDOG=1").count();
    assert!(signs(manager.during(Duration::from_secs(2))) >= 3);
    let send = |signal| kill(Pid::from_raw(supervisor.cast_signed()), signal).unwrap();
    send(Signal::SIGSTOP);
    manager.during(Duration::from_millis(200));
    assert_eq!(signs(manager.during(Duration::from_millis(1500))), 0);
    send(Signal::SIGCONT);
    manager.until("WATCHDOG=1");

    sandbox.file("f.toml", &FILE.replace("2500", "10"));
    assert_eq!(sandbox.run(&["up", file.to_str().unwrap()]).0, 0);
    let said = manager.until("READY=1");
    let at = |wanted: &str| said.iter().position(|line| line.starts_with(wanted)).unwrap();
    assert!(at("RELOADING=1") < at("READY=1") && at("MONOTONIC_USEC=") < at("READY=1"), "{said:?}");

    send(Signal::SIGTERM);
    manager.until("STOPPING=1");
    assert!(up.wait().unwrap().success());
}

/// What `systemd-analyze` says about the unit file, under a home folder with the command.
fn analyzed(unit: &str) -> Option<String> {
    let home = tempfile::tempdir().unwrap();
    let bin = home.path().join(".local/bin");
    std::fs::create_dir_all(&bin).unwrap();
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_supergaussian"), bin.join("supergaussian")).unwrap();
    let file = home.path().join("supergaussian@lab.service");
    std::fs::write(&file, unit).unwrap();
    let mut verify = Command::new("systemd-analyze");
    verify.args(["verify", "--user"]).arg(&file).env("HOME", home.path()).env("XDG_RUNTIME_DIR", home.path());
    let output = verify.output().ok()?;
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    Some(if output.status.success() { said } else { format!("{}: {said}", output.status) })
}

#[test]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn the_unit_file_is_valid() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ops/systemd/supergaussian@.service");
    let unit = std::fs::read_to_string(path).unwrap();
    for line in
        ["Type=notify", "KillMode=mixed", "Delegate=yes", "Restart=on-failure", "WatchdogSec=20", "NoNewPrivileges=yes"]
    {
        assert!(unit.lines().any(|l| l == line), "{line}");
    }
    let Some(said) = analyzed(&unit) else {
        eprintln!("SKIPPED: no `systemd-analyze` on this machine; the unit file is not verified");
        return;
    };
    assert_eq!(said, "");
    let wrong = analyzed(&unit.replace("KillMode=mixed", "KillMode=sometimes")).unwrap();
    assert!(wrong.contains("kill mode"), "{wrong}");
}
