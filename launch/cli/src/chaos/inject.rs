//! Injects faults one after another. Waits until the stack has recovered from each.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use sg_proto::keys::{self, role};
use sg_proto::launch::{PsReply, RestartRequest, Service, ServiceState, SwapRequest, SwapState};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use tokio::sync::watch;

use super::plan::{Fault, Kind};
use super::session::SessionStep;
use super::stack::{self, POLL_PERIOD, Process, Stack, signal};
use super::stalled_disk::StalledDisk;
use crate::playback::Counts;
use crate::terminal::{self, Failure, format_time};

/// Longest time for the recovery from one fault.
const RECOVERY_TIME: Duration = Duration::from_secs(60);
/// Longest wait for the process of a targeted service.
const TARGET_TIME: Duration = Duration::from_secs(30);
/// Longest wait for the refusal of a command on a full disk.
const REFUSAL_TIME: Duration = Duration::from_secs(10);

/// Time after a supervisor's standstill in which it could take a service for hung.
const JUDGEMENT_TIME: Duration = Duration::from_secs(4);
/// Time in which the supervisor is stopped after the begin of a swap.
const SWAP_TIME: Duration = Duration::from_millis(1500);

/// A fault that the stack has recovered from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Recovery {
    pub(super) kind: Kind,
    /// Time from the fault until every service is ready again.
    pub(super) recovered: Duration,
}

/// Observations during all faults.
#[derive(Debug, Default)]
pub(super) struct FaultLog {
    pub(super) recoveries: Vec<Recovery>,
    /// Longest time that processes outlived their supervisor.
    pub(super) followed: Duration,
    /// Processes without a service, one line each.
    pub(super) orphans: Vec<String>,
}

/// Injects the faults of a plan.
pub(super) struct Injector<'a> {
    pub(super) stack: &'a mut Stack,
    pub(super) bus: &'a Bus,
    /// By service.
    pub(super) executables: &'a HashMap<String, PathBuf>,
    pub(super) plan: &'a [Fault],
    pub(super) steps: &'a [SessionStep],
    /// The project of the session.
    pub(super) project: &'a Path,
    /// Duration of each step without faults.
    pub(super) calm: &'a [Duration],
    pub(super) begun: watch::Receiver<usize>,
    pub(super) answered: watch::Receiver<usize>,
    pub(super) set_up: watch::Sender<usize>,
    pub(super) counts: Arc<Counts>,
    pub(super) log: &'a mut FaultLog,
}

impl Injector<'_> {
    /// Injects every fault of the plan.
    pub(super) async fn run(mut self) -> Result<(), Failure> {
        let plan = self.plan;
        for (index, fault) in plan.iter().enumerate() {
            let number = index + 1;
            let act = self.steps.get(fault.step).map_or_else(String::new, SessionStep::name);
            let outcome = self.inject(index, fault).await;
            let recovered = outcome
                .map_err(|failure| Failure::Work(format!("fault {number}, {fault} ({act}): {}", failure.text())))?;
            let of = plan.len();
            terminal::print_status(&format!(
                "[{number:>width$}/{of}] {fault} ({act}): recovered after {}",
                format_time(recovered.as_secs_f64() * 1e3),
                width = of.to_string().len()
            ));
            self.log.recoveries.push(Recovery { kind: fault.kind, recovered });
        }
        Ok(())
    }

    /// Injects one fault at its moment and waits for the recovery. Returns the time of the recovery.
    async fn inject(&mut self, index: usize, fault: &Fault) -> Result<Duration, Failure> {
        let over = |_| Failure::Work("the session ended before the fault".to_owned());
        self.begun.wait_for(|n| *n > fault.step).await.map_err(over)?;
        match fault.kind {
            Kind::NoRoom => return self.no_room(index, fault).await,
            Kind::Stalled => return self.stall(index, fault).await,
            _ => {}
        }
        self.set_up.send_replace(index + 1);
        let calm = self.calm.get(fault.step).copied().unwrap_or_default();
        tokio::time::sleep(calm.mul_f64(fault.moment)).await;
        let began = Instant::now();
        let mut ended = Vec::new();
        match fault.kind {
            Kind::Kill | Kind::Two => ended = self.signal_all(fault, Signal::SIGKILL).await?,
            Kind::Terminate => ended = self.signal_all(fault, Signal::SIGTERM).await?,
            Kind::Hang => ended = self.signal_all(fault, Signal::SIGSTOP).await?,
            Kind::Restart => {
                for service in &fault.targets {
                    let request = RestartRequest { service: service.clone() };
                    let context = Context::root().deadline_in(TARGET_TIME);
                    ended.push(self.bus.ask(&keys::RESTART, &request, &context).await?.old_pid);
                }
            }
            Kind::Swap => ended = self.swap(fault).await?,
            Kind::Pause => self.pause(fault).await?,
            Kind::AtStart => ended = self.kill_twice(fault).await?,
            Kind::Supervisor => ended = self.kill_supervisor(false).await?,
            Kind::Everything => ended = self.kill_supervisor(true).await?,
            Kind::Standstill => self.stand_still(fault, Signal::SIGSTOP).await?,
            Kind::Suspended => self.stand_still(fault, Signal::SIGTSTP).await?,
            Kind::SwapStandstill | Kind::Frozen => self.stand_still(fault, Signal::SIGSTOP).await?,
            Kind::NoRoom | Kind::Stalled => {}
        }
        self.recovery(&ended).await?;
        let recovered = began.elapsed();
        if matches!(fault.kind, Kind::Supervisor | Kind::Everything) {
            self.look_for_orphans().await;
        }
        Ok(recovered)
    }

    /// Process ids of a fault's targets. Waits until each target has a process.
    async fn targets(&mut self, fault: &Fault) -> Result<Vec<u32>, Failure> {
        let began = Instant::now();
        loop {
            self.stack.check()?;
            if let Some(ps) = stack::ps(self.bus).await {
                let pids: Vec<_> = fault.targets.iter().filter_map(|name| pid_of(&ps, name)).collect();
                if pids.len() == fault.targets.len() {
                    return Ok(pids);
                }
            }
            if began.elapsed() > TARGET_TIME {
                return Err(Failure::Work(format!("no process of {}", fault.targets.join(", "))));
            }
            tokio::time::sleep(POLL_PERIOD).await;
        }
    }

    async fn signal_all(&mut self, fault: &Fault, what: Signal) -> Result<Vec<u32>, Failure> {
        let pids = self.targets(fault).await?;
        for pid in &pids {
            signal(*pid, what)?;
        }
        Ok(pids)
    }

    /// Swaps a service for another process of its own executable.
    async fn swap(&mut self, fault: &Fault) -> Result<Vec<u32>, Failure> {
        let pids = self.targets(fault).await?;
        for name in &fault.targets {
            let executable = self.executables.get(name).map_or_else(String::new, |path| path.display().to_string());
            let request = SwapRequest { service: name.clone(), executable, params: String::new() };
            self.bus.ask(&keys::SWAP, &request, &Context::root().deadline_in(TARGET_TIME)).await?;
        }
        Ok(pids)
    }

    async fn pause(&mut self, fault: &Fault) -> Result<(), Failure> {
        let pids = self.signal_all(fault, Signal::SIGSTOP).await?;
        tokio::time::sleep(Duration::from_millis(fault.pause_ms)).await;
        pids.into_iter().try_for_each(|pid| signal(pid, Signal::SIGCONT))
    }

    /// Stops the supervisor for longer than services may be silent, and lets it go on: alone, with all services, or in the
    /// middle of a swap. All processes must stay, but the one that is swapped.
    async fn stand_still(&mut self, fault: &Fault, stop: Signal) -> Result<(), Failure> {
        self.recovery(&[]).await?;
        let before = stack::ps(self.bus).await.map(|ps| ps.services).unwrap_or_default();
        let Some(supervisor) = self.stack.supervisor() else { return Ok(()) };
        let mut ended = Vec::new();
        if fault.kind == Kind::SwapStandstill {
            ended = self.swap(fault).await?;
            tokio::time::sleep(SWAP_TIME.mul_f64(fault.moment)).await;
        }
        stack::signal_group(supervisor, stop)?;
        let began = Instant::now();
        while !stack::is_stopped(supervisor) {
            if began.elapsed() > TARGET_TIME {
                return Err(Failure::Work(format!("{stop} did not stop the supervisor")));
            }
            tokio::time::sleep(POLL_PERIOD).await;
        }
        let frozen = if fault.kind == Kind::Frozen { self.stack.processes() } else { Vec::new() };
        frozen.iter().try_for_each(|process| signal(process.pid, Signal::SIGSTOP))?;
        tokio::time::sleep(Duration::from_millis(fault.pause_ms)).await;
        stack::signal_group(supervisor, Signal::SIGCONT)?;
        frozen.iter().try_for_each(|process| signal(process.pid, Signal::SIGCONT))?;
        // Long enough for every judgement that a supervisor could make of the silence.
        tokio::time::sleep(JUDGEMENT_TIME).await;
        self.recovery(&ended).await?;
        let after = stack::ps(self.bus).await.map(|ps| ps.services).unwrap_or_default();
        let is_done = |new: &Service| new.swap.as_ref().is_some_and(|swap| swap.state() == SwapState::Done);
        let stays = |old: &Service| {
            let swapped = ended.contains(&old.pid);
            let is_right = |new: &Service| if swapped { is_done(new) } else { new.pid == old.pid };
            after.iter().any(|new| new.name == old.name && new.restarts == old.restarts && is_right(new))
        };
        match before.iter().find(|old| !stays(old)) {
            None => Ok(()),
            Some(lost) if ended.contains(&lost.pid) => {
                Err(Failure::Work(format!("the swap of `{}` failed, because the supervisor stood still", lost.name)))
            }
            Some(lost) => Err(Failure::Work(format!(
                "`{}` (process {}) was restarted, although it had done nothing wrong",
                lost.name, lost.pid
            ))),
        }
    }

    /// Kills a process, waits for its successor, and kills that too after a pause.
    async fn kill_twice(&mut self, fault: &Fault) -> Result<Vec<u32>, Failure> {
        if fault.targets.iter().any(|name| name == role::SUPERVISOR) {
            let ended = self.kill_supervisor(false).await?;
            tokio::time::sleep(Duration::from_millis(fault.pause_ms)).await;
            return Ok([ended, self.kill_supervisor(false).await?].concat());
        }
        let mut ended = self.signal_all(fault, Signal::SIGKILL).await?;
        let began = Instant::now();
        while began.elapsed() < TARGET_TIME {
            let next = self.targets(fault).await?;
            if next.iter().all(|pid| !ended.contains(pid)) {
                // A share of the start, which is mostly over after a tenth of a second.
                tokio::time::sleep(Duration::from_millis(fault.pause_ms / 4)).await;
                for pid in &next {
                    signal(*pid, Signal::SIGKILL)?;
                }
                ended.extend(next);
                return Ok(ended);
            }
            tokio::time::sleep(POLL_PERIOD).await;
        }
        Err(Failure::Work("the killed process was not started again".to_owned()))
    }

    /// Kills the supervisor, with or without its services, and starts it again at once.
    async fn kill_supervisor(&mut self, all: bool) -> Result<Vec<u32>, Failure> {
        let before = self.stack.processes();
        if all {
            for process in &before {
                signal(process.pid, Signal::SIGKILL)?;
            }
        }
        let supervisor = self.stack.supervisor();
        self.stack.kill_supervisor().await?;
        self.stack.up()?;
        let (took, left) = self.stack.wait_gone(&before).await;
        self.log.followed = self.log.followed.max(took);
        self.log.orphans.extend(left.iter().map(|p| format!("process {} outlived its supervisor", p.pid)));
        Ok(before.iter().map(|p| p.pid).chain(supervisor).collect())
    }

    /// Simulates a full disk before the step's command, waits for the refusal, and ends the simulation.
    async fn no_room(&mut self, index: usize, fault: &Fault) -> Result<Duration, Failure> {
        let refused = |counts: &Counts| counts.refused_for_room.load(Ordering::Relaxed);
        let before = refused(&self.counts);
        let pids = self.targets(fault).await?;
        let limits = pids.iter().map(|pid| limit(*pid, Some(0))).collect::<Result<Vec<_>, _>>()?;
        let began = Instant::now();
        self.set_up.send_replace(index + 1);
        while refused(&self.counts) == before && began.elapsed() < REFUSAL_TIME {
            tokio::time::sleep(POLL_PERIOD).await;
        }
        // If the full disk ended the process, the check below finds it.
        let given_back: Result<Vec<_>, _> = pids.iter().zip(limits).map(|(pid, old)| limit(*pid, old)).collect();
        if self.targets(fault).await? != pids {
            return Err(Failure::Work("the full disk ended the process".to_owned()));
        }
        given_back?;
        if refused(&self.counts) == before {
            return Err(Failure::Work("the command was not refused with RESOURCE_EXHAUSTED".to_owned()));
        }
        self.accepted(fault, "the disk has room again, but the command is still refused").await?;
        Ok(began.elapsed())
    }

    /// Stalls the disk before the step's command, and lets it go on after a while. The command must wait that long and then
    /// be accepted.
    async fn stall(&mut self, index: usize, fault: &Fault) -> Result<Duration, Failure> {
        let pids = self.targets(fault).await?;
        let stalled = StalledDisk::begin(self.project).await?;
        let began = Instant::now();
        self.set_up.send_replace(index + 1);
        tokio::time::sleep(Duration::from_millis(fault.pause_ms)).await;
        if *self.answered.borrow() > fault.step {
            return Err(Failure::Work("the command was answered, although nothing could be written".to_owned()));
        }
        drop(stalled);
        self.accepted(fault, "the disk writes again, but the command is still refused").await?;
        if self.targets(fault).await? != pids {
            return Err(Failure::Work("the stalled disk ended the process".to_owned()));
        }
        Ok(began.elapsed())
    }

    /// Waits until the command of the fault's step is accepted.
    async fn accepted(&mut self, fault: &Fault, otherwise: &str) -> Result<(), Failure> {
        let over = |_| Failure::Work("the session ended before its command was saved".to_owned());
        let saved = self.answered.wait_for(|n| *n > fault.step);
        let saved = tokio::time::timeout(RECOVERY_TIME, saved).await;
        saved.map_err(|_| Failure::Work(otherwise.to_owned()))?.map_err(over).map(drop)
    }

    /// Waits until every service is ready, with none of these processes.
    async fn recovery(&mut self, ended: &[u32]) -> Result<(), Failure> {
        let began = Instant::now();
        let mut last = "the supervisor does not answer".to_owned();
        while began.elapsed() < RECOVERY_TIME {
            self.stack.check()?;
            if let Some(ps) = stack::ps(self.bus).await {
                let recovered = |s: &Service| s.state() == ServiceState::Ready && !ended.contains(&s.pid);
                match ps.services.iter().find(|s| !recovered(s)) {
                    None if self.stack.supervisor() == Some(ps.pid) => return Ok(()),
                    None => last = format!("the supervisor is process {}", ps.pid),
                    Some(unready) => {
                        let state = crate::supervisor_client::state(unready);
                        let swap = unready.swap.as_ref().map_or("", |s| s.reason.as_str());
                        last = format!(
                            "`{}` is {state} (process {}): {} {swap}",
                            unready.name, unready.pid, unready.reason
                        );
                        let swap_failed = unready.swap.as_ref().is_some_and(|s| s.state() == SwapState::Failed);
                        if swap_failed || matches!(unready.state(), ServiceState::Failed | ServiceState::Stopped) {
                            break;
                        }
                    }
                }
            }
            tokio::time::sleep(POLL_PERIOD).await;
        }
        Err(Failure::Work(format!("not recovered after {}: {last}", format_time(began.elapsed().as_secs_f64() * 1e3))))
    }

    async fn look_for_orphans(&mut self) {
        let Some(ps) = stack::ps(self.bus).await else { return };
        let processes = self.stack.processes();
        let of_no_service = |p: &&Process| !ps.services.iter().any(|s| s.pid == p.pid);
        self.log.orphans.extend(
            processes
                .iter()
                .filter(of_no_service)
                .map(|p| format!("process {} belongs to no service of the stack", p.pid)),
        );
    }
}

fn pid_of(ps: &PsReply, name: &str) -> Option<u32> {
    if name == role::SUPERVISOR {
        return Some(ps.pid);
    }
    ps.services.iter().find(|s| s.name == name).map(|s| s.pid).filter(|pid| *pid > 0)
}

/// Limits the size of files that a process writes, as a full disk does. Returns the earlier limit.
fn limit(pid: u32, bytes: Option<u64>) -> Result<Option<u64>, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::Work(format!("process {pid} cannot be limited: {e}"));
    let raw = i32::try_from(pid).map_err(|e| failed(&e))?;
    let pid = Pid::from_raw(raw);
    let maximum = rustix::process::getrlimit(Resource::Fsize).maximum;
    let old = prlimit(pid, Resource::Fsize, Rlimit { current: bytes.or(maximum), maximum }).map_err(|e| failed(&e))?;
    Ok(old.current)
}
