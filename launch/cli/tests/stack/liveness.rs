//! Liveness that means progress: hung work is noticed, and nobody is judged by a supervisor that did not run.

use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use crate::sandbox::{Sandbox, TIMEOUT, Up, pid, runs};

/// Six services under the usual limits.
const SIX: &str = r#"
schema = 1
[service.one]
exec = "./fixture"
[service.two]
exec = "./fixture"
[service.three]
exec = "./fixture"
[service.four]
exec = "./fixture"
[service.five]
exec = "./fixture"
[service.six]
exec = "./fixture"
"#;

fn pids(services: &[Value]) -> Vec<(String, i32)> {
    services.iter().map(|s| (s["name"].as_str().unwrap().to_owned(), pid(s))).collect()
}

/// Stops a supervisor for longer than a service may be silent. No service may be restarted.
fn stands_still(sandbox: &Sandbox, up: &Up, stop: Signal, time: Duration) {
    let before = pids(&sandbox.ps("six"));
    assert_eq!(before.len(), 6);
    up.signal(stop);
    std::thread::sleep(time);
    up.signal(Signal::SIGCONT);
    // Every judgement of the silence would be made by now.
    std::thread::sleep(Duration::from_secs(7));
    for name in ["one", "six"] {
        sandbox.ready("six", name);
    }
    let after = sandbox.ps("six");
    assert_eq!(pids(&after), before, "{}", up.errors());
    assert!(after.iter().all(|s| s["restarts"] == 0 && s["state"] == "READY"), "{after:#?}");
}

#[test]
fn a_stopped_supervisor_restarts_nobody() {
    let sandbox = Sandbox::new();
    let file = sandbox.file("six.toml", SIX);
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    for name in ["one", "two", "three", "four", "five", "six"] {
        sandbox.ready("six", name);
    }
    stands_still(&sandbox, &up, Signal::SIGSTOP, Duration::from_millis(7500));
    assert!(up.errors().contains("the supervisor did not run for 7."), "{}", up.errors());
    // Longer than a client's attempt to connect again.
    stands_still(&sandbox, &up, Signal::SIGSTOP, Duration::from_secs(16));
    // A service that dies meanwhile is restarted, and only that.
    let three = sandbox.ready("six", "three");
    up.signal(Signal::SIGSTOP);
    kill(Pid::from_raw(pid(&three)), Signal::SIGKILL).unwrap();
    std::thread::sleep(Duration::from_secs(6));
    up.signal(Signal::SIGCONT);
    sandbox.wait("six", "three", |s| s["state"] == "READY" && s["restarts"] == 1);
    let others = sandbox.ps("six");
    assert!(others.iter().all(|s| s["name"] == "three" || s["restarts"] == 0), "{others:#?}");
    up.signal(Signal::SIGINT);
    assert_eq!(up.end().0, 0, "{}", up.errors());
}

/// A stack of one service with this policy and these parameters.
fn one(sandbox: &Sandbox, policy: &str, params: &str) -> Up {
    let text = format!(
        "schema = 1\n[defaults]\nbackoff = {{ initial_ms = 10, max_ms = 100 }}\n[service.one]\nexec = \"./fixture\"\nrole = \"agent-core\"\n{policy}\nparams = {{ {params} }}\n"
    );
    let file = sandbox.file("f.toml", &text);
    sandbox.up(&[file.to_str().unwrap()])
}

#[test]
fn hung_work_is_told_and_then_restarted() {
    let sandbox = Sandbox::new();
    let mut up = one(&sandbox, "progress = 4", "work_ms = 3600000");
    // Its process sends signs of life all along.
    // Either part may come a moment before the other.
    let is_whole = |busy: &str| busy.contains("busy with a message") && busy.contains("waiting");
    let busy = sandbox.wait("f", "one", |s| s["busy"].as_str().is_some_and(is_whole));
    let told = busy["busy"].as_str().unwrap();
    assert!(told.starts_with("busy with a message for ") && told.contains("1 waiting, the oldest for "), "{told}");
    assert_eq!(busy["restarts"], 0);
    sandbox.wait("f", "one", |s| s["restarts"].as_u64() >= Some(1));
    let errors = up.errors();
    assert!(errors.contains("hung: actor `worker`, busy with a message, has made no progress for"), "{errors}");
    up.signal(Signal::SIGINT);
    assert_eq!(up.end().0, 0);
}

#[test]
fn work_that_makes_progress_may_take_long() {
    let sandbox = Sandbox::new();
    let up = one(&sandbox, "progress = 2\nready = 2.5", "load_ms = 5000, work_ms = 6000, part_ms = 200");
    let began = Instant::now();
    while !sandbox.run(&["logs", "one"]).1.contains("the work is done") {
        assert!(began.elapsed() < TIMEOUT, "{}", up.errors());
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(sandbox.ready("f", "one")["restarts"], 0, "{}", up.errors());
}

#[test]
fn a_panic_in_a_handler_ends_the_process() {
    let sandbox = Sandbox::new();
    let _up = one(&sandbox, "intensity = { restarts = 1000, within_s = 1 }", "panics = true");
    let first = sandbox.ready("f", "one");
    let (status, out, errors) = sandbox.run(&["say", "undo", "--timeout", "5"]);
    assert_eq!(status, 1, "{out}{errors}");
    let again = sandbox.wait("f", "one", |s| s["state"] == "READY" && s["restarts"].as_u64() >= Some(1));
    assert_ne!(pid(&again), pid(&first));
    let (_, log, _) = sandbox.run(&["logs", "one"]);
    let said = log.lines().find(|l| l.contains("panicked")).unwrap();
    assert!(said.contains("ERROR") && said.contains("fixture.rs:") && said.contains(": broke on purpose"), "{log}");
    let (_, own, _) = sandbox.run(&["logs", "supervisor"]);
    assert!(own.contains("down: exit status 1: panicked at "), "{own}");
}

/// A service behind a shell that starts other programs too: one below it, and one in a session of the system of its own.
fn shell(sandbox: &Sandbox) {
    let pids = sandbox.path().join("pids");
    let fixture = sandbox.path().join("fixture");
    let text = format!(
        "sleep 3601 & echo $! >> '{pids}'\nsetsid sleep 3602 & echo $! >> '{pids}'\n'{fixture}' \"$@\"\nexit $?",
        pids = pids.display(),
        fixture = fixture.display()
    );
    sandbox.script("shell", &text);
}

fn grandchildren(sandbox: &Sandbox) -> Vec<i32> {
    let text = std::fs::read_to_string(sandbox.path().join("pids")).unwrap();
    text.lines().map(|line| line.parse().unwrap()).collect()
}

#[test]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn a_child_without_environment_ends_with_a_killed_supervisor() {
    if sg_stack::control_group::delegated().is_none() {
        eprintln!("SKIPPED: no control groups are delegated to this process");
        return;
    }
    let sandbox = Sandbox::new();
    let (pids, fixture) = (sandbox.path().join("pids"), sandbox.path().join("fixture"));
    let text =
        format!("setsid env -i sleep 3603 & echo $! >> '{}'\n'{}' \"$@\"\nexit $?", pids.display(), fixture.display());
    sandbox.script("shell", &text);
    let file = sandbox.file("f.toml", "schema = 1\n[service.one]\nexec = \"./shell\"\nwrite = [\".\"]\n");
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    sandbox.ready("f", "one");
    assert!(grandchildren(&sandbox).iter().all(|pid| runs(*pid)));
    up.signal(Signal::SIGKILL);
    up.end();
    let began = Instant::now();
    while grandchildren(&sandbox).iter().any(|pid| runs(*pid)) {
        assert!(began.elapsed() < Duration::from_secs(5), "{:?}", grandchildren(&sandbox));
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn no_child_of_a_child_survives() {
    let sandbox = Sandbox::new();
    shell(&sandbox);
    let file = sandbox.file(
        "f.toml",
        "schema = 1\n[service.one]\nexec = \"./shell\"\nwrite = [\".\"]\nbackoff = { initial_ms = 10, max_ms = 100 }\n",
    );
    let file = file.to_str().unwrap();
    let mut up = sandbox.up(&[file]);
    let first = sandbox.ready("f", "one");
    assert!(grandchildren(&sandbox).iter().all(|pid| runs(*pid)));
    // Its shell dies.
    kill(Pid::from_raw(pid(&first)), Signal::SIGKILL).unwrap();
    sandbox.wait("f", "one", |s| s["state"] == "READY" && s["restarts"] == 1);
    let seen = grandchildren(&sandbox);
    assert_eq!(seen.len(), 4);
    assert!(seen.iter().take(2).all(|pid| !runs(*pid)), "{seen:?}");
    // It is restarted.
    assert_eq!(sandbox.run(&["restart", "one"]).0, 0);
    let seen = grandchildren(&sandbox);
    assert!(seen.len() == 6 && seen.iter().take(4).all(|pid| !runs(*pid)), "{seen:?}");
    // The supervisor is killed. No further run cleans up.
    up.signal(Signal::SIGKILL);
    up.end();
    let began = Instant::now();
    while grandchildren(&sandbox).iter().any(|pid| runs(*pid)) {
        assert!(began.elapsed() < Duration::from_secs(5), "{:?}", grandchildren(&sandbox));
        std::thread::sleep(Duration::from_millis(20));
    }
    // An orderly stop.
    let mut up = sandbox.up(&[file]);
    sandbox.ready("f", "one");
    assert_eq!(sandbox.run(&["down"]).0, 0);
    assert_eq!(up.end().0, 0);
    let seen = grandchildren(&sandbox);
    assert!(seen.len() == 8 && seen.iter().all(|pid| !runs(*pid)), "{seen:?}");
}
