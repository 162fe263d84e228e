//! A service in another language takes a role of a running stack, and gives it back.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by its helpers and says what it skips")]

use std::time::Duration;

use sg_proto::keys::{self, role};
use sg_proto::scene::Color;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_tests::stack::Stack;
use sg_tests::{executable, python_intent};

fn soon() -> Context {
    Context::root().deadline_in(Duration::from_secs(20))
}

/// The backend that understands utterances at present.
async fn backend(cli: &Bus) -> String {
    cli.newest(&keys::INTENT_STATE, &soon()).await.unwrap().backend
}

async fn palette(cli: &Bus, unit: &str) -> Color {
    let state = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
    state.base_units.iter().find(|u| u.name == unit).and_then(|u| u.palette).unwrap()
}

fn pids(stack: &Stack) -> Vec<(String, u64)> {
    let pid = |s: &serde_json::Value| (s["name"].as_str().unwrap().to_owned(), s["pid"].as_u64().unwrap());
    stack.ps().iter().map(pid).collect()
}

fn run(stack: &Stack, arguments: &[&str]) {
    let (status, _, said) = tokio::task::block_in_place(|| stack.run(arguments)).unwrap();
    assert_eq!(status, Some(0), "{arguments:?}: {said}");
}

#[test]
fn a_service_in_python_takes_the_intent_role_and_gives_it_back() {
    let Some(python) = python_intent().unwrap() else {
        println!("SKIPPED: the service in Python needs the environment that ops/python.sh makes");
        return;
    };
    let ours = executable("supergaussian-agent-intent").unwrap();
    let stack = Stack::up().unwrap();
    sg_runtime::process::block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        let grammar = backend(&cli).await;
        let before = pids(&stack);

        run(&stack, &["swap", "agent-intent", python.to_str().unwrap()]);
        assert_eq!(backend(&cli).await, "python-keywords");
        run(&stack, &["say", "make the sac red"]);
        let sac = palette(&cli, "sac").await;
        assert!(sac.red > 0.9 && sac.green < 0.1 && sac.blue < 0.1, "{sac:?}");
        let during = pids(&stack);
        let changed: Vec<_> = before.iter().zip(&during).filter(|(b, d)| b != d).map(|(b, _)| b.0.as_str()).collect();
        assert_eq!(changed, ["agent-intent"], "only one service was touched");

        run(&stack, &["swap", "agent-intent", ours.to_str().unwrap()]);
        assert_eq!(backend(&cli).await, grammar);
        run(&stack, &["say", "make the sac blue"]);
        assert!(palette(&cli, "sac").await.blue > 0.8);
    })
    .unwrap();
}
