//! Carries out a person's requests at a display, one after another. Messages to the agents and questions to the labeling service
//! run asynchronously.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use sg_input::number_format::grouped;
use sg_input::short_path;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::language::{Source, Utterance};
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{OpenReply, OpenRequest, SaveReply, SaveRequest};
use sg_proto::scene::{Command, WalkTuning, command};
use sg_proto::selection::{ProposalsRequest, SampleReply, SampleRequest, StrokesRequest, TuneReply, TuneRequest};
use sg_proto::speech::ControlRequest;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_scene::mask::Mask;
use sg_viewer::display::{Request, RequestQueue, StateWriter, tour_sentence};
use tokio::runtime::Handle;

use super::labeling::Questions;
use super::preview;

/// Timeout of a change or a stroke, long enough for a service's restart.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Timeout of a stroke's sample: after that the hand is elsewhere.
const SAMPLE_TIMEOUT: Duration = Duration::from_millis(500);

/// Timeout for the supervisor to begin to open a scene.
const OPEN_TIMEOUT: Duration = Duration::from_secs(3);

/// Timeout of a saved file: the Gaussians of a large scene are read and written anew.
const SAVE_TIMEOUT: Duration = Duration::from_secs(600);

/// Time after which a person is told that a file is still being saved.
const SAVE_PATIENCE: Duration = Duration::from_secs(1);

/// Timeout for the agents' answer.
const AGENT_TIMEOUT: Duration = Duration::from_secs(120);

/// Carries requests out, on a thread of their own, while the display exists.
///
/// # Errors
/// The system's error if it cannot start a thread.
pub(super) fn run(bus: Bus, requests: Receiver<Request>, writer: StateWriter) -> io::Result<()> {
    let runtime = Handle::current();
    let body = move || {
        let questions = Questions::new(bus.clone(), writer.clone());
        let preview = Arc::new(Mask::empty(0));
        let mut executor = RequestExecutor { bus, writer, preview, utterance_id: None, questions };
        for request in RequestQueue::new(requests) {
            runtime.block_on(executor.carry_out(request));
        }
    };
    std::thread::Builder::new().name("errands".to_owned()).spawn(body).map(drop)
}

/// State from one request to the next.
struct RequestExecutor {
    bus: Bus,
    writer: StateWriter,
    /// The newest preview of the stroke under way.
    preview: Arc<Mask>,
    /// Id of the last sentence.
    utterance_id: Option<String>,
    /// Questions to the labeling service.
    questions: Questions,
}

impl RequestExecutor {
    async fn carry_out(&mut self, request: Request) {
        let Self { bus, writer, preview, utterance_id, questions } = self;
        match request {
            Request::Change(action) => report_failure(writer, apply(bus, *action).await),
            Request::Sample(sample) => {
                // A missing preview is followed by another, or by the stroke itself.
                if let Ok(reply) = self::sample(bus, &sample).await {
                    show(writer, preview, &reply);
                }
            }
            Request::Select(strokes) => {
                let outcome = select(bus, &strokes).await;
                if outcome.is_err() {
                    forget(writer);
                }
                report_failure(writer, outcome);
            }
            Request::Tune(tuning) => match tune(bus, tuning).await {
                Ok(reply) => show_trial(writer, tuning, &reply),
                // As with samples.
                Err(fault) if matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded) => (),
                Err(fault) => report_failure(writer, Err(fault)),
            },
            Request::Forget => forget(writer),
            Request::Propose(count) => report_failure(writer, propose(bus, writer, count).await),
            Request::Find { number, text } => questions.find(number, text),
            Request::Views { number, unit } => questions.views(number, unit),
            Request::Speech(control) => {
                let request = ControlRequest { control: control.into() };
                let context = Context::root().deadline_in(TIMEOUT);
                report_failure(writer, bus.ask(&keys::SPEECH_CONTROL, &request, &context).await.map(drop));
            }
            Request::Say(text) => *utterance_id = Some(say(bus, writer, text)),
            Request::Tour(step) => *utterance_id = Some(say(bus, writer, tour_sentence(step).to_owned())),
            Request::Open(path, spacing) => match open(bus, &path, spacing).await {
                Ok(reply) => writer.notice(opens(&path, &reply), false),
                Err(fault) => report_failure(writer, Err(fault)),
            },
            Request::Save(request) => save(bus, writer, *request),
            Request::Withdraw => {
                if let Some(id) = utterance_id.take() {
                    let outcome = bus.cancel(role::AGENT_CORE, &id).await;
                    if !outcome.unwrap_or(false) {
                        writer.notice("it was answered already; nothing was withdrawn", false);
                    }
                }
            }
        }
    }
}

/// Shows a failed request as a notice.
fn report_failure(writer: &StateWriter, outcome: Result<(), Fault>) {
    if let Err(fault) = outcome {
        writer.notice(fault.message, true);
    }
}

async fn apply(bus: &Bus, action: command::Action) -> Result<(), Fault> {
    let context = Context::root().deadline_in(TIMEOUT);
    // Retries use the same id: the request takes effect once.
    let id = format!("display-{}", context.id);
    let command = Command { id: id.clone(), expected_revision: 0, action: Some(action) };
    bus.ask(&keys::SCENE_APPLY, &command, &context.with_id(id)).await.map(drop)
}

async fn select(bus: &Bus, strokes: &StrokesRequest) -> Result<(), Fault> {
    bus.ask(&keys::SELECTION_STROKES, strokes, &Context::root().deadline_in(TIMEOUT)).await.map(drop)
}

async fn sample(bus: &Bus, sample: &SampleRequest) -> Result<SampleReply, Fault> {
    bus.ask(&keys::SELECTION_SAMPLE, sample, &Context::root().deadline_in(SAMPLE_TIMEOUT)).await
}

async fn tune(bus: &Bus, tuning: WalkTuning) -> Result<TuneReply, Fault> {
    let request = TuneRequest { tuning: Some(tuning) };
    bus.ask(&keys::SELECTION_TUNE, &request, &Context::root().deadline_in(SAMPLE_TIMEOUT)).await
}

/// Shows the trial selection of other walk parameters.
fn show_trial(writer: &StateWriter, tuning: WalkTuning, reply: &TuneReply) {
    writer.update(|state| {
        let committed = state.scene.selection();
        if reply.selection_hash == committed.hash() {
            state.selected = Arc::new(preview::changed(committed.mask(), &reply.changed));
            state.uncommitted = true;
            state.trial_tuning = Some(tuning);
        }
    });
}

/// Shows the committed selection without trial or stroke.
fn forget(writer: &StateWriter) {
    writer.update(|state| {
        state.selected = Arc::clone(state.scene.selection().mask());
        (state.uncommitted, state.trial_tuning) = (false, None);
    });
}

/// Requests proposals: the most informative places for a next stroke.
async fn propose(bus: &Bus, writer: &StateWriter, count: u32) -> Result<(), Fault> {
    let request = ProposalsRequest { count };
    let reply = bus.ask(&keys::SELECTION_PROPOSALS, &request, &Context::root().deadline_in(TIMEOUT)).await?;
    if reply.proposals.is_empty() {
        writer.notice("the walk leaves nothing open: no place would tell much", false);
    }
    writer.update(|state| state.proposals = Some(Arc::new(reply)));
    Ok(())
}

/// Shows the selection that the stroke under way would produce. Each answer holds the differences from the one before.
fn show(writer: &StateWriter, before: &mut Arc<Mask>, reply: &SampleReply) {
    writer.update(|state| {
        let committed = state.scene.selection();
        if reply.selection_hash != committed.hash() {
            return;
        }
        let from = if reply.relative_to_committed || before.len() != committed.mask().len() {
            committed.mask()
        } else {
            &*before
        };
        let after = Arc::new(preview::changed(from, &reply.changed));
        *before = Arc::clone(&after);
        state.selected = after;
        (state.uncommitted, state.trial_tuning) = (true, None);
    });
}

/// Opens a scene or volume in a window of its own.
async fn open(bus: &Bus, path: &Path, spacing: Option<[f64; 3]>) -> Result<OpenReply, Fault> {
    let spacing = spacing.map_or_else(Vec::new, |spacing| spacing.to_vec());
    let request = OpenRequest { path: path.display().to_string(), spacing };
    bus.ask(&keys::OPEN, &request, &Context::root().deadline_in(OPEN_TIMEOUT)).await
}

/// The notice for an opened file.
fn opens(path: &Path, reply: &OpenReply) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str()).display();
    let first = if reply.volume { "as soon as Gaussians are made of it, " } else { "" };
    format!("{name}: {first}a window of its own opens (session {})", reply.session)
}

/// Saves a file, asynchronously. The picture that it is made of goes afterwards.
fn save(bus: &Bus, writer: &StateWriter, request: SaveRequest) {
    let (bus, writer) = (bus.clone(), writer.clone());
    tokio::spawn(async move {
        let context = Context::root().deadline_in(SAVE_TIMEOUT);
        let mut saving = std::pin::pin!(bus.ask(&keys::SAVE, &request, &context));
        let saved = match tokio::time::timeout(SAVE_PATIENCE, &mut saving).await {
            Ok(saved) => saved,
            Err(_) => {
                writer.notice(format!("Saving {}…", short_path(Path::new(&request.path))), false);
                saving.await
            }
        };
        if let Some(Content::Picture(picture)) = &request.content {
            // Left over, it only takes room until the end of the process.
            let _ = std::fs::remove_file(&picture.path);
        }
        match saved {
            Ok(reply) => writer.notice(saved_line(&request, &reply), false),
            Err(fault) => report_failure(&writer, Err(fault)),
        }
    });
}

/// The notice for a saved file.
fn saved_line(request: &SaveRequest, reply: &SaveReply) -> String {
    let path = short_path(Path::new(&request.path));
    match &request.content {
        Some(Content::Gaussians(_)) => {
            format!("Saved {} splats to {path}", grouped(reply.gaussians))
        }
        Some(Content::Project(_)) => format!("Saved a copy of the project to {path}"),
        Some(Content::Picture(_)) => format!("Saved the picture to {path}"),
        None => format!("Saved {path}"),
    }
}

/// Sends an utterance to the agents, asynchronously; returns the id that can withdraw it.
fn say(bus: &Bus, writer: &StateWriter, text: String) -> String {
    let context = Context::root().deadline_in(AGENT_TIMEOUT);
    let id = context.id.clone();
    let (bus, writer) = (bus.clone(), writer.clone());
    tokio::spawn(async move {
        let utterance = Utterance { text, source: Source::Text.into(), ..Utterance::default() };
        // The answer comes as every stage of the conversation does.
        report_failure(&writer, bus.ask(&keys::UTTER, &utterance, &context).await.map(drop));
    });
    id
}
