//! `supergaussian contract check` by its front door: on this checkout, away from it, on broken contracts, and on a running
//! stack.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test fails by its helpers and says what it skips"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

use prost::Message as _;
use prost_reflect::prost_types::FileDescriptorSet;
use serde_json::Value;
use sg_tests::stack::{SESSION, Stack};
use sg_tests::{command, said};

fn proto() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../proto").canonicalize().unwrap()
}

/// Runs `contract …` in a folder, with buf where the machine has it.
fn contract(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let mut contract = command(folder).unwrap();
    contract.current_dir(folder).arg("contract").args(arguments).env_remove("SUPERGAUSSIAN_REQUIRE_TOOLS");
    let output = contract.output().unwrap();
    (output.status.code(), said(&output))
}

/// Whether buf is there. If every tool is required, a missing buf fails the test.
fn has_buf() -> bool {
    let found = Command::new("buf").arg("--version").output().is_ok_and(|o| o.status.success());
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
    assert!(found || !required, "buf is missing, and SUPERGAUSSIAN_REQUIRE_TOOLS=1");
    if !found {
        println!("SKIPPED: buf is missing");
    }
    found
}

/// A copy of the schema that may be spoiled.
fn copy_of_proto(folder: &Path) -> PathBuf {
    let copy = folder.join("proto");
    let status = Command::new("cp").arg("-r").arg(proto()).arg(&copy).status().unwrap();
    assert!(status.success());
    copy
}

fn edit(path: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{}: no `{from}`", path.display());
    std::fs::write(path, text.replacen(from, to, 1)).unwrap();
}

#[test]
fn this_checkout_is_compatible_with_the_last_release() {
    let (status, said) = contract(&proto(), &["check"]);
    assert_eq!(status, Some(0), "{said}");
    for what in ["structure against v0.1.0", "golden bytes of the release", "key table"] {
        assert!(said.contains(what), "{said}");
    }
    if has_buf() {
        assert!(said.contains("buf breaking") && !said.contains("SKIPPED"), "{said}");
    }
}

#[test]
fn away_from_a_checkout_the_compiled_schema_is_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let (status, said) = contract(folder.path(), &["check"]);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("SKIPPED   buf") && said.contains("structure against v0.1.0"), "{said}");
}

#[test]
fn without_buf_the_check_reports_it_and_fails_where_tools_are_required() {
    let run = |required: &str| {
        let mut check = command(&proto()).unwrap();
        check.current_dir(proto()).args(["contract", "check"]).env("PATH", "");
        let output = check.env("SUPERGAUSSIAN_REQUIRE_TOOLS", required).output().unwrap();
        (output.status.code(), said(&output))
    };
    let (status, said) = run("0");
    assert!(status == Some(0) && said.contains("SKIPPED   buf") && said.contains("buf is missing"), "{said}");
    let (status, said) = run("1");
    assert!(status == Some(1) && said.contains("buf is missing"), "{said}");
}

#[test]
fn a_scene_of_another_image_is_not_found() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = FileDescriptorSet::decode(sg_proto::released::IMAGE).unwrap();
    let bus = files.file.iter_mut().find(|f| f.package() == "supergaussian.bus.v1").unwrap();
    let health = bus.message_type.iter_mut().find(|m| m.name() == "Health").unwrap();
    let mut field = health.field.first().unwrap().clone();
    field.name = Some("mood".into());
    field.json_name = Some("mood".into());
    field.number = Some(99);
    health.field.push(field);
    let image = folder.path().join("richer.binpb");
    std::fs::write(&image, files.encode_to_vec()).unwrap();
    let (status, said) = contract(folder.path(), &["check", "--against", image.to_str().unwrap()]);
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("field supergaussian.bus.v1.Health.mood = 99 is gone"), "{said}");

    std::fs::write(&image, b"no image").unwrap();
    let (status, said) = contract(folder.path(), &["check", "--against", image.to_str().unwrap()]);
    assert!(status == Some(2) && said.contains("richer.binpb is not a compiled schema"), "{said}");
    let (status, said) = contract(folder.path(), &["check", "--against", "none.binpb"]);
    assert!(status == Some(2) && said.contains("none.binpb"), "{said}");
}

#[test]
fn a_schema_that_breaks_the_last_release_is_found_by_buf() {
    if !has_buf() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let copy = copy_of_proto(folder.path());
    let bus = copy.join("supergaussian/bus/v1/bus.proto");
    edit(&bus, "uint64 refused = 8;", "uint32 refused = 8;");
    let (status, said) = contract(folder.path(), &["check"]);
    assert!(status == Some(1) && said.contains("FAILED    buf breaking"), "{said}");
    assert!(said.contains("\"refused\"") && said.contains("1 of"), "{said}");
}

#[test]
fn golden_bytes_may_only_be_added_to() {
    let folder = tempfile::tempdir().unwrap();
    let copy = copy_of_proto(folder.path());
    let bus = copy.join("golden/supergaussian.bus.v1.txt");
    let text = std::fs::read_to_string(&bus).unwrap();
    let without_first: String = text.lines().skip(1).map(|line| format!("{line}\n")).collect();
    std::fs::write(&bus, without_first).unwrap();
    let (status, said) = contract(folder.path(), &["check"]);
    assert!(status == Some(1) && said.contains("released lines of v0.1.0 were changed or deleted"), "{said}");

    // A line at the end whose meaning differs from its words.
    let last = text.lines().last().unwrap().replacen("{\"", "{\"x", 1);
    std::fs::write(&bus, format!("{text}{last}\n")).unwrap();
    let (status, said) = contract(folder.path(), &["check"]);
    assert!(status == Some(1) && said.contains("the meaning has changed"), "{said}");
    assert!(said.contains("begin as in v0.1.0"), "{said}");
}

#[test]
fn a_release_is_kept_once() {
    let folder = tempfile::tempdir().unwrap();
    let copy = copy_of_proto(folder.path());
    let (status, said) = contract(folder.path(), &["release", "9.0.0"]);
    assert_eq!(status, Some(0), "{said}");
    let image = copy.join("released/v9.0.0.binpb");
    let (status, said) = contract(folder.path(), &["check", "--against", image.to_str().unwrap()]);
    assert_eq!(status, Some(0), "{said}");
    let golden = std::fs::read_to_string(copy.join("released/v9.0.0.golden")).unwrap();
    assert!(golden.lines().any(|l| l.starts_with("supergaussian.scene.v1 ")), "{golden}");
    for version in ["9.0.0", "nine"] {
        let (status, said) = contract(folder.path(), &["release", version]);
        assert_eq!(status, Some(2), "{said}");
    }
}

#[test]
fn every_process_of_a_running_stack_keeps_to_its_rows() {
    let stack = Stack::up().unwrap();
    let (status, text, said) = stack.run(&["contract", "check", "--session", SESSION, "--json"]).unwrap();
    assert_eq!(status, Some(0), "{said}");
    let findings: Vec<Value> = serde_json::from_str(&text).unwrap();
    for what in ["processes of", "types of", "rows of"] {
        let check = format!("{what} `{SESSION}`");
        let finding =
            findings.iter().find(|f| f["check"] == check.as_str()).unwrap_or_else(|| panic!("{check}: {text}"));
        assert_eq!(finding["outcome"], "ok", "{finding}");
    }
    // The check finds a process that answers another's requests.
    sg_runtime::process::block_on(async {
        let thief = stack.join(sg_proto::keys::role::AGENT_INTENT).await.unwrap();
        let _token = thief.declare_liveliness("thief-1").await.unwrap();
        let _serving = thief
            .serve(&sg_proto::keys::PARSE, 4, |_, _| std::future::ready(Err(sg_runtime::fault::Fault::internal("no"))))
            .await
            .unwrap();
        let stack = &stack;
        let arguments = ["contract", "check", "--session", SESSION];
        let (status, _, said) = tokio::task::block_in_place(|| stack.run(&arguments)).unwrap();
        assert!(status == Some(1) && said.contains("agent-intent/cmd/parse is served by 2 processes"), "{said}");
    })
    .unwrap();
}
