//! Understanding with whatever the launch file chooses: the model, or the grammar.

use std::time::Instant;

use sg_agents::backend::Parameters;
use sg_agents::grammar;
use sg_agents::understand::Understanding;
use sg_proto::keys::role;
use sg_proto::language::{AgentState, Intent, IntentRequest};
use sg_runtime::fault::Fault;

use crate::mind::Mind;

/// What understands utterances.
pub(crate) struct Understander {
    mind: Mind,
    understanding: Understanding,
}

impl Understander {
    /// Makes ready to understand, within the async runtime.
    ///
    /// # Errors
    /// A line on what is wrong with the parameters.
    pub(crate) fn new(parameters: &Parameters) -> Result<Self, String> {
        let understanding = Understanding::new().map_err(|e| e.to_string())?;
        Ok(Self { mind: Mind::new(parameters)?, understanding })
    }

    /// The state of an agent that begins with this.
    pub(crate) fn told(&self) -> AgentState {
        self.mind.told()
    }

    /// Understands an utterance before `deadline`; `told` counts where the grammar has to do.
    ///
    /// # Errors
    /// `InvalidArgument` where there is nothing to understand; where no fallback is wanted, why the model did not serve.
    pub(crate) async fn understand(
        &mut self,
        request: &IntentRequest,
        id: &str,
        deadline: Instant,
        told: &mut AgentState,
    ) -> Result<Intent, Fault> {
        let mut fallback = String::new();
        if self.mind.has_model() {
            let prompt = self.understanding.prompt(role::AGENT_INTENT, request, id);
            let prompt = prompt.map_err(|refused| Fault::invalid(refused.to_string()))?;
            match self.mind.ask(&prompt, deadline, |answer| self.understanding.accept(answer, request)).await {
                Ok(thought) => {
                    self.mind.served();
                    let backend = self.mind.backend().to_owned();
                    return Ok(Intent { backend, model: thought.model, ..thought.value });
                }
                Err(error) => {
                    let details = [role::AGENT_INTENT.to_owned()];
                    fallback = self.mind.instead(&error, told).map_err(|fault| fault.with_details(details))?;
                }
            }
        }
        let observation = request.observation.clone().unwrap_or_default();
        let intent = tokio::task::block_in_place(|| grammar::understand(&request.text, &observation));
        let intent = intent.map_err(|refused| Fault::invalid(refused.to_string()))?;
        Ok(Intent { fallback, ..intent })
    }
}
