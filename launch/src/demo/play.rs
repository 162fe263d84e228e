//! Plays a script step by step through the bus.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use sg_launch::script::Step;
use sg_proto::bus::Code;
use sg_proto::keys::{self, Ask};
use sg_proto::language::{Reply, Source, Utterance};
use sg_proto::prost::{Message, Name};
use sg_proto::render::{CaptureRequest, Frame};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Command, SaveUnit, SetView, StrokeMode, View, set_view};
use sg_proto::selection::StrokesRequest;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;

use super::read_strokes;
use super::transcript::Transcript;
use crate::children;
use crate::decode::Decoder;
use crate::remote::services;
use crate::terminal::{self, Failure, thousands, time};

/// How long one step may take, restarts of services included.
const STEP_TIME: Duration = Duration::from_secs(180);
/// How long a picture of the shared viewpoint is waited for after a change.
const VIEW_TIME: Duration = Duration::from_secs(20);
/// How long a service that is to be killed may take to have a process.
const VICTIM_TIME: Duration = Duration::from_secs(10);

/// How a script is played.
#[derive(Debug, Clone)]
pub(super) struct Settings {
    pub(super) out: PathBuf,
    /// Width and height of pictures, pixels.
    pub(super) size: u32,
    /// The service that is killed.
    pub(super) chaos: Option<String>,
}

/// What was measured, milliseconds.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    pub(super) walk: Vec<f64>,
    /// From sending strokes to the picture of the shared viewpoint that shows what they selected.
    pub(super) stroke_to_picture: Vec<f64>,
    pub(super) frame: Vec<f64>,
    pub(super) reply: Vec<f64>,
}

/// Plays scripts.
pub(super) struct Player {
    bus: Bus,
    decoder: Decoder,
    transcript: Transcript,
    settings: Settings,
    conversation: String,
    step: u32,
    /// The newest revision of the scene that an answer spoke of.
    revision: u64,
    pub(super) measured: Measured,
    pub(super) pictures: Vec<PathBuf>,
    pub(super) replies: usize,
    /// What was said but not done.
    pub(super) undone: Vec<String>,
}

impl Player {
    pub(super) async fn new(bus: Bus, settings: Settings) -> Result<Self, Failure> {
        Ok(Self {
            transcript: Transcript::begin(&bus).await?,
            bus,
            decoder: Decoder::new()?,
            settings,
            conversation: format!("demo-{}", Context::root().id),
            step: 0,
            revision: 0,
            measured: Measured::default(),
            pictures: Vec::new(),
            replies: 0,
            undone: Vec::new(),
        })
    }

    /// Plays all steps in order.
    pub(super) async fn play(&mut self, steps: &[Step]) -> Result<(), Failure> {
        let of = steps.len();
        for (index, step) in steps.iter().enumerate() {
            self.step += 1;
            let what = match step {
                Step::Strokes { file, restart } => self.brush(file, *restart).await,
                Step::Say(text) => self.say(text).await,
                Step::Save(name) => self.save(name).await,
                Step::View(view) => self.look(view).await,
                Step::Capture { name, highlight, only } => self.capture(name, *highlight, only).await,
                Step::Chaos => self.kill().await,
            };
            let number = index + 1;
            let what = what.map_err(|failure| match failure {
                Failure::Input(text) => Failure::Input(format!("step {number}: {text}")),
                Failure::Work(text) => Failure::Work(format!("step {number}: {text}")),
                Failure::Told(status) => Failure::Told(status),
            })?;
            if !what.is_empty() {
                terminal::tell(&format!("[{number:2}/{of}] {what}"));
            }
        }
        Ok(())
    }

    /// Width and height of its pictures, pixels.
    pub(super) fn size(&self) -> u32 {
        self.settings.size
    }

    /// Writes what was heard so far.
    pub(super) fn write_transcript(&self) -> Result<PathBuf, Failure> {
        self.transcript.write(&self.settings.out, &self.decoder)
    }

    /// The context of a step: its ids do not depend on how often it is tried, so that it takes effect once.
    fn context(&self) -> Context {
        Context::root()
            .deadline_in(STEP_TIME)
            .with_id(format!("{}/{}", self.conversation, self.step))
            .at_step(self.conversation.clone(), self.step)
    }

    /// Asks until there is an answer that another try would not change.
    async fn ask<Q, R>(&self, row: &Ask<Q, R>, request: &Q, context: &Context) -> Result<R, Failure>
    where
        Q: Message + Name,
        R: Message + Name + Default,
    {
        self.transcript.note(row.role, row.name, request, context);
        loop {
            match self.bus.ask(row, request, context).await {
                Ok(reply) => {
                    self.transcript.note(row.role, row.name, &reply, context);
                    return Ok(reply);
                }
                Err(fault) => {
                    let pause = fault.retry_after.unwrap_or(Duration::from_millis(100));
                    let passing = matches!(fault.code, Code::Unavailable | Code::Aborted | Code::ResourceExhausted);
                    if !passing || context.remaining() <= pause {
                        return Err(fault.into());
                    }
                    tokio::time::sleep(pause).await;
                }
            }
        }
    }

    async fn brush(&mut self, file: &Path, restart: bool) -> Result<String, Failure> {
        let strokes = read_strokes(file)?;
        let count = strokes.len();
        let walks = strokes.iter().any(|s| s.mode() == StrokeMode::Walk);
        let began = Instant::now();
        let request = StrokesRequest { strokes, restart };
        let reply = self.ask(&keys::SELECTION_STROKES, &request, &self.context()).await?;
        self.revision = self.revision.max(reply.revision);
        let seen = self.transcript.view_of(reply.revision, VIEW_TIME).await;
        let mut picture = String::new();
        if let Some(at) = seen {
            let ms = at.saturating_duration_since(began).as_secs_f64() * 1000.0;
            picture = format!(", on the picture after {}", time(ms));
            self.measured.stroke_to_picture.push(ms);
        }
        let mut walk = String::new();
        if walks {
            walk = format!(", walk {}", time(reply.walk_ms));
            self.measured.walk.push(reply.walk_ms);
        }
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let plural = if count == 1 { "stroke" } else { "strokes" };
        Ok(format!("brush {count} {plural} of {name}: {} Gaussians selected{walk}{picture}", thousands(reply.selected)))
    }

    async fn say(&mut self, text: &str) -> Result<String, Failure> {
        let utterance = Utterance { text: text.to_owned(), source: Source::Text.into() };
        let began = Instant::now();
        let reply: Reply = self.ask(&keys::UTTER, &utterance, &self.context()).await?;
        self.measured.reply.push(began.elapsed().as_secs_f64() * 1000.0);
        self.revision = self.revision.max(reply.revision);
        self.replies += 1;
        if !reply.ok {
            self.undone.push(format!("\"{text}\": {}", reply.text));
        }
        Ok(format!("say \"{text}\" → {}", reply.text))
    }

    async fn save(&mut self, name: &str) -> Result<String, Failure> {
        self.command(Action::SaveUnit(SaveUnit { name: name.to_owned(), replace: false })).await
    }

    async fn look(&mut self, view: &View) -> Result<String, Failure> {
        self.command(Action::SetView(SetView { change: Some(set_view::Change::View(*view)) })).await
    }

    async fn command(&mut self, action: Action) -> Result<String, Failure> {
        let context = self.context();
        let command = Command { id: context.id.clone(), action: Some(action), ..Command::default() };
        let result = self.ask(&keys::SCENE_APPLY, &command, &context).await?;
        self.revision = self.revision.max(result.revision);
        Ok(result.summary)
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
        let frame = self.ask(&keys::CAPTURE, &request, &self.context()).await?;
        self.measured.frame.push(frame.render_ms);
        let base = format!("{:02}-{name}", self.pictures.len() + 1);
        let out = &self.settings.out;
        let picture = keep(&frame, &out.join(format!("{base}.npy")), &out.join(format!("{base}.png")))?;
        let shown = picture.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.pictures.push(picture);
        Ok(format!("capture {shown}, drawn in {}", time(frame.render_ms)))
    }

    /// Kills the service that the command names, as it is, and goes on at once.
    async fn kill(&self) -> Result<String, Failure> {
        let Some(victim) = &self.settings.chaos else { return Ok(String::new()) };
        let began = Instant::now();
        loop {
            let ps = services(&self.bus).await?;
            let pid = ps.services.iter().find(|s| s.name == *victim).map_or(0, |s| s.pid);
            if pid > 0 {
                children::signal(pid, Signal::SIGKILL)
                    .map_err(|e| Failure::Work(format!("process {pid} cannot be killed: {e}")))?;
                return Ok(format!("kill -9 {pid} ({victim})"));
            }
            if began.elapsed() > VICTIM_TIME {
                return Err(Failure::Work(format!("`{victim}` has no process that could be killed")));
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }
}

/// Copies a picture out of the session's folder, whole or not at all. Returns the PNG.
fn keep(frame: &Frame, npy: &Path, png: &Path) -> Result<PathBuf, Failure> {
    for (from, to) in [(&frame.npy_path, npy), (&frame.png_path, png)] {
        let part = to.with_extension("part");
        std::fs::copy(from, &part)
            .and_then(|_| std::fs::rename(&part, to))
            .map_err(|e| Failure::Work(format!("{from} → {}: {e}", to.display())))?;
    }
    Ok(png.to_owned())
}
