//! The intent agent on the bus: utterance and observation in, intent out and published.

use std::time::Duration;

use sg_agents::recent::Recent;
use sg_proto::keys::{self, role};
use sg_proto::language::{AgentState, Intent, IntentRequest};
use sg_runtime::actor::{Actor, Reply};
use sg_runtime::bus::{Bus, Owned};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};

use crate::understander::Understander;

/// Requests that wait at most.
const QUEUE: usize = 16;
/// Intents kept for askers that ask again.
const KEPT_INTENTS: usize = 64;
/// Time kept back for the grammar, where the model does not serve, and for the answer's own way.
const MARGIN: Duration = Duration::from_millis(100);

pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::AGENT_INTENT {
        return Err(StartError::Input(format!(
            "role `{}`: this executable serves `{}`",
            host.role(),
            role::AGENT_INTENT
        )));
    }
    let understander = Understander::new(&host.params()?)
        .map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;
    let told = understander.told();
    let state = host.bus().own(&keys::INTENT_STATE, told.clone()).await?;
    let understood = Recent::new(KEPT_INTENTS);
    let listener = Listener { bus: host.bus().clone(), understander, told, state, understood };
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
    understander: Understander,
    told: AgentState,
    state: Owned<AgentState>,
    /// Intents by request, for askers that ask again: a model might understand otherwise the second time.
    understood: Recent<Intent>,
}

impl Listener {
    async fn parse(&mut self, request: &IntentRequest, context: &Context) -> Result<Intent, Fault> {
        if let Some(intent) = self.understood.get(&context.id) {
            return Ok(intent.clone());
        }
        let deadline = context.deadline.checked_sub(MARGIN).unwrap_or(context.deadline);
        let intent = self.understander.understand(request, &context.id, deadline, &mut self.told).await?;
        self.understood.keep(&context.id, intent.clone());
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
        let Message::Parse { request, context, mut reply } = message;
        // An asker that has gone away needs no answer, and no model is kept busy for it.
        let outcome = tokio::select! {
            outcome = self.parse(&request, &context) => outcome,
            () = reply.closed() => return Ok(()),
        };
        self.told.answered += 1;
        self.told.refused += u64::from(outcome.as_ref().map_or(true, |intent| !intent.not_understood.is_empty()));
        if let Err(fault) = self.state.set(self.told.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be told");
        }
        let _ = reply.send(outcome);
        Ok(())
    }
}
