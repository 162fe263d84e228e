//! What the grammar says and what a model may answer are the same: the form of an intent holds all of it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use sg_language::intent_schema::IntentSchema;
use sg_language::{commands, grammar};

#[test]
fn everything_that_the_grammar_says_has_this_form_and_comes_back_the_same() {
    let schema = IntentSchema::new().unwrap();
    let mut others = Vec::new();
    for said in commands::examples(&["sac", "vessel"]) {
        let meant = grammar::parse(&said, &grammar::sample_observation(&["sac", "vessel"])).unwrap();
        let written = schema.encode(&meant).unwrap();
        match schema.decode(&written.to_string()) {
            Ok(read) if read.clauses == meant.clauses => (),
            other => others.push(format!("“{said}”: {meant:?}\n{written}\n{other:?}")),
        }
    }
    assert!(others.is_empty(), "{}", others.join("\n\n"));
}
