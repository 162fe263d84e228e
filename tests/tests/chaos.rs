//! `supergaussian chaos`: a session under faults ends as the same session without.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by its helpers and prints what it measured")]

use std::path::Path;
use std::process::Output;
use std::time::Duration;

use sg_proto::keys::{self, role};
use sg_proto::language::{Source, Utterance};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Command, SaveUnit, Select, Target};
use sg_runtime::context::Context;
use sg_tests::soak::{self, options::Options};
use sg_tests::stack::Stack;
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
fn fifty_faults_leave_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let output = chaos(folder.path(), &["--faults", "50", "--seed", "1", "--gaussians", "5000", "--json"]);
    if !output.status.success() {
        // After a failure, the files are of more use than a clean machine.
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
    assert_eq!(kinds.len(), 16, "every kind of fault has come up: {kinds:?}");
}

#[test]
fn a_plan_is_printed_first_and_repeats_for_its_seed() {
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

/// The agents forget their words and actions when they are killed; the scene does not.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_repeated_utterance_after_killed_agents_finds_its_result() {
    let stack = Stack::up().unwrap();
    let bus = stack.join(role::CLI).await.unwrap();
    let soon = || Context::root().deadline_in(Duration::from_secs(60));
    let everything = Target { everything: true, ..Target::default() };
    for (id, action) in [
        ("select", Action::Select(Select { target: Some(everything), operation: 0 })),
        ("save", Action::SaveUnit(SaveUnit { name: "dome".into(), replace: false })),
    ] {
        let command = Command { id: id.into(), action: Some(action), ..Command::default() };
        bus.ask(&keys::SCENE_APPLY, &command, &soon()).await.unwrap();
    }
    let delete = Utterance { text: "remove the name dome".into(), source: Source::Text.into(), ..Utterance::default() };
    let say = || soon().with_id("said-once");
    let first = bus.ask(&keys::UTTER, &delete, &say()).await.unwrap();
    assert!(first.ok, "{first:?}");
    for service in stack.ps().iter().filter(|s| matches!(s["name"].as_str(), Some("agent-core" | "agent-function"))) {
        let status = std::process::Command::new("kill").args(["-9", &service["pid"].to_string()]).status().unwrap();
        assert!(status.success());
    }
    let again = bus.ask(&keys::UTTER, &delete, &say()).await.unwrap();
    assert!(again.ok, "{again:?}");
    assert_eq!(again.revision, first.revision, "it was done once");
    // Another sentence of the same words is another wish.
    let other = bus.ask(&keys::UTTER, &delete, &soon().with_id("said-anew")).await.unwrap();
    assert!(!other.ok && other.text.contains("dome"), "{other:?}");
}

/// The long one is `cargo bench --workspace --bench soak`.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_short_soak_keeps_its_bounds() {
    let out = tempfile::tempdir().unwrap();
    let options = Options {
        commands: 400,
        captures: 40,
        restarts: 14,
        minutes: 0.3,
        at_most: Some(5.0),
        gaussians: 0,
        pixels: 32,
        users: 2,
        services: Vec::new(),
        sample_ms: 250,
        seed: 1,
        out: out.path().to_owned(),
    };
    let outcome = soak::play(&options).await.unwrap();
    println!("{}", outcome.report);
    assert!(outcome.complete && outcome.holds(), "{}", outcome.report);
    let samples = std::fs::read_to_string(out.path().join("samples.csv")).unwrap();
    let columns = samples.lines().next().unwrap().split(',').count();
    assert!(samples.lines().count() > 20 && samples.lines().all(|l| l.split(',').count() == columns), "{samples}");
    let plot = std::fs::read_to_string(out.path().join("soak.svg")).unwrap();
    for process in ["supervisor", "scene", "render-capture", "agent-core"] {
        assert!(outcome.rows.iter().any(|r| r.subject == process && r.quantity == "threads" && r.largest > 1.0));
        assert!(plot.contains(process), "{process}");
    }
}
