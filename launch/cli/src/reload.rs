//! `up` for a running stack: reloads its launch file.

use std::time::Instant;

use sg_proto::keys::{self, role};
use sg_proto::launch::{Change, Difference, PsReply, ReloadRequest};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::session::SessionDir;

use crate::supervisor_client::{ANSWER, POLL_PERIOD, refused, services};
use crate::swap::{FOLLOW_TIME, Progress, progress, started};
use crate::terminal::{self, CommandResult, Failure, columns, format_time};

/// Reloads the launch file of a session, prints the differences, and follows them to their end. `name` is the session's
/// name if the file contains it.
pub(crate) async fn reload(session: &SessionDir, request: ReloadRequest, name: Option<&str>) -> CommandResult {
    let bus = Bus::connect(session.name(), role::CLI, &session.endpoint()).await?;
    let ps = services(&bus).await?;
    // A file with the same name by chance must not stop another stack.
    if ps.launch_file != request.launch_file && name != Some(session.name()) {
        let name = session.name();
        return Err(Failure::Work(format!(
            "session `{name}` runs already, from {}; stop it with `supergaussian down --session {name}`, name this one with --session, or put `name = \"{name}\"` into the file to change what runs",
            ps.launch_file
        )));
    }
    let began = Instant::now();
    let reply = bus.ask(&keys::RELOAD, &request, &Context::root().deadline_in(ANSWER)).await.map_err(refused)?;
    let rows: Vec<_> = reply.differences.iter().map(|d| vec![d.service.clone(), word(d.change()).to_owned()]).collect();
    for line in columns(&[vec![vec!["SERVICE".to_owned(), "CHANGE".to_owned()]], rows].concat()) {
        terminal::print_line(&line);
    }
    loop {
        let ps = services(&bus).await?;
        let open: Vec<_> = reply.differences.iter().map(|d| (d, progress_of(&ps, d))).collect();
        let running: Vec<_> = open
            .iter()
            .filter_map(
                |(d, p)| if let Progress::Running(what) = p { Some(format!("{}: {what}", d.service)) } else { None },
            )
            .collect();
        let failed: Vec<_> = open
            .into_iter()
            .filter_map(|(_, p)| if let Progress::Failed(why) = p { Some(why) } else { None })
            .collect();
        // A service that waits for a failed one waits for ever.
        let waits = |line: &String| line.contains("which failed");
        if running.is_empty() || (!failed.is_empty() && running.iter().all(waits)) {
            bus.close().await;
            if failed.is_empty() {
                terminal::print_line(&format!("done after {}", format_time(began.elapsed().as_secs_f64() * 1000.0)));
                return Ok(());
            }
            return Err(Failure::Faults([failed, running].concat()));
        }
        if began.elapsed() > FOLLOW_TIME {
            let seconds = FOLLOW_TIME.as_secs();
            return Err(Failure::Work(format!("not done after {seconds} s: {}", running.join("; "))));
        }
        tokio::time::sleep(POLL_PERIOD).await;
    }
}

fn word(change: Change) -> &'static str {
    match change {
        Change::Unchanged | Change::Unspecified => "unchanged",
        Change::Added => "added",
        Change::Removed => "removed",
        Change::Swapped => "swapped",
        Change::Restarted => "restarted",
        Change::InPlace => "changed",
    }
}

/// Progress of a difference.
fn progress_of(ps: &PsReply, difference: &Difference) -> Progress {
    let service = ps.services.iter().find(|s| s.name == difference.service);
    match (difference.change(), service) {
        (Change::Removed, None) => Progress::Done,
        (Change::Removed, Some(_)) => Progress::Running("stops".to_owned()),
        (_, None) => Progress::Failed(format!("service `{}` was removed in the meantime", difference.service)),
        // It may wait for a node whose certificate is revoked.
        (Change::Unchanged, Some(_)) => Progress::Done,
        (Change::Swapped, Some(service)) => match progress(service, difference.swap) {
            Progress::Done => started(service),
            other => other,
        },
        (_, Some(service)) => started(service),
    }
}
