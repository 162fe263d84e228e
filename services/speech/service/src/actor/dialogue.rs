//! The conversation with the agents: commands, questions before what takes something away, replies.

use std::time::{Duration, Instant};

use sg_proto::keys;
use sg_proto::language::{Reply as AgentReply, Source, Utterance};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::speech;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_speech::conversation::{Action, Event, Turn};
use sg_speech::endpoint::Control;

use super::{Message, Speech, phase};
use crate::commands;
use crate::params::Opening;

/// How long the agents may take.
const AGENT_TIME: Duration = Duration::from_secs(55);
/// How long a question waits for its yes or no.
const QUESTION_TIME: Duration = Duration::from_secs(30);

/// A command that waits for a yes or no.
struct Question {
    command: String,
    text: String,
    until: Instant,
}

impl Question {
    fn is_open(&self) -> bool {
        Instant::now() < self.until
    }
}

/// Questions, and events that follow from actions.
#[derive(Default)]
pub(super) struct Dialogue {
    question: Option<Question>,
    /// Events of the conversation that an action has caused.
    later: Vec<Event>,
}

impl Dialogue {
    /// The question that still waits for its yes or no.
    fn question(&self) -> Option<&Question> {
        self.question.as_ref().filter(|question| question.is_open())
    }

    /// Whether a yes or no is expected.
    pub(super) fn has_question(&self) -> bool {
        self.question().is_some()
    }
}

impl Speech {
    /// An event that follows from the present one.
    pub(super) fn step_later(&mut self, event: Event) {
        self.dialogue.later.push(event);
    }

    /// Takes an event of the conversation, and does what follows from it.
    pub(super) async fn step(&mut self, event: Event) {
        self.dialogue.later.push(event);
        self.settle().await;
    }

    /// Takes all events that wait.
    pub(super) async fn settle(&mut self) {
        while !self.dialogue.later.is_empty() {
            let event = self.dialogue.later.remove(0);
            for action in self.conversation.step(event, self.begun.elapsed()) {
                match action {
                    Action::Recognize { turn } => Box::pin(self.recognize(turn)).await,
                    Action::CancelRecognition { turn } => self.cancel_recognition(turn),
                    Action::Submit { turn, text } => self.submit(turn, text),
                    Action::Speak { turn, text } => self.speak_reply(turn, text),
                    Action::StopSpeaking { turn } => self.stop_reply(turn),
                    Action::CancelSpeech => self.control_microphone(Control::Cancel),
                    Action::SayNotUnderstood => {
                        // A held button asks for an answer. An open microphone hears much that is no command.
                        if self.params.trigger == Opening::Held {
                            self.speak_note("I did not understand that.");
                        }
                    }
                    Action::SayNoAnswer => {
                        self.state.notice = "no answer came in time; say it again".to_owned();
                        self.speak_note("No answer came in time. Please say it again.");
                    }
                    // The state is shown after each message.
                    Action::Show(_) => {}
                }
            }
        }
        self.set_timer();
    }

    /// Wakes the actor at the deadline of the conversation.
    fn set_timer(&mut self) {
        if let Some(timer) = self.timer.take() {
            timer.abort();
        }
        let Some(deadline) = self.conversation.deadline() else { return };
        let (mailbox, wait) = (self.mailbox.clone(), deadline.saturating_sub(self.begun.elapsed()));
        self.timer = Some(tokio::spawn(async move {
            tokio::time::sleep(wait).await;
            mailbox.send(Message::Tick);
        }));
    }

    /// Sends a command to the agents, or asks first.
    fn submit(&mut self, turn: Turn, text: String) {
        if let Some(question) = self.dialogue.question.take().filter(Question::is_open) {
            match commands::answer(&text) {
                Some(true) => return self.utter(turn, question.command),
                Some(false) => {
                    let text = "Nothing was changed.".to_owned();
                    return self.step_later(Event::Reply { turn, text });
                }
                // Another command takes the place of the question.
                None => {}
            }
        }
        if let Some(asked) = commands::question(&text, self.recognitions.scene()) {
            let until = Instant::now() + QUESTION_TIME;
            self.dialogue.question = Some(Question { command: text, text: asked.clone(), until });
            return self.step_later(Event::Reply { turn, text: asked });
        }
        self.utter(turn, text);
    }

    fn utter(&mut self, turn: Turn, text: String) {
        if text.len() > MAX_UTTERANCE_BYTES {
            let text = "That was too long. Please say it in parts.".to_owned();
            return self.step_later(Event::Reply { turn, text });
        }
        // All utterances of a microphone are one conversation: "it" means what was spoken of before.
        let context = Context::root().deadline_in(AGENT_TIME).at_step(self.context.id.clone(), 1);
        let (bus, mailbox) = (self.bus.clone(), self.mailbox.clone());
        tokio::spawn(async move {
            let utterance = Utterance { text, source: Source::Speech.into(), ..Utterance::default() };
            let outcome = bus.ask(&keys::UTTER, &utterance, &context).await;
            mailbox.send(Message::Answered { turn, outcome });
        });
    }

    /// Takes the answer of the agents.
    pub(super) async fn answered(&mut self, turn: Turn, outcome: Result<AgentReply, Fault>) {
        let text = match outcome {
            Ok(reply) => reply.text,
            Err(fault) => fault.message,
        };
        self.step(Event::Reply { turn, text }).await;
    }

    /// Changes the microphone or the reply.
    pub(super) async fn control(&mut self, control: speech::Control) -> Result<(), Fault> {
        match control {
            speech::Control::Press | speech::Control::Release if self.params.trigger != Opening::Held => {
                return Err(Fault::precondition(
                    "the microphone opens by voice; set the parameter trigger = \"held\" for push-to-talk",
                ));
            }
            speech::Control::Press => {
                self.state.held = true;
                self.playback.stop_all();
                self.control_microphone(Control::Press);
            }
            speech::Control::Release => {
                self.state.held = false;
                self.control_microphone(Control::Release);
            }
            speech::Control::Mute => {
                self.control_microphone(Control::Mute);
                self.step(Event::Mute).await;
            }
            speech::Control::Unmute => {
                self.control_microphone(Control::Unmute);
                self.step(Event::Unmute).await;
            }
            speech::Control::StopSpeaking => self.playback.stop_all(),
            speech::Control::Unspecified => return Err(Fault::invalid("no control is given")),
        }
        Ok(())
    }

    /// Takes over into the state what panels show.
    pub(super) fn show(&mut self) {
        let own = phase(self.conversation.state());
        let is_quiet = matches!(own, speech::Phase::Idle | speech::Phase::Muted);
        let phase = if is_quiet && self.playback.is_sounding() { speech::Phase::Speaking } else { own };
        self.state.phase = phase.into();
        self.state.muted = self.conversation.is_muted();
        self.state.question = self.dialogue.question().map(|question| question.text.clone()).unwrap_or_default();
    }
}
