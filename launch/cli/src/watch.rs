//! `watch`: every message, decoded.

use std::time::{Duration, Instant};

use serde_json::json;
use sg_runtime::bus::WatchedMessage;
use tokio::signal::unix::{SignalKind, signal};

use crate::decode::{Decoder, hide_masks, is_health, shorten_lists};
use crate::supervisor_client::join;
use crate::terminal::{self, CommandResult, Failure};

/// Most messages that wait for a slow terminal. The oldest are dropped and counted.
const CAPACITY: usize = 4096;
/// Pause between two checks of the stack.
const POLL_PERIOD: Duration = Duration::from_millis(500);

pub(crate) async fn watch(name: Option<&str>, json: bool, all: bool) -> CommandResult {
    let decoder = Decoder::new()?;
    let (session, bus) = join(name).await?;
    let mut seen = bus.watch_all(CAPACITY).await?;
    let no_signal = |e| Failure::Work(format!("signals cannot be received: {e}"));
    let mut interrupt = signal(SignalKind::interrupt()).map_err(no_signal)?;
    let mut terminate = signal(SignalKind::terminate()).map_err(no_signal)?;
    terminal::print_status(&format!("watching session {}; press Ctrl-C to end", session.name()));
    let began = Instant::now();
    let mut printed = 0;
    let mut glance = tokio::time::interval(POLL_PERIOD);
    loop {
        tokio::select! {
            message = seen.next() => {
                let Some(message) = message else { break };
                if all || !is_health(&message) {
                    terminal::print_line(&line(&decoder, &message, began.elapsed(), json));
                }
                if seen.lost() > printed {
                    terminal::print_status(&format!("{} messages lost, because this terminal is too slow", seen.lost() - printed));
                    printed = seen.lost();
                }
            }
            _ = glance.tick() => {
                if !session.is_running() {
                    terminal::print_status(&format!("session {} has stopped", session.name()));
                    break;
                }
            }
            _ = interrupt.recv() => break,
            _ = terminate.recv() => break,
        }
    }
    bus.close().await;
    Ok(())
}

/// Key, conversation and step, type, JSON.
fn line(decoder: &Decoder, seen: &WatchedMessage, at: Duration, json: bool) -> String {
    let mut message = decoder.json(&seen.message, &seen.payload);
    hide_masks(&mut message);
    if json {
        return json!({
            "t_seconds": at.as_secs_f64(), "key": seen.key, "conversation": seen.context.conversation,
            "step": seen.context.step, "sender": seen.context.sender, "id": seen.context.id, "cause": seen.context.cause,
            "node": seen.context.identity.as_ref().map_or("", |i| &i.node),
            "type": seen.message, "message": message,
        })
        .to_string();
    }
    shorten_lists(&mut message);
    let chain = match seen.context.conversation.as_str() {
        "" => "-".to_owned(),
        conversation => format!("{conversation}/{}", seen.context.step),
    };
    format!("{:8.3} {} {chain} {} {message}", at.as_secs_f64(), seen.key, seen.message)
}
