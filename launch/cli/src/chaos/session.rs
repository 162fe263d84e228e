//! The scripted session: the script round by round, and what was heard of the scene while it was played.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::script::Step;
use sg_proto::keys;
use sg_proto::scene::command::Action;
use sg_proto::scene::{ChangesRequest, DeleteUnit, Reset, Select, State, Target};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use tokio::sync::watch;

use crate::playback::{AcknowledgedChange, Counts, Player, Settings};
use crate::terminal::Failure;

/// Name of the conversation, the same with and without faults: the ids of all commands follow from it.
const CONVERSATION: &str = "chaos";
/// Longest time of one step, faults included.
const STEP_TIME: Duration = Duration::from_secs(60);
/// How long the scene may take to tell what changed.
const ANSWER: Duration = Duration::from_secs(60);

/// One step of the session.
#[derive(Debug, Clone)]
pub(super) enum SessionStep {
    /// Of the script.
    Step(Step),
    /// Between two rounds of the script.
    Command(Action),
}

impl SessionStep {
    /// Whether it is one command to the scene, whose sender sees it refused.
    pub(super) fn is_command(&self) -> bool {
        matches!(self, Self::Command(_) | Self::Step(Step::Save(_) | Step::View(_)))
    }

    pub(super) fn name(&self) -> String {
        match self {
            Self::Step(Step::Strokes { file, .. }) => {
                format!("brush {}", file.file_name().unwrap_or_default().to_string_lossy())
            }
            Self::Step(Step::Say(text)) => format!("say \"{text}\""),
            Self::Step(Step::Save(name)) => format!("save {name}"),
            Self::Step(Step::View(_)) => "look".to_owned(),
            Self::Step(Step::Capture { name, .. }) => format!("capture {name}"),
            Self::Step(Step::Chaos) => "chaos".to_owned(),
            Self::Command(Action::DeleteUnit(unit)) => format!("delete {}", unit.name),
            Self::Command(Action::Select(_)) => "select nothing".to_owned(),
            Self::Command(_) => "reset".to_owned(),
        }
    }
}

/// The script as one round, and what makes room for the next: no unit, no selection, the first look.
pub(super) fn round(steps: Vec<Step>) -> (Vec<SessionStep>, Vec<SessionStep>) {
    let mut between: Vec<_> = steps
        .iter()
        .filter_map(|step| match step {
            Step::Save(name) => Some(Action::DeleteUnit(DeleteUnit { name: name.clone() })),
            _ => None,
        })
        .collect();
    between.push(Action::Select(Select { target: Some(Target::default()), ..Select::default() }));
    between.push(Action::Reset(Reset {}));
    // The faults are ours.
    let round = steps.into_iter().filter(|s| *s != Step::Chaos).map(SessionStep::Step).collect();
    (round, between.into_iter().map(SessionStep::Command).collect())
}

/// Where the player waits for the faults, and they for it.
#[derive(Debug)]
pub(super) struct FaultGate {
    /// The step that each fault strikes.
    pub(super) steps: Vec<usize>,
    /// Steps that were begun.
    pub(super) begun: watch::Sender<usize>,
    /// Steps that were answered.
    pub(super) answered: watch::Sender<usize>,
    /// Faults that are set up, so that the step they strike may go on.
    pub(super) set_up: watch::Receiver<usize>,
}

impl FaultGate {
    /// Waits until the fault that strikes this step is set up, which it is when the stack has recovered from the one before.
    async fn enter(&mut self, step: usize) -> Result<(), Failure> {
        self.begun.send_replace(step + 1);
        let Some(fault) = self.steps.iter().position(|s| *s == step) else { return Ok(()) };
        let set_up = self.set_up.wait_for(|n| *n > fault).await;
        set_up.map(drop).map_err(|_| Failure::Work("the faults ended before the session".to_owned()))
    }
}

/// A session that was played.
#[derive(Debug)]
pub(super) struct SessionResult {
    /// The scene at the end, with masks.
    pub(super) state: State,
    /// Revision and command of every accepted change.
    pub(super) changes: Vec<(u64, String)>,
    pub(super) acknowledged: Vec<AcknowledgedChange>,
    /// Content hashes of the pictures, in order.
    pub(super) hashes: Vec<String>,
    /// Their files, as PNG; the arrays stand beside them.
    pub(super) pictures: Vec<PathBuf>,
    /// What was said but not done.
    pub(super) failed_utterances: Vec<String>,
    /// How long each step took.
    pub(super) times: Vec<Duration>,
}

/// How a session is played.
pub(super) struct SessionSettings<'a> {
    pub(super) bus: &'a Bus,
    pub(super) steps: &'a [SessionStep],
    /// Steps after which the changes are asked for.
    pub(super) round: usize,
    pub(super) out: PathBuf,
    pub(super) size: u32,
    pub(super) counts: Arc<Counts>,
}

/// Plays all steps in order.
pub(super) async fn play(playing: SessionSettings<'_>, mut gate: Option<FaultGate>) -> Result<SessionResult, Failure> {
    let SessionSettings { bus, steps, round, out, size, counts } = playing;
    let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", out.display()));
    std::fs::create_dir_all(&out).map_err(fail)?;
    let settings = Settings {
        out: out.clone(),
        conversation: CONVERSATION.to_owned(),
        step_time: STEP_TIME,
        size,
        chaos: None,
        counts,
    };
    let mut player = Player::new(bus.clone(), settings).await?;
    let mut changes = Vec::new();
    let mut times = Vec::with_capacity(steps.len());
    for (index, act) in steps.iter().enumerate() {
        if let Some(gate) = &mut gate {
            gate.enter(index).await?;
        }
        let began = Instant::now();
        let played = match act {
            SessionStep::Step(step) => player.play_step(step).await,
            SessionStep::Command(action) => player.play_command(action.clone()).await,
        };
        times.push(began.elapsed());
        if let Err(failure) = played {
            // It says what was going on when a step failed.
            player.write_transcript()?;
            let text = format!("step {}, {}: {}", index + 1, act.name(), failure.text());
            return Err(Failure::Work(text));
        }
        if let Some(gate) = &gate {
            gate.answered.send_replace(index + 1);
        }
        if (index + 1) % round == 0 {
            catch_up(bus, &mut changes).await?;
        }
    }
    catch_up(bus, &mut changes).await?;
    let request = ChangesRequest { from: 0, snapshot: true };
    let reply = bus.ask(&keys::SCENE_CHANGES, &request, &Context::root().deadline_in(ANSWER)).await?;
    let state = reply.snapshot.ok_or_else(|| Failure::Work("the scene gave no snapshot".to_owned()))?;
    player.write_transcript()?;
    let Player { acknowledged, hashes, pictures, failed_utterances, .. } = player;
    Ok(SessionResult { state, changes, acknowledged, hashes, pictures, failed_utterances, times })
}

/// Asks the scene for what was accepted since it was asked last.
async fn catch_up(bus: &Bus, changes: &mut Vec<(u64, String)>) -> Result<(), Failure> {
    let from = changes.last().map_or(0, |(revision, _)| *revision);
    let request = ChangesRequest { from, snapshot: false };
    let reply = bus.ask(&keys::SCENE_CHANGES, &request, &Context::root().deadline_in(ANSWER)).await?;
    if reply.snapshot.is_some() {
        return Err(Failure::Work(format!("the changes after revision {from} are too many for one answer")));
    }
    changes.extend(reply.events.into_iter().map(|event| (event.revision, event.command_id)));
    Ok(())
}
