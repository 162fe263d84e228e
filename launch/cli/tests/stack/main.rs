//! Whole stacks of fixture services under the real command.

#![allow(clippy::panic, clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

mod containment;
mod faults;
mod fixture;
mod liveness;
mod open;
mod reload;
mod revocation;
mod sandbox;
mod service_manager;
mod swap;

use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sandbox::{Sandbox, pid, runs};
use serde_json::Value;

const TWO: &str = r#"
schema = 1
[defaults]
backoff = { initial_ms = 50, max_ms = 400 }
[service.view]
exec = "./fixture"
role = "render-view"
after = { scene = "ready" }
[service.scene]
exec = "./fixture"
params = { start_ms = 200 }
"#;

#[test]
fn stack_starts_lists_restarts_and_stops() {
    let sandbox = Sandbox::new();
    let file = sandbox.file("two.toml", TWO);
    let file = file.to_str().unwrap();
    let mut up = sandbox.up(&[file]);
    let view = sandbox.ready("two", "view");
    let scene = sandbox.ready("two", "scene");
    assert_eq!(
        (&scene["role"], &view["role"], &view["instance"]),
        (&"scene".into(), &"render-view".into(), &"view.1".into())
    );
    assert!(scene["uptime_ms"].as_u64() >= Some(view["uptime_ms"].as_u64().unwrap() + 200), "{scene} {view}");
    assert!(scene["start_ms"].as_u64() >= Some(200));

    // Health messages report the memory every second.
    sandbox.wait("two", "view", |s| s["memory_bytes"].as_u64() > Some(1 << 20));
    let (status, table, _) = sandbox.run(&["ps"]);
    assert_eq!(status, 0);
    assert!(table.lines().count() == 3 && table.contains("READY"), "{table}");

    let (status, out, _) = sandbox.run(&["restart", "view"]);
    assert_eq!(status, 0);
    let again = sandbox.ready("two", "view");
    assert_ne!(pid(&again), pid(&view));
    assert!(out.contains(&format!("process {} stopped, process {} ready", pid(&view), pid(&again))), "{out}");
    assert!(!runs(pid(&view)));
    assert_eq!(sandbox.run(&["restart", "veiw"]).0, 2);

    kill(Pid::from_raw(pid(&scene)), Signal::SIGKILL).unwrap();
    let reborn = sandbox.wait("two", "scene", |s| s["state"] == "READY" && s["restarts"] == 1);
    assert_eq!(reborn["instance"], "scene.2");

    let (_, log, _) = sandbox.run(&["logs", "scene"]);
    assert_eq!(log.matches("loaded greeting=\"hello there\"").count(), 2, "{log}");
    let (status, _, errors) = sandbox.run(&["logs", "scnee"]);
    assert!(status == 2 && errors.contains("did you mean `scene`?"), "{errors}");

    let (status, out, _) = sandbox.run(&["down"]);
    assert!(status == 0 && out.contains("session two stopped"), "{out}");
    let (status, errors) = up.end();
    assert_eq!(status, 0, "{errors}");
    assert!(errors.contains("down: killed by SIGKILL; restarting"), "{errors}");
    assert!(!sandbox.path().join("run/two/bus.sock").exists());
    let (status, _, errors) = sandbox.run(&["ps"]);
    assert!(status == 1 && errors.contains("no stack is running"), "{errors}");
    // Logs outlive the stack.
    assert!(sandbox.run(&["logs", "--session", "two", "scene"]).1.contains("loaded"));
}

#[test]
fn stacks_are_isolated() {
    let sandbox = Sandbox::new();
    let one = "schema = 1\n[service.scene]\nexec = \"./fixture\"\n";
    let file = sandbox.file("one.toml", one);
    let file = file.to_str().unwrap();
    let _a = sandbox.up(&[file, "--session", "a"]);
    let _b = sandbox.up(&[file, "--session", "b"]);
    let (a, b) = (sandbox.ready("a", "scene"), sandbox.ready("b", "scene"));
    assert_ne!(pid(&a), pid(&b));
    let (status, _, errors) = sandbox.run(&["ps"]);
    assert!(
        status == 2 && errors.contains("several stacks are running: a, b; pick one with --session NAME"),
        "{errors}"
    );
    assert_eq!(sandbox.run(&["down", "--session", "a"]).0, 0);
    assert!(!runs(pid(&a)) && runs(pid(&b)));
    assert_eq!(pid(&sandbox.ps("b")[0]), pid(&b));
    let (status, _, errors) = sandbox.run(&["ps", "--session", "c"]);
    assert!(status == 2 && errors.contains("no stack of session `c` is running; running: b"), "{errors}");
}

#[test]
fn ctrl_c_stops_in_reverse_order() {
    let sandbox = Sandbox::new();
    let chain = r#"
schema = 1
[service.third]
exec = "./fixture"
after = { second = "ready" }
[service.first]
exec = "./fixture"
[service.second]
exec = "./fixture"
after = { first = "ready" }
"#;
    let file = sandbox.file("chain.toml", chain);
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    sandbox.ready("chain", "third");
    let began = Instant::now();
    up.signal(Signal::SIGINT);
    let (status, errors) = up.end();
    assert_eq!(status, 0, "{errors}");
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
    let told: Vec<_> =
        errors.lines().filter(|l| l.ends_with("  stopping") || l.ends_with("  stopped")).map(str::trim).collect();
    let expected: Vec<_> = ["third ", "second", "first "]
        .iter()
        .flat_map(|s| [format!("{s}  stopping"), format!("{s}  stopped")])
        .collect();
    assert_eq!(told, expected, "{errors}");
}

fn ignores_sigterm(pid: i32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let ignored = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    ignored.is_some_and(|signals| signals & (1 << (Signal::SIGTERM as u32 - 1)) != 0)
}

#[test]
fn ignored_sigterm_leads_to_kill_and_second_ctrl_c_is_immediate() {
    let sandbox = Sandbox::new();
    let file = sandbox.file("s.toml", "schema = 1\n[service.a]\nexec = \"./stubborn\"\nstop = 0.5\nready = 100\n");
    let file = file.to_str().unwrap();
    let mut up = sandbox.up(&[file]);
    // The shell has to ignore the signal first.
    let stubborn = sandbox.wait("s", "a", |s| s["pid"].as_u64() > Some(0) && ignores_sigterm(pid(s)));
    let began = Instant::now();
    up.signal(Signal::SIGTERM);
    assert_eq!(up.end().0, 0);
    let took = began.elapsed();
    assert!(took > Duration::from_millis(450) && took < Duration::from_secs(3), "{took:?}");
    assert!(!runs(pid(&stubborn)));

    let mut up = sandbox.up(&[file, "--set", "service.a.stop=60"]);
    sandbox.wait("s", "a", |s| s["pid"].as_u64() > Some(0) && ignores_sigterm(pid(s)));
    up.signal(Signal::SIGINT);
    sandbox.wait("s", "a", |s| s["state"] == "STOPPING");
    up.signal(Signal::SIGINT);
    assert_eq!(up.end().0, 0);
}

#[test]
fn services_die_with_their_supervisor_and_the_next_run_finds_a_clean_session() {
    let sandbox = Sandbox::new();
    let text = format!("{TWO}[service.shell]\nexec = \"./stubborn\"\nready = 100\n");
    let file = sandbox.file("two.toml", &text);
    let file = file.to_str().unwrap();
    let mut up = sandbox.up(&[file]);
    sandbox.ready("two", "view");
    let pids: Vec<_> = sandbox.ps("two").iter().map(pid).collect();
    assert_eq!(pids.len(), 3);
    for pid in &pids {
        let open = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().flatten();
        let inherited = open.filter(|e| std::fs::read_link(e.path()).is_ok_and(|p| p.ends_with("bus.sock.lock")));
        assert_eq!(inherited.count(), 0, "the lock on the bus's socket must not pass on");
    }
    up.signal(Signal::SIGKILL);
    up.end();
    let began = Instant::now();
    while pids.iter().any(|p| runs(*p)) {
        assert!(began.elapsed() < Duration::from_secs(2), "still there: {pids:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(sandbox.path().join("run/two/bus.sock").exists(), "what a killed supervisor leaves");
    let _up = sandbox.up(&[file, "--only", "scene"]);
    let scene = sandbox.ready("two", "scene");
    assert!(!pids.contains(&pid(&scene)));
    assert_eq!(sandbox.ps("two").len(), 1);
}

#[test]
fn hung_service_is_restarted() {
    let sandbox = Sandbox::new();
    let text = "schema = 1\n[service.scene]\nexec = \"./fixture\"\nparams = { hang_ms = 300 }\nliveness = 1.5\nbackoff = { initial_ms = 10, max_ms = 100 }\n";
    let file = sandbox.file("h.toml", text);
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    let first = sandbox.ready("h", "scene");
    let second = sandbox.wait("h", "scene", |s| s["state"] == "READY" && s["restarts"] == 1);
    assert!(!runs(pid(&first)) && runs(pid(&second)));
    up.signal(Signal::SIGINT);
    let (_, errors) = up.end();
    assert!(errors.contains("stopping: hung: no sign of life for 1.5 s"), "{errors}");
}

#[test]
fn wrong_input_is_reported_and_final() {
    let sandbox = Sandbox::new();
    let text = "schema = 1\n[service.scene]\nexec = \"./refuse\"\n[service.view]\nexec = \"./fixture\"\n[service.odd]\nexec = \"./fixture\"\nparams = { stat_ms = 3 }\n";
    let file = sandbox.file("w.toml", text);
    let file = file.to_str().unwrap();
    let mut up = sandbox.up(&[file]);
    sandbox.ready("w", "view");
    let failed = sandbox.wait("w", "scene", |s| s["state"] == "FAILED");
    assert_eq!((&failed["reason"], &failed["restarts"]), (&"exit status 2: no such scene".into(), &0.into()));
    let odd = sandbox.wait("w", "odd", |s| s["state"] == "FAILED");
    let reason = odd["reason"].as_str().unwrap();
    assert!(reason.contains("parameters of `odd`: unknown field `stat_ms`"), "{reason}");
    let (status, _, errors) = sandbox.run(&["restart", "scene"]);
    assert!(status == 1 && errors.contains("service `scene` failed: exit status 2: no such scene"), "{errors}");
    up.signal(Signal::SIGINT);
    assert_eq!(up.end().0, 0, "nothing critical failed");

    let mut up = sandbox.up(&[file, "--set", "service.scene.critical=true"]);
    let (status, errors) = up.end();
    assert_eq!(status, 1);
    assert!(errors.ends_with("error: service `scene` failed: exit status 2: no such scene\n"), "{errors}");
}

#[test]
fn repeated_crashes_are_final_and_stop_a_critical_stack() {
    let sandbox = Sandbox::new();
    let text = "schema = 1\n[service.scene]\nexec = \"./crash\"\ncritical = true\nbackoff = { initial_ms = 10, max_ms = 40 }\nintensity = { restarts = 3, within_s = 10 }\n[service.view]\nexec = \"./fixture\"\n";
    let file = sandbox.file("c.toml", text);
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    let (status, errors) = up.end();
    assert_eq!(status, 1);
    assert_eq!(errors.matches("down: exit status 1: cannot go on; restarting").count(), 3, "{errors}");
    let reason = "service `scene` failed: failed 4 times within 10 s: exit status 1: cannot go on";
    assert!(errors.contains(reason), "{errors}");
}

#[test]
fn unready_process_is_stopped() {
    let sandbox = Sandbox::new();
    let text = "schema = 1\n[service.a]\nexec = \"./stubborn\"\nready = 0.3\nstop = 0.2\nrestart = \"never\"\n";
    let file = sandbox.file("n.toml", text);
    let mut up = sandbox.up(&[file.to_str().unwrap()]);
    let (status, errors) = up.end();
    assert_eq!(status, 1, "no service is left");
    assert!(errors.contains("service `a` failed: not ready within 0.3 s"), "{errors}");
}

#[test]
fn a_bad_launch_file_is_refused_with_its_line() {
    let sandbox = Sandbox::new();
    let file = sandbox.file("bad.toml", "schema = 1\n[service.a]\nexec = \"./fixture\"\nafter = { a = \"ready\" }\n");
    let file = file.to_str().unwrap();
    for command in ["up", "check", "graph"] {
        let (status, out, errors) = sandbox.run(&[command, file]);
        assert_eq!((status, out.as_str()), (2, ""));
        let line = format!("error: {file}:4:11: `a` comes after `a`: a cycle; take one `after` away");
        let snippet = "\n    │\n  4 │ after = { a = \"ready\" }\n    │           ^\n";
        assert_eq!(errors, format!("{line}{snippet}"));
    }
    let (status, _, errors) = sandbox.run(&["up", "none.toml"]);
    assert!(status == 2 && errors == "error: none.toml: No such file or directory (os error 2)\n", "{errors}");
    let good = sandbox.file("two.toml", TWO);
    let (status, _, errors) = sandbox.run(&["up", good.to_str().unwrap(), "--only", "sceen"]);
    assert!(status == 2 && errors.contains("did you mean `scene`?"), "{errors}");
    let (status, out, _) = sandbox.run(&["check", good.to_str().unwrap()]);
    assert!(
        status == 0 && out.ends_with("two.toml: valid; session two, 2 services, start order: scene, view\n"),
        "{out}"
    );
    let (_, dot, _) = sandbox.run(&["graph", good.to_str().unwrap(), "--dot"]);
    assert!(dot.contains("\"scene\" -> \"view\" [label = \"ready\"];"), "{dot}");
}

#[test]
fn unknown_commands_are_refused_with_a_suggestion() {
    let sandbox = Sandbox::new();
    let (status, _, errors) = sandbox.run(&["sceen", "info"]);
    assert_eq!((status, errors.as_str()), (2, "error: unknown command `sceen`; did you mean `scene`?\n"));
    assert_eq!(sandbox.run(&["upp"]).2, "error: unknown command `upp`; did you mean `up`?\n");
    let (status, out, _) = sandbox.run(&["contract", "describe", "scene"]);
    assert!(status == 0 && out.contains("cmd/apply"), "{out}");
    let (status, _, errors) = sandbox.run(&["contract", "describe", "scen"]);
    assert!(status == 2 && errors.contains("did you mean `scene`?"), "{errors}");
}

#[test]
fn utterance_is_answered_and_watched() {
    let sandbox = Sandbox::new();
    let text = "schema = 1\n[service.agent-core]\nexec = \"./fixture\"\nparams = { answers = true }\n[service.scene]\nexec = \"./fixture\"\n";
    let file = sandbox.file("talk.toml", text);
    let file = file.to_str().unwrap();
    let _up = sandbox.up(&[file]);
    sandbox.ready("talk", "agent-core");

    let mut watch =
        sandbox.command(&["watch", "--json"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The output shows that it watches.
    BufReader::new(watch.stderr.take().unwrap()).read_line(&mut String::new()).unwrap();

    let (status, out, errors) = sandbox.run(&["say", "make it red"]);
    assert_eq!((status, out.as_str()), (0, "you said: make it red\n"));
    assert!(errors.contains("utterance") && errors.contains("reply"), "{errors}");
    let (status, out, _) = sandbox.run(&["say", "fail", "--json"]);
    assert_eq!(status, 1);
    let said: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&said["ok"], &said["text"]), (&false.into(), &"you said: fail".into()));
    assert_eq!(said["stages"][0]["stage"], "utterance");
    assert_eq!(said["stages"][0]["message"]["text"], "fail");

    let mut lines = BufReader::new(watch.stdout.take().unwrap()).lines();
    let seen: Value = loop {
        let line: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        assert!(!line["key"].as_str().unwrap().ends_with("health"));
        if line["key"] == "sg/talk/agent-core/event/reply" {
            break line;
        }
    };
    assert_eq!(seen["message"]["text"], "you said: make it red");
    assert_eq!((&seen["step"], &seen["sender"]), (&1.into(), &"agent-core".into()));
    kill(Pid::from_raw(i32::try_from(watch.id()).unwrap()), Signal::SIGINT).unwrap();
    assert!(watch.wait().unwrap().success());

    assert_eq!(sandbox.run(&["say", " "]).0, 2);
    assert_eq!(sandbox.run(&["down"]).0, 0);
}

#[test]
fn utterance_without_agents_fails_with_one_line() {
    let sandbox = Sandbox::new();
    let file = sandbox.file("mute.toml", "schema = 1\n[service.scene]\nexec = \"./fixture\"\n");
    let _up = sandbox.up(&[file.to_str().unwrap()]);
    sandbox.ready("mute", "scene");
    let began = Instant::now();
    let (status, _, errors) = sandbox.run(&["say", "undo", "--timeout", "0.5"]);
    assert!(status == 1 && errors.contains("agent-core"), "{errors}");
    assert!(began.elapsed() < Duration::from_secs(4));
}
