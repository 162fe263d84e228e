//! The offline command `parse`: output and exit status.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::process::{Command, Output};

fn parse(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_supergaussian-agent-intent")).args(arguments).output().unwrap()
}

#[test]
fn an_intent_is_written_as_json() {
    let output = parse(&["parse", "make the sac red, then zoom in", "--units", "sac,vessel", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(output.stderr.is_empty());
    let intent: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(intent["backend"], "grammar");
    assert_eq!(intent["clauses"][0]["act"], "ACT_SET_COLOR");
    assert_eq!(intent["clauses"][0]["target"]["names"][0], "sac");
    let red = intent["clauses"][0]["color"]["red"].as_f64().unwrap();
    assert!((red - 211.0 / 255.0).abs() < 1e-6, "{red}");
    assert_eq!(intent["clauses"][1]["view"]["zoom"], 1.5);
}

#[test]
fn parts_that_are_not_understood_fail_the_command() {
    let output = parse(&["parse", "make the sac red and dance", "--units", "sac"]);
    assert_eq!(output.status.code(), Some(1));
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains("set_color: “make the sac red”") && stderr.contains("not understood: “dance”"), "{stderr}");
    assert!(output.stdout.is_empty());
}

#[test]
fn invalid_arguments_exit_with_status_2() {
    for (arguments, part) in [
        (&["parse", "", "--units", "sac"][..], "the utterance is empty"),
        (&["parse", &"a".repeat(5000)], "5000 bytes"),
        (&["parse", "zoom in", "--backend", "gpt"], "use one of `grammar`, `openai`, `grpc`"),
        (&["parse", "zoom in", "--model", "m"], "the backend `grammar` has no parameter `model`"),
        (&["parse"], "<TEXT>"),
    ] {
        let output = parse(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(part), "{output:?}");
    }
}

#[test]
fn phrases_hold_the_names_of_units() {
    let output = parse(&["phrases", "--units", "leaves,pot"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8(output.stdout).unwrap().contains("make the leaves red"));
}
