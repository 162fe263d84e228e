//! The scripted session, in rounds, and its results.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_proto::keys;
use sg_proto::scene::command::Action;
use sg_proto::scene::{ChangesRequest, DeleteUnit, Reset, Select, State, Target};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use supergaussian::script::Step;
use tokio::sync::watch;

use crate::playback::{AcknowledgedChange, Counts, Player, Settings};
use crate::terminal::Failure;

/// Name of the conversation, equal with and without faults. It determines the ids of all commands.
const CONVERSATION: &str = "chaos";
/// Longest time of one step, faults included.
const STEP_TIME: Duration = Duration::from_secs(60);
/// Longest time for the scene's list of changes.
const ANSWER: Duration = Duration::from_secs(60);

/// One step of the session.
#[derive(Debug, Clone)]
pub(super) enum SessionStep {
    /// A step of the script.
    Step(Step),
    /// A command between two rounds.
    Command(Action),
}

impl SessionStep {
    /// Whether it is one scene command whose refusal the sender sees.
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

/// One round of the script, and the commands between rounds: delete units, clear the selection, reset.
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
    // The plan injects all faults.
    let round = steps.into_iter().filter(|s| *s != Step::Chaos).map(SessionStep::Step).collect();
    (round, between.into_iter().map(SessionStep::Command).collect())
}

/// Synchronizes the player with the faults.
#[derive(Debug)]
pub(super) struct FaultGate {
    /// Step of each fault.
    pub(super) steps: Vec<usize>,
    /// Number of begun steps.
    pub(super) begun: watch::Sender<usize>,
    /// Number of answered steps.
    pub(super) answered: watch::Sender<usize>,
    /// Number of injected faults. The step of a fault waits for its injection.
    pub(super) set_up: watch::Receiver<usize>,
}

impl FaultGate {
    /// Waits for the fault of this step, which is injected after the recovery from the one before.
    async fn enter(&mut self, step: usize) -> Result<(), Failure> {
        self.begun.send_replace(step + 1);
        let Some(fault) = self.steps.iter().position(|s| *s == step) else { return Ok(()) };
        let set_up = self.set_up.wait_for(|n| *n > fault).await;
        set_up.map(drop).map_err(|_| Failure::Work("the faults ended before the session".to_owned()))
    }
}

/// The result of a session.
#[derive(Debug)]
pub(super) struct SessionResult {
    /// The scene at the end, with masks.
    pub(super) state: State,
    /// Revision and command of every accepted change.
    pub(super) changes: Vec<(u64, String)>,
    pub(super) acknowledged: Vec<AcknowledgedChange>,
    /// Content hashes of the pictures, in order.
    pub(super) hashes: Vec<String>,
    /// PNG files of the pictures. The arrays are beside them.
    pub(super) pictures: Vec<PathBuf>,
    /// Utterances that the agents could not carry out.
    pub(super) failed_utterances: Vec<String>,
    /// Duration of each step.
    pub(super) times: Vec<Duration>,
}

/// Settings of a session.
pub(super) struct SessionSettings<'a> {
    pub(super) bus: &'a Bus,
    pub(super) steps: &'a [SessionStep],
    /// Number of steps after which the changes are requested.
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
            // The transcript shows the context of the failure.
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

/// Requests the changes since the last request.
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
