//! A soak: users work in a running stack for long, its services are restarted again and again, and what the processes use
//! is sampled and judged. Memory, descriptors, threads and disk have to stay level.
//!
//! The services are restarted one after another, each for an equal share of the session. So each of them also lives for
//! long without a restart, and a leak shows.

pub mod judge;
pub mod options;
pub mod pace;
pub mod plot;
pub mod restarts;
pub mod samples;
pub mod trend;
pub mod usage;
pub mod users;

use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::launch::PsRequest;
use sg_runtime::context::Context;

use crate::made_scene;
use crate::stack::{SESSION, Stack};
use crate::until::PATIENCE;
use judge::Row;
use options::Options;
use pace::Pace;
use restarts::Restarts;
use samples::{Folders, Sample, Sampler};
use users::Users;

/// Pause between two reports of a session that goes on.
const REPORTS: Duration = Duration::from_secs(60);
/// How long the last requests may take.
const LAST_REQUESTS: Duration = Duration::from_secs(90);

/// The result of a session.
#[derive(Debug)]
pub struct Outcome {
    /// Quantities with their bounds.
    pub rows: Vec<Row>,
    /// Requests that failed, and the texts of the first ones.
    pub failures: (u64, Vec<String>),
    /// Accepted commands whose results the scene no longer has.
    pub lost: Vec<String>,
    /// Whether all commands, captures and restarts were done.
    pub complete: bool,
    /// All of it as a text with tables.
    pub report: String,
}

impl Outcome {
    /// Whether every bound is kept, nothing failed and nothing is lost.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.failures.0 == 0 && self.lost.is_empty() && self.rows.iter().all(Row::holds)
    }
}

/// Plays a session in a stack of its own. SIGTERM and Ctrl-C end it early, with all results up to then.
///
/// The folder of the options gets `samples.csv`, and every minute `soak.svg` and `soak.md`.
///
/// # Errors
/// A line that names the part that is missing, did not get ready, or could not be written.
pub async fn play(options: &Options) -> Result<Outcome, String> {
    let named = |path: &Path, e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    std::fs::create_dir_all(&options.out).map_err(|e| named(&options.out, &e))?;
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let temporary = folder.path().join("temporary");
    std::fs::create_dir(&temporary).map_err(|e| named(&temporary, &e))?;
    let file = folder.path().join("stack.toml");
    std::fs::write(&file, include_str!("../../../launch/headless.toml")).map_err(|e| named(&file, &e))?;
    let (file_text, settings) = (file.display().to_string(), settings(options, folder.path())?);
    let env = [("TMPDIR", temporary.to_string_lossy().into_owned())];
    let env: Vec<(&str, &str)> = env.iter().map(|(key, value)| (*key, value.as_str())).collect();
    let stack = tokio::task::block_in_place(|| Stack::up_of(&file_text, &settings, &env))?;

    let bus = stack.join(role::CLI).await.map_err(|e| e.to_string())?;
    let soon = Context::root().deadline_in(PATIENCE);
    let ps = bus.ask(&keys::PS, &PsRequest {}, &soon).await.map_err(|e| e.to_string())?;
    let services: Vec<String> = ps.services.into_iter().map(|s| s.name).collect();
    let restarted = if options.services.is_empty() { services.clone() } else { options.services.clone() };
    if let Some(name) = restarted.iter().find(|name| !services.contains(name)) {
        return Err(format!("no service `{name}`; there are {}", services.join(", ")));
    }
    let data = stack.run_root().join(".data");
    let folders = Folders { session: stack.run_root().join(SESSION), data, temporary: temporary.clone() };
    let sampler = Sampler::new(bus.clone(), stack.supervisor(), &services, folders);
    let users = Users::of(bus.clone(), options.seed, options.pixels).await.map_err(|e| e.to_string())?;
    let (users, pace) = (Arc::new(users), Arc::new(Pace::new(options)));

    let mut tasks = tokio::task::JoinSet::new();
    for _ in 0..options.users.max(1) {
        let (users, pace) = (Arc::clone(&users), Arc::clone(&pace));
        tasks.spawn(async move { users.work(&pace).await });
    }
    let (looking, looks) = (Arc::clone(&users), Arc::clone(&pace));
    tasks.spawn(async move { looking.look(&looks).await });
    let (restarts, restarting) = (Restarts::new(bus, file, settings, restarted), Arc::clone(&pace));
    tasks.spawn(async move { restarts.work(&restarting).await });

    let samples = sample_until_done(&mut tasks, &sampler, &pace, options).await?;
    let over = tokio::time::timeout(LAST_REQUESTS, async { while tasks.join_next().await.is_some() {} }).await;
    if over.is_err() {
        pace.fail(&format!("requests without an answer {} s after the end", LAST_REQUESTS.as_secs()));
    }
    let outcome = outcome(&sampler.names, &samples, &pace, users.lost().await);
    write_results(options, &sampler.names, &samples, &outcome.report)?;
    Ok(outcome)
}

/// The settings over the launch file.
fn settings(options: &Options, folder: &Path) -> Result<Vec<String>, String> {
    let mut settings = vec![
        // Services are killed on purpose, again and again.
        "defaults.intensity={ restarts = 1000, within_s = 1 }".to_owned(),
        "defaults.backoff={ initial_ms = 30, max_ms = 500 }".to_owned(),
        format!("service.render-view.params.width={}", options.pixels),
        format!("service.render-view.params.height={}", options.pixels),
        "service.render-view.params.backend=\"cpu\"".to_owned(),
        "service.render-capture.params.backend=\"cpu\"".to_owned(),
    ];
    let scene = match options.gaussians {
        0 => crate::small_scene::write(folder).map_err(|e| e.to_string())?,
        gaussians => tokio::task::block_in_place(|| made_scene::write(folder, gaussians))?,
    };
    settings.push(format!("service.scene.params.scene={}", scene.display()));
    Ok(settings)
}

async fn sample_until_done(
    tasks: &mut tokio::task::JoinSet<()>,
    sampler: &Sampler,
    pace: &Pace,
    options: &Options,
) -> Result<Vec<Sample>, String> {
    let path = options.out.join("samples.csv");
    let fail = |e: std::io::Error| format!("{}: {e}", path.display());
    let mut table = File::create(&path).map_err(fail)?;
    writeln!(table, "{}", sampler.header()).map_err(fail)?;
    let signal_error = |e: std::io::Error| format!("signals cannot be watched: {e}");
    let kind = tokio::signal::unix::SignalKind::terminate();
    let mut terminate = tokio::signal::unix::signal(kind).map_err(signal_error)?;
    let mut period = tokio::time::interval(Duration::from_millis(options.sample_ms.max(10)));
    period.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    let (mut samples, mut reported) = (Vec::new(), Instant::now());
    loop {
        tokio::select! {
            _ = period.tick() => {}
            _ = terminate.recv() => pace.stop(),
            _ = tokio::signal::ctrl_c() => pace.stop(),
            ended = tasks.join_next() => match ended {
                Some(Ok(())) => continue,
                Some(Err(e)) => return Err(format!("a user failed: {e}")),
                None => return Ok(samples),
            },
        }
        if let Some(sample) = sampler.take(pace).await {
            writeln!(table, "{}", sample.line()).map_err(fail)?;
            samples.push(sample);
        } else if !pace.is_over() {
            pace.fail("the supervisor does not answer");
        }
        if reported.elapsed() >= REPORTS {
            reported = Instant::now();
            let so_far = outcome(&sampler.names, &samples, pace, Vec::new());
            write_results(options, &sampler.names, &samples, &so_far.report)?;
        }
        if pace.is_over() {
            return Ok(samples);
        }
    }
}

fn outcome(names: &[String], samples: &[Sample], pace: &Pace, lost: Vec<String>) -> Outcome {
    let (rows, failures) = (judge::judge(names, samples), pace.failures());
    let work = [("commands", &pace.commands), ("captures", &pace.captures), ("restarts", &pace.restarts)];
    let complete = work.iter().all(|(_, work)| work.done() >= work.total());
    // Writing to a string cannot fail.
    let mut text = String::new();
    let done: Vec<_> = work.iter().map(|(name, w)| format!("{} of {} {name}", w.done(), w.total())).collect();
    let _ = writeln!(text, "{} in {:.0} s, {} samples\n", done.join(", "), pace.elapsed().as_secs_f64(), samples.len());
    for ((work, code), count) in pace.answers() {
        let _ = writeln!(text, "- {work}: {count} {code}");
    }
    for line in failures.1.iter().chain(&lost) {
        let _ = writeln!(text, "- {line}");
    }
    let _ =
        writeln!(text, "\n| process | quantity | begin | end | largest (at most) | per 1,000 commands (at most) | |");
    let _ = writeln!(text, "| --- | --- | --- | --- | --- | --- | --- |");
    for row in &rows {
        let bound = |bound: Option<f64>| bound.map_or_else(String::new, |b| format!(" (≤ {b})"));
        let slope = row.slope.map_or_else(|| "–".to_owned(), |s| format!("{s:.3}"));
        let _ = writeln!(
            text,
            "| {} | {} | {:.0} | {:.0} | {:.0}{} | {slope}{} | {} |",
            row.subject,
            row.quantity,
            row.begin,
            row.end,
            row.largest,
            bound(row.most.map(f64::round)),
            bound(row.slope_bound),
            if row.holds() { "" } else { "NOT KEPT" },
        );
    }
    Outcome { rows, failures, lost, complete, report: text }
}

fn write_results(options: &Options, names: &[String], samples: &[Sample], report: &str) -> Result<(), String> {
    let path = options.out.join("soak.md");
    std::fs::write(&path, report).map_err(|e| format!("{}: {e}", path.display()))?;
    plot::draw(&options.out.join("soak.svg"), names, samples)
}
