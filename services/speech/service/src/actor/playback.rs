//! From text to sound: replies of the agents, short notes, and texts on request.

use std::sync::atomic::Ordering;

use sg_proto::speech;
use sg_runtime::actor::Reply;
use sg_runtime::fault::Fault;
use sg_speech::child_process::Limits;
use sg_speech::conversation::{Event, Turn};
use sg_speech::endpoint::Control;
use sg_speech::speaker::Spoken;
use sg_speech::synthesis::MAX_TEXT;

use super::Speech;
use crate::loudspeaker::{Loudspeaker, SpeechId};

/// Why a text is spoken.
enum Purpose {
    /// The reply of a turn.
    Turn(Turn),
    /// Somebody has sent it.
    Request(Reply<speech::SpeakReply>),
    /// A note beside the conversation.
    Note,
}

struct Sounding {
    id: SpeechId,
    limits: Limits,
    purpose: Purpose,
}

/// Texts that are spoken or wait for it.
pub(super) struct Playback {
    loudspeaker: Option<Loudspeaker>,
    sounding: Vec<Sounding>,
}

impl Playback {
    pub(super) fn new(loudspeaker: Option<Loudspeaker>) -> Self {
        Self { loudspeaker, sounding: Vec::new() }
    }

    /// Whether something sounds.
    pub(super) fn is_sounding(&self) -> bool {
        !self.sounding.is_empty()
    }

    /// Stops everything that is spoken.
    pub(super) fn stop_all(&self) {
        self.sounding.iter().for_each(|sounding| sounding.limits.cancel.store(true, Ordering::Relaxed));
    }

    fn begin(&mut self, text: String, purpose: Purpose) -> Result<(), (String, Purpose)> {
        let Some(loudspeaker) = &mut self.loudspeaker else {
            let nothing = "nothing speaks: name an output by the parameter `output`, and install espeak-ng or flite";
            return Err((nothing.to_owned(), purpose));
        };
        match loudspeaker.speak(text) {
            Ok((id, limits)) => {
                self.sounding.push(Sounding { id, limits, purpose });
                Ok(())
            }
            Err(problem) => Err((problem, purpose)),
        }
    }
}

impl Speech {
    /// Speaks the reply of a turn. Without a loudspeaker it ends at once.
    pub(super) fn speak_reply(&mut self, turn: Turn, text: String) {
        match self.playback.begin(text, Purpose::Turn(turn)) {
            Ok(()) => self.control_microphone(Control::ReplyStarted),
            Err(_) => self.step_later(Event::ReplyEnded { turn }),
        }
    }

    /// Speaks a note beside the conversation, if anything speaks.
    pub(super) fn speak_note(&mut self, text: &str) {
        if self.playback.begin(text.to_owned(), Purpose::Note).is_ok() {
            self.control_microphone(Control::ReplyStarted);
        }
    }

    /// Speaks a text that somebody has sent.
    pub(super) fn speak_on_request(&mut self, text: String, reply: Reply<speech::SpeakReply>) {
        if text.len() > MAX_TEXT || text.trim().is_empty() {
            let problem = format!("the text has {} bytes; take 1 to {MAX_TEXT}", text.len());
            let _ = reply.send(Err(Fault::invalid(problem)));
            return;
        }
        match self.playback.begin(text, Purpose::Request(reply)) {
            Ok(()) => self.control_microphone(Control::ReplyStarted),
            Err((problem, Purpose::Request(reply))) => {
                let _ = reply.send(Err(Fault::precondition(problem)));
            }
            Err(_) => {}
        }
    }

    /// Stops the reply of a turn.
    pub(super) fn stop_reply(&mut self, turn: Turn) {
        let is_it = |sounding: &&Sounding| matches!(sounding.purpose, Purpose::Turn(of) if of == turn);
        if let Some(sounding) = self.playback.sounding.iter().find(is_it) {
            sounding.limits.cancel.store(true, Ordering::Relaxed);
        }
    }

    /// Takes the end of a text.
    pub(super) async fn spoken(&mut self, id: SpeechId, outcome: Result<Spoken, String>) {
        let Some(at) = self.playback.sounding.iter().position(|sounding| sounding.id == id) else { return };
        let Sounding { purpose, .. } = self.playback.sounding.remove(at);
        if !self.playback.is_sounding() {
            self.control_microphone(Control::ReplyEnded);
        }
        if let Err(problem) = &outcome {
            self.state.notice = format!("a text was not spoken: {problem}");
            tracing::warn!(problem, "a text was not spoken");
        }
        match purpose {
            Purpose::Turn(turn) => self.step(Event::ReplyEnded { turn }).await,
            Purpose::Request(reply) => {
                let outcome = outcome.map_err(Fault::internal).map(|spoken| speech::SpeakReply {
                    sentences: u32::try_from(spoken.sentences).unwrap_or(u32::MAX),
                    stopped: spoken.stopped,
                    first_sound_ms: spoken.first_sound.map(|time| time.as_secs_f64() * 1e3),
                });
                let _ = reply.send(outcome);
            }
            Purpose::Note => {}
        }
    }
}
