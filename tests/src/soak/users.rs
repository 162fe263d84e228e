//! Users of a session: they select, change, look, speak and ask for pictures.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sg_proto::bus::Code;
use sg_proto::keys;
use sg_proto::language::{Source, Utterance};
use sg_proto::render::{CaptureRequest, PickRequest, Quality};
use sg_proto::scene::command::Action;
use sg_proto::scene::selection_operation::Operation;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::set_view::Change;
use sg_proto::scene::{
    Color, Command, CommandResult, DeleteUnit, Grow, InSphere, Invert, NamedView, Orbit, Redo, RenameUnit, Reset,
    SaveUnit, Select, SelectionOperation, SelectionStep, SetBackground, SetColor, SetLight, SetOpacity, SetTerm,
    SetView, SetVisibility, ShadingTerm, ShowOnly, Stroke, StrokeKind, StrokeMode, Target, Undo, WalkTuning,
};
use sg_proto::selection::{StrokesRequest, TuneRequest};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

use super::pace::Pace;

/// How long a user waits for an answer, restarts included.
const PATIENCE: Duration = Duration::from_secs(60);
/// Units that the users keep at a time.
const MOST_UNITS: usize = 12;
/// Accepted commands that are asked for again at the end.
const REMEMBERED: usize = 1000;
/// Of so many commands one is an utterance.
const UTTERANCE_EACH: u64 = 50;
/// A point within the part that the users brush, normalized.
const BRUSHED: [f64; 3] = [0.77, 0.48, 0.48];

/// What the users say, one after another.
const UTTERANCES: [&str; 14] = [
    "make everything blue",
    "zoom in",
    "what is selected?",
    "rotate left 30 degrees",
    "undo",
    "fade everything else to 50 percent",
    "list the units",
    "redo",
    "zoom out",
    "show everything",
    "make the selection red",
    "help",
    "from the front",
    "undo",
];

/// What all users of a session share.
#[derive(Debug)]
pub struct Users {
    bus: Bus,
    seed: u64,
    pixels: u32,
    /// Names of the base units.
    base: Vec<String>,
    /// Names of the units that they have saved, oldest first.
    saved: Mutex<VecDeque<String>>,
    /// Ids and revisions of the last accepted commands.
    accepted: Mutex<VecDeque<(String, u64)>>,
}

impl Users {
    /// Users of a session whose scene is ready.
    ///
    /// # Errors
    /// The scene's fault.
    pub async fn of(bus: Bus, seed: u64, pixels: u32) -> Result<Self, Fault> {
        let state = bus.newest(&keys::SCENE_STATE, &soon()).await?;
        let base = state.base_units.into_iter().map(|unit| unit.name).collect();
        Ok(Self { bus, seed, pixels, base, saved: Mutex::default(), accepted: Mutex::default() })
    }

    /// One user: commands, strokes and utterances until none is left.
    pub async fn work(&self, pace: &Pace) {
        while let Some(number) = pace.next(&pace.commands).await {
            let mut rng = self.rng("command", number);
            if number % UTTERANCE_EACH == UTTERANCE_EACH - 1 {
                pace.note("utterance", &self.say(number).await);
            } else if rng.random_bool(0.1) {
                pace.note("strokes", &self.brush(&mut rng, number).await);
            } else {
                let action = self.action(&mut rng, number);
                pace.note("command", &self.apply(number, action).await);
            }
            pace.commands.finish();
        }
    }

    /// One user: pictures of the present view until none is left.
    pub async fn look(&self, pace: &Pace) {
        while let Some(number) = pace.next(&pace.captures).await {
            let mut rng = self.rng("capture", number);
            let request = CaptureRequest {
                width: self.pixels,
                height: self.pixels,
                quality: Quality::Fast.into(),
                highlight_selection: rng.random_bool(0.5),
                measure_units: rng.random_bool(0.2),
                ..CaptureRequest::default()
            };
            pace.note("capture", &self.bus.ask(&keys::CAPTURE, &request, &soon()).await);
            if rng.random_bool(0.1) {
                let at = f64::from(self.pixels) * 0.5;
                let request =
                    PickRequest { width: self.pixels, height: self.pixels, x: at, y: at, ..PickRequest::default() };
                pace.note("pick", &self.bus.ask(&keys::PICK, &request, &soon()).await);
            }
            if number % UTTERANCE_EACH == 0 {
                self.look_at_units().await;
            }
            pace.captures.finish();
        }
    }

    /// Takes the list of saved units from the scene: undo brings deleted ones back.
    async fn look_at_units(&self) {
        // Without an answer the list stays as it is until the next look.
        if let Ok(state) = self.bus.newest(&keys::SCENE_STATE, &soon()).await {
            let names = state.units.into_iter().filter(|unit| !unit.derived).map(|unit| unit.name);
            *self.saved.lock().unwrap_or_else(PoisonError::into_inner) = names.collect();
        }
    }

    /// Asks for the results of the last accepted commands once more: those that the scene has lost.
    pub async fn lost(&self) -> Vec<String> {
        let accepted: Vec<_> = self.accepted.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect();
        let mut lost = Vec::new();
        for (id, revision) in accepted {
            let question = Command { id: id.clone(), ..Command::default() };
            match self.bus.ask(&keys::SCENE_APPLY, &question, &soon()).await {
                Ok(known) if known.revision == revision => {}
                Ok(other) => lost.push(format!("{id}: revision {} instead of {revision}", other.revision)),
                Err(fault) => lost.push(format!("{id}: {fault}")),
            }
        }
        lost
    }

    fn rng(&self, of: &str, number: u64) -> ChaCha8Rng {
        let word = of.bytes().fold(self.seed, |h, b| h.wrapping_mul(31).wrapping_add(b.into()));
        ChaCha8Rng::seed_from_u64(word.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(number))
    }

    async fn apply(&self, number: u64, action: Action) -> Result<CommandResult, Fault> {
        let id = format!("soak-{}-{number}", self.seed);
        let saved = match &action {
            Action::SaveUnit(unit) => Some(unit.name.clone()),
            _ => None,
        };
        let command = Command { id: id.clone(), action: Some(action), ..Command::default() };
        let context = soon();
        let result = loop {
            match self.bus.ask(&keys::SCENE_APPLY, &command, &context).await {
                // A full queue: the same command later.
                Err(Fault { code: Code::ResourceExhausted, retry_after: Some(pause), .. })
                    if context.remaining() > pause =>
                {
                    tokio::time::sleep(pause).await;
                }
                result => break result,
            }
        }?;
        let mut accepted = self.accepted.lock().unwrap_or_else(PoisonError::into_inner);
        accepted.push_back((id, result.revision));
        if accepted.len() > REMEMBERED {
            accepted.pop_front();
        }
        drop(accepted);
        if let Some(name) = saved {
            self.saved.lock().unwrap_or_else(PoisonError::into_inner).push_back(name);
        }
        Ok(result)
    }

    async fn brush(&self, rng: &mut ChaCha8Rng, number: u64) -> Result<(), Fault> {
        if rng.random_bool(0.1) {
            let tuning = WalkTuning { leak: rng.random_range(0.0..0.1), threshold: rng.random_range(-0.5..0.5) };
            let request = TuneRequest { tuning: Some(tuning) };
            return self.bus.ask(&keys::SELECTION_TUNE, &request, &soon()).await.map(drop);
        }
        let mut near = || BRUSHED.map(|x| x + rng.random_range(-0.03..0.03));
        let points = [near(), near()].concat();
        let (mode, kind) = match number % 7 {
            0 => (StrokeMode::Cluster, StrokeKind::Toggle),
            1 => (StrokeMode::Point, StrokeKind::Foreground),
            2 => (StrokeMode::Walk, StrokeKind::Background),
            _ => (StrokeMode::Walk, StrokeKind::Foreground),
        };
        let radius = rng.random_range(0.02..0.08);
        let stroke = Stroke { mode: mode.into(), kind: kind.into(), radius, points, ..Stroke::default() };
        let operation = match number % 11 {
            0 => Some(Operation::Grow(Grow { distance: 0.02 })),
            1 => Some(Operation::Invert(Invert {})),
            2 => Some(Operation::Sphere(InSphere { centre: BRUSHED.to_vec(), radius: rng.random_range(0.05..0.2) })),
            _ => None,
        };
        let steps = operation.map(|operation| {
            let operation = SelectionOperation { operation: Some(operation), ..SelectionOperation::default() };
            SelectionStep { step: Some(Step::Operation(operation)) }
        });
        // Strokes of one selection do not grow without end: people begin another one.
        let (restart, steps) = (rng.random_bool(0.4), steps.into_iter().collect());
        let request = StrokesRequest { strokes: vec![stroke], restart, steps, ..StrokesRequest::default() };
        self.bus.ask(&keys::SELECTION_STROKES, &request, &soon()).await.map(drop)
    }

    async fn say(&self, number: u64) -> Result<(), Fault> {
        let which = (number / UTTERANCE_EACH) as usize % UTTERANCES.len();
        let text = UTTERANCES.get(which).copied().unwrap_or("help").to_owned();
        let context = soon().at_step(format!("soak-{}", number / UTTERANCE_EACH % 40), 1);
        // Whether the agents could do it depends on what the others have just done.
        self.bus
            .ask(&keys::UTTER, &Utterance { text, source: Source::Text.into(), ..Utterance::default() }, &context)
            .await
            .map(drop)
    }

    /// The next command of a user, in about the shares in which people give them.
    fn action(&self, rng: &mut ChaCha8Rng, number: u64) -> Action {
        let name = format!("unit {number}");
        let target = Some(self.target(rng));
        let mut color = || Some(Color { red: rng.random(), green: rng.random(), blue: rng.random() });
        match number % 50 {
            0..8 => Action::SetColor(SetColor { target, color: color() }),
            8 => Action::SetColor(SetColor { target, color: None }),
            9 => Action::SetBackground(SetBackground { color: color() }),
            10..16 => {
                let relative = number.is_multiple_of(2);
                let factor = if relative { rng.random_range(0.7..1.4) } else { rng.random() };
                Action::SetOpacity(SetOpacity { target, factor, relative })
            }
            16..19 => Action::SetVisibility(SetVisibility { target, visible: rng.random_bool(0.7) }),
            19 => Action::ShowOnly(ShowOnly { target }),
            20..23 => Action::SetLight(SetLight {
                ambient: Some(rng.random()),
                diffuse: Some(rng.random()),
                specular: Some(rng.random()),
                ..SetLight::default()
            }),
            23 => Action::SetTerm(SetTerm {
                term: if rng.random_bool(0.8) { ShadingTerm::Full } else { ShadingTerm::Normal }.into(),
            }),
            24..30 => {
                let orbit = Orbit {
                    azimuth_degrees: rng.random_range(-40.0..40.0),
                    elevation_degrees: rng.random_range(-9.0..9.0),
                };
                Action::SetView(SetView { change: Some(Change::Orbit(orbit)) })
            }
            30 => Action::SetView(SetView { change: Some(Change::Zoom(rng.random_range(0.9..1.1))) }),
            31 => Action::SetView(SetView { change: Some(Change::Named(NamedView::Initial.into())) }),
            32..35 => Action::Select(Select { target, operation: rng.random_range(0..5) }),
            35..39 => self.save_or_delete(name),
            39 => self.oldest().map_or(Action::Undo(Undo { steps: 1 }), |name| Action::DeleteUnit(DeleteUnit { name })),
            40 | 41 => match self.any_saved(rng) {
                Some(old) => {
                    self.rename(&old, &name);
                    Action::RenameUnit(RenameUnit { name: old, new_name: name })
                }
                None => Action::SaveUnit(SaveUnit { name, replace: false }),
            },
            42..46 => Action::Undo(Undo { steps: rng.random_range(1..4) }),
            46..49 => Action::Redo(Redo { steps: rng.random_range(1..3) }),
            // Once in a while people begin anew with the look.
            _ if rng.random_bool(0.2) => Action::Reset(Reset {}),
            _ => Action::SetView(SetView { change: Some(Change::Focus(self.target(rng))) }),
        }
    }

    fn target(&self, rng: &mut ChaCha8Rng) -> Target {
        let at = rng.random_range(0..self.base.len().max(1));
        let base = || self.base.get(at).cloned();
        let unit = match rng.random_range(0..6) {
            0 => return Target { selection: true, ..Target::default() },
            1 => return Target { everything: true, ..Target::default() },
            2 => return Target { selection: true, complement: true, ..Target::default() },
            3 => base(),
            _ => self.any_saved(rng).or_else(base),
        };
        Target { units: unit.into_iter().collect(), ..Target::default() }
    }

    fn save_or_delete(&self, name: String) -> Action {
        let full = self.saved.lock().unwrap_or_else(PoisonError::into_inner).len() >= MOST_UNITS;
        match full.then(|| self.oldest()).flatten() {
            Some(name) => Action::DeleteUnit(DeleteUnit { name }),
            None => Action::SaveUnit(SaveUnit { name, replace: false }),
        }
    }

    /// Takes the oldest saved unit off the list.
    fn oldest(&self) -> Option<String> {
        self.saved.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }

    fn any_saved(&self, rng: &mut ChaCha8Rng) -> Option<String> {
        let saved = self.saved.lock().unwrap_or_else(PoisonError::into_inner);
        if saved.is_empty() { None } else { saved.get(rng.random_range(0..saved.len())).cloned() }
    }

    fn rename(&self, old: &str, new: &str) {
        let mut saved = self.saved.lock().unwrap_or_else(PoisonError::into_inner);
        saved.iter_mut().filter(|name| *name == old).for_each(|name| new.clone_into(name));
    }
}

fn soon() -> Context {
    Context::root().deadline_in(PATIENCE)
}
