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

/// Says loudly that this kernel confines nothing, or too little for a test.
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn confines(least: u32) -> bool {
    match sg_confinement::support() {
        sg_confinement::Support::Version(version) if version >= least => true,
        support => {
            eprintln!("SKIPPED: this test needs version {least} of Landlock; {support}");
            false
        }
    }
}

/// What a service says that it could do: the lines after `tried`.
fn tried(sandbox: &Sandbox, service: &str) -> Vec<String> {
    let log = sandbox.run(&["logs", service]).1;
    log.lines().filter_map(|line| Some(line.split_once("tried ")?.1.to_owned())).collect()
}

#[test]
fn a_service_reads_and_changes_its_own_files_only() {
    if !confines(6) {
        return;
    }
    let sandbox = Sandbox::new();
    // Not in the folder of the executable, which a service may read.
    let home = tempfile::tempdir().unwrap();
    let mut paths = Vec::new();
    for name in [".ssh/id_ed25519", "given/model", "outputs/table", ".config/secret"] {
        let path = home.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, "text").unwrap();
        paths.push(path.display().to_string());
    }
    let executable = home.path().join("bin/fixture");
    std::fs::create_dir(executable.parent().unwrap()).unwrap();
    std::fs::copy(sandbox.path().join("fixture"), &executable).unwrap();
    let run = sandbox.path().join("run/f");
    // Parameters of another service, and the supervisor's own files.
    for name in ["params/other.1.json", "supervisor.lock"] {
        paths.push(run.join(name).display().to_string());
    }
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let text = format!(
        r#"
schema = 1
[defaults]
env = {{ TRIED_PATHS = "{paths}", TRIED_ADDRESS = "{address}", TRIED_PROCESS = "{process}" }}
[service.other]
exec = "{home}/bin/fixture"
params = {{ secret = "s" }}
[service.scene]
exec = "{home}/bin/fixture"
after = {{ other = "ready" }}
params = {{ ledger = "{home}/given/model" }}
[service.free]
exec = "{home}/bin/fixture"
confined = false
after = {{ scene = "ready", more = "ready" }}
[service.more]
exec = "{home}/bin/fixture"
after = {{ scene = "ready" }}
write = ["{home}/outputs"]
"#,
        paths = paths.join(":"),
        address = listener.local_addr().unwrap(),
        process = std::process::id(),
        home = home.path().display(),
    );
    let file = sandbox.file("f.toml", &text);
    let up = sandbox.up(&[file.to_str().unwrap()]);
    sandbox.ready("f", "free");
    let (denied, done) = ("PermissionDenied", "done");
    let line = |name: &str, read: &str, written: &str| format!("{name} read={read} written={written}");
    let system = |connected: &str, signalled: &str| {
        [format!("a connection connected={connected}"), format!("a process signalled={signalled}")]
    };
    let ssh = |read| line("id_ed25519", read, read);
    let of_scene = [
        ssh(denied),
        // Named in its parameters.
        line("model", done, denied),
        line("table", denied, denied),
        line("secret", denied, denied),
        line("other.1.json", denied, denied),
        line("supervisor.lock", denied, denied),
    ];
    assert_eq!(tried(&sandbox, "scene"), [&of_scene[..], &system(denied, denied)].concat(), "{}", up.errors());
    let more = tried(&sandbox, "more");
    assert_eq!(more[2], line("table", done, done));
    assert_eq!((&more[0], &more[1], &more[6]), (&ssh(denied), &line("model", denied, denied), &system(done, "")[0]));
    let free = tried(&sandbox, "free");
    assert_eq!((&free[0], &free[6..]), (&ssh(done), &system(done, done)[..]));
    assert!(up.errors().contains("services are confined (Landlock, version"), "{}", up.errors());
    assert!(up.errors().contains("except for free"), "{}", up.errors());
}

#[test]
fn the_folder_for_temporary_files_is_the_services_own() {
    let sandbox = Sandbox::new();
    sandbox.script("scratch", "cat <<END > \"$TMPDIR/note\"\n$TMPDIR\nEND\ncat \"$TMPDIR/note\"; exit 3");
    let file = sandbox
        .file("f.toml", "schema = 1\n[service.one]\nexec = \"./scratch\"\nrestart = \"never\"\ncritical = true\n");
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    up.end();
    let folder = sandbox.path().join("run/f/blobs/one.1");
    let (_, log, _) = sandbox.run(&["logs", "one", "--session", "f"]);
    let said = log + &up.errors();
    assert!(confines(1).then_some(()).is_none_or(|()| said.contains(folder.to_str().unwrap())), "{said}");
}
