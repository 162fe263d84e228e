//! Traces: what was asked and answered, told to an OpenTelemetry collector where one is named.
//!
//! Ids come with the messages themselves ([`Context::traceparent`]), so that one trace runs through the whole loop
//! whatever language its services are written in; this module only exports what they say.

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

/// Environment variable that names the collector, such as `http://127.0.0.1:4317`.
pub const COLLECTOR: &str = "OTEL_EXPORTER_OTLP_ENDPOINT";

/// Spans that wait for the collector at most; what finds no room is dropped.
const WAITING: usize = 4096;
/// How long spans are gathered before they are sent.
const GATHERING: Duration = Duration::from_millis(500);
/// How long one delivery may take, and the last one when the process leaves.
const PATIENCE: Duration = Duration::from_secs(2);

/// Which side of a message a span is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Who asked.
    Client,
    /// Who answered.
    Server,
    /// Who published.
    Producer,
}

struct Exporting {
    processor: BatchSpanProcessor,
    scope: InstrumentationScope,
}

static EXPORTING: OnceLock<Option<Exporting>> = OnceLock::new();

/// Begins to export if the environment names a collector. Needs a runtime, on which the connection lives.
pub(crate) fn start(role: &str) {
    EXPORTING.get_or_init(|| {
        let endpoint = std::env::var(COLLECTOR).ok().filter(|e| !e.is_empty())?;
        let exporter = SpanExporter::builder().with_tonic().with_endpoint(&endpoint).with_timeout(PATIENCE).build();
        let exporter = match exporter {
            Ok(exporter) => exporter,
            Err(error) => {
                tracing::warn!(endpoint, %error, "traces are not exported; check {COLLECTOR}");
                return None;
            }
        };
        let config = BatchConfigBuilder::default().with_max_queue_size(WAITING).with_scheduled_delay(GATHERING).build();
        let mut processor = BatchSpanProcessor::builder(exporter).with_batch_config(config).build();
        let resource = Resource::builder().with_service_name(format!("supergaussian-{role}")).build();
        processor.set_resource(&resource);
        Some(Exporting { processor, scope: InstrumentationScope::builder("sg-runtime").build() })
    });
}

/// Sends what is gathered, when the process leaves.
pub(crate) async fn finish() {
    if let Some(Some(exporting)) = EXPORTING.get() {
        // A collector that is away keeps nobody from leaving.
        let flush = tokio::task::spawn_blocking(move || drop(exporting.processor.force_flush()));
        let _ = tokio::time::timeout(PATIENCE, flush).await;
    }
}

/// Exports one span: the message of this context, from `started` until now.
pub(crate) fn record(
    context: &Context,
    kind: Kind,
    name: impl FnOnce() -> String,
    started: SystemTime,
    code: Option<Code>,
) {
    let Some(Some(exporting)) = EXPORTING.get() else { return };
    let (Ok(trace), Ok(span)) = (TraceId::from_hex(context.trace_id()), SpanId::from_hex(context.span_id())) else {
        return;
    };
    let parent = SpanId::from_hex(&context.parent_span).unwrap_or(SpanId::INVALID);
    let mut attributes = vec![KeyValue::new("message.id", context.id.clone())];
    if !context.conversation.is_empty() {
        attributes.push(KeyValue::new("conversation", context.conversation.clone()));
        attributes.push(KeyValue::new("step", i64::from(context.step)));
    }
    exporting.processor.on_end(SpanData {
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
        instrumentation_scope: exporting.scope.clone(),
    });
}
