//! gRPC client for `supergaussian.backend.v1.BackendService`.

use std::time::Duration;

use sg_endpoint::{ApiKey, ClientError, GrpcClient};
use sg_language::prompt::{MAX_ANSWER_BYTES, Prompt, single_line};
use sg_proto::backend::{CompleteRequest, CompleteResponse};

use crate::config::ModelConfig;
use crate::error::LlmError;
use crate::model::{Completion, CompletionFuture, LanguageModel};

/// Path of the method.
const COMPLETE: &str = "/supergaussian.backend.v1.BackendService/Complete";
/// Bytes of a message besides its texts.
const FRAME_BYTES: usize = 4096;

/// A model behind a gRPC endpoint.
pub(crate) struct Grpc {
    client: GrpcClient,
    model: String,
    temperature: Option<f64>,
}

impl Grpc {
    pub(crate) fn new(config: &ModelConfig, key: Option<ApiKey>) -> Result<Self, ClientError> {
        let client = GrpcClient::new(&config.endpoint, key)?;
        Ok(Self { client, model: config.model.clone(), temperature: config.temperature })
    }

    async fn request(&self, prompt: &Prompt, seed: Option<u64>, timeout: Duration) -> Result<Completion, LlmError> {
        let message = CompleteRequest {
            agent: prompt.agent.to_owned(),
            model: self.model.clone(),
            system: prompt.system.clone(),
            user: prompt.user.clone(),
            json_schema: prompt.schema.as_ref().map_or_else(String::new, ToString::to_string),
            deadline_ms: u32::try_from(timeout.as_millis()).unwrap_or(u32::MAX),
            seed: seed.unwrap_or_default(),
            id: prompt.id.clone(),
            temperature: self.temperature,
            max_tokens: prompt.max_tokens,
        };
        let CompleteResponse { text, model, prompt_tokens, answer_tokens } =
            self.client.call(COMPLETE, message, timeout, MAX_ANSWER_BYTES + FRAME_BYTES).await?;
        Ok(Completion { text, model: single_line(&model), prompt_tokens, answer_tokens })
    }
}

impl LanguageModel for Grpc {
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, timeout: Duration) -> CompletionFuture<'a> {
        Box::pin(self.request(prompt, seed, timeout))
    }
}
