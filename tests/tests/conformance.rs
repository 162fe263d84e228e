//! Every role passes its conformance: with the executables of this project, and with the example in Python.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by its helpers and prints what was tried")]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sg_proto::keys::role;
use sg_tests::conformance::{Candidate, Check, conform, roles};
use sg_tests::executable;

/// Tries an executable and gives the checks that failed.
fn tried(role: &str, executable: PathBuf) -> Vec<Check> {
    let params = serde_json::Map::new();
    let candidate = Candidate { role: role.to_owned(), executable, params, ready: Duration::from_secs(60) };
    let begun = Instant::now();
    let (mut count, mut failed) = (0, Vec::new());
    let mut tell = |check: &Check| {
        count += 1;
        if check.outcome.is_err() {
            failed.push(check.clone());
        }
    };
    let held = sg_runtime::process::block_on(conform(&candidate, &mut tell)).unwrap().unwrap();
    assert_eq!(held, failed.is_empty());
    assert!(count > 10, "only {count} checks for {role}");
    println!("{role}: {count} checks in {:.1} s", begun.elapsed().as_secs_f64());
    failed
}

fn holds(role: &str, name: &str) {
    assert_eq!(tried(role, executable(name).unwrap()), Vec::new());
}

#[test]
fn scene() {
    holds(role::SCENE, "supergaussian-scene");
}

#[test]
fn selection() {
    holds(role::SELECTION, "supergaussian-selection");
}

#[test]
fn labeling() {
    holds(role::LABELING, "supergaussian-labeling");
}

#[test]
fn speech() {
    holds(role::SPEECH, "supergaussian-speech");
}

#[test]
fn render_view() {
    holds(role::RENDER_VIEW, "supergaussian-render-node");
}

#[test]
fn render_capture() {
    holds(role::RENDER_CAPTURE, "supergaussian-render-node");
}

#[test]
fn agent_core() {
    holds(role::AGENT_CORE, "supergaussian-agent-core");
}

#[test]
fn agent_intent() {
    holds(role::AGENT_INTENT, "supergaussian-agent-intent");
}

#[test]
fn agent_function() {
    holds(role::AGENT_FUNCTION, "supergaussian-agent-function");
}

#[test]
fn agent_intent_in_python() {
    let Some(intent) = sg_tests::python_intent().unwrap() else {
        println!("SKIPPED: the service in Python needs the environment that ops/python.sh makes");
        return;
    };
    assert_eq!(tried(role::AGENT_INTENT, intent), Vec::new());
}

#[test]
fn every_role_of_the_stack_can_be_tried() {
    let services: Vec<_> = role::ALL.into_iter().filter(|r| !role::NON_SERVICES.contains(r)).collect();
    assert_eq!(roles(), services);
}

/// The checks are only worth something if they notice a program that does not fulfil the role.
#[test]
fn an_unfit_program_fails_the_conformance_of_its_role() {
    // Another role's executable never serves this one.
    let failed = tried_whole(role::AGENT_INTENT, &executable("supergaussian-scene").unwrap());
    assert!(failed.contains(&"gets ready in time"), "{failed:?}");
    let Some(intent) = sg_tests::python_intent().unwrap() else {
        println!("SKIPPED: the service in Python needs the environment that ops/python.sh makes");
        return;
    };
    // The example with a fault in each of a few places.
    for (place, fault, check) in [
        ("    \"red\": (1.0, 0.0, 0.0),", "    \"red\": (0.0, 0.0, 1.0),", "understands what everybody says"),
        ("        if envelope.epoch < seen:", "        if False:", "refuses what comes from an epoch that has passed"),
        ("        self._counts[\"refused\"] += 1", "        pass", "counts what it refuses"),
        (
            "            cause=context.id,",
            "            cause=\"\",",
            "publishes what it understood, in its conversation",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        spoiled_copy(intent.parent().unwrap(), folder.path(), place, fault);
        let failed: Vec<_> =
            tried(role::AGENT_INTENT, folder.path().join("intent")).into_iter().map(|c| c.what).collect();
        assert_eq!(failed.first(), Some(&check), "{fault}: {failed:?}");
    }
}

/// As [`tried`], for one that may not come far.
fn tried_whole(role: &str, executable: &Path) -> Vec<&'static str> {
    let candidate = Candidate {
        role: role.to_owned(),
        executable: executable.to_owned(),
        params: serde_json::Map::new(),
        ready: Duration::from_secs(5),
    };
    let mut failed = Vec::new();
    let mut tell = |check: &Check| failed.extend(check.outcome.as_ref().err().map(|_| check.what));
    assert!(!sg_runtime::process::block_on(conform(&candidate, &mut tell)).unwrap().unwrap());
    failed
}

/// Copies a folder, with one line of one of its files replaced.
fn spoiled_copy(from: &Path, to: &Path, place: &str, fault: &str) {
    let mut spoiled = 0;
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        if !path.is_file() {
            continue;
        }
        let target = to.join(path.file_name().unwrap());
        std::fs::copy(&path, &target).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        if text.contains(place) {
            spoiled += 1;
            std::fs::write(&target, text.replacen(place, fault, 1)).unwrap();
        }
    }
    assert_eq!(spoiled, 1, "{place}");
    // The schema is looked for above the service.
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("../proto");
    std::os::unix::fs::symlink(schema, to.join("proto")).unwrap();
}
