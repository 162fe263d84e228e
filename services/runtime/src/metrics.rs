//! Prometheus metrics of a process.
//!
//! The names are an enum, so each quantity has one name. Without an installed recorder, as in commands, a metric costs one
//! branch.

use std::sync::OnceLock;
use std::time::Duration;

use metrics::Unit;
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use sg_proto::bus::{Code, Health};

/// All metrics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Time from sending a request to its reply, by key and code.
    AskSeconds,
    /// Requests sent again because no process served the role, by key.
    Retries,
    /// Time to handle a request, by key and code.
    ServeSeconds,
    /// Messages published, by key.
    Published,
    /// Messages refused for their type, size, form, sender or epoch, by key.
    Refused,
    /// Messages dropped in transit or at a full queue, by key.
    Dropped,
    /// Messages waiting in an actor's mailbox, by actor.
    ActorQueued,
    /// Messages handled, by actor.
    ActorHandled,
    /// Messages refused by a full mailbox, by actor.
    ActorDropped,
    /// Time of one render pass, by pass; measured on the graphics device where there is one.
    PassSeconds,
    /// Resident memory of the process.
    MemoryBytes,
    /// Time since the start of the process.
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

/// Upper bounds of the histogram buckets, seconds: from one local message to the slowest request.
const BUCKETS: [f64; 16] = [5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 5.0, 30.0];

impl Metric {
    /// All metrics.
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

    /// Name in Prometheus.
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
            Self::AskSeconds => (Kind::Histogram, Unit::Seconds, "Time from sending a request to its reply"),
            Self::Retries => (Kind::Counter, Unit::Count, "Requests sent again because no process served the role"),
            Self::ServeSeconds => (Kind::Histogram, Unit::Seconds, "Time to handle a request"),
            Self::Published => (Kind::Counter, Unit::Count, "Messages published"),
            Self::Refused => {
                (Kind::Counter, Unit::Count, "Messages refused for their type, size, form, sender or epoch")
            }
            Self::Dropped => (Kind::Counter, Unit::Count, "Messages dropped in transit or at a full queue"),
            Self::ActorQueued => (Kind::Gauge, Unit::Count, "Messages waiting in an actor's mailbox"),
            Self::ActorHandled => (Kind::Counter, Unit::Count, "Messages handled"),
            Self::ActorDropped => (Kind::Counter, Unit::Count, "Messages refused by a full mailbox"),
            Self::PassSeconds => (Kind::Histogram, Unit::Seconds, "Time of one render pass"),
            Self::MemoryBytes => (Kind::Gauge, Unit::Bytes, "Resident memory"),
            Self::UptimeSeconds => (Kind::Gauge, Unit::Seconds, "Time since the start of the process"),
            Self::ServiceRestarts => (Kind::Counter, Unit::Count, "Starts of a service after its first"),
            Self::ServiceReady => (Kind::Gauge, Unit::Count, "Whether a service is ready"),
        }
    }
}

static HANDLE: OnceLock<PrometheusHandle> = OnceLock::new();

/// Installs the recorder of this process. All metrics carry its role and instance. A second call changes nothing.
pub fn install(role: &str, instance: &str) {
    let builder = PrometheusBuilder::new().add_global_label("role", role).add_global_label("instance", instance);
    let mut histograms = Metric::ALL.into_iter().filter(|m| m.describe().0 == Kind::Histogram);
    let builder =
        histograms.try_fold(builder, |b, m| b.set_buckets_for_metric(Matcher::Full(m.name().to_owned()), &BUCKETS));
    // Fails only for an empty list of buckets.
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
        // Cannot fail: the recorder is installed once.
        let _ = HANDLE.set(handle);
    }
}

/// All metrics in Prometheus' text format; empty without a recorder.
#[must_use]
pub fn render() -> String {
    let Some(handle) = HANDLE.get() else { return String::new() };
    // Histograms keep raw samples until upkeep.
    handle.run_upkeep();
    handle.render()
}

/// Bounds the memory of histograms between two calls of [`render`]; called with every health message.
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

/// Sets the metrics of a supervised service.
pub fn service(name: &str, restarts: u32, ready: bool) {
    let label = [("service", name.to_owned())];
    metrics::counter!(Metric::ServiceRestarts.name(), &label).absolute(u64::from(restarts));
    metrics::gauge!(Metric::ServiceReady.name(), &label).set(f64::from(u8::from(ready)));
}

/// Sets the metrics of a process from its health.
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

/// Label of an outcome: a gRPC code.
pub(crate) fn code(code: Option<Code>) -> &'static str {
    code.map_or("OK", |code| code.as_str_name().trim_start_matches("CODE_"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn names_are_unique_and_end_in_their_unit() {
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
    fn metrics_are_rendered() {
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
