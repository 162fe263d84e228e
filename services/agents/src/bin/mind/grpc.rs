//! Models behind a program of one's own, over gRPC: `supergaussian.backend.v1.BackendService`.

use std::path::PathBuf;
use std::time::Duration;

use hyper_util::rt::TokioIo;
use reqwest::header::AUTHORIZATION;
use sg_agents::backend::Choice;
use sg_agents::endpoint::Endpoint;
use sg_agents::prompt::{Completion, MAX_ANSWER_BYTES, ModelError, Prompt, Rejected, line};
use sg_proto::backend::{CompleteRequest, CompleteResponse};
use tokio::net::UnixStream;
use tonic::codegen::http::uri::PathAndQuery;
use tonic::metadata::MetadataMap;
use tonic::transport::{self, Channel, Uri};
use tonic::{Code, Request, Status};
use tonic_prost::ProstCodec;
use tower::service_fn;

use super::key::Key;
use super::{Answering, Model};

/// The one method of the service.
const COMPLETE: &str = "/supergaussian.backend.v1.BackendService/Complete";
/// Longest wait for a connection.
const CONNECT: Duration = Duration::from_secs(5);
/// What a message may have beside its texts, bytes.
const FRAME_BYTES: usize = 4096;

/// A model by its endpoint.
pub(super) struct Grpc {
    channel: Channel,
    authorization: MetadataMap,
    key: Option<Key>,
    model: String,
    temperature: Option<f64>,
}

impl Grpc {
    pub(super) fn new(choice: &Choice, key: Option<Key>) -> Result<Self, String> {
        let unfit = |e: transport::Error| format!("`endpoint`: {}: {}", choice.endpoint, super::openai::chain(&e));
        let channel = match &choice.endpoint {
            Endpoint::Url(url) => {
                let endpoint = transport::Endpoint::from_shared(url.as_str().to_owned()).map_err(unfit)?;
                endpoint.connect_timeout(CONNECT).connect_lazy()
            }
            Endpoint::Unix(path) => through_socket(path.clone()),
        };
        let mut headers = tonic::codegen::http::HeaderMap::new();
        if let Some(key) = &key {
            headers.insert(AUTHORIZATION, key.header()?);
        }
        let authorization = MetadataMap::from_headers(headers);
        Ok(Self { channel, authorization, key, model: choice.model.clone(), temperature: choice.temperature })
    }

    async fn ask(&self, prompt: &Prompt, seed: Option<u64>, time: Duration) -> Result<Completion, ModelError> {
        let question = CompleteRequest {
            agent: prompt.agent.to_owned(),
            model: self.model.clone(),
            system: prompt.system.clone(),
            user: prompt.user.clone(),
            json_schema: prompt.schema.as_ref().map_or_else(String::new, ToString::to_string),
            deadline_ms: u32::try_from(time.as_millis()).unwrap_or(u32::MAX),
            seed: seed.unwrap_or_default(),
            id: prompt.id.clone(),
            temperature: self.temperature,
            max_tokens: prompt.max_tokens,
        };
        let mut request = Request::new(question);
        *request.metadata_mut() = self.authorization.clone();
        request.set_timeout(time);
        let mut client =
            tonic::client::Grpc::new(self.channel.clone()).max_decoding_message_size(MAX_ANSWER_BYTES + FRAME_BYTES);
        client.ready().await.map_err(|e| ModelError::Away(super::openai::chain(&e)))?;
        let path = PathAndQuery::from_static(COMPLETE);
        let codec = ProstCodec::<CompleteRequest, CompleteResponse>::default();
        let response = client.unary(request, path, codec).await.map_err(|status| self.failed(&status, time))?;
        let CompleteResponse { text, model, prompt_tokens, answer_tokens } = response.into_inner();
        Ok(Completion { text, model: line(&model), prompt_tokens, answer_tokens })
    }

    fn failed(&self, status: &Status, time: Duration) -> ModelError {
        let mut text = line(&format!("{:?}: {}", status.code(), status.message()));
        if let Some(key) = &self.key {
            text = key.hidden_in(&text);
        }
        match status.code() {
            // What a server says when it is busy, stops, or fell over its own feet.
            Code::Unavailable | Code::ResourceExhausted | Code::Aborted | Code::Internal | Code::Unknown => {
                ModelError::Away(text)
            }
            Code::DeadlineExceeded | Code::Cancelled => ModelError::Late(time),
            // This is what the client says of a message over its limit.
            Code::OutOfRange => ModelError::Rejected(Rejected(text)),
            _ => ModelError::Refused(text),
        }
    }
}

/// A channel through a unix socket; the URI is a name only.
fn through_socket(path: PathBuf) -> Channel {
    let endpoint = transport::Endpoint::from_static("http://localhost").connect_timeout(CONNECT);
    endpoint.connect_with_connector_lazy(service_fn(move |_: Uri| {
        let path = path.clone();
        async move { UnixStream::connect(path).await.map(TokioIo::new) }
    }))
}

impl Model for Grpc {
    fn complete<'a>(&'a self, prompt: &'a Prompt, seed: Option<u64>, time: Duration) -> Answering<'a> {
        Box::pin(self.ask(prompt, seed, time))
    }
}
