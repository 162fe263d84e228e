//! Plays a script step by step over the bus.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use sg_proto::bus::Code;
use sg_proto::keys::{self, Identity, Request};
use sg_proto::language::{Reply, Source, Utterance};
use sg_proto::prost::{Message, Name};
use sg_proto::render::CaptureRequest;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Command, SaveUnit, SetView, StrokeMode, set_view};
use sg_proto::selection::StrokesRequest;
use sg_proto::stroke_file::stroke_of;
use sg_runtime::blobs::StoredFile;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::session::SessionDir;

use sg_stack::spawn;

use crate::capture::keep_picture;
use crate::decode::Decoder;
use crate::strokes::read_strokes;
use crate::supervisor_client::services;
use crate::terminal::{self, Failure, format_count, format_time};
use crate::transcript::Transcript;
use supergaussian::script::Step;

/// Longest wait for the view's picture after a change.
const VIEW_TIME: Duration = Duration::from_secs(20);
/// Longest wait for the process of the service to kill.
const TARGET_TIME: Duration = Duration::from_secs(10);

/// Settings of a playback.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// Folder for pictures and the transcript.
    pub(crate) out: PathBuf,
    /// Name of the conversation. The ids of all requests begin with it.
    pub(crate) conversation: String,
    /// Longest time of one step, restarts of services included.
    pub(crate) step_time: Duration,
    /// Width and height of pictures, pixels.
    pub(crate) size: u32,
    /// The service to kill.
    pub(crate) chaos: Option<String>,
    pub(crate) counts: Arc<Counts>,
}

/// Counters of a playback.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    /// Retries by the player, beyond those of the bus.
    pub(crate) retries: AtomicU64,
    /// Refusals because the journal could not be written.
    pub(crate) refused_for_room: AtomicU64,
}

/// Measured times, milliseconds.
#[derive(Debug, Clone, Default)]
pub(crate) struct Measurements {
    pub(crate) walk: Vec<f64>,
    /// From the strokes to the view's picture of their selection.
    pub(crate) stroke_to_picture: Vec<f64>,
    pub(crate) frame: Vec<f64>,
    pub(crate) reply: Vec<f64>,
}

/// An acknowledged change of the scene. It must never be lost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct AcknowledgedChange {
    /// Id of the scene command; empty if the agents chose it.
    pub(crate) id: String,
    /// Revision after it.
    pub(crate) revision: u64,
}

/// Plays scripts.
pub(crate) struct Player {
    bus: Bus,
    decoder: Decoder,
    transcript: Transcript,
    settings: Settings,
    step: u32,
    /// Newest revision of the scene in an answer.
    revision: u64,
    pub(crate) measured: Measurements,
    pub(crate) pictures: Vec<PathBuf>,
    /// Content hash of each picture.
    pub(crate) hashes: Vec<String>,
    pub(crate) replies: usize,
    /// Utterances that the agents could not carry out.
    pub(crate) failed_utterances: Vec<String>,
    pub(crate) acknowledged: Vec<AcknowledgedChange>,
}

impl Player {
    pub(crate) async fn new(bus: Bus, settings: Settings) -> Result<Self, Failure> {
        Ok(Self {
            transcript: Transcript::begin(&bus).await?,
            bus,
            decoder: Decoder::new()?,
            settings,
            step: 0,
            revision: 0,
            measured: Measurements::default(),
            pictures: Vec::new(),
            hashes: Vec::new(),
            replies: 0,
            failed_utterances: Vec::new(),
            acknowledged: Vec::new(),
        })
    }

    /// Plays all steps in order.
    pub(crate) async fn play(&mut self, steps: &[Step]) -> Result<(), Failure> {
        let of = steps.len();
        for (index, step) in steps.iter().enumerate() {
            let number = index + 1;
            let what = self.play_step(step).await.map_err(|failure| match failure {
                Failure::Input(text) => Failure::Input(format!("step {number}: {text}")),
                Failure::Work(text) => Failure::Work(format!("step {number}: {text}")),
                several @ (Failure::Mistakes(_) | Failure::Faults(_) | Failure::Reported(_)) => several,
            })?;
            if !what.is_empty() {
                terminal::print_status(&format!("[{number:2}/{of}] {what}"));
            }
        }
        Ok(())
    }

    /// Plays one step. Returns its result as text.
    pub(crate) async fn play_step(&mut self, step: &Step) -> Result<String, Failure> {
        self.step += 1;
        match step {
            Step::Strokes { file, restart } => self.brush(file, *restart).await,
            Step::Say(text) => self.say(text).await,
            Step::Save(name) => {
                self.command(Action::SaveUnit(SaveUnit { name: name.to_owned(), replace: false })).await
            }
            Step::View(view) => {
                self.command(Action::SetView(SetView { change: Some(set_view::Change::View(*view)) })).await
            }
            Step::Capture { name, highlight, only } => self.capture(name, *highlight, only).await,
            Step::Chaos => self.kill().await,
        }
    }

    /// Sends one command to the scene as a step of its own.
    pub(crate) async fn play_command(&mut self, action: Action) -> Result<String, Failure> {
        self.step += 1;
        self.command(action).await
    }

    /// Width and height of the pictures, pixels.
    pub(crate) fn size(&self) -> u32 {
        self.settings.size
    }

    /// Writes the transcript so far.
    pub(crate) fn write_transcript(&self) -> Result<PathBuf, Failure> {
        self.transcript.write(&self.settings.out, &self.decoder)
    }

    /// The context of a step. Its id is the same for every try, so that a step takes effect once.
    fn context(&self) -> Context {
        Context::root()
            .deadline_in(self.settings.step_time)
            .with_id(format!("{}/{}", self.settings.conversation, self.step))
            .at_step(self.settings.conversation.clone(), self.step)
    }

    /// Repeats a request until its answer is final.
    async fn ask<Q, R>(&self, row: &Request<Q, R>, request: &Q, context: &Context) -> Result<R, Failure>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        Ok(self.ask_identified(row, request, context).await?.0)
    }

    /// As [`Player::ask`], with the sender of the reply.
    async fn ask_identified<Q, R>(
        &self,
        row: &Request<Q, R>,
        request: &Q,
        context: &Context,
    ) -> Result<(R, Option<Identity>), Failure>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        self.transcript.note(row.role, row.name, request, context);
        loop {
            match self.bus.ask_identified(row, request, context).await {
                Ok((reply, sender)) => {
                    self.transcript.note(row.role, row.name, &reply, context);
                    return Ok((reply, sender));
                }
                Err(fault) => {
                    let pause = fault.retry_after.unwrap_or(Duration::from_millis(100));
                    let passing = matches!(fault.code, Code::Unavailable | Code::Aborted | Code::ResourceExhausted);
                    if !passing || context.remaining() <= pause {
                        return Err(fault.into());
                    }
                    let Counts { retries, refused_for_room } = &*self.settings.counts;
                    retries.fetch_add(1, Ordering::Relaxed);
                    refused_for_room.fetch_add(u64::from(fault.code == Code::ResourceExhausted), Ordering::Relaxed);
                    tokio::time::sleep(pause).await;
                }
            }
        }
    }

    async fn brush(&mut self, file: &Path, restart: bool) -> Result<String, Failure> {
        let steps = read_strokes(file)?;
        let strokes: Vec<_> = steps.iter().filter_map(stroke_of).collect();
        let (count, operations) = (strokes.len(), steps.len() - strokes.len());
        let walks = strokes.iter().any(|s| s.mode() == StrokeMode::Walk);
        let began = Instant::now();
        let request = StrokesRequest { restart, steps, ..StrokesRequest::default() };
        let context = self.context();
        let reply = self.ask(&keys::SELECTION_STROKES, &request, &context).await?;
        // The selection service names its command after the request.
        self.acknowledge(format!("strokes-{}", context.id), reply.revision);
        let seen = self.transcript.view_of(reply.revision, VIEW_TIME).await;
        let mut picture = String::new();
        if let Some(at) = seen {
            let ms = at.saturating_duration_since(began).as_secs_f64() * 1000.0;
            picture = format!(", on the picture after {}", format_time(ms));
            self.measured.stroke_to_picture.push(ms);
        }
        let mut walk = String::new();
        if walks {
            walk = format!(", walk {}", format_time(reply.walk_ms));
            self.measured.walk.push(reply.walk_ms);
        }
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let plural = |n: usize| if n == 1 { "" } else { "s" };
        let further = match operations {
            0 => String::new(),
            n => format!(" and {n} operation{}", plural(n)),
        };
        Ok(format!(
            "brush {count} stroke{}{further} of {name}: {} Gaussians selected{walk}{picture}",
            plural(count),
            format_count(reply.selected)
        ))
    }

    async fn say(&mut self, text: &str) -> Result<String, Failure> {
        let utterance = Utterance { text: text.to_owned(), source: Source::Text.into(), ..Utterance::default() };
        let began = Instant::now();
        let context = self.context();
        let reply: Reply = self.ask(&keys::UTTER, &utterance, &context).await?;
        self.measured.reply.push(began.elapsed().as_secs_f64() * 1000.0);
        self.acknowledge(String::new(), reply.revision);
        self.replies += 1;
        if !reply.ok {
            self.failed_utterances.push(format!("\"{text}\": {}", reply.text));
        }
        Ok(format!("say \"{text}\" → {}", reply.text))
    }

    async fn command(&mut self, action: Action) -> Result<String, Failure> {
        let context = self.context();
        let command = Command { id: context.id.clone(), action: Some(action), ..Command::default() };
        let result = self.ask(&keys::SCENE_APPLY, &command, &context).await?;
        self.acknowledge(command.id, result.revision);
        Ok(result.summary)
    }

    fn acknowledge(&mut self, id: String, revision: u64) {
        self.revision = self.revision.max(revision);
        self.acknowledged.push(AcknowledgedChange { id, revision });
    }

    async fn capture(&mut self, name: &str, highlight: bool, only: &[String]) -> Result<String, Failure> {
        let request = CaptureRequest {
            width: self.settings.size,
            height: self.settings.size,
            at_least_revision: self.revision,
            highlight_selection: highlight,
            only_units: only.to_vec(),
            ..CaptureRequest::default()
        };
        let context = self.context();
        let (frame, sender) = self.ask_identified(&keys::CAPTURE, &request, &context).await?;
        self.measured.frame.push(frame.render_ms);
        self.hashes.push(frame.hash.clone());
        let base = picture_base(self.pictures.len() + 1, name);
        let out = &self.settings.out;
        let session = SessionDir::named(self.bus.session()).map_err(|e| Failure::Work(e.to_string()))?;
        let picture = out.join(format!("{base}.png"));
        let files = [
            (&frame.npy_path, &frame.hash, &out.join(format!("{base}.npy"))),
            (&frame.png_path, &frame.png_hash, &picture),
        ];
        for (path, hash, to) in files {
            let stored = StoredFile { path, hash, sender: sender.as_ref() };
            keep_picture(&self.bus, &session, stored, to).await?;
        }
        let shown = picture.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.pictures.push(picture);
        Ok(format!("capture {shown}, drawn in {}", format_time(frame.render_ms)))
    }

    /// Kills the chosen service and continues at once.
    async fn kill(&self) -> Result<String, Failure> {
        let Some(target) = &self.settings.chaos else { return Ok(String::new()) };
        let began = Instant::now();
        loop {
            let ps = services(&self.bus).await?;
            let pid = ps.services.iter().find(|s| s.name == *target).map_or(0, |s| s.pid);
            if pid > 0 {
                spawn::signal(pid, Signal::SIGKILL)
                    .map_err(|e| Failure::Work(format!("process {pid} cannot be killed: {e}")))?;
                return Ok(format!("kill -9 {pid} ({target})"));
            }
            if began.elapsed() > TARGET_TIME {
                return Err(Failure::Work(format!("`{target}` has no process")));
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }
}

/// File name of the n-th picture of a script, counted from 1, without the extension.
pub(crate) fn picture_base(n: usize, name: &str) -> String {
    format!("{n:02}-{name}")
}
