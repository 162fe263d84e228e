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
mod playback;
mod recognitions;

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
use tokio::runtime::Handle;
use tokio::task::JoinHandle;

use crate::backends;
use crate::devices::{self, Place};
use crate::loudspeaker::{Loudspeaker, SpeechId};
use crate::microphone::{Microphone, Sound};
use crate::params::{Opening, Params};
use crate::recognition_thread::{RecognitionThread, Report};

use self::dialogue::Dialogue;
use self::playback::Playback;
use self::recognitions::Recognitions;

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
    let runtime = Handle::current();
    // Models are read from files.
    let (recognizer, synthesizer) = tokio::task::block_in_place(|| {
        Ok((backends::recognizer(&chosen, &runtime)?, backends::synthesizer(&chosen, &runtime)?))
    })
    .map_err(input)?;
    let (microphone, output) = (Place::of(&params.input), Place::of(&params.output));
    if let Some(output) = &output {
        // A wrong path is known now and not at the first reply.
        devices::output(output, params.output_rate).map_err(|e| input(e.to_string()))?;
    }
    let mut state = speech::State {
        trigger: match params.trigger {
            Opening::Voice => speech::Trigger::Voice,
            Opening::Held => speech::Trigger::Held,
        }
        .into(),
        muted: params.muted,
        recognizer: recognizer.shown(|r| r.name()),
        synthesizer: synthesizer.shown(|s| s.name()),
        remote: recognizer.leaves_this_machine(),
        notice: [recognizer.notice, synthesizer.notice].into_iter().flatten().collect::<Vec<_>>().join("; "),
        ..speech::State::default()
    };
    match &microphone {
        Some(place) => state.input = place.to_string(),
        None => {
            let how = "name a device, a named pipe or a WAV file by the parameter `input`";
            state.notice = format!("no microphone: {how}");
        }
    }
    state.output = output.as_ref().map(Place::to_string).unwrap_or_default();
    let mut conversation = Conversation::new(Deadlines::default());
    if params.muted {
        conversation.step(Event::Mute, Duration::ZERO);
    }
    state.phase = phase(conversation.state()).into();
    let published = host.bus().retain(&keys::SPEECH_STATE, state.clone()).await?;
    // The threads start before the actor has its mailbox. They have nothing to say until a message of the actor.
    let own = Arc::new(OnceLock::new());
    let own_mailbox = OwnMailbox(Arc::clone(&own));
    let recognizer = recognizer.backend.map(|recognizer| {
        let own_mailbox = own_mailbox.clone();
        RecognitionThread::start(recognizer, move |report| own_mailbox.send(Message::Recognizer(report)))
    });
    let recognizer = recognizer.transpose().map_err(StartError::Failed)?;
    let loudspeaker = synthesizer.backend.zip(output).map(|(synthesizer, output)| {
        let own_mailbox = own_mailbox.clone();
        Loudspeaker::start(synthesizer, (output, params.output_rate), move |id, outcome| {
            own_mailbox.send(Message::Spoken { id, outcome });
        })
    });
    let loudspeaker = loudspeaker.transpose().map_err(StartError::Failed)?;
    let agent = Speech {
        host: host.clone(),
        bus: host.bus().clone(),
        params,
        input: microphone,
        begun: Instant::now(),
        conversation,
        context: Context::root(),
        recognitions: Recognitions::new(recognizer),
        playback: Playback::new(loudspeaker),
        dialogue: Dialogue::default(),
        state,
        published,
        microphone: None,
        mailbox: own_mailbox,
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
struct OwnMailbox(Arc<OnceLock<Mailbox<Message>>>);

impl OwnMailbox {
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
    /// Where sound comes from.
    input: Option<Place>,
    /// Start of the conversation's clock.
    begun: Instant,
    conversation: Conversation,
    /// The conversation of the agents that all utterances belong to.
    context: Context,
    recognitions: Recognitions,
    playback: Playback,
    dialogue: Dialogue,
    state: speech::State,
    published: RetainedValue<speech::State>,
    microphone: Option<Microphone>,
    mailbox: OwnMailbox,
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
        Observed { state: self.conversation.state(), utterances: self.recognitions.utterances() }
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        let before = self.state.clone();
        match message {
            Message::Open => self.open(),
            Message::Sound(sound) => self.hear(sound).await,
            Message::Recognizer(report) => self.recognized(report).await,
            Message::Spoken { id, outcome } => self.spoken(id, outcome).await,
            Message::Answered { turn, outcome } => self.answered(turn, outcome).await,
            Message::Scene(scene) => self.recognitions.expect(*scene, &mut self.state),
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
        self.playback.stop_all();
        self.recognitions.cancel();
    }
}
