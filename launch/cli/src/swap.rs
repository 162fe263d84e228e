//! `swap`: another executable for one running service.

use std::path::Path;
use std::time::{Duration, Instant};

use sg_proto::keys;
use sg_proto::launch::{PsReply, Service, ServiceState, SwapRequest, SwapState};
use sg_runtime::context::Context;
use sg_stack::file::ExecutableSearch;

use crate::supervisor_client::{ANSWER, POLL_PERIOD, join, refused, services, state};
use crate::terminal::{self, CommandResult, Failure, format_time};

/// How long to follow a swap. It is longer than a large scene takes to load and cluster. The swap itself continues.
pub(crate) const FOLLOW_TIME: Duration = Duration::from_secs(1800);

#[derive(Debug, clap::Args)]
pub(crate) struct SwapArgs {
    /// Name in the launch file
    service: String,
    /// Executable: a path with a slash, or a name beside this program or on PATH; a name only for a service on another
    /// machine
    executable: String,
    /// Parameters of the candidate as a JSON object; by default the present ones
    #[arg(long, value_name = "JSON")]
    params: Option<String>,
}

pub(crate) async fn swap(session: Option<&str>, arguments: &SwapArgs) -> CommandResult {
    let SwapArgs { service, executable, params } = arguments;
    if let Some(text) = params
        && let Err(error) = serde_json::from_str::<serde_json::Map<String, serde_json::Value>>(text)
    {
        return Err(Failure::Input(format!("--params: {error}; write a JSON object")));
    }
    let (session, bus) = join(session).await?;
    let PsReply { pid: supervisor, services: listed, .. } = services(&bus).await?;
    let before = listed.into_iter().find(|s| s.name == *service);
    let found = match &before {
        // A node looks its executables up itself.
        Some(service) if !service.node.is_empty() => executable.clone(),
        _ => {
            let found = ExecutableSearch::here_then_path().find(executable, Path::new(""));
            let found = found.map_err(|e| Failure::Input(e.to_string()))?;
            found.display().to_string()
        }
    };
    let request =
        SwapRequest { service: service.clone(), executable: found, params: params.clone().unwrap_or_default() };
    let old = before.map_or(0, |s| s.pid);
    let began = Instant::now();
    let reply = bus.ask(&keys::SWAP, &request, &Context::root().deadline_in(ANSWER)).await.map_err(refused)?;
    loop {
        let ps = match services(&bus).await {
            Ok(ps) if ps.pid == supervisor => ps,
            Ok(_) => {
                return Err(Failure::Work(format!("the supervisor was replaced; try the swap of `{service}` again")));
            }
            // A supervisor that stands still answers later, and the swap goes on then.
            Err(_) if session.is_running() && began.elapsed() < FOLLOW_TIME => {
                tokio::time::sleep(POLL_PERIOD).await;
                continue;
            }
            Err(failure) => return Err(failure),
        };
        let Some(now) = ps.services.into_iter().find(|s| s.name == *service) else {
            return Err(Failure::Work(format!("service `{service}` was removed in the meantime")));
        };
        match progress(&now, reply.number) {
            Progress::Done => {
                let left = if old > 0 { format!("process {old} stopped, ") } else { String::new() };
                let took = format_time(began.elapsed().as_secs_f64() * 1000.0);
                terminal::print_line(&format!("{service}: {left}process {} serves after {took}", now.pid));
                bus.close().await;
                return Ok(());
            }
            Progress::Failed(reason) => return Err(Failure::Work(reason)),
            Progress::Running(what) if began.elapsed() > FOLLOW_TIME => {
                let seconds = FOLLOW_TIME.as_secs();
                return Err(Failure::Work(format!("swap of `{service}` is not done after {seconds} s: {what}")));
            }
            Progress::Running(_) => tokio::time::sleep(POLL_PERIOD).await,
        }
    }
}

/// Progress of a change.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    Done,
    Failed(String),
    /// Running, with the present stage.
    Running(String),
}

/// Progress of the swap with this number. Number 0 is the first start of a service.
pub(crate) fn progress(service: &Service, number: u64) -> Progress {
    let name = &service.name;
    let Some(swap) = service.swap.as_ref().filter(|_| number > 0) else { return started(service) };
    match swap.state() {
        _ if swap.number > number => Progress::Failed(format!("swap of `{name}` failed: another swap replaced it")),
        SwapState::Done => Progress::Done,
        SwapState::Failed => {
            let now = match service.state() {
                ServiceState::Ready => format!("process {} serves on", service.pid),
                _ => format!("the service is {} with its old executable", state(service)),
            };
            Progress::Failed(format!("swap of `{name}` failed: {}; {now}", swap.reason))
        }
        _ => Progress::Running(format!("{} {}", swap.state().as_str_name(), swap.reason)),
    }
}

/// Progress of a service towards readiness.
pub(crate) fn started(service: &Service) -> Progress {
    match service.state() {
        ServiceState::Ready | ServiceState::Stopped => Progress::Done,
        ServiceState::Failed => Progress::Failed(format!("service `{}` failed: {}", service.name, service.reason)),
        _ => Progress::Running(format!("{} {}", state(service), service.reason)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::launch::Swap;

    fn service(state: ServiceState, swap: Option<(u64, SwapState)>) -> Service {
        Service {
            name: "a".into(),
            state: state.into(),
            pid: 7,
            reason: "why".into(),
            swap: swap.map(|(number, state)| Swap {
                number,
                state: state.into(),
                reason: "no".into(),
                ..Swap::default()
            }),
            ..Service::default()
        }
    }

    #[test]
    fn a_swap_is_followed_by_its_number() {
        let at = |state| progress(&service(ServiceState::Ready, Some((2, state))), 2);
        assert_eq!(at(SwapState::Done), Progress::Done);
        assert!(matches!(at(SwapState::Verifying), Progress::Running(_)));
        assert_eq!(at(SwapState::Failed), Progress::Failed("swap of `a` failed: no; process 7 serves on".into()));
        let later = progress(&service(ServiceState::Ready, Some((3, SwapState::Done))), 2);
        assert_eq!(later, Progress::Failed("swap of `a` failed: another swap replaced it".into()));
        let first = progress(&service(ServiceState::Failed, None), 0);
        assert_eq!(first, Progress::Failed("service `a` failed: why".into()));
    }
}
