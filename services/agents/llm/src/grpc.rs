//! gRPC client for `supergaussian.backend.v1.BackendService`.

use std::path::PathBuf;
use std::time::Duration;

use hyper_util::rt::TokioIo;
use reqwest::header::AUTHORIZATION;
use sg_language::prompt::{InvalidAnswer, MAX_ANSWER_BYTES, Prompt, single_line};
use sg_proto::backend::{CompleteRequest, CompleteResponse};
use tokio::net::UnixStream;
use tonic::codegen::http::uri::PathAndQuery;
use tonic::metadata::MetadataMap;
use tonic::transport::{self, Channel, Uri};
use tonic::{Code, Request, Status};
use tonic_prost::ProstCodec;
use tower::service_fn;

use crate::api_key::ApiKey;
use crate::config::{ConfigError, ModelConfig};
use crate::endpoint::Endpoint;
use crate::error::{LlmError, error_chain};
use crate::model::{Completion, CompletionFuture, LanguageModel};

/// Path of the method.
const COMPLETE: &str = "/supergaussian.backend.v1.BackendService/Complete";
/// Longest wait for a connection.
const CONNECT: Duration = Duration::from_secs(5);
/// Bytes of a message besides its texts.
const FRAME_BYTES: usize = 4096;

/// A model behind a gRPC endpoint.
pub(crate) struct Grpc {
    channel: Channel,
    authorization: MetadataMap,
    key: Option<ApiKey>,
    model: String,
    temperature: Option<f64>,
}

impl Grpc {
    pub(crate) fn new(config: &ModelConfig, key: Option<ApiKey>) -> Result<Self, ConfigError> {
        let invalid = |e: transport::Error| ConfigError::UnusableEndpoint {
            endpoint: config.endpoint.to_string(),
            reason: error_chain(&e),
        };
        let channel = match &config.endpoint {
            Endpoint::Url(url) => {
                let endpoint = transport::Endpoint::from_shared(url.as_str().to_owned()).map_err(invalid)?;
                endpoint.connect_timeout(CONNECT).connect_lazy()
            }
            Endpoint::Unix(path) => through_socket(path.clone()),
        };
        let mut headers = tonic::codegen::http::HeaderMap::new();
        if let Some(key) = &key {
            headers.insert(AUTHORIZATION, key.header());
        }
        let authorization = MetadataMap::from_headers(headers);
        Ok(Self { channel, authorization, key, model: config.model.clone(), temperature: config.temperature })
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
        let mut request = Request::new(message);
        *request.metadata_mut() = self.authorization.clone();
        request.set_timeout(timeout);
        let mut client =
            tonic::client::Grpc::new(self.channel.clone()).max_decoding_message_size(MAX_ANSWER_BYTES + FRAME_BYTES);
        client.ready().await.map_err(|e| LlmError::Unavailable(error_chain(&e)))?;
        let path = PathAndQuery::from_static(COMPLETE);
        let codec = ProstCodec::<CompleteRequest, CompleteResponse>::default();
        let response = client.unary(request, path, codec).await.map_err(|status| self.error(&status, timeout))?;
        let CompleteResponse { text, model, prompt_tokens, answer_tokens } = response.into_inner();
        Ok(Completion { text, model: single_line(&model), prompt_tokens, answer_tokens })
    }

    fn error(&self, status: &Status, timeout: Duration) -> LlmError {
        let mut text = single_line(&format!("{:?}: {}", status.code(), status.message()));
        if let Some(key) = &self.key {
            text = key.redact(&text);
        }
        match status.code() {
            // Overload, shutdown and internal errors are transient.
            Code::Unavailable | Code::ResourceExhausted | Code::Aborted | Code::Internal | Code::Unknown => {
                LlmError::Unavailable(text)
            }
            Code::DeadlineExceeded | Code::Cancelled => LlmError::Timeout(timeout),
            // The client reports a message over its size limit so.
            Code::OutOfRange => InvalidAnswer::new(text).into(),
            _ => LlmError::Refused(text),
        }
    }
}

/// A channel over a unix socket. The URI is a placeholder.
fn through_socket(path: PathBuf) -> Channel {
    let endpoint = transport::Endpoint::from_static("http://localhost").connect_timeout(CONNECT);
    endpoint.connect_with_connector_lazy(service_fn(move |_: Uri| {
        let path = path.clone();
        async move { UnixStream::connect(path).await.map(TokioIo::new) }
    }))
}

impl LanguageModel for Grpc {
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, timeout: Duration) -> CompletionFuture<'a> {
        Box::pin(self.request(prompt, seed, timeout))
    }
}
