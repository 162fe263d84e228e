//! The backend `openai` against a scripted server, through the command `parse`.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

mod scripted;

use std::process::{Command, Output};
use std::time::Duration;

use scripted::{Answer, Server};
use serde_json::{Value, json};

const KEY: &str = "sk-very-5ecret-key";

fn parse(text: &str, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_supergaussian-agent-intent"))
        .args(["parse", text, "--units", "sac,vessel", "--backend", "openai", "--model", "m-1", "--json"])
        .args(more)
        .env("TEST_MODEL_KEY", KEY)
        .env_remove("TEST_NO_KEY")
        // No server listens there, so a client that used these proxies would fail.
        .envs(
            ["http_proxy", "HTTP_PROXY", "https_proxy", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"]
                .map(|v| (v, "http://127.0.0.1:9")),
        )
        .output()
        .unwrap()
}

fn intent(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {output:?}"))
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// The answer of a model to "verstecke den Sack".
fn hides_the_sac() -> String {
    let target =
        json!({"names": ["sac"], "selection": false, "everything": false, "complement": false, "focus": false});
    let clause = json!({"act": "ACT_HIDE", "target": target, "words": "verstecke den Sack"});
    json!({"clauses": [clause], "not_understood": []}).to_string()
}

#[test]
fn a_model_interprets_german_and_its_key_stays_secret() {
    let server = Server::start(&[Answer::completion(&hides_the_sac())]);
    let options = ["--endpoint", &server.url(), "--key-env", "TEST_MODEL_KEY", "--seed", "7", "--temperature", "0"];
    let output = parse("verstecke den Sack", &options);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let meant = intent(&output);
    assert_eq!((&meant["backend"], &meant["model"]), (&json!("openai"), &json!("scripted-1")));
    assert_eq!(meant["clauses"][0]["act"], "ACT_HIDE");
    assert_eq!(meant["clauses"][0]["target"]["names"], json!(["sac"]));

    let request = &server.requests()[0];
    assert_eq!(
        (request.path.as_str(), request.authorization.as_str()),
        ("/v1/chat/completions", "Bearer sk-very-5ecret-key")
    );
    let body = &request.body;
    assert_eq!((&body["model"], &body["seed"], &body["temperature"]), (&json!("m-1"), &json!(7), &json!(0.0)));
    assert_eq!(body["response_format"]["json_schema"]["schema"]["additionalProperties"], false);
    let user: Value = serde_json::from_str(body["messages"][1]["content"].as_str().unwrap()).unwrap();
    assert_eq!((&user["utterance"], &user["units"]), (&json!("verstecke den Sack"), &json!(["sac", "vessel"])));
    assert!(!body.to_string().contains(KEY));
}

#[test]
fn no_log_line_holds_the_key() {
    let server = Server::start(&[Answer::completion(&hides_the_sac())]);
    let output = Command::new(env!("CARGO_BIN_EXE_supergaussian-agent-intent"))
        .args(["parse", "verstecke den Sack", "--units", "sac", "--backend", "openai", "--model", "m"])
        .args(["--endpoint", &server.url(), "--key-env", "TEST_MODEL_KEY"])
        .envs([("TEST_MODEL_KEY", KEY), ("SUPERGAUSSIAN_LOG", "trace")])
        .output()
        .unwrap();
    assert_eq!(server.requests().len(), 1);
    assert!(stderr(&output).contains("TRACE"), "{}", stderr(&output));
    assert!(!stderr(&output).contains(KEY));
}

#[test]
fn an_invalid_answer_is_retried_before_the_fallback() {
    let server = Server::start(&[Answer::completion("I hid it for you!"), Answer::completion(&hides_the_sac())]);
    let again = parse("verstecke den Sack", &["--endpoint", &server.url(), "--seed", "7"]);
    assert_eq!(intent(&again)["backend"], "openai", "{again:?}");
    let seeds: Vec<Value> = server.requests().iter().map(|a| a.body["seed"].clone()).collect();
    assert_eq!(seeds, [7, 8], "the same seed would give the same answer");

    let server = Server::start(&[Answer::completion("I hid it for you!")]);
    let fallen = parse("hide the sac", &["--endpoint", &server.url(), "--retries", "2"]);
    assert_eq!(fallen.status.code(), Some(0), "{fallen:?}");
    assert_eq!(server.requests().len(), 3);
    let meant = intent(&fallen);
    assert_eq!((&meant["backend"], &meant["clauses"][0]["act"]), (&json!("grammar"), &json!("ACT_HIDE")));
    assert!(meant["fallback"].as_str().unwrap().contains("is invalid: it does not match the schema"), "{meant}");
    assert!(stderr(&fallen).contains("the grammar served: the model's answer is invalid"), "{fallen:?}");

    let server = Server::start(&[Answer::completion(&hides_the_sac().replace("\"sac\"", "\"liver\""))]);
    let invented = parse("hide the sac", &["--endpoint", &server.url()]);
    assert_eq!(intent(&invented)["backend"], "grammar");
    assert!(stderr(&invented).contains("names a unit that does not exist and was not mentioned"), "{invented:?}");
}

#[test]
fn without_a_fallback_the_request_fails() {
    let echo = format!(r#"{{"error": {{"message": "wrong key {KEY}"}}}}"#);
    let server = Server::start(&[Answer::new(401, &echo)]);
    let more = ["--endpoint", &server.url(), "--key-env", "TEST_MODEL_KEY", "--fallback", "none", "--retries", "5"];
    let output = parse("hide the sac", &more);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert_eq!(stderr(&output).trim(), "the model refused: status 401: wrong key (key)");
    assert_eq!(server.requests().len(), 1, "a refusal is not retried");
    assert!(output.stdout.is_empty());
}

#[test]
fn the_grammar_serves_when_the_model_is_late_unavailable_or_overloaded() {
    let server = Server::start(&[Answer::completion(&hides_the_sac()).with_delay(Duration::from_secs(30))]);
    let late = parse("hide the sac", &["--endpoint", &server.url(), "--timeout-s", "0.3"]);
    assert_eq!(intent(&late)["backend"], "grammar");
    assert!(stderr(&late).contains("did not answer within"), "{late:?}");

    let away = parse("hide the sac", &["--endpoint", "http://127.0.0.1:9/v1"]);
    assert_eq!(intent(&away)["backend"], "grammar");
    assert!(stderr(&away).contains("the model is unavailable"), "{away:?}");

    let server = Server::start(&[Answer::new(503, "{}"), Answer::completion(&hides_the_sac())]);
    let busy = parse("verstecke den Sack", &["--endpoint", &server.url()]);
    assert_eq!(intent(&busy)["backend"], "openai", "{busy:?}");
}

#[test]
fn endless_answers_and_redirects_are_refused() {
    let server = Server::start(&[Answer::new(200, &"a".repeat(4 << 20))]);
    let output = parse("hide the sac", &["--endpoint", &server.url(), "--retries", "0"]);
    assert!(stderr(&output).contains("bytes"), "{output:?}");

    let elsewhere = Server::start(&[Answer::completion(&hides_the_sac())]);
    let server = Server::start(&[Answer::redirect(format!("{}/chat/completions", elsewhere.url()))]);
    let output = parse("hide the sac", &["--endpoint", &server.url(), "--key-env", "TEST_MODEL_KEY"]);
    assert!(stderr(&output).contains("refused: status 307"), "{output:?}");
    assert!(elsewhere.requests().is_empty(), "prompts and keys go where the launch file says");
}

#[test]
fn invalid_parameters_exit_with_status_2() {
    for (more, part) in [
        (
            &["--endpoint", "http://127.0.0.1:9", "--key-env", "TEST_NO_KEY"][..],
            "environment variable TEST_NO_KEY is not set",
        ),
        (&["--endpoint", "http://10.1.2.3/v1"], "use https"),
        (&["--endpoint", "http://127.0.0.1:9", "--timeout-s", "0"], "`timeout_s` is 0"),
        (&["--endpoint", "http://127.0.0.1:9", "--fallback", "gpt"], "`fallback` is `grammar` or `none`"),
        (&[], "needs `key_env`"),
    ] {
        let output = parse("hide the sac", more);
        assert_eq!(output.status.code(), Some(2), "{more:?}: {output:?}");
        assert!(stderr(&output).contains(part), "{output:?}");
    }
}
