//! The intent agent on the bus: an utterance and an observation in, an intent out.

use std::num::NonZeroUsize;
use std::time::Duration;

use lru::LruCache;
use sg_llm::{InterpretError, Interpreter};
use sg_proto::keys::{self, role};
use sg_proto::language::{AgentState, Intent, IntentRequest};
use sg_runtime::actor::{Actor, ActorError, Reply};
use sg_runtime::bus::{Bus, RetainedValue};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};

/// Length of the request queue.
const QUEUE: usize = 16;
/// Intents kept for repeated requests.
const CACHED_INTENTS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(63);
/// Time reserved for the fallback to the grammar and for the reply.
const MARGIN: Duration = Duration::from_millis(100);

pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::AGENT_INTENT {
        return Err(StartError::Input(format!(
            "role `{}`: this executable serves `{}`",
            host.role(),
            role::AGENT_INTENT
        )));
    }
    let interpreter = Interpreter::new(&host.params()?)
        .map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;
    let agent_state = interpreter.initial_state();
    let published_state = host.bus().retain(&keys::INTENT_STATE, agent_state.clone()).await?;
    let intents = LruCache::new(CACHED_INTENTS);
    let agent = IntentAgent { bus: host.bus().clone(), interpreter, agent_state, published_state, intents };
    let (mailbox, _) = host.spawn(agent, QUEUE);
    host.route(&keys::PARSE, QUEUE, &mailbox, |request, context, reply| Message::Parse { request, context, reply })
        .await?;
    Ok(())
}

enum Message {
    Parse { request: IntentRequest, context: Context, reply: Reply<Intent> },
}

struct IntentAgent {
    bus: Bus,
    interpreter: Interpreter,
    agent_state: AgentState,
    published_state: RetainedValue<AgentState>,
    /// Intents by request id: a model may answer a repeated request differently.
    intents: LruCache<String, Intent>,
}

impl IntentAgent {
    async fn parse(&mut self, request: &IntentRequest, context: &Context) -> Result<Intent, Fault> {
        if let Some(intent) = self.intents.get(&context.id) {
            return Ok(intent.clone());
        }
        let deadline = context.deadline.checked_sub(MARGIN).unwrap_or(context.deadline);
        let intent = self
            .interpreter
            .interpret(request, &context.id, deadline, &mut self.agent_state)
            .await
            .map_err(|error| interpret_fault(&error))?;
        if !context.id.is_empty() {
            self.intents.put(context.id.clone(), intent.clone());
        }
        if let Err(fault) = self.bus.publish(&keys::INTENT, &intent, &context.next()).await {
            tracing::warn!(%fault, "an intent could not be published");
        }
        Ok(intent)
    }
}

/// The reply to a request that was not interpreted.
pub(crate) fn interpret_fault(error: &InterpretError) -> Fault {
    match error {
        InterpretError::Utterance(error) => Fault::invalid(error.to_string()),
        InterpretError::Llm(error) => {
            Fault { retry_after: error.retry_after(), ..Fault::new(error.code(), error.sentence()) }
                .with_details([role::AGENT_INTENT.to_owned()])
        }
    }
}

impl Actor for IntentAgent {
    type Message = Message;
    type State = String;

    fn name(&self) -> &'static str {
        "intent"
    }

    fn state(&self) -> String {
        format!(
            "{}: {} requests understood, {} not",
            self.agent_state.backend,
            self.agent_state.answered - self.agent_state.refused,
            self.agent_state.refused
        )
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        let Message::Parse { request, context, mut reply } = message;
        // A client that is gone needs no answer, so the request to the model is cancelled.
        let outcome = tokio::select! {
            outcome = self.parse(&request, &context) => outcome,
            () = reply.closed() => return Ok(()),
        };
        self.agent_state.answered += 1;
        self.agent_state.refused +=
            u64::from(outcome.as_ref().map_or(true, |intent| !intent.not_understood.is_empty()));
        if let Err(fault) = self.published_state.set(self.agent_state.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be published");
        }
        let _ = reply.send(outcome);
        Ok(())
    }
}
