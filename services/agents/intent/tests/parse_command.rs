//! The offline command `parse`: output and exit status.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::process::{Command, Output};

fn parse(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_supergaussian-agent-intent")).args(arguments).output().unwrap()
}

#[test]
fn an_intent_is_written_as_json_by_its_schema() {
    let output = parse(&["parse", "make the sac red, then zoom in", "--units", "sac,vessel", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(output.stderr.is_empty());
    let intent: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(intent["backend"], "grammar");
    assert_eq!(intent["clauses"][0]["act"], "ACT_SET_COLOR");
    assert_eq!(intent["clauses"][0]["target"]["names"][0], "sac");
    assert_eq!(intent["clauses"][0]["color"]["red"], 1.0);
    assert_eq!(intent["clauses"][1]["view"]["zoom"], 1.5);
}

#[test]
fn what_is_not_understood_fails_the_command_and_is_said() {
    let output = parse(&["parse", "make the sac red and dance", "--units", "sac"]);
    assert_eq!(output.status.code(), Some(1));
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("set_color: “make the sac red”") && told.contains("not understood: “dance”"), "{told}");
    assert!(output.stdout.is_empty());
}

#[test]
fn wrong_arguments_are_told_in_a_line_with_status_2() {
    for (arguments, part) in [
        (&["parse", "", "--units", "sac"][..], "nothing was said"),
        (&["parse", &"a".repeat(5000)], "5000 bytes"),
        (&["parse", "zoom in", "--backend", "gpt"], "there are `grammar`, `openai`, `grpc`"),
        (&["parse", "zoom in", "--model", "m"], "`model` means nothing to the backend `grammar`"),
        (&["parse"], "<TEXT>"),
    ] {
        let output = parse(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(part), "{output:?}");
    }
}

#[test]
fn phrases_name_the_units_given() {
    let output = parse(&["phrases", "--units", "leaves,pot"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8(output.stdout).unwrap().contains("make the leaves red"));
}
