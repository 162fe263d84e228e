//! gRPC client for `supergaussian.backend.v1`.

use std::path::PathBuf;
use std::time::Duration;

use hyper_util::rt::TokioIo;
use prost::Message;
use reqwest::header::AUTHORIZATION;
use tokio::net::UnixStream;
use tonic::codegen::http::uri::PathAndQuery;
use tonic::metadata::MetadataMap;
use tonic::transport::{self, Channel, Uri};
use tonic::{Code, Request, Status};
use tonic_prost::ProstCodec;
use tower::service_fn;

use crate::CONNECT;
use crate::address::Endpoint;
use crate::api_key::ApiKey;
use crate::error::{CallError, ClientError, error_chain, one_line};

/// A client of one gRPC endpoint.
pub struct GrpcClient {
    channel: Channel,
    authorization: MetadataMap,
    key: Option<ApiKey>,
}

impl GrpcClient {
    /// A client inside an async runtime. It connects with its first request, so the server may start later.
    ///
    /// # Errors
    /// [`ClientError`]: the endpoint cannot be used.
    pub fn new(endpoint: &Endpoint, key: Option<ApiKey>) -> Result<Self, ClientError> {
        let channel = match endpoint {
            Endpoint::Url(url) if url.scheme() == "https" => return Err(ClientError::Encrypted),
            Endpoint::Url(url) => {
                let unusable = |e: transport::Error| ClientError::Unusable {
                    endpoint: endpoint.to_string(),
                    reason: error_chain(&e),
                };
                let endpoint = transport::Endpoint::from_shared(url.as_str().to_owned()).map_err(unusable)?;
                endpoint.connect_timeout(CONNECT).connect_lazy()
            }
            Endpoint::Unix(path) => through_socket(path.clone()),
        };
        let mut headers = tonic::codegen::http::HeaderMap::new();
        if let Some(key) = &key {
            headers.insert(AUTHORIZATION, key.header());
        }
        Ok(Self { channel, authorization: MetadataMap::from_headers(headers), key })
    }

    /// Calls the method with this path, such as `/package.Service/Method`. The answer has at most `most` bytes.
    ///
    /// # Errors
    /// [`CallError`], without the key.
    pub async fn call<Q, R>(
        &self,
        path: &'static str,
        message: Q,
        timeout: Duration,
        most: usize,
    ) -> Result<R, CallError>
    where
        Q: Message + Send + Sync + 'static,
        R: Message + Default + Send + Sync + 'static,
    {
        let mut request = Request::new(message);
        *request.metadata_mut() = self.authorization.clone();
        request.set_timeout(timeout);
        // The request was made here, so its size is the caller's.
        let mut client = tonic::client::Grpc::new(self.channel.clone()).max_decoding_message_size(most);
        client.ready().await.map_err(|e| CallError::Unavailable(error_chain(&e)))?;
        let codec = ProstCodec::<Q, R>::default();
        let answer = client.unary(request, PathAndQuery::from_static(path), codec).await;
        answer.map(tonic::Response::into_inner).map_err(|status| self.error(&status, timeout))
    }

    fn error(&self, status: &Status, timeout: Duration) -> CallError {
        let text = format!("{:?}: {}", status.code(), status.message());
        // Redacted before it is cut, so that no part of a key is left.
        let text = one_line(&self.key.as_ref().map_or_else(|| text.clone(), |key| key.redact(&text)));
        match status.code() {
            // Overload, shutdown and internal errors are transient.
            Code::Unavailable | Code::ResourceExhausted | Code::Aborted | Code::Internal | Code::Unknown => {
                CallError::Unavailable(text)
            }
            Code::DeadlineExceeded | Code::Cancelled => CallError::Timeout(timeout),
            // The client reports a message over its size limit so.
            Code::OutOfRange => CallError::Invalid(text),
            _ => CallError::Refused(text),
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
