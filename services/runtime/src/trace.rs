//! Export of traces to an OpenTelemetry collector.
//!
//! Messages carry the ids ([`Context::traceparent`]), so one trace spans services in any language. This module only exports
//! the spans of this process.

use std::sync::OnceLock;
use std::time::{Duration, SystemTime};

use opentelemetry::trace::{SpanContext, SpanId, SpanKind, Status, TraceFlags, TraceId, TraceState};
use opentelemetry::{InstrumentationScope, KeyValue};
use opentelemetry_otlp::{SpanExporter, WithExportConfig as _};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{
    BatchConfigBuilder, BatchSpanProcessor, SpanData, SpanEvents, SpanLinks, SpanProcessor,
};
use sg_proto::bus::Code;

use crate::context::Context;
use crate::metrics;

/// Environment variable with the endpoint of the collector, such as `http://127.0.0.1:4317`.
pub const COLLECTOR: &str = "OTEL_EXPORTER_OTLP_ENDPOINT";

/// Most waiting spans; further ones are dropped.
const QUEUE_SIZE: usize = 4096;
/// Time between two exports.
const EXPORT_PERIOD: Duration = Duration::from_millis(500);
/// Longest time for one export, and for the last one at exit.
const EXPORT_TIMEOUT: Duration = Duration::from_secs(2);

/// Side of a message in a span.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Sender of a request.
    Client,
    /// Receiver of a request.
    Server,
    /// Publisher of a message.
    Producer,
}

struct Exporter {
    processor: BatchSpanProcessor,
    scope: InstrumentationScope,
}

static EXPORTER: OnceLock<Option<Exporter>> = OnceLock::new();

/// Starts the export if the environment names a collector. Must run inside a tokio runtime.
pub(crate) fn start(role: &str) {
    EXPORTER.get_or_init(|| {
        let endpoint = std::env::var(COLLECTOR).ok().filter(|e| !e.is_empty())?;
        let exporter =
            SpanExporter::builder().with_tonic().with_endpoint(&endpoint).with_timeout(EXPORT_TIMEOUT).build();
        let exporter = match exporter {
            Ok(exporter) => exporter,
            Err(error) => {
                tracing::warn!(endpoint, %error, "traces are not exported; check {COLLECTOR}");
                return None;
            }
        };
        let config =
            BatchConfigBuilder::default().with_max_queue_size(QUEUE_SIZE).with_scheduled_delay(EXPORT_PERIOD).build();
        let mut processor = BatchSpanProcessor::builder(exporter).with_batch_config(config).build();
        let resource = Resource::builder().with_service_name(format!("supergaussian-{role}")).build();
        processor.set_resource(&resource);
        Some(Exporter { processor, scope: InstrumentationScope::builder("sg-runtime").build() })
    });
}

/// Exports the waiting spans at exit.
pub(crate) async fn finish() {
    if let Some(Some(exporter)) = EXPORTER.get() {
        // An absent collector must not delay the exit.
        let flush = tokio::task::spawn_blocking(move || drop(exporter.processor.force_flush()));
        let _ = tokio::time::timeout(EXPORT_TIMEOUT, flush).await;
    }
}

/// Exports one span for the message of this context, from `started` until now.
pub(crate) fn record(
    context: &Context,
    kind: Kind,
    name: impl FnOnce() -> String,
    started: SystemTime,
    code: Option<Code>,
) {
    let Some(Some(exporter)) = EXPORTER.get() else { return };
    let (Ok(trace), Ok(span)) = (TraceId::from_hex(context.trace_id()), SpanId::from_hex(context.span_id())) else {
        return;
    };
    let parent = SpanId::from_hex(&context.parent_span).unwrap_or(SpanId::INVALID);
    let mut attributes = vec![KeyValue::new("message.id", context.id.clone())];
    if !context.conversation.is_empty() {
        attributes.push(KeyValue::new("conversation", context.conversation.clone()));
        attributes.push(KeyValue::new("step", i64::from(context.step)));
    }
    exporter.processor.on_end(SpanData {
        span_context: SpanContext::new(trace, span, TraceFlags::SAMPLED, false, TraceState::NONE),
        parent_span_id: parent,
        parent_span_is_remote: kind == Kind::Server,
        span_kind: match kind {
            Kind::Client => SpanKind::Client,
            Kind::Server => SpanKind::Server,
            Kind::Producer => SpanKind::Producer,
        },
        name: name().into(),
        start_time: started,
        end_time: SystemTime::now(),
        attributes,
        dropped_attributes_count: 0,
        events: SpanEvents::default(),
        links: SpanLinks::default(),
        status: code.map_or(Status::Ok, |code| Status::error(metrics::code(Some(code)))),
        instrumentation_scope: exporter.scope.clone(),
    });
}
