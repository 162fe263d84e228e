//! The intent agent on the bus: utterance and observation in, intent out and published.

use sg_agents::backend::{Backend, Parameters};
use sg_proto::keys::{self, role};
use sg_proto::language::{AgentState, Intent, IntentRequest};
use sg_runtime::actor::{Actor, Reply};
use sg_runtime::bus::{Bus, Owned};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};

/// Requests that wait at most.
const QUEUE: usize = 16;

pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::AGENT_INTENT {
        return Err(StartError::Input(format!(
            "role `{}`: this executable serves `{}`",
            host.role(),
            role::AGENT_INTENT
        )));
    }
    let Parameters { backend } = host.params()?;
    let told = AgentState { backend: backend.name().to_owned(), ..AgentState::default() };
    let state = host.bus().own(&keys::INTENT_STATE, told.clone()).await?;
    let listener = Listener { bus: host.bus().clone(), backend, told, state };
    let (mailbox, _) = host.spawn(listener, QUEUE);
    host.serve(&keys::PARSE, QUEUE, move |request, context| {
        let mailbox = mailbox.clone();
        async move { mailbox.ask(context.deadline, |reply| Message::Parse { request, context, reply }).await }
    })
    .await?;
    Ok(())
}

enum Message {
    Parse { request: IntentRequest, context: Context, reply: Reply<Intent> },
}

struct Listener {
    bus: Bus,
    backend: Backend,
    told: AgentState,
    state: Owned<AgentState>,
}

impl Listener {
    async fn parse(&self, request: &IntentRequest, context: &Context) -> Result<Intent, Fault> {
        let observation = request.observation.clone().unwrap_or_default();
        let intent = tokio::task::block_in_place(|| self.backend.understand(&request.text, &observation))
            .map_err(|refused| Fault::invalid(refused.to_string()))?;
        if let Err(fault) = self.bus.publish(&keys::INTENT, &intent, &context.next()).await {
            tracing::warn!(%fault, "an intent could not be published");
        }
        Ok(intent)
    }
}

impl Actor for Listener {
    type Message = Message;
    type State = String;

    fn name(&self) -> &'static str {
        "listener"
    }

    fn state(&self) -> String {
        format!(
            "{}: {} understood, {} not",
            self.told.backend,
            self.told.answered - self.told.refused,
            self.told.refused
        )
    }

    async fn handle(&mut self, message: Message) -> Result<(), String> {
        let Message::Parse { request, context, reply } = message;
        let outcome = self.parse(&request, &context).await;
        self.told.answered += 1;
        self.told.refused += u64::from(outcome.as_ref().map_or(true, |intent| !intent.not_understood.is_empty()));
        if let Err(fault) = self.state.set(self.told.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be told");
        }
        // An asker that has gone away needs no answer.
        let _ = reply.send(outcome);
        Ok(())
    }
}
