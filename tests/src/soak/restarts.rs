//! Restarts of services in every way: killed, asked for, swapped, and by a reload of the launch file.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_proto::keys;
use sg_proto::launch::{
    PsReply, PsRequest, ReloadRequest, RestartRequest, Service, ServiceState, Swap, SwapRequest, SwapState,
};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

use super::pace::Pace;

/// How long a restarted service may take until it is ready.
const READY: Duration = Duration::from_secs(60);
/// Pause between two looks.
const LOOKS: Duration = Duration::from_millis(20);
/// Pause after a swap that did not come about.
const AGAIN: Duration = Duration::from_millis(200);

/// Restarts services of a stack.
#[derive(Debug)]
pub struct Restarts {
    bus: Bus,
    /// The launch file, and the settings over it.
    file: PathBuf,
    settings: Vec<String>,
    /// Services to restart, each for an equal share of the session. The others meanwhile live long enough to show a leak.
    services: Vec<String>,
    /// The last environment of each reloaded service.
    rounds: BTreeMap<String, u64>,
}

impl Restarts {
    /// Restarts of these services.
    #[must_use]
    pub fn new(bus: Bus, file: PathBuf, settings: Vec<String>, services: Vec<String>) -> Self {
        Self { bus, file, settings, services, rounds: BTreeMap::new() }
    }

    /// Restarts one service after another until none is left.
    pub async fn work(mut self, pace: &Pace) {
        while let Some(number) = pace.next(&pace.restarts).await {
            let share = number as usize * self.services.len() / pace.restarts.total().max(1) as usize;
            let Some(service) = self.services.get(share).cloned() else { return };
            match self.restart(&service, number, pace).await {
                Ok(Some(kind)) => pace.note(kind, &Ok::<(), Fault>(())),
                Ok(None) => return,
                Err(reason) => pace.fail(&format!("restart of `{service}`: {reason}")),
            }
            pace.restarts.finish();
        }
    }

    /// Restarts a service and waits until it is ready: the way it was restarted, or `None` at the end of the session.
    async fn restart(&mut self, service: &str, number: u64, pace: &Pace) -> Result<Option<&'static str>, String> {
        let Some(before) = self.ready(service, None, pace).await? else { return Ok(None) };
        let line = |fault: Fault| fault.to_string();
        let kind = match number % 5 {
            0 | 2 => {
                let pid = i32::try_from(before.pid).map_err(|e| e.to_string())?;
                kill(Pid::from_raw(pid), Signal::SIGKILL).map_err(|e| e.to_string())?;
                "kill -9"
            }
            1 => {
                let request =
                    SwapRequest { service: service.into(), executable: before.executable, params: String::new() };
                self.bus.ask(&keys::SWAP, &request, &soon()).await.map_err(line)?;
                "swap"
            }
            3 => {
                self.rounds.insert(service.to_owned(), number);
                let env = self.rounds.iter().map(|(name, round)| format!("service.{name}.env.SOAK_ROUND=\"{round}\""));
                let overrides = self.settings.iter().cloned().chain(env).collect();
                let launch_file = self.file.display().to_string();
                let request = ReloadRequest { launch_file, overrides, only: Vec::new() };
                self.bus.ask(&keys::RELOAD, &request, &soon()).await.map_err(line)?;
                "reload"
            }
            _ => {
                let request = RestartRequest { service: service.into() };
                self.bus.ask(&keys::RESTART, &request, &soon()).await.map_err(line)?;
                "restart"
            }
        };
        Ok(self.ready(service, Some(before.pid), pace).await?.map(|_| kind))
    }

    /// The service once it is ready, in another process than the former one. `None` at the end of the session.
    async fn ready(&self, service: &str, former: Option<u32>, pace: &Pace) -> Result<Option<Service>, String> {
        let begun = Instant::now();
        loop {
            let ps = self.ps().await;
            let found = ps.as_ref().ok().and_then(|ps| ps.services.iter().find(|s| s.name == service));
            if let Some(now) = found {
                if now.state() == ServiceState::Ready && Some(now.pid) != former && !is_under_way(now) {
                    return Ok(Some(now.clone()));
                }
                if let Some(swap) = now.swap.as_ref().filter(|s| s.state() == SwapState::Failed)
                    && Some(now.pid) == former
                    && begun.elapsed() > AGAIN
                {
                    return Err(format!("its swap failed: {}", swap.reason));
                }
                if now.state() == ServiceState::Failed {
                    return Err(now.reason.clone());
                }
            }
            if pace.is_over() {
                return Ok(None);
            }
            if begun.elapsed() > READY {
                return Err(format!("not ready after {:.0} s: {found:?}", begun.elapsed().as_secs_f64()));
            }
            tokio::time::sleep(LOOKS).await;
        }
    }

    async fn ps(&self) -> Result<PsReply, Fault> {
        self.bus.ask(&keys::PS, &PsRequest {}, &soon()).await
    }
}

fn is_under_way(service: &Service) -> bool {
    let state = service.swap.as_ref().map_or(SwapState::Unspecified, Swap::state);
    !matches!(state, SwapState::Unspecified | SwapState::Done | SwapState::Failed)
}

fn soon() -> Context {
    Context::root().deadline_in(READY)
}
