//! Services that misbehave: the stack survives each, and says what happened.

use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use serde_json::Value;
use sg_proto::keys::{self, role};

use crate::bench::{Bench, Up, pid, runs};

/// A stack of one that misbehaves and one that does not.
fn beside(bench: &Bench, params: &str, more: &str) -> Up {
    let text = format!(
        "schema = 1\n[defaults]\nready = 20\nbackoff = {{ initial_ms = 10, max_ms = 100 }}\n[service.good]\nexec = \"./fixture\"\n[service.bad]\nexec = \"./fixture\"\nrole = \"agent-core\"\nparams = {{ {params} }}\n{more}"
    );
    let file = bench.file("f.toml", &text);
    let up = bench.up(&[file.to_str().unwrap()]);
    bench.ready("f", "good");
    up
}

/// The good one was never touched, and the stack stops in order; what it told.
fn survived(bench: &Bench, mut up: Up) -> String {
    let good = bench.ready("f", "good");
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
fn one_that_crashes_at_its_start() {
    let bench = Bench::new();
    let up = beside(&bench, "crash = true", "intensity = { restarts = 2, within_s = 60 }\n");
    let bad = bench.wait("f", "bad", |s| s["state"] == "FAILED");
    let reason = bad["reason"].as_str().unwrap();
    assert!(
        reason.starts_with("failed 3 times within 60 s: exit status 1: ") && reason.contains("crashed on purpose"),
        "{reason}"
    );
    let told = survived(&bench, up);
    assert_eq!(told.matches("crashed on purpose; restarting").count(), 2, "{told}");
}

#[test]
fn one_that_crashes_later() {
    let bench = Bench::new();
    let up = beside(&bench, "crash_ms = 300", "intensity = { restarts = 1000, within_s = 1 }\n");
    bench.wait("f", "bad", |s| s["restarts"].as_u64() >= Some(2));
    assert!(survived(&bench, up).contains("down: killed by SIGABRT; restarting"));
}

#[test]
fn one_that_never_gets_ready() {
    let bench = Bench::new();
    let up = beside(&bench, "never_ready = true", "ready = 1\nrestart = \"never\"\n");
    let bad = bench.wait("f", "bad", |s| s["state"] == "FAILED");
    assert_eq!(bad["reason"], "not ready within 1 s");
    survived(&bench, up);
}

#[test]
fn one_that_hears_no_request_to_stop() {
    let bench = Bench::new();
    let up = beside(&bench, "deaf = true", "stop = 0.5\n");
    let bad = bench.ready("f", "bad");
    let (status, out, errors) = bench.run(&["restart", "bad"]);
    assert_eq!(status, 0, "{out}{errors}");
    assert!(!runs(pid(&bad)));
    survived(&bench, up);
}

#[test]
fn one_that_floods() {
    let bench = Bench::new();
    let up = beside(&bench, "flood = 300000", "");
    bench.ready("f", "bad");
    // One who follows without reading holds nobody up, and knows afterwards what it missed.
    let folder = bench.path().to_owned();
    let (lost, answers) = sg_runtime::process::block_on(async move {
        let bus = Bench::join_in(&folder, "f").await;
        let mut slow = bus.follow(&keys::UTTERANCE, role::AGENT_CORE, 8).await.unwrap();
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
    let bad = bench.ready("f", "bad");
    assert_eq!(bad["restarts"], 0, "{bad}");
    survived(&bench, up);
}

#[test]
fn one_that_sends_garbage() {
    let bench = Bench::new();
    let up = beside(&bench, "garbage = true", "");
    bench.ready("f", "bad");
    let began = Instant::now();
    let log = loop {
        let (_, log, _) = bench.run(&["logs", "bad"]);
        if log.contains("garbage was sent") {
            break log;
        }
        assert!(began.elapsed() < Duration::from_secs(20), "{log}");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(log.contains("may not ask cmd/ps; only cli may"), "{log}");
    assert_eq!(log.matches("garbage was refused").count(), 40, "{log}");
    // The supervisor took none of it for a sign of anything, and answers.
    let bad = bench.ready("f", "bad");
    assert_eq!((&bad["restarts"], &bad["instance"]), (&0.into(), &"bad-1".into()));
    survived(&bench, up);
}

#[test]
fn one_that_leaks_memory() {
    let bench = Bench::new();
    let up = beside(&bench, "leak_mib = 200", "memory_mib = 150\n");
    bench.wait("f", "bad", restarted);
    let told = survived(&bench, up);
    assert!(told.contains("MiB of memory, more than its 150 MiB"), "{told}");
}

#[test]
fn one_that_answers_late() {
    let bench = Bench::new();
    let up = beside(&bench, "answers = true, late_ms = 3000", "");
    bench.ready("f", "bad");
    let began = Instant::now();
    let (status, _, errors) = bench.run(&["say", "undo", "--timeout", "0.5"]);
    assert!(status == 1 && errors.contains("agent-core") && errors.contains("in time"), "{errors}");
    assert!(began.elapsed() < Duration::from_millis(2900), "{:?}", began.elapsed());
    assert_eq!(bench.run(&["say", "undo", "--timeout", "30"]).0, 0, "late is not never");
    survived(&bench, up);
}
