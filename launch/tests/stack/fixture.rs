//! A service that misbehaves on purpose. It is this test executable itself, started again by a script of the bench, so
//! that no executable beside those of the project has to be built.

use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use serde::Deserialize;
use sg_proto::keys;
use sg_proto::language::{Reply, Utterance};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::process::{Host, ServeArgs, StartError, run};

#[derive(Parser)]
struct Fixture {
    #[command(flatten)]
    serve: ServeArgs,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct Params {
    /// Milliseconds before it is ready.
    start_ms: u64,
    /// Milliseconds after which it hangs, deaf to everything.
    hang_ms: Option<u64>,
    /// Answers utterances (role agent-core): all but "fail" with success.
    answers: bool,
}

#[test]
#[ignore = "not a test: the services that the other tests start"]
fn fixture() {
    let arguments = std::env::var("ARGUMENTS").expect("started by a script of the bench");
    let fixture = Fixture::parse_from(arguments.lines());
    let status = run(fixture.serve, "fixture", load);
    std::process::exit(i32::from(status != ExitCode::SUCCESS) * 2);
}

async fn load(host: Host) -> Result<(), StartError> {
    let params: Params = host.params()?;
    tokio::time::sleep(Duration::from_millis(params.start_ms)).await;
    if params.answers {
        let bus = host.bus().clone();
        host.serve(&keys::UTTER, 4, move |utterance, context| answer(bus.clone(), utterance, context)).await?;
    }
    if let Some(ms) = params.hang_ms {
        // More than there are threads that carry messages.
        for _ in 0..8 {
            tokio::spawn(async move {
                tokio::time::sleep(Duration::from_millis(ms)).await;
                std::thread::sleep(Duration::from_secs(3600));
            });
        }
    }
    tracing::info!(greeting = "hello there", "loaded");
    Ok(())
}

async fn answer(bus: Bus, utterance: Utterance, context: Context) -> Result<Reply, sg_runtime::fault::Fault> {
    bus.publish(&keys::UTTERANCE, &utterance, &context.next()).await?;
    let ok = utterance.text != "fail";
    let reply = Reply { text: format!("you said: {}", utterance.text), ok, ..Reply::default() };
    bus.publish(&keys::REPLY, &reply, &context.next()).await?;
    Ok(reply)
}
