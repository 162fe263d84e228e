//! Services have no more rights than they need, and nothing in a session's folder leads out of it.

use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

use nix::sys::stat::Mode;
use nix::unistd::mkfifo;

use crate::sandbox::{Sandbox, pid};

#[test]
fn a_service_has_no_new_privileges_no_core_dumps_and_secret_parameters() {
    let sandbox = Sandbox::new();
    let secret = "correct-horse-battery";
    let text = format!("schema = 1\n[service.one]\nexec = \"./fixture\"\nparams = {{ secret = \"{secret}\" }}\n");
    let file = sandbox.file("f.toml", &text);
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    let pid = pid(&sandbox.ready("f", "one"));
    let proc = |name: &str| std::fs::read_to_string(format!("/proc/{pid}/{name}")).unwrap();
    assert!(proc("status").contains("NoNewPrivs:\t1"));
    let limits = proc("limits");
    let limit = |name: &str| limits.lines().find(|l| l.starts_with(name)).unwrap().split_whitespace().nth(4).unwrap();
    assert_eq!(limit("Max core file size"), "0");
    let open_files = limits.lines().find(|l| l.starts_with("Max open files")).unwrap();
    assert!(open_files.split_whitespace().nth(4).unwrap().parse::<u64>().unwrap() <= 8192, "{open_files}");
    // The secret has arrived, and only in the file.
    assert!(sandbox.run(&["logs", "one"]).1.contains(&format!("the secret is known length={}", secret.len())));
    for process in std::fs::read_dir("/proc").unwrap().flatten() {
        let arguments = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
        assert!(!String::from_utf8_lossy(&arguments).contains(secret), "{}", process.path().display());
    }
    let params = sandbox.path().join("run/f/params/one.1.json");
    assert_eq!(std::fs::metadata(&params).unwrap().permissions().mode() & 0o777, 0o600);
    assert!(std::fs::read_to_string(&params).unwrap().contains(secret));
    assert_eq!(sandbox.run(&["down"]).0, 0);
    assert_eq!(up.end().0, 0);
    assert!(!params.exists(), "parameters go with their process");
}

/// `up` refuses at once, in one line that contains `said`.
fn refused(sandbox: &Sandbox, said: &str) {
    let file = sandbox.file("f.toml", "schema = 1\n[service.one]\nexec = \"./fixture\"\n");
    let began = Instant::now();
    let (status, out, errors) = sandbox.run(&["up", file.to_str().unwrap()]);
    assert!(status > 0 && errors.lines().count() == 1 && errors.contains(said), "{status} {out}{errors}");
    // No search for sessions waits for a pipe.
    assert_eq!(sandbox.run(&["ps"]).0, 1);
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

#[test]
fn links_and_pipes_in_a_sessions_folder_are_refused() {
    for name in ["supervisor.lock", "processes", "bus.sock", "logs/one.log", "blobs/x.npy"] {
        let sandbox = Sandbox::new();
        let path = sandbox.path().join("run/f").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        for folder in ["run", "run/f"] {
            let private = std::fs::Permissions::from_mode(0o700);
            std::fs::set_permissions(sandbox.path().join(folder), private).unwrap();
        }
        mkfifo(&path, Mode::S_IRWXU).unwrap();
        refused(&sandbox, "is a named pipe");
        std::fs::remove_file(&path).unwrap();
        let target = sandbox.file("target", "kept");
        std::os::unix::fs::symlink(&target, &path).unwrap();
        refused(&sandbox, "is a symbolic link");
        assert_eq!(std::fs::read_to_string(&target).unwrap(), "kept");
    }
}

#[test]
fn the_folder_of_all_sessions_must_be_private() {
    let sandbox = Sandbox::new();
    let run = sandbox.path().join("run");
    std::fs::create_dir(&run).unwrap();
    std::fs::set_permissions(&run, std::fs::Permissions::from_mode(0o755)).unwrap();
    refused(&sandbox, "belongs to another user");
    std::fs::remove_dir(&run).unwrap();
    let elsewhere = sandbox.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    std::fs::set_permissions(&elsewhere, std::fs::Permissions::from_mode(0o700)).unwrap();
    std::os::unix::fs::symlink(&elsewhere, &run).unwrap();
    refused(&sandbox, "is a link");
    std::fs::remove_file(&run).unwrap();
    if nix::unistd::geteuid().is_root() {
        std::fs::create_dir(&run).unwrap();
        std::fs::set_permissions(&run, std::fs::Permissions::from_mode(0o700)).unwrap();
        std::os::unix::fs::chown(&run, Some(65_534), None).unwrap();
        refused(&sandbox, "belongs to another user");
    }
}
