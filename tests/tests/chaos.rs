//! `supergaussian chaos`: a session under faults ends as the same session without.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by its helpers and prints what it measured")]

use std::path::Path;
use std::process::Output;

use sg_tests::{command, said};

fn chaos(folder: &Path, arguments: &[&str]) -> Output {
    command(&folder.join("run"))
        .unwrap()
        .arg("chaos")
        .arg("--out")
        .arg(folder.join("out"))
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn fifty_faults_leave_the_scene_as_it_would_be_without() {
    let folder = tempfile::tempdir().unwrap();
    let output = chaos(folder.path(), &["--faults", "50", "--seed", "1", "--gaussians", "5000", "--json"]);
    if !output.status.success() {
        // What a failure left behind is of more use than a clean machine.
        println!("left behind: {}", folder.keep().display());
    }
    assert!(output.status.success(), "{}", said(&output));
    let tally: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("{tally:#}");
    for nothing in ["lost", "doubled", "orphans"] {
        assert_eq!(tally[nothing], 0, "{nothing}: {tally:#}");
    }
    assert_eq!(tally["faults"], 50);
    assert_eq!(tally["wrong"].as_array().map(Vec::len), Some(0));
    assert!(tally["acknowledged"].as_u64() > Some(30) && tally["refused_for_room"].as_u64() > Some(0), "{tally:#}");
    let kinds = tally["kinds"].as_object().unwrap();
    assert_eq!(kinds.len(), 11, "every kind of fault has come up: {kinds:?}");
}

#[test]
fn a_plan_is_told_beforehand_and_repeats_for_its_seed() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |seed: &str| {
        let output = chaos(folder.path(), &["--plan", "--faults", "40", "--seed", seed]);
        assert!(output.status.success(), "{}", said(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let first = plan("5");
    assert_eq!(first.lines().count(), 40);
    assert!(first.contains("kill -9 supervisor") && first.contains("disk full scene"), "{first}");
    assert_eq!(plan("5"), first);
    assert_ne!(plan("6"), first);
}

#[test]
fn a_launch_file_without_a_scene_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mute.toml");
    std::fs::write(&file, "schema = 1\n[service.agent-intent]\nexec = \"supergaussian-agent-intent\"\n").unwrap();
    let output = chaos(folder.path(), &[file.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(errors.contains("mute.toml: no service of the role `scene`") && errors.lines().count() == 1, "{errors}");
}
