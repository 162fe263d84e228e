//! `say`: one utterance to the running stack, with the stages of its pipeline.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sg_proto::keys;
use sg_proto::language::{ActionResult, Intent, Observation, Perceive, Plan, Reply, Source, Utterance};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::prost::{Message, Name};
use sg_runtime::bus::{Bus, WatchedMessage};
use sg_runtime::context::Context;

use sg_stack::terminal::may_color;

use crate::decode::{Decoder, hide_masks, stage};
use crate::supervisor_client::join;
use crate::terminal::{self, Color, CommandResult, Failure, format_time, paint};

/// Most messages that wait at a time.
const CAPACITY: usize = 256;
/// How long to wait for messages after the answer.
const TRAIL: Duration = Duration::from_millis(100);

/// Sends an utterance to the core agent.
pub(crate) async fn utter(bus: &Bus, text: &str, context: &Context) -> Result<Reply, Failure> {
    let utterance = Utterance { text: text.to_owned(), source: Source::Text.into(), ..Utterance::default() };
    Ok(bus.ask(&keys::UTTER, &utterance, context).await?)
}

pub(crate) async fn say(name: Option<&str>, text: String, json: bool, timeout: f64) -> CommandResult {
    if text.trim().is_empty() || text.len() > MAX_UTTERANCE_BYTES {
        return Err(Failure::Input(format!("write an utterance of 1 to {MAX_UTTERANCE_BYTES} bytes")));
    }
    let timeout = Duration::try_from_secs_f64(timeout).ok().filter(|t| !t.is_zero());
    let timeout = timeout.ok_or_else(|| Failure::Input("--timeout must be a number of seconds above 0".to_owned()))?;
    let decoder = Decoder::new()?;
    let (_, bus) = join(name).await?;
    let mut seen = bus.watch_all(CAPACITY).await?;
    let root = Context::root().deadline_in(timeout);
    let conversation = root.id.clone();
    let context = root.at_step(conversation.clone(), 1);

    let began = Instant::now();
    let mut stages = Vec::new();
    let asking = utter(&bus, &text, &context);
    tokio::pin!(asking);
    let mut reply = None;
    // Until the reply, and a moment longer for late messages.
    let mut end = tokio::time::Instant::now() + timeout + TRAIL;
    loop {
        tokio::select! {
            outcome = &mut asking, if reply.is_none() => {
                reply = Some(outcome);
                end = tokio::time::Instant::now() + TRAIL;
            }
            message = seen.next() => {
                let Some(message) = message else { break };
                // Newest values are not pipeline stages.
                if message.context.conversation == conversation && stage(&message.key) != keys::SCENE_STATE.name {
                    let at = began.elapsed();
                    if !json {
                        terminal::print_status(&shown(&message, at));
                    }
                    stages.push(as_json(&decoder, &message, at));
                }
            }
            () = tokio::time::sleep_until(end) => break,
        }
    }
    let reply = reply.unwrap_or_else(|| Err(Failure::Work("no answer in time".to_owned())));
    let lost = seen.lost();
    bus.close().await;
    let reply = match reply {
        Ok(reply) => reply,
        Err(failure) if json => {
            terminal::print_line(&json!({"ok": false, "error": failure.text(), "stages": stages}).to_string());
            return Err(failure);
        }
        Err(failure) => return Err(failure),
    };
    if lost > 0 {
        terminal::print_status(&format!("{lost} pipeline messages were lost, because this terminal is too slow"));
    }
    if json {
        let mut answer = decoder.json_of(&reply);
        hide_masks(&mut answer);
        terminal::print_line(
            &json!({"ok": reply.ok, "text": reply.text, "reply": answer, "stages": stages}).to_string(),
        );
    } else {
        terminal::print_line(&reply.text);
    }
    if reply.ok { Ok(()) } else { Err(Failure::Work("not everything was done".to_owned())) }
}

fn as_json(decoder: &Decoder, seen: &WatchedMessage, at: Duration) -> Value {
    let mut message = decoder.json(&seen.message, &seen.payload);
    hide_masks(&mut message);
    json!({
        "t_seconds": at.as_secs_f64(), "conversation": seen.context.conversation, "step": seen.context.step,
        "stage": stage(&seen.key), "key": seen.key, "type": seen.message, "message": message,
    })
}

/// One line for a stage.
fn shown(seen: &WatchedMessage, at: Duration) -> String {
    let at = format_time(at.as_secs_f64() * 1000.0);
    let colored = may_color(&std::io::stderr());
    let name = paint(Color::Cyan, &format!("{:<12}", stage(&seen.key)), colored);
    let gist = gist(&seen.message, &seen.payload);
    // The full reply follows at the end.
    format!("{at:>8}  {name} {}", gist.lines().next().unwrap_or_default())
}

/// The content of a pipeline message as text.
fn gist(full_name: &str, payload: &[u8]) -> String {
    fn read<M: Message + Name + Default>(full_name: &str, payload: &[u8]) -> Option<M> {
        if full_name == M::full_name() { M::decode(payload).ok() } else { None }
    }
    let steps = |clauses: &[sg_proto::language::Clause]| {
        let names: Vec<_> = clauses
            .iter()
            .map(|c| format!("{} ({})", c.act().as_str_name().trim_start_matches("ACT_").to_lowercase(), c.words))
            .collect();
        names.join(", ")
    };
    if let Some(m) = read::<Utterance>(full_name, payload) {
        m.text
    } else if let Some(m) = read::<Perceive>(full_name, payload) {
        let capture = m.capture.unwrap_or_default();
        format!("{}, {}×{}", m.moment, capture.width, capture.height)
    } else if let Some(m) = read::<Observation>(full_name, payload) {
        let (scene, frame) = (m.scene.unwrap_or_default(), m.frame);
        let picture = frame.map_or_else(String::new, |f| format!(", picture after {}", format_time(f.render_ms)));
        let missing = if m.missing.is_empty() { String::new() } else { format!(", missing: {}", m.missing) };
        format!("{}: revision {}, {} units{picture}{missing}", m.moment, scene.revision, scene.units.len())
    } else if let Some(m) = read::<Intent>(full_name, payload) {
        let lost = if !m.answer.is_empty() {
            format!("; answer: {}", m.answer)
        } else if m.not_understood.is_empty() {
            String::new()
        } else {
            format!("; not understood: {}", m.not_understood.join(", "))
        };
        format!("{}{lost}", steps(&m.clauses)).trim_start_matches("; ").to_owned()
    } else if let Some(m) = read::<Plan>(full_name, payload) {
        steps(&m.clauses)
    } else if let Some(m) = read::<ActionResult>(full_name, payload) {
        format!("{}{}", if m.ok { "" } else { "not done: " }, m.text)
    } else if let Some(m) = read::<Reply>(full_name, payload) {
        m.text
    } else if let Some(m) = read::<sg_proto::scene::Event>(full_name, payload) {
        format!("revision {}: {}", m.revision, m.summary)
    } else if let Some(m) = read::<sg_proto::render::Frame>(full_name, payload) {
        format!("{}×{} of revision {} after {}", m.width, m.height, m.revision, format_time(m.render_ms))
    } else {
        full_name.to_owned()
    }
}
