//! The JSON schema covers every intent of the grammar.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use sg_language::intent_schema::IntentSchema;
use sg_language::{commands, grammar};

#[test]
fn every_intent_of_the_grammar_survives_the_schema() {
    let schema = IntentSchema::new().unwrap();
    let mut failures = Vec::new();
    for utterance in commands::examples(&["sac", "vessel"]) {
        let intent = grammar::parse(&utterance, &grammar::sample_observation(&["sac", "vessel"])).unwrap();
        let json = schema.encode(&intent).unwrap();
        match schema.decode(&json.to_string()) {
            Ok(read) if read.clauses == intent.clauses => (),
            other => failures.push(format!("“{utterance}”: {intent:?}\n{json}\n{other:?}")),
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}
