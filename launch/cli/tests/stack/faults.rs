//! Services that misbehave: the stack survives each, and says what happened.

use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use serde_json::Value;
use sg_proto::keys::{self, role};

use crate::sandbox::{Sandbox, Up, pid, runs};

/// A stack of one misbehaving and one good service.
fn beside(sandbox: &Sandbox, params: &str, more: &str) -> Up {
    let text = format!(
        "schema = 1\n[defaults]\nready = 20\nbackoff = {{ initial_ms = 10, max_ms = 100 }}\n[service.good]\nexec = \"./fixture\"\n[service.bad]\nexec = \"./fixture\"\nrole = \"agent-core\"\nparams = {{ {params} }}\n{more}"
    );
    let file = sandbox.file("f.toml", &text);
    let up = sandbox.up(&[file.to_str().unwrap()]);
    sandbox.ready("f", "good");
    up
}

/// Checks that the good service is untouched and that the stack stops in order. Returns the output.
fn survived(sandbox: &Sandbox, mut up: Up) -> String {
    let good = sandbox.ready("f", "good");
    assert_eq!(good["restarts"], 0, "{good}");
    up.signal(Signal::SIGINT);
    let (status, errors) = up.end();
    assert!(status == 0 && !runs(pid(&good)), "{errors}");
    errors
}

fn restarted(service: &Value) -> bool {
    service["state"] == "READY" && service["restarts"].as_u64() >= Some(1)
}

#[test]
fn crash_at_start() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "crash = true", "intensity = { restarts = 2, within_s = 60 }\n");
    let bad = sandbox.wait("f", "bad", |s| s["state"] == "FAILED");
    let reason = bad["reason"].as_str().unwrap();
    assert!(
        reason.starts_with("failed 3 times within 60 s: exit status 1: ") && reason.contains("crashed on purpose"),
        "{reason}"
    );
    let told = survived(&sandbox, up);
    assert_eq!(told.matches("crashed on purpose; restarting").count(), 2, "{told}");
}

#[test]
fn late_crash() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "crash_ms = 300", "intensity = { restarts = 1000, within_s = 1 }\n");
    sandbox.wait("f", "bad", |s| s["restarts"].as_u64() >= Some(2));
    assert!(survived(&sandbox, up).contains("down: killed by SIGABRT; restarting"));
}

#[test]
fn never_ready() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "never_ready = true", "ready = 1\nrestart = \"never\"\n");
    let bad = sandbox.wait("f", "bad", |s| s["state"] == "FAILED");
    assert_eq!(bad["reason"], "not ready within 1 s");
    survived(&sandbox, up);
}

#[test]
fn ignored_sigterm() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "deaf = true", "stop = 0.5\n");
    let bad = sandbox.ready("f", "bad");
    let (status, out, errors) = sandbox.run(&["restart", "bad"]);
    assert_eq!(status, 0, "{out}{errors}");
    assert!(!runs(pid(&bad)));
    survived(&sandbox, up);
}

#[test]
fn message_flood() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "flood = 300000", "");
    sandbox.ready("f", "bad");
    // A follower that does not read blocks no other process, and learns how much it missed.
    let folder = sandbox.path().to_owned();
    let (lost, answers) = sg_runtime::process::block_on(async move {
        let bus = Sandbox::join_in(&folder, "f").await;
        let mut slow = bus.subscribe(&keys::UTTERANCE, role::AGENT_CORE, 8).await.unwrap();
        let began = Instant::now();
        let mut answers = 0;
        while began.elapsed() < Duration::from_secs(2) {
            let context = sg_runtime::context::Context::root();
            bus.ask(&keys::PS, &sg_proto::launch::PsRequest {}, &context).await.unwrap();
            answers += 1;
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        slow.next().await.unwrap();
        let lost = slow.lost();
        bus.close().await;
        (lost, answers)
    })
    .unwrap();
    assert!(lost > 1000, "a flood of {lost}");
    assert!(answers > 5, "{answers}");
    let bad = sandbox.ready("f", "bad");
    assert_eq!(bad["restarts"], 0, "{bad}");
    survived(&sandbox, up);
}

#[test]
fn garbage_on_the_bus() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "garbage = true", "");
    sandbox.ready("f", "bad");
    let began = Instant::now();
    let log = loop {
        let (_, log, _) = sandbox.run(&["logs", "bad"]);
        if log.contains("garbage was sent") {
            break log;
        }
        assert!(began.elapsed() < Duration::from_secs(20), "{log}");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(log.contains("may not send cmd/ps; only cli may"), "{log}");
    assert_eq!(log.matches("garbage was refused").count(), 40, "{log}");
    // The supervisor ignores these messages and answers requests.
    let bad = sandbox.ready("f", "bad");
    assert_eq!((&bad["restarts"], &bad["instance"]), (&0.into(), &"bad.1".into()));
    survived(&sandbox, up);
}

#[test]
fn memory_leak() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "leak_mib = 200", "memory_mib = 150\n");
    sandbox.wait("f", "bad", restarted);
    let told = survived(&sandbox, up);
    assert!(told.contains("MiB of memory; its limit is 150 MiB"), "{told}");
}

#[test]
fn late_answers() {
    let sandbox = Sandbox::new();
    let up = beside(&sandbox, "answers = true, late_ms = 3000", "");
    sandbox.ready("f", "bad");
    let began = Instant::now();
    let (status, _, errors) = sandbox.run(&["say", "undo", "--timeout", "0.5"]);
    assert!(status == 1 && errors.contains("agent-core") && errors.contains("in time"), "{errors}");
    assert!(began.elapsed() < Duration::from_millis(2900), "{:?}", began.elapsed());
    assert_eq!(sandbox.run(&["say", "undo", "--timeout", "30"]).0, 0, "late is not never");
    survived(&sandbox, up);
}
