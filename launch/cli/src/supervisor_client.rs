//! `ps`, `logs`, `restart` and `down`: requests to the supervisor of a running stack.

use std::time::{Duration, Instant};

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::launch::{DownRequest, PsReply, PsRequest, RestartRequest, Service, ServiceState, Swap, SwapState};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::session::{self, SessionDir};
use sg_stack::log_line::LogLine;
use sg_stack::suggestion::suggestion;

use crate::terminal::{self, CommandResult, Failure, columns, format_time};
use sg_stack::console;
use sg_stack::log_file::{self, LogReader};

/// Longest time for the supervisor's answer.
pub(crate) const ANSWER: Duration = Duration::from_secs(5);
/// Longest time for a stop or restart, beyond any grace period.
const TIMEOUT: Duration = Duration::from_secs(120);
/// Longest time until a stack is ready. A large scene is clustered meanwhile.
const START_TIME: Duration = Duration::from_secs(900);
/// Pause between two checks.
pub(crate) const POLL_PERIOD: Duration = Duration::from_millis(50);

/// Joins the bus of a running session with the role of the command line.
pub(crate) async fn join(name: Option<&str>) -> Result<(SessionDir, Bus), Failure> {
    let session = session::find(name)?;
    let bus = Bus::connect(session.name(), role::CLI, &session.endpoint()).await?;
    Ok((session, bus))
}

/// The services of a stack.
pub(crate) async fn services(bus: &Bus) -> Result<PsReply, Failure> {
    Ok(bus.ask(&keys::PS, &PsRequest {}, &Context::root().deadline_in(ANSWER)).await?)
}

/// Waits until every service is ready.
pub(crate) async fn wait_until_ready(bus: &Bus) -> Result<PsReply, Failure> {
    let began = Instant::now();
    loop {
        let ps = services(bus).await?;
        if let Some(failed) = ps.services.iter().find(|s| s.state() == ServiceState::Failed) {
            return Err(Failure::Work(format!("service `{}` failed: {}", failed.name, failed.reason)));
        }
        let missing: Vec<_> =
            ps.services.iter().filter(|s| s.state() != ServiceState::Ready).map(|s| s.name.as_str()).collect();
        if missing.is_empty() {
            return Ok(ps);
        }
        if began.elapsed() > START_TIME {
            let seconds = START_TIME.as_secs();
            return Err(Failure::Work(format!("not ready after {seconds} s: {}", missing.join(", "))));
        }
        tokio::time::sleep(POLL_PERIOD).await;
    }
}

pub(crate) async fn ps(name: Option<&str>, json: bool) -> CommandResult {
    let (_, bus) = join(name).await?;
    let ps = services(&bus).await?;
    if json {
        terminal::print_line(&as_json(&ps).to_string());
    } else {
        for line in columns(&as_rows(&ps)) {
            terminal::print_line(&line);
        }
    }
    bus.close().await;
    Ok(())
}

fn as_json(ps: &PsReply) -> serde_json::Value {
    let service = |s: &Service| {
        serde_json::json!({
            "name": s.name, "role": s.role, "state": state(s), "pid": s.pid, "instance": s.instance,
            "restarts": s.restarts, "uptime_ms": s.uptime_ms, "memory_bytes": s.memory_bytes,
            "start_ms": s.start_ms, "reason": s.reason, "executable": s.executable, "epoch": s.epoch, "node": s.node,
            "answer_ms": s.answer_ms, "answer_ms_p99": s.answer_ms_p99, "busy": s.busy,
            "swap": s.swap.as_ref().map(|swap| serde_json::json!({
                "number": swap.number, "state": swap_state(swap), "executable": swap.executable, "pid": swap.pid,
                "instance": swap.instance, "reason": swap.reason,
            })),
        })
    };
    let services: Vec<_> = ps.services.iter().map(service).collect();
    serde_json::json!({
        "session": ps.session, "launch_file": ps.launch_file, "pid": ps.pid, "services": services,
    })
}

fn as_rows(ps: &PsReply) -> Vec<Vec<String>> {
    // Latencies of requests: median / 99th percentile of the last minute.
    let head = ["SERVICE", "ROLE", "ON", "STATE", "PID", "UP", "RESTARTS", "MEMORY", "START", "LATENCY", "WHY"];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    let or_dash = |known: bool, text: String| if known { text } else { "-".to_owned() };
    rows.extend(ps.services.iter().map(|s| {
        vec![
            s.name.clone(),
            s.role.clone(),
            if s.node.is_empty() { "here".to_owned() } else { s.node.clone() },
            state(s).to_owned(),
            or_dash(s.pid > 0, s.pid.to_string()),
            or_dash(s.pid > 0, format_time(s.uptime_ms as f64)),
            s.restarts.to_string(),
            or_dash(s.memory_bytes > 0, format!("{} MiB", s.memory_bytes >> 20)),
            or_dash(s.start_ms > 0, format_time(s.start_ms as f64)),
            or_dash(s.answer_ms > 0.0, format!("{:.1} / {:.1} ms", s.answer_ms, s.answer_ms_p99)),
            why(s),
        ]
    }));
    rows
}

/// The reason for a service's state, its long work, and the state of its swap.
fn why(service: &Service) -> String {
    let swap = service.swap.as_ref().filter(|s| s.state() != SwapState::Done).map(|swap| {
        let reason = if swap.reason.is_empty() { String::new() } else { format!(": {}", swap.reason) };
        let state = swap_state(swap).to_lowercase().replace('_', " ");
        format!("swap to {} {state}{reason}", swap.executable)
    });
    let own = Some(service.reason.clone()).filter(|r| !r.is_empty());
    let busy = Some(service.busy.clone()).filter(|b| !b.is_empty());
    own.into_iter().chain(busy).chain(swap).collect::<Vec<_>>().join("; ")
}

fn swap_state(swap: &Swap) -> &'static str {
    swap.state().as_str_name().trim_start_matches("SWAP_STATE_")
}

/// The name of a service's state.
pub(crate) fn state(service: &Service) -> &'static str {
    service.state().as_str_name().trim_start_matches("SERVICE_STATE_")
}

/// The failure for a request that the supervisor refused.
pub(crate) fn refused(fault: Fault) -> Failure {
    match fault.code {
        Code::NotFound | Code::InvalidArgument => Failure::Input(fault.to_string()),
        _ => fault.into(),
    }
}

pub(crate) async fn restart(name: Option<&str>, service: &str) -> CommandResult {
    let (_, bus) = join(name).await?;
    let find = |ps: PsReply| ps.services.into_iter().find(|s| s.name == service);
    let before = find(services(&bus).await?).map_or(0, |s| s.restarts);
    let request = RestartRequest { service: service.to_owned() };
    let reply = bus.ask(&keys::RESTART, &request, &Context::root().deadline_in(ANSWER)).await;
    let reply = reply.map_err(refused)?;
    let began = Instant::now();
    loop {
        tokio::time::sleep(POLL_PERIOD).await;
        let Some(now) = find(services(&bus).await?) else { continue };
        match now.state() {
            ServiceState::Ready if now.restarts > before => {
                let old =
                    if reply.old_pid > 0 { format!("process {} stopped, ", reply.old_pid) } else { String::new() };
                terminal::print_line(&format!(
                    "{service}: {old}process {} ready after {}",
                    now.pid,
                    format_time(now.start_ms as f64)
                ));
                bus.close().await;
                return Ok(());
            }
            ServiceState::Failed => return Err(Failure::Work(format!("service `{service}` failed: {}", now.reason))),
            _ if began.elapsed() > TIMEOUT => {
                let seconds = TIMEOUT.as_secs();
                return Err(Failure::Work(format!("`{service}` is {} after {seconds} s: {}", state(&now), now.reason)));
            }
            _ => {}
        }
    }
}

pub(crate) async fn down(name: Option<&str>) -> CommandResult {
    let (session, bus) = join(name).await?;
    bus.ask(&keys::DOWN, &DownRequest {}, &Context::root().deadline_in(ANSWER)).await?;
    let began = Instant::now();
    while session.is_running() {
        if began.elapsed() > TIMEOUT {
            let seconds = TIMEOUT.as_secs();
            return Err(Failure::Work(format!("session `{}` still runs after {seconds} s", session.name())));
        }
        tokio::time::sleep(POLL_PERIOD).await;
    }
    let took = format_time(began.elapsed().as_secs_f64() * 1000.0);
    terminal::print_line(&format!("session {} stopped after {took}", session.name()));
    Ok(())
}

/// Logs outlive their stack, so a named session is read even if it does not run.
pub(crate) fn logs(name: Option<&str>, service: Option<&str>, follow: bool) -> CommandResult {
    let session = match name {
        Some(name) => SessionDir::named(name)?,
        None => session::find(None)?,
    };
    let folder = session.logs();
    let all = log_file::services(&folder);
    if all.is_empty() {
        return Err(Failure::Input(format!("session `{}` has no logs", session.name())));
    }
    let wanted: Vec<_> = match service {
        None => all,
        Some(service) if all.iter().any(|s| s == service) => vec![service.to_owned()],
        Some(service) => {
            let hint = suggestion(service, all.iter().map(String::as_str));
            return Err(Failure::Input(format!("no service `{service}`{hint}")));
        }
    };
    let width = if wanted.len() > 1 { wanted.iter().map(String::len).max().unwrap_or(0) } else { 0 };
    let mut readers: Vec<_> =
        wanted.iter().map(|s| (LogReader::open(log_file::path_of(&folder, s)), String::new())).collect();
    let colored = terminal::stdout_colored();
    loop {
        // Check before reading, so that the last lines are still read.
        let running = session.is_running();
        let mut lines = Vec::new();
        for (position, (service, (reader, last))) in wanted.iter().zip(&mut readers).enumerate() {
            for line in reader.lines().map_err(|e| Failure::Work(format!("log of `{service}`: {e}")))? {
                let mut line = LogLine::parse(&line);
                // A line without a time stays behind the line before it.
                if line.timestamp.is_empty() {
                    line.timestamp.clone_from(last);
                }
                last.clone_from(&line.timestamp);
                lines.push((line, position));
            }
        }
        lines.sort_by(|a, b| a.0.timestamp.cmp(&b.0.timestamp));
        for (line, position) in lines {
            let service = wanted.get(position).map_or("", String::as_str);
            let ink = console::color_of(position);
            terminal::print_line(&console::format_line(line.time(), service, width, ink, &line, colored));
        }
        if !follow || !running {
            return Ok(());
        }
        std::thread::sleep(4 * POLL_PERIOD);
    }
}
