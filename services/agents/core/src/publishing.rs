//! Publication of what happens, for whoever follows the conversation.

use sg_proto::keys::Stream;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;

/// Publishes a message. A failure is logged and stops nothing.
pub(crate) async fn publish<M: prost::Message + prost::Name>(
    bus: &Bus,
    row: &Stream<M>,
    message: &M,
    context: &Context,
) {
    if let Err(fault) = bus.publish(row, message, context).await {
        tracing::warn!(%fault, key = row.name, "a message could not be published");
    }
}
