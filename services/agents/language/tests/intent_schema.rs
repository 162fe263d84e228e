//! What the grammar says and what a model may answer are the same: the form of an intent holds all of it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use sg_language::grammar;
use sg_language::intent_schema::IntentSchema;

#[test]
fn everything_that_the_grammar_says_has_this_form_and_comes_back_the_same() {
    let form = IntentSchema::new().unwrap();
    let mut others = Vec::new();
    for said in grammar::examples(&["sac", "vessel"]) {
        let meant = grammar::parse(&said, &grammar::sample_observation(&["sac", "vessel"])).unwrap();
        let written = form.write(&meant).unwrap();
        match form.read(&written.to_string()) {
            Ok(read) if read.clauses == meant.clauses => (),
            other => others.push(format!("“{said}”: {meant:?}\n{written}\n{other:?}")),
        }
    }
    assert!(others.is_empty(), "{}", others.join("\n\n"));
}
