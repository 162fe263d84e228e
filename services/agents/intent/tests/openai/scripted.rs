//! An HTTP server with scripted answers that records its requests.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::header::{AUTHORIZATION, CONTENT_TYPE, LOCATION};
use hyper::service::service_fn;
use hyper::{Request, Response};
use hyper_util::rt::TokioIo;
use serde_json::{Value, json};
use tokio::net::TcpListener;

/// A scripted answer.
#[derive(Clone)]
pub(crate) struct Answer {
    status: u16,
    body: String,
    location: Option<String>,
    delay: Duration,
}

impl Answer {
    pub(crate) fn new(status: u16, body: &str) -> Self {
        Self { status, body: body.to_owned(), location: None, delay: Duration::ZERO }
    }

    /// A chat completion with a text.
    pub(crate) fn completion(text: &str) -> Self {
        let choice = json!({"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": text}});
        Self::new(200, &json!({"model": "scripted-1", "choices": [choice]}).to_string())
    }

    pub(crate) fn with_delay(self, delay: Duration) -> Self {
        Self { delay, ..self }
    }

    pub(crate) fn redirect(location: String) -> Self {
        Self { location: Some(location), ..Self::new(307, "") }
    }
}

/// A recorded request.
#[derive(Debug, Clone)]
pub(crate) struct RecordedRequest {
    pub(crate) path: String,
    pub(crate) authorization: String,
    pub(crate) body: Value,
}

/// The server. It stops with the test.
pub(crate) struct Server {
    address: SocketAddr,
    requests: Arc<Mutex<Vec<RecordedRequest>>>,
    _runtime: tokio::runtime::Runtime,
}

impl Server {
    /// Answers requests in order. The last answer repeats.
    pub(crate) fn start(script: &[Answer]) -> Self {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
        let address = listener.local_addr().unwrap();
        let requests = Arc::new(Mutex::new(Vec::new()));
        let (script, log) = (script.to_vec(), Arc::clone(&requests));
        runtime.spawn(async move {
            loop {
                let (stream, _) = listener.accept().await.unwrap();
                let (script, log) = (script.clone(), Arc::clone(&log));
                tokio::spawn(async move {
                    let serve = service_fn(move |request| answer(request, script.clone(), Arc::clone(&log)));
                    // Some tests disconnect during an answer.
                    let _ =
                        hyper::server::conn::http1::Builder::new().serve_connection(TokioIo::new(stream), serve).await;
                });
            }
        });
        Self { address, requests, _runtime: runtime }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}/v1", self.address)
    }

    pub(crate) fn requests(&self) -> Vec<RecordedRequest> {
        self.requests.lock().unwrap().clone()
    }
}

async fn answer(
    request: Request<Incoming>,
    script: Vec<Answer>,
    log: Arc<Mutex<Vec<RecordedRequest>>>,
) -> Result<Response<Full<Bytes>>, Infallible> {
    let path = request.uri().path().to_owned();
    let authorization = request.headers().get(AUTHORIZATION).map_or("", |v| v.to_str().unwrap()).to_owned();
    let body = request.into_body().collect().await.unwrap().to_bytes();
    let body = serde_json::from_slice(&body).unwrap();
    let answer = {
        let mut log = log.lock().unwrap();
        log.push(RecordedRequest { path, authorization, body });
        script[(log.len() - 1).min(script.len() - 1)].clone()
    };
    tokio::time::sleep(answer.delay).await;
    let mut response = Response::builder().status(answer.status).header(CONTENT_TYPE, "application/json");
    if let Some(location) = answer.location {
        response = response.header(LOCATION, location);
    }
    Ok(response.body(Full::new(Bytes::from(answer.body))).unwrap())
}
