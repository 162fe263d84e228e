//! The transcript: all messages on the bus during a playback.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sg_proto::keys::{self, role};
use sg_proto::prost::{Message, Name};
use sg_proto::render::Frame;
use sg_runtime::bus::{Bus, WatchedMessage};
use sg_runtime::context::Context;
use tokio::task::JoinHandle;

use crate::decode::{Decoder, hide_masks, is_health, stage};
use crate::terminal::Failure;

/// Its file name.
pub(crate) const FILE: &str = "transcript.json";
/// Most messages that wait at a time.
const CAPACITY: usize = 4096;
/// Most messages of one transcript.
const MAX_ENTRIES: usize = 100_000;
/// Pause between two checks for an expected message.
const POLL_PERIOD: Duration = Duration::from_millis(2);

/// A transcript in progress.
#[derive(Debug)]
pub(crate) struct Transcript {
    began: Instant,
    session: String,
    entries: Arc<Mutex<Vec<Entry>>>,
    listening: JoinHandle<()>,
}

#[derive(Debug, Clone)]
struct Entry {
    at: Duration,
    seen: WatchedMessage,
}

impl Transcript {
    /// Starts to listen.
    pub(crate) async fn begin(bus: &Bus) -> Result<Self, Failure> {
        let mut watching = bus.watch_all(CAPACITY).await?;
        let began = Instant::now();
        let entries = Arc::new(Mutex::new(Vec::new()));
        let heard = Arc::clone(&entries);
        let listening = tokio::spawn(async move {
            while let Some(seen) = watching.next().await {
                if !is_health(&seen) {
                    push(&heard, Entry { at: began.elapsed(), seen });
                }
            }
        });
        Ok(Self { began, session: bus.session().to_owned(), entries, listening })
    }

    /// Adds a request or a reply, which the bus does not show to others.
    pub(crate) fn note<M: Message + Name>(&self, role: &str, name: &str, message: &M, context: &Context) {
        let seen = WatchedMessage {
            key: keys::key(&self.session, role, name),
            message: M::full_name(),
            payload: message.encode_to_vec(),
            context: context.clone(),
        };
        push(&self.entries, Entry { at: self.began.elapsed(), seen });
    }

    /// Waits for the view's picture of this revision or a later one. Returns its time of arrival.
    pub(crate) async fn view_of(&self, revision: u64, time: Duration) -> Option<Instant> {
        let key = keys::key(&self.session, role::RENDER_VIEW, keys::VIEW_FRAME.name);
        let end = Instant::now() + time;
        let mut looked = 0;
        while Instant::now() < end {
            {
                let entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
                for entry in entries.iter().skip(looked).filter(|e| e.seen.key == key) {
                    let frame = Frame::decode(entry.seen.payload.as_slice());
                    if frame.is_ok_and(|f| f.revision >= revision) {
                        return Some(self.began + entry.at);
                    }
                }
                looked = entries.len();
            }
            tokio::time::sleep(POLL_PERIOD).await;
        }
        None
    }

    /// Writes the list of `{t_seconds, conversation, step, stage, key, type, message}`, sorted by time.
    pub(crate) fn write(&self, out: &Path, decoder: &Decoder) -> Result<PathBuf, Failure> {
        let path = out.join(FILE);
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner).clone();
        entries.sort_by_key(|e| e.at);
        let list: Vec<Value> = entries.iter().map(|e| e.json(decoder)).collect();
        let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", path.display()));
        let text = serde_json::to_vec_pretty(&list).map_err(|e| fail(e.into()))?;
        let part = out.join(format!(".{FILE}.part"));
        std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, &path)).map_err(fail)?;
        Ok(path)
    }
}

impl Drop for Transcript {
    fn drop(&mut self) {
        self.listening.abort();
    }
}

fn push(entries: &Mutex<Vec<Entry>>, entry: Entry) {
    let mut entries = entries.lock().unwrap_or_else(PoisonError::into_inner);
    if entries.len() < MAX_ENTRIES {
        entries.push(entry);
    }
}

impl Entry {
    fn json(&self, decoder: &Decoder) -> Value {
        let WatchedMessage { key, message, payload, context } = &self.seen;
        let mut decoded = decoder.json(message, payload);
        hide_masks(&mut decoded);
        json!({
            "t_seconds": self.at.as_secs_f64(),
            "conversation": context.conversation,
            "step": context.step,
            "stage": stage(key),
            "key": key,
            "type": message,
            "message": decoded,
        })
    }
}
