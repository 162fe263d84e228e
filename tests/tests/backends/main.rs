//! Each agent with a backend of its own: programs that are no part of this project, in a running stack.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::panic,
    reason = "a test fails by panicking and prints its tally"
)]

mod programs;

use std::process::Command;

use programs::Program;
use serde_json::Value;
use sg_proto::keys::{self, role};
use sg_proto::speech::SpeakRequest;
use sg_runtime::process::block_on;
use sg_speech::audio::wav::{MAX_DURATION, read_wav};
use sg_tests::executable;
use sg_tests::stack::Stack;
use sg_tests::until::soon;

/// Sends an utterance: the answer as JSON, with the stages it went through.
fn say(stack: &Stack, text: &str) -> Value {
    let (_, answer, told) = stack.run(&["say", text, "--json", "--timeout", "60"]).unwrap();
    serde_json::from_str(&answer).unwrap_or_else(|e| panic!("“{text}”: {e}: {told}"))
}

/// The message of a stage.
fn stage<'a>(answer: &'a Value, name: &str) -> &'a Value {
    let full = format!("supergaussian.language.v1.{name}");
    let stages = answer["stages"].as_array().unwrap();
    &stages.iter().find(|s| s["type"] == full.as_str()).unwrap_or_else(|| panic!("no {name} in {answer:#}"))["message"]
}

fn starts(text: &Value, with: &str) {
    assert!(text.as_str().is_some_and(|t| t.starts_with(with)), "{text} does not start with {with}");
}

fn set(agent: &str, parameter: &str, value: &str) -> String {
    format!("service.{agent}.params.{parameter}={value}")
}

#[test]
fn one_agent_of_a_stack_thinks_with_a_program_in_python_and_falls_back_when_that_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let address = format!("unix:{}", folder.path().join("model.sock").display());
    let Some(german) = Program::german(&address) else { return };
    assert_eq!(german.endpoint, address);
    let agent = "agent-intent";
    let stack = Stack::up_with(&[set(agent, "backend", "grpc"), set(agent, "endpoint", &address)]).unwrap();

    let answer = say(&stack, "färbe das sac rot und mach body auf 40 prozent");
    assert_eq!(answer["ok"], true, "{answer:#}");
    let intent = stage(&answer, "Intent");
    assert_eq!((&intent["backend"], &intent["model"]), (&"grpc".into(), &"german-keywords".into()));
    starts(&answer["text"], "The sac is now rot");
    assert_eq!(answer["reply"]["backend"], "grammar", "only the one agent was given a model");

    drop(german);
    let answer = say(&stack, "make the sac blue");
    assert_eq!(answer["ok"], true, "{answer:#}");
    let intent = stage(&answer, "Intent");
    assert_eq!(intent["backend"], "grammar");
    starts(&intent["fallback"], "the model is unavailable");
    say(&stack, "make the sac green");
    let (_, log, _) = stack.run(&["logs", agent]).unwrap();
    assert_eq!(log.matches("the grammar serves until it recovers").count(), 1, "{log}");

    // The program comes back, and no service needed a restart for it.
    std::fs::remove_file(folder.path().join("model.sock")).unwrap_or_default();
    let _german = Program::german(&address).unwrap();
    let answer = say(&stack, "verstecke das sac");
    assert_eq!(stage(&answer, "Intent")["backend"], "grpc", "{answer:#}");
}

#[test]
fn one_agent_of_a_running_stack_swaps_its_backend_alone() {
    let Some(german) = Program::german("127.0.0.1:0") else { return };
    let stack = Stack::up().unwrap();
    let words = "verstecke das sac";
    assert_eq!(say(&stack, words)["ok"], false, "the grammar speaks no German");
    let pids = || -> Vec<(String, u64)> {
        let pid = |s: &Value| (s["name"].as_str().unwrap().to_owned(), s["pid"].as_u64().unwrap());
        stack.ps().iter().map(pid).collect()
    };
    let before = pids();

    // The same file once more, with another table for one agent.
    let agent = "agent-intent";
    let (status, out, told) =
        stack.up_again(&[set(agent, "backend", "grpc"), set(agent, "endpoint", &german.endpoint)]).unwrap();
    assert_eq!(status, Some(0), "{told}");
    assert!(out.lines().any(|l| l.starts_with(agent) && l.contains("swapped")), "{out}");
    let changed = |now: &[(String, u64)]| -> Vec<String> {
        before.iter().zip(now).filter(|(b, n)| b.1 != n.1).map(|(b, _)| b.0.clone()).collect()
    };
    let with_model = pids();
    assert_eq!(changed(&with_model), [agent]);
    let answer = say(&stack, words);
    assert_eq!(answer["ok"], true, "{answer:#}");
    assert_eq!(stage(&answer, "Intent")["backend"], "grpc");

    // And back.
    let (status, _, told) = stack.up_again(&[]).unwrap();
    assert_eq!(status, Some(0), "{told}");
    assert_eq!(changed(&pids()), [agent]);
    assert_eq!(stage(&say(&stack, "show everything"), "Intent")["backend"], "grammar");
}

#[test]
fn every_agent_thinks_with_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let (Some(german), Some(llama)) = (Program::german("127.0.0.1:0"), Program::llama(folder.path())) else { return };
    let mut settings = Vec::new();
    for agent in ["agent-intent", "agent-core"] {
        settings.extend([set(agent, "backend", "grpc"), set(agent, "endpoint", &german.endpoint)]);
        settings.push(set(agent, "fallback", "none"));
    }
    let stack = Stack::up_with(&settings).unwrap();
    let refused = say(&stack, "verstecke die beule");
    assert_eq!(refused["ok"], false, "{refused:#}");
    starts(&refused["text"], "Nicht alles ging: Nothing is named “beule” yet.");
    assert_eq!(refused["reply"]["backend"], "grpc");
    drop(stack);

    // With a model, the function agent resolves the meaning. First the model knows the answer; then it chooses among the units,
    // regardless of the request.
    let function = "agent-function";
    let knows = [set(function, "backend", "grpc"), set(function, "endpoint", &german.endpoint)];
    let stack = Stack::up_with(&[&settings[..], &knows[..]].concat()).unwrap();
    let answer = say(&stack, "verstecke die beule");
    assert_eq!(answer["ok"], true, "{answer:#}");
    let resolved = &stage(&answer, "ActionResult")["resolved_names"][0];
    assert_eq!((&resolved["spoken"], &resolved["unit"]), (&"beule".into(), &"sac".into()));
    starts(&answer["reply"]["facts"], "Interpreted “beule” as the unit “sac”. The sac is now hidden.");
    assert_eq!(answer["text"], format!("Erledigt: {}", answer["reply"]["facts"].as_str().unwrap()));
    drop(stack);

    let endpoint = format!("{}/v1", llama.endpoint);
    let chooses =
        [set(function, "backend", "openai"), set(function, "model", "random"), set(function, "endpoint", &endpoint)];
    let stack = Stack::up_with(&[&settings[..], &chooses[..]].concat()).unwrap();
    let answer = say(&stack, "verstecke die leber");
    let action = stage(&answer, "ActionResult");
    match action["resolved_names"][0]["unit"].as_str() {
        Some(unit) => {
            assert!(["sac", "body"].contains(&unit) && answer["ok"] == true, "{answer:#}");
            assert!(action["resolved_names"][0]["model"].as_str().is_some_and(|m| m.contains("random")), "{action:#}");
        }
        None => starts(&action["text"], "Nothing is named “leber” yet."),
    }

    drop(german);
    let answer = say(&stack, "zeige das sac");
    assert_eq!(answer["ok"], false, "{answer:#}");
    starts(&answer["error"], "The model is unavailable");
}

#[test]
fn a_llama_cpp_server_follows_the_schema_and_invented_units_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let Some(llama) = Program::llama(folder.path()) else { return };
    let intent = executable("supergaussian-agent-intent").unwrap();
    let endpoint = format!("{}/v1", llama.endpoint);
    let (mut taken, mut made_up) = (0, 0);
    const ASKED: usize = 12;
    for seed in 0..ASKED {
        let output = Command::new(&intent)
            .args(["parse", "hide the sac", "--units", "sac,vessel", "--selected", "--json"])
            .args(["--backend", "openai", "--model", "random", "--endpoint", &endpoint, "--temperature", "1"])
            .args(["--seed", &seed.to_string(), "--retries", "0", "--fallback", "none", "--timeout-s", "120"])
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.stdout.is_empty() {
            println!("{seed}: {}", told.trim());
            assert!(told.contains("answer is invalid"), "{told}");
            // Its grammar holds the form; it does not hold ranges of fractions, and the most tokens may cut it off.
            assert!(
                !told.contains("does not match the schema")
                    && !told.contains(" needs `")
                    && !told.contains("has no field `"),
                "{told}"
            );
            made_up += 1;
        } else {
            let meant: Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!((&meant["backend"], meant.get("fallback")), (&"openai".into(), None));
            println!("{seed}: {}", meant["clauses"]);
            taken += 1;
        }
    }
    println!("{taken} of {ASKED} answers of a random model were taken, {made_up} not");
    assert!(taken > 0, "an answer within the form that names nothing wrong is taken");
}

#[test]
fn a_program_in_python_speaks_and_hears() {
    let folder = tempfile::tempdir().unwrap();
    if ["espeak-ng", "pocketsphinx_batch"].map(|name| executable(name).is_ok()) != [true; 2] {
        let is_required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
        assert!(!is_required, "espeak-ng or pocketsphinx is missing; run ops/setup-debian.sh");
        println!("SKIPPED: espeak-ng or pocketsphinx is missing");
        return;
    }
    let Some(program) = Program::speech("127.0.0.1:0") else { return };
    let sound = folder.path().join("command.wav");
    let endpoint = program.endpoint.clone();
    let run = |arguments: &[&str]| {
        let mut command = Command::new(executable("supergaussian-speech").unwrap());
        let output = command.args(arguments).args(["--endpoint", &endpoint]).output().unwrap();
        (output.status.code(), [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()))
    };
    let sound = sound.to_str().unwrap();
    let spoken = run(&["speak", "hide the vessel", "--out", sound, "--synthesizer", "grpc"]);
    assert_eq!(spoken.0, Some(0), "{spoken:?}");
    let heard = run(&["listen", sound, "--recognizer", "grpc", "--unit", "sac", "--unit", "vessel"]);
    assert_eq!((heard.0, heard.1[0].as_str()), (Some(0), "command\t1.00\thide the vessel\n"), "{heard:?}");
    // The confined service may reach the program.
    let reply = folder.path().join("reply.wav");
    let settings = [
        set("speech", "output", &reply.display().to_string()),
        set("speech", "synthesizer", "grpc"),
        set("speech", "synthesizer_server.endpoint", &endpoint),
    ];
    let stack = Stack::up_with(&settings).unwrap();
    let text = "The vessel is hidden.".to_owned();
    let said = block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        cli.ask(&keys::SPEECH_SPEAK, &SpeakRequest { text }, &soon()).await.unwrap()
    })
    .unwrap();
    assert!(said.sentences == 1 && !said.stopped && said.first_sound_ms.is_some(), "{said:?}");
    let length = read_wav(&reply, MAX_DURATION).unwrap().duration();
    assert!(length.as_secs_f64() > 0.5, "{length:?}");
    drop(stack);
    drop(program);
    let silent = run(&["speak", "hide it", "--out", sound, "--synthesizer", "grpc"]);
    assert!(silent.0 == Some(2) && silent.1[1].starts_with("error: `grpc` at http://127.0.0.1:"), "{silent:?}");
}
