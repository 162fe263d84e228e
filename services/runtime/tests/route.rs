//! Requests that an actor answers through its mailbox.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use std::time::Duration;

use sg_proto::bus::{CancelReply, Code};
use sg_proto::keys::{self, role};
use sg_proto::scene::{Command, CommandResult};
use sg_runtime::actor::{self, Actor, ActorError, Reply};
use sg_runtime::bus::{Bus, endpoint_of};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

struct Scene {
    revision: u64,
}

enum Message {
    Apply { command: Command, context: Context, reply: Reply<CommandResult> },
}

impl Actor for Scene {
    type Message = Message;
    type State = u64;

    fn name(&self) -> &'static str {
        "scene"
    }

    fn state(&self) -> u64 {
        self.revision
    }

    async fn handle(&mut self, Message::Apply { command, context, reply }: Message) -> Result<(), ActorError> {
        let result = match command.id.as_str() {
            "refuse" => Err(Fault::precondition("the selection is empty")),
            "fail" => return Err(ActorError::new("failed on purpose")),
            id => {
                if id == "slow" {
                    tokio::time::sleep(Duration::from_millis(200)).await;
                }
                self.revision += 1;
                let summary = context.conversation;
                Ok(CommandResult { id: command.id, revision: self.revision, summary, ..CommandResult::default() })
            }
        };
        let _ = reply.send(result);
        Ok(())
    }
}

fn soon() -> Context {
    Context::root().deadline_in(Duration::from_secs(5))
}

fn command(id: &str) -> Command {
    Command { id: id.to_owned(), ..Command::default() }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_actor_answers_through_its_mailbox() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("bus.sock");
    let _router = Bus::open_router("test", role::SUPERVISOR, &socket, None).await.unwrap();
    let scene = Bus::connect("test", role::SCENE, &endpoint_of(&socket)).await.unwrap();
    let cli = Bus::connect("test", role::CLI, &endpoint_of(&socket)).await.unwrap();

    let (mailbox, running) = actor::spawn(Scene { revision: 0 }, 8);
    let message = |command, context, reply| Message::Apply { command, context, reply };
    let _serving = scene.route(&keys::SCENE_APPLY, 8, &mailbox, message).await.unwrap();
    let bus = scene.clone();
    let cancel = move |request: sg_proto::bus::CancelRequest, context: Context| {
        std::future::ready(Ok(CancelReply { found: bus.cancel_pending(&request.id, &context) }))
    };
    let _cancel = scene.serve(&keys::CANCEL, 4, cancel).await.unwrap();
    let ask = async |id: &str, context: Context| cli.ask(&keys::SCENE_APPLY, &command(id), &context).await;

    let result = ask("first", soon().at_step("talk", 1)).await.unwrap();
    assert_eq!((result.id.as_str(), result.revision, result.summary.as_str()), ("first", 1, "talk"));
    assert_eq!(ask("refuse", soon()).await.unwrap_err().code, Code::FailedPrecondition);

    let late = ask("slow", Context::root().deadline_in(Duration::from_millis(50))).await.unwrap_err();
    assert_eq!(late.code, Code::DeadlineExceeded);

    let (asking, cancelling) = tokio::join!(ask("slow", soon().with_id("a")), async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        cli.cancel(role::SCENE, "a").await
    });
    assert_eq!(asking.unwrap_err().code, Code::Cancelled);
    assert!(cancelling.unwrap());

    // The actor finishes the two messages without a reader of their replies.
    assert_eq!(ask("last", soon()).await.unwrap().revision, 4);

    let failed = ask("fail", soon().deadline_in(Duration::from_millis(300))).await.unwrap_err();
    assert!(matches!(failed.code, Code::Unavailable | Code::DeadlineExceeded), "{failed:?}");
    assert_eq!(running.exit.await.unwrap(), actor::Exit::Failed(ActorError::new("failed on purpose")));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_loop_answers_through_an_inbox() {
    let (mailbox, mut inbox) = actor::mailbox::<Reply<u64>>("loop", 1);
    let reader = tokio::spawn(async move {
        while let Some(reply) = inbox.recv().await {
            let _ = reply.send(Ok(7));
        }
    });
    assert_eq!(mailbox.ask(soon().deadline, |reply| reply).await, Ok(7));
    drop(mailbox);
    reader.await.unwrap();
}
