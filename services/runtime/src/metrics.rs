//! What a process counts, in Prometheus' terms.
//!
//! Names are an enum, so that the same thing is never counted under two of them. Where no recorder was installed, as in
//! commands, counting costs a branch.

use std::sync::OnceLock;
use std::time::Duration;

use metrics::Unit;
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use sg_proto::bus::{Code, Health};

/// Everything that is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Time from asking to the answer, by key and code.
    AskSeconds,
    /// Questions put again because nobody served the role, by key.
    Retries,
    /// Time a request was worked on, by key and code.
    ServeSeconds,
    /// Messages of streams sent, by key.
    Published,
    /// Messages refused for their type, size, form, sender or epoch, by key.
    Refused,
    /// Messages lost on the way or for want of room, by key.
    Dropped,
    /// Messages waiting in an actor's mailbox, by actor.
    ActorQueued,
    /// Messages an actor has handled, by actor.
    ActorHandled,
    /// Messages an actor's full mailbox turned away, by actor.
    ActorDropped,
    /// Time of one pass of a picture, by pass: that of the graphics device where one draws.
    PassSeconds,
    /// Resident memory of the process.
    MemoryBytes,
    /// Age of the process.
    UptimeSeconds,
    /// Starts of a supervised service after its first, by service.
    ServiceRestarts,
    /// Whether a supervised service is ready, 0 or 1, by service.
    ServiceReady,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Counter,
    Gauge,
    Histogram,
}

/// Upper bounds of the buckets of times, seconds: from a message on one machine to the slowest question.
const BUCKETS: [f64; 16] = [5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 5.0, 30.0];

impl Metric {
    /// All of them.
    pub const ALL: [Self; 14] = [
        Self::AskSeconds,
        Self::Retries,
        Self::ServeSeconds,
        Self::Published,
        Self::Refused,
        Self::Dropped,
        Self::ActorQueued,
        Self::ActorHandled,
        Self::ActorDropped,
        Self::PassSeconds,
        Self::MemoryBytes,
        Self::UptimeSeconds,
        Self::ServiceRestarts,
        Self::ServiceReady,
    ];

    /// Its name for Prometheus.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::AskSeconds => "supergaussian_ask_seconds",
            Self::Retries => "supergaussian_ask_retries_total",
            Self::ServeSeconds => "supergaussian_serve_seconds",
            Self::Published => "supergaussian_published_total",
            Self::Refused => "supergaussian_refused_total",
            Self::Dropped => "supergaussian_dropped_total",
            Self::ActorQueued => "supergaussian_actor_queued",
            Self::ActorHandled => "supergaussian_actor_handled_total",
            Self::ActorDropped => "supergaussian_actor_dropped_total",
            Self::PassSeconds => "supergaussian_pass_seconds",
            Self::MemoryBytes => "supergaussian_memory_bytes",
            Self::UptimeSeconds => "supergaussian_uptime_seconds",
            Self::ServiceRestarts => "supergaussian_service_restarts_total",
            Self::ServiceReady => "supergaussian_service_ready",
        }
    }

    fn describe(self) -> (Kind, Unit, &'static str) {
        match self {
            Self::AskSeconds => (Kind::Histogram, Unit::Seconds, "From asking to the answer"),
            Self::Retries => (Kind::Counter, Unit::Count, "Questions put again because nobody served the role"),
            Self::ServeSeconds => (Kind::Histogram, Unit::Seconds, "Work on one request"),
            Self::Published => (Kind::Counter, Unit::Count, "Messages of streams sent"),
            Self::Refused => {
                (Kind::Counter, Unit::Count, "Messages refused for their type, size, form, sender or epoch")
            }
            Self::Dropped => (Kind::Counter, Unit::Count, "Messages lost on the way or for want of room"),
            Self::ActorQueued => (Kind::Gauge, Unit::Count, "Messages waiting in an actor's mailbox"),
            Self::ActorHandled => (Kind::Counter, Unit::Count, "Messages an actor has handled"),
            Self::ActorDropped => (Kind::Counter, Unit::Count, "Messages an actor's full mailbox turned away"),
            Self::PassSeconds => (Kind::Histogram, Unit::Seconds, "One pass of a picture"),
            Self::MemoryBytes => (Kind::Gauge, Unit::Bytes, "Resident memory"),
            Self::UptimeSeconds => (Kind::Gauge, Unit::Seconds, "Age of the process"),
            Self::ServiceRestarts => (Kind::Counter, Unit::Count, "Starts of a service after its first"),
            Self::ServiceReady => (Kind::Gauge, Unit::Count, "Whether a service is ready"),
        }
    }
}

static HANDLE: OnceLock<PrometheusHandle> = OnceLock::new();

/// Begins to count in this process; what is counted carries its role and instance. A second call changes nothing.
pub fn install(role: &str, instance: &str) {
    let builder = PrometheusBuilder::new().add_global_label("role", role).add_global_label("instance", instance);
    let mut histograms = Metric::ALL.into_iter().filter(|m| m.describe().0 == Kind::Histogram);
    let builder =
        histograms.try_fold(builder, |b, m| b.set_buckets_for_metric(Matcher::Full(m.name().to_owned()), &BUCKETS));
    // Refused only for an empty list of buckets.
    let Ok(builder) = builder else { return };
    let recorder = builder.build_recorder();
    let handle = recorder.handle();
    if metrics::set_global_recorder(recorder).is_ok() {
        for metric in Metric::ALL {
            let (kind, unit, text) = metric.describe();
            match kind {
                Kind::Counter => metrics::describe_counter!(metric.name(), unit, text),
                Kind::Gauge => metrics::describe_gauge!(metric.name(), unit, text),
                Kind::Histogram => metrics::describe_histogram!(metric.name(), unit, text),
            }
        }
        // Nobody else sets it: the recorder was ours to install.
        let _ = HANDLE.set(handle);
    }
}

/// What was counted so far, in Prometheus' text format; empty where nothing was installed.
#[must_use]
pub fn render() -> String {
    let Some(handle) = HANDLE.get() else { return String::new() };
    // Histograms keep raw samples until somebody looks.
    handle.run_upkeep();
    handle.render()
}

/// Keeps memory bounded where nobody looks: called with every sign of life.
pub(crate) fn upkeep() {
    if let Some(handle) = HANDLE.get() {
        handle.run_upkeep();
    }
}

/// Adds to a counter.
pub fn count(metric: Metric, labels: &[(&'static str, &'static str)], by: u64) {
    metrics::counter!(metric.name(), labels).increment(by);
}

/// Adds a time to a histogram.
pub fn observe(metric: Metric, labels: &[(&'static str, &'static str)], time: Duration) {
    metrics::histogram!(metric.name(), labels).record(time.as_secs_f64());
}

/// Sets what a supervisor knows of one service.
pub fn service(name: &str, restarts: u32, ready: bool) {
    let label = [("service", name.to_owned())];
    metrics::counter!(Metric::ServiceRestarts.name(), &label).absolute(u64::from(restarts));
    metrics::gauge!(Metric::ServiceReady.name(), &label).set(f64::from(u8::from(ready)));
}

/// Sets what a process's health says.
#[allow(clippy::cast_precision_loss, reason = "bytes and milliseconds stay far below 2^53")]
pub(crate) fn health(health: &Health) {
    metrics::gauge!(Metric::MemoryBytes.name()).set(health.memory_bytes as f64);
    metrics::gauge!(Metric::UptimeSeconds.name()).set(health.uptime_ms as f64 / 1e3);
    for actor in &health.actors {
        let label = [("actor", actor.name.clone())];
        metrics::gauge!(Metric::ActorQueued.name(), &label).set(f64::from(actor.queued));
        metrics::counter!(Metric::ActorHandled.name(), &label).absolute(actor.handled);
        metrics::counter!(Metric::ActorDropped.name(), &label).absolute(actor.dropped);
    }
}

/// The label of an outcome.
pub(crate) fn code(code: Option<Code>) -> &'static str {
    code.map_or("OK", |code| code.as_str_name().trim_start_matches("CODE_"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn names_are_unique_and_end_in_what_they_count() {
        let names: HashSet<_> = Metric::ALL.iter().map(|m| m.name()).collect();
        assert_eq!(names.len(), Metric::ALL.len());
        for metric in Metric::ALL {
            let (kind, unit, _) = metric.describe();
            let name = metric.name();
            assert!(name.starts_with("supergaussian_"), "{name}");
            assert_eq!(name.ends_with("_total"), kind == Kind::Counter, "{name}");
            assert_eq!(name.ends_with("_seconds"), unit == Unit::Seconds, "{name}");
            assert_eq!(name.ends_with("_bytes"), unit == Unit::Bytes, "{name}");
        }
    }

    #[test]
    fn what_is_counted_is_rendered() {
        install("scene", "scene-1");
        count(Metric::Refused, &[("key", "cmd/apply")], 2);
        observe(Metric::ServeSeconds, &[("key", "cmd/apply"), ("code", code(None))], Duration::from_micros(1500));
        service("scene", 3, true);
        let text = render();
        let line =
            |start: &str| text.lines().find(|l| l.starts_with(start)).unwrap_or_else(|| panic!("{start}\n{text}"));
        let refused = line("supergaussian_refused_total{");
        assert!(refused.contains("key=\"cmd/apply\"") && refused.contains("role=\"scene\""), "{refused}");
        assert!(refused.ends_with(" 2"), "{refused}");
        assert!(line("# TYPE supergaussian_serve_seconds").ends_with("histogram"));
        assert!(text.contains("le=\"0.002\"} 1") && text.contains("le=\"0.001\"} 0"), "{text}");
        assert!(line("supergaussian_service_restarts_total{").ends_with(" 3"));
    }
}
