//! `up` for a running stack.

use nix::sys::signal::Signal;

use crate::sandbox::{Sandbox, pid, runs};

const BEFORE: &str = r#"
schema = 1
[defaults]
ready = 20
[service.kept]
exec = "./fixture"
[service.dropped]
exec = "./fixture"
[service.edited]
exec = "./fixture"
[service.watched]
exec = "./fixture"
"#;

const AFTER: &str = r#"
schema = 1
[defaults]
ready = 20
[service.added]
exec = "./fixture"
after = { kept = "ready" }
[service.kept]
exec = "./fixture"
[service.edited]
exec = "./fixture"
params = { start_ms = 10 }
[service.watched]
exec = "./fixture"
liveness = 9
"#;

#[test]
fn an_edited_file_is_applied_to_the_stack_that_runs() {
    let sandbox = Sandbox::new();
    let file = sandbox.file("edit.toml", BEFORE);
    let file = file.to_str().unwrap();
    let mut up = sandbox.up(&[file]);
    let names = ["kept", "dropped", "edited", "watched"];
    let before = names.map(|name| pid(&sandbox.ready("edit", name)));
    let (status, out, errors) = sandbox.run(&["up", file]);
    assert_eq!(status, 0, "{errors}");
    assert_eq!(out.matches("unchanged").count(), 4, "{out}");

    sandbox.file("edit.toml", AFTER);
    let (status, out, errors) = sandbox.run(&["up", file]);
    assert_eq!(status, 0, "{out}{errors}");
    let told: Vec<_> = out.lines().map(|l| l.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
    let expected =
        ["SERVICE CHANGE", "kept unchanged", "added added", "edited swapped", "watched changed", "dropped removed"];
    assert_eq!(told[..6], expected, "{out}");
    assert!(told[6].starts_with("done after"), "{out}");
    let after = sandbox.ps("edit");
    let seen: Vec<_> = after.iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(seen, ["kept", "added", "edited", "watched"]);
    assert!(after.iter().all(|s| s["state"] == "READY"), "{after:?}");
    let now = |name| pid(after.iter().find(|s| s["name"] == name).unwrap());
    assert_eq!((now("kept"), now("watched")), (before[0], before[3]));
    assert!(now("edited") != before[2] && !runs(before[1]) && !runs(before[2]));

    // A mistake in the file changes nothing.
    sandbox.file("edit.toml", &AFTER.replace("liveness", "livenes"));
    let (status, _, errors) = sandbox.run(&["up", file]);
    assert!(status == 2 && errors.contains("did you mean `liveness`?"), "{errors}");
    // A reload that fails for one service still applies to the others.
    sandbox.file("edit.toml", &AFTER.replace("start_ms = 10", "odd = 10"));
    let (status, out, errors) = sandbox.run(&["up", file]);
    assert!(status == 1 && errors.contains("swap of `edited` failed") && errors.contains("serves on"), "{out}{errors}");
    assert_eq!(pid(&sandbox.ready("edit", "edited")), now("edited"));
    up.signal(Signal::SIGINT);
    assert_eq!(up.end().0, 0);
}

#[test]
fn another_file_needs_the_session_name() {
    let sandbox = Sandbox::new();
    let text = "schema = 1\n[service.a]\nexec = \"./fixture\"\n";
    let file = sandbox.file("one.toml", text);
    let _up = sandbox.up(&[file.to_str().unwrap()]);
    let first = pid(&sandbox.ready("one", "a"));
    std::fs::create_dir(sandbox.path().join("deep")).unwrap();
    let exec = sandbox.path().join("fixture");
    let other = format!("schema = 1\n[service.b]\nexec = \"{}\"\n", exec.display());
    let same_name = sandbox.file("deep/one.toml", &other);
    let (status, out, errors) = sandbox.run(&["up", same_name.to_str().unwrap()]);
    assert!(status == 1 && out.is_empty() && errors.lines().count() == 1, "{errors}");
    assert!(errors.contains("session `one` runs already, from ") && errors.contains("name = \"one\""), "{errors}");
    assert!(runs(first));
    let named = sandbox.file("named.toml", &format!("name = \"one\"\n{other}"));
    let (status, out, errors) = sandbox.run(&["up", named.to_str().unwrap()]);
    assert!(status == 0 && out.contains("removed"), "{out}{errors}");
    assert!(!runs(first));
    assert_eq!(sandbox.ps("one").len(), 1);
    sandbox.ready("one", "b");
}
