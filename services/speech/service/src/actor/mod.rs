//! The speech process: it turns what is said into commands, and speaks the replies.
//!
//! | thread or task | work |
//! | --- | --- |
//! | microphone | reads sound and finds utterances |
//! | recognizer | turns an utterance into text |
//! | loudspeaker | turns a reply into sound |
//! | actor `speech` | holds the conversation, asks the agents, publishes the state |
//!
//! It owns nothing that must be kept: a restart loses at most the utterance that is being heard.

mod dialogue;
mod follow;
mod hearing;
mod speaking;

use std::fmt;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::language::Reply as AgentReply;
use sg_proto::scene::State as SceneState;
use sg_proto::speech;
use sg_runtime::actor::{Actor, ActorError, Mailbox, Reply};
use sg_runtime::bus::{Bus, RetainedValue};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};
use sg_speech::conversation::{Conversation, Deadlines, Event, State};
use sg_speech::speaker::Spoken;
use tokio::task::JoinHandle;

use crate::backends::{self, Chosen};
use crate::devices;
use crate::loudspeaker::{Loudspeaker, SpeechId};
use crate::microphone::{Microphone, Sound};
use crate::params::{Opening, Params};
use crate::recognition_thread::{RecognitionThread, Report};

use self::dialogue::Dialogue;
use self::hearing::Hearing;
use self::speaking::Speaking;

/// Length of the mailbox: sound arrives faster than a slow bus answers.
const QUEUE: usize = 64;
/// Length of the queues of requests.
const REQUESTS: usize = 8;

/// Messages to the actor.
enum Message {
    /// This process holds its role: the microphone opens.
    Open,
    Sound(Sound),
    Recognizer(Report),
    /// The loudspeaker is done with a text.
    Spoken {
        id: SpeechId,
        outcome: Result<Spoken, String>,
    },
    /// The agents have answered.
    Answered {
        turn: u64,
        outcome: Result<AgentReply, Fault>,
    },
    /// The units of the scene have changed.
    Scene(Box<SceneState>),
    /// The deadline of the conversation.
    Tick,
    Control {
        request: speech::ControlRequest,
        reply: Reply<speech::ControlReply>,
    },
    Speak {
        request: speech::SpeakRequest,
        reply: Reply<speech::SpeakReply>,
    },
}

/// Opens what the parameters name, and starts to serve.
///
/// # Errors
/// [`StartError`] for invalid parameters, a device or backend that is named and not there, or a failure of the bus.
pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::SPEECH {
        return Err(StartError::Input(format!("role `{}`: this executable serves `{}`", host.role(), role::SPEECH)));
    }
    let params: Params = host.params()?;
    let input = |problem: String| StartError::Input(format!("parameters of `{}`: {problem}", role::SPEECH));
    params.endpoints().map_err(input)?;
    let chosen = params.backends();
    let Chosen { backend: recognizer, notice: deaf } =
        tokio::task::block_in_place(|| backends::recognizer(&chosen)).map_err(input)?;
    let Chosen { backend: synthesizer, notice: mute } = backends::synthesizer(&chosen).map_err(input)?;
    if params.has_output() {
        // A wrong path is known now and not at the first reply.
        devices::output(&params.output, params.output_rate).map_err(|e| input(e.to_string()))?;
    }
    let mut state = speech::State {
        trigger: match params.trigger {
            Opening::Voice => speech::Trigger::Voice,
            Opening::Held => speech::Trigger::Held,
        }
        .into(),
        muted: params.muted,
        recognizer: recognizer.as_ref().map_or("", |r| r.name()).to_owned(),
        synthesizer: synthesizer.as_ref().map_or("", |s| s.name()).to_owned(),
        notice: [deaf, mute.filter(|_| params.has_output())].into_iter().flatten().collect::<Vec<_>>().join("; "),
        ..speech::State::default()
    };
    if params.has_input() {
        state.input = devices::description(&params.input);
    } else {
        state.notice = "no microphone: name a WAV file or a named pipe by the parameter `input`".to_owned();
    }
    if params.has_output() {
        state.output = devices::description(&params.output);
    }
    let mut conversation = Conversation::new(Deadlines::default());
    if params.muted {
        conversation.step(Event::Mute, Duration::ZERO);
    }
    state.phase = phase(conversation.state()).into();
    let published = host.bus().retain(&keys::SPEECH_STATE, state.clone()).await?;
    // The threads start before the actor has its mailbox. They have nothing to say until a message of the actor.
    let own = Arc::new(OnceLock::new());
    let tell = Tell(Arc::clone(&own));
    let recognizer = recognizer.map(|recognizer| {
        let tell = tell.clone();
        RecognitionThread::start(recognizer, move |report| tell.send(Message::Recognizer(report)))
    });
    let recognizer = recognizer.transpose().map_err(StartError::Failed)?;
    let loudspeaker = synthesizer.filter(|_| params.has_output()).map(|synthesizer| {
        let tell = tell.clone();
        let output = (params.output.clone(), params.output_rate);
        Loudspeaker::start(synthesizer, output, move |id, outcome| tell.send(Message::Spoken { id, outcome }))
    });
    let loudspeaker = loudspeaker.transpose().map_err(StartError::Failed)?;
    let agent = Speech {
        host: host.clone(),
        bus: host.bus().clone(),
        params,
        begun: Instant::now(),
        conversation,
        context: Context::root(),
        hearing: Hearing::new(recognizer),
        speaking: Speaking::new(loudspeaker),
        dialogue: Dialogue::default(),
        state,
        published,
        microphone: None,
        tell,
        timer: None,
    };
    let (mailbox, _) = host.spawn(agent, QUEUE);
    // Nobody else sets it.
    let _ = own.set(mailbox.clone());
    tokio::spawn(follow::scene(host.bus().clone(), mailbox.clone()));
    host.route(&keys::SPEECH_CONTROL, REQUESTS, &mailbox, |request, _, reply| Message::Control { request, reply })
        .await?;
    host.route(&keys::SPEECH_SPEAK, REQUESTS, &mailbox, |request, _, reply| Message::Speak { request, reply }).await?;
    if host.is_standby() {
        // Two processes must not hear the same utterance.
        host.before_promotion(move || async move {
            mailbox.tell(Message::Open).map_err(|fault| StartError::Failed(fault.message))
        });
    } else {
        mailbox.tell(Message::Open).map_err(|fault| StartError::Failed(fault.message))?;
    }
    Ok(())
}

fn phase(state: State) -> speech::Phase {
    match state {
        State::Idle => speech::Phase::Idle,
        State::Listening => speech::Phase::Listening,
        State::Thinking => speech::Phase::Thinking,
        State::Speaking => speech::Phase::Speaking,
        State::Muted => speech::Phase::Muted,
    }
}

/// The actor's own mailbox, for threads and tasks that report to it.
#[derive(Clone)]
struct Tell(Arc<OnceLock<Mailbox<Message>>>);

impl Tell {
    /// Puts a message into the mailbox. A full one drops it, after a line in the log.
    fn send(&self, message: Message) {
        if let Some(mailbox) = self.0.get()
            && let Err(fault) = mailbox.tell(message)
        {
            tracing::warn!(%fault, "a message of the microphone, recognizer or loudspeaker was dropped");
        }
    }
}

/// The actor of the conversation.
struct Speech {
    host: Host,
    bus: Bus,
    params: Params,
    /// Start of the conversation's clock.
    begun: Instant,
    conversation: Conversation,
    /// The conversation of the agents that all utterances belong to.
    context: Context,
    hearing: Hearing,
    speaking: Speaking,
    dialogue: Dialogue,
    state: speech::State,
    published: RetainedValue<speech::State>,
    microphone: Option<Microphone>,
    tell: Tell,
    timer: Option<JoinHandle<()>>,
}

/// Observable state of the actor.
#[derive(Clone)]
struct Observed {
    state: State,
    utterances: u64,
}

impl fmt::Display for Observed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}, {} utterances", self.state, self.utterances)
    }
}

impl Actor for Speech {
    type Message = Message;
    type State = Observed;

    fn name(&self) -> &'static str {
        "speech"
    }

    fn state(&self) -> Observed {
        Observed { state: self.conversation.state(), utterances: self.hearing.utterances() }
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        let before = self.state.clone();
        match message {
            Message::Open => self.open(),
            Message::Sound(sound) => self.hear(sound).await,
            Message::Recognizer(report) => self.recognized(report).await,
            Message::Spoken { id, outcome } => self.spoken(id, outcome).await,
            Message::Answered { turn, outcome } => self.answered(turn, outcome).await,
            Message::Scene(scene) => self.hearing.expect(*scene, &mut self.state),
            Message::Tick => self.step(Event::Tick).await,
            Message::Control { request, reply } => {
                let outcome = self.control(request.control()).await;
                self.show();
                let _ = reply.send(outcome.map(|()| speech::ControlReply { state: Some(self.state.clone()) }));
            }
            Message::Speak { request, reply } => self.speak_on_request(request.text, reply),
        }
        self.settle().await;
        self.show();
        if self.state != before {
            let context = Context::root();
            let set = self.published.set(self.state.clone(), &context).await;
            let published = self.bus.publish(&keys::SPEECH_CHANGE, &self.state, &context).await;
            if let Err(fault) = set.and(published) {
                tracing::warn!(%fault, "the state could not be published");
            }
        }
        Ok(())
    }

    async fn stop(&mut self) {
        self.speaking.stop_all();
        self.hearing.cancel();
    }
}
