//! gRPC over a unix socket, with tonic.

use std::convert::Infallible;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use sg_proto::render::Frame;
use sg_proto::scene::{Command, CommandResult};
use tokio::net::UnixListener;
use tokio_stream::wrappers::{ReceiverStream, UnixListenerStream};
use tonic::body::Body;
use tonic::codegen::http::uri::PathAndQuery;
use tonic::codegen::http::{Request, Response};
use tonic::server::{ClientStreamingService, NamedService, UnaryService};
use tonic::transport::{Channel, Endpoint, Server};
use tonic::{Status, Streaming};
use tonic_prost::ProstCodec;

use crate::{Link, appears, command, small};

const ECHO: &str = "/bench/echo";
const STREAM: &str = "/bench/stream";
/// Larger than the largest message of the benchmark, bytes.
const LIMIT: usize = 8 << 20;

fn path(folder: &Path) -> PathBuf {
    folder.join("grpc.sock")
}

#[derive(Clone, Default)]
struct Answering(Arc<AtomicU64>);

impl NamedService for Answering {
    const NAME: &'static str = "bench";
}

type Answer<T> = Pin<Box<dyn Future<Output = Result<tonic::Response<T>, Status>> + Send>>;

impl UnaryService<Command> for Answering {
    type Response = CommandResult;
    type Future = Answer<CommandResult>;

    fn call(&mut self, request: tonic::Request<Command>) -> Self::Future {
        let revision = self.0.load(Ordering::Relaxed);
        let reply = CommandResult { id: request.into_inner().id, revision, ..Default::default() };
        Box::pin(std::future::ready(Ok(tonic::Response::new(reply))))
    }
}

impl ClientStreamingService<Frame> for Answering {
    type Response = CommandResult;
    type Future = Answer<CommandResult>;

    fn call(&mut self, request: tonic::Request<Streaming<Frame>>) -> Self::Future {
        let heard = Arc::clone(&self.0);
        Box::pin(async move {
            let mut frames = request.into_inner();
            while frames.message().await?.is_some() {
                heard.fetch_add(1, Ordering::Relaxed);
            }
            Ok(tonic::Response::new(CommandResult::default()))
        })
    }
}

impl tower::Service<Request<Body>> for Answering {
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, Infallible>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let service = self.clone();
        Box::pin(async move {
            if request.uri().path() == STREAM {
                let mut grpc = tonic::server::Grpc::new(ProstCodec::<CommandResult, Frame>::default());
                return Ok(grpc.client_streaming(service, request).await);
            }
            let mut grpc = tonic::server::Grpc::new(ProstCodec::<CommandResult, Command>::default())
                .max_decoding_message_size(LIMIT);
            Ok(grpc.unary(service, request).await)
        })
    }
}

pub(crate) async fn serve(folder: &Path) {
    let incoming = UnixListenerStream::new(UnixListener::bind(path(folder)).unwrap());
    Server::builder().add_service(Answering::default()).serve_with_incoming(incoming).await.unwrap();
}

pub(crate) struct Grpc(Channel);

impl Grpc {
    pub(crate) async fn connect(folder: &Path) -> Self {
        appears(&path(folder)).await;
        let uri = format!("unix:{}", path(folder).display());
        Self(Endpoint::from_shared(uri).unwrap().connect().await.unwrap())
    }

    async fn ask(&self, text: &str) -> CommandResult {
        let mut grpc = tonic::client::Grpc::new(self.0.clone()).max_decoding_message_size(LIMIT);
        grpc.ready().await.unwrap();
        let codec = ProstCodec::<Command, CommandResult>::default();
        let request = tonic::Request::new(command(text));
        grpc.unary(request, PathAndQuery::from_static(ECHO), codec).await.unwrap().into_inner()
    }
}

impl Link for Grpc {
    async fn echo(&mut self, text: &str) {
        assert_eq!(self.ask(text).await.id.len(), text.len());
    }

    async fn flood(&mut self, time: Duration) -> u64 {
        let before = self.ask("").await.revision;
        let (sender, receiver) = tokio::sync::mpsc::channel(1024);
        let sending = tokio::spawn(async move {
            let frame = small();
            let begun = Instant::now();
            while begun.elapsed() < time {
                for _ in 0..64 {
                    sender.send(frame.clone()).await.unwrap();
                }
            }
        });
        let mut grpc = tonic::client::Grpc::new(self.0.clone());
        grpc.ready().await.unwrap();
        let codec = ProstCodec::<Frame, CommandResult>::default();
        let frames = tonic::Request::new(ReceiverStream::new(receiver));
        grpc.client_streaming(frames, PathAndQuery::from_static(STREAM), codec).await.unwrap();
        sending.await.unwrap();
        self.ask("").await.revision - before
    }
}
