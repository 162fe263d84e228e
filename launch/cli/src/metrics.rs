//! `metrics`: the metrics of all processes of a stack, for Prometheus.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::net::SocketAddr;
use std::time::Duration;

use http_body_util::Full;
use hyper::body::Bytes;
use hyper::header::CONTENT_TYPE;
use hyper::service::service_fn;
use hyper::{Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use sg_proto::bus::MetricsRequest;
use sg_proto::keys::{self, role};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use tokio::net::TcpListener;

use crate::supervisor_client::{join, services};
use crate::terminal::{self, CommandResult, Failure};

/// Longest time for one process's answer. Processes that do not answer are left out.
const TIMEOUT: Duration = Duration::from_millis(500);
/// Longest time for a request's headers.
const HEADERS: Duration = Duration::from_secs(5);
/// Most connections at a time.
const CONNECTIONS: usize = 16;
/// Content type of Prometheus' text format.
const FORMAT: &str = "text/plain; version=0.0.4";

pub(crate) async fn metrics(session: Option<&str>, listen: Option<SocketAddr>) -> CommandResult {
    let (_, bus) = join(session).await?;
    match listen {
        Some(address) => serve(bus, address).await,
        None => {
            terminal::print_line(gather(&bus).await?.trim_end());
            bus.close().await;
            Ok(())
        }
    }
}

/// The metrics of all processes that answer.
async fn gather(bus: &Bus) -> Result<String, Failure> {
    let running = services(bus).await?.services.into_iter().filter(|s| s.pid > 0);
    let places = running.map(|s| keys::instance(&s.instance)).chain([role::SUPERVISOR.to_owned()]);
    let requests = places.map(|place| {
        let bus = bus.clone();
        tokio::spawn(async move {
            let context = Context::root().deadline_in(TIMEOUT);
            bus.ask_role(&keys::METRICS, &place, &MetricsRequest {}, &context).await
        })
    });
    let mut texts = Vec::new();
    for answer in requests.collect::<Vec<_>>() {
        // A missing answer shows in `supergaussian_service_ready`.
        if let Ok(Ok(reply)) = answer.await {
            texts.push(reply.text);
        }
    }
    Ok(merged(&texts))
}

/// Merges several texts: one description per name, with all samples below it.
fn merged(texts: &[String]) -> String {
    let mut families: BTreeMap<&str, (Vec<&str>, Vec<&str>)> = BTreeMap::new();
    for text in texts {
        let mut family = "";
        for line in text.lines().filter(|l| !l.is_empty()) {
            let comment = line.strip_prefix("# HELP ").or_else(|| line.strip_prefix("# TYPE "));
            if let Some(rest) = comment {
                family = rest.split(' ').next().unwrap_or_default();
                let heads = &mut families.entry(family).or_default().0;
                if !heads.contains(&line) {
                    heads.push(line);
                }
            } else {
                families.entry(family).or_default().1.push(line);
            }
        }
    }
    let mut out = String::new();
    for (heads, samples) in families.values() {
        for line in heads.iter().chain(samples) {
            out.push_str(line);
            out.push('\n');
        }
    }
    out
}

async fn serve(bus: Bus, address: SocketAddr) -> CommandResult {
    if !address.ip().is_loopback() {
        return Err(Failure::Input(format!(
            "--listen {address}: metrics are served on loopback addresses only; use 127.0.0.1:{}",
            address.port()
        )));
    }
    let fail = |e: std::io::Error| Failure::Work(format!("--listen {address}: {e}"));
    let listener = TcpListener::bind(address).await.map_err(fail)?;
    let bound = listener.local_addr().map_err(fail)?;
    terminal::print_line(&format!("http://{bound}/metrics"));
    let room = std::sync::Arc::new(tokio::sync::Semaphore::new(CONNECTIONS));
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            _ = tokio::signal::ctrl_c() => break,
        };
        let (Ok((stream, _)), Ok(place)) = (accepted, room.clone().try_acquire_owned()) else { continue };
        let bus = bus.clone();
        tokio::spawn(async move {
            let answering = service_fn(move |request| answer(bus.clone(), request));
            let connection = hyper::server::conn::http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEADERS)
                .keep_alive(false)
                .serve_connection(TokioIo::new(stream), answering);
            // A client that disconnects loses only its own answer.
            let _ = connection.await;
            drop(place);
        });
    }
    bus.close().await;
    Ok(())
}

async fn answer(bus: Bus, request: Request<hyper::body::Incoming>) -> Result<Response<Full<Bytes>>, Infallible> {
    let (status, text) = match request.uri().path() {
        "/metrics" => match gather(&bus).await {
            Ok(text) => (StatusCode::OK, text),
            Err(failure) => (StatusCode::SERVICE_UNAVAILABLE, format!("{}\n", failure.text())),
        },
        _ => (StatusCode::NOT_FOUND, "only /metrics is served\n".to_owned()),
    };
    let mut response = Response::new(Full::new(Bytes::from(text)));
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, hyper::header::HeaderValue::from_static(FORMAT));
    Ok(response)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_several_processes_are_described_once() {
        let text = |role: &str, extra: &str| {
            format!("# HELP a_total A\n# TYPE a_total counter\na_total{{role=\"{role}\"}} 1\n\n{extra}")
        };
        let more = "# TYPE b gauge\nb 2\n";
        let merged = merged(&[text("x", more), text("y", "")]);
        let expected = "# HELP a_total A\n# TYPE a_total counter\na_total{role=\"x\"} 1\na_total{role=\"y\"} 1\n\
                        # TYPE b gauge\nb 2\n";
        assert_eq!(merged, expected);
    }
}
