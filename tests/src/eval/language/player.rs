//! Plays utterances through a running stack, each from the same state.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glam::Vec3;
use sg_edit::EditState;
use sg_formats::{SaveOptions, save};
use sg_proto::keys::{self, role};
use sg_proto::language::{Reply, Source, Utterance as Spoken};
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    ChangesRequest, Color, KeepView, Orbit, Redo, SaveUnit, Select, SetColor, SetOpacity, SetView, Target, Undo,
    set_view,
};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::process::block_on;
use sg_scene::model::Scene;
use sg_scene::synthetic::test_scene;

use super::Played;
use super::condition::Condition;
use super::outcome::Outcome;
use super::utterances::Utterance;
use crate::commands::{apply, select_range};
use crate::eval::EvalError;
use crate::stack::Stack;

/// Base units of the file: name, Gaussians, palette. The last holds the units that are saved.
const UNITS: [(&str, usize, [f32; 3]); 4] = [
    ("vessels", 900, [0.85, 0.35, 0.1]),
    ("bone", 600, [0.95, 0.92, 0.8]),
    ("tissue", 700, [0.95, 0.6, 0.7]),
    (OTHERS, SAC + CLIP, [0.6, 0.6, 0.6]),
];
/// The base unit of the saved ones.
const OTHERS: &str = "others";
/// Gaussians of the saved units.
const SAC: usize = 120;
const CLIP: usize = 40;
/// Time for an answer: a model takes some.
const TIME: Duration = Duration::from_secs(60);
/// Time for the first stop of a tour.
const FIRST_STOP: Duration = Duration::from_secs(5);
/// Most steps of undo and redo on the way back to the start.
const STEPS: usize = 48;

/// A stack on the scene of the sets.
pub(super) struct Player {
    settings: Vec<String>,
    session: Session,
}

struct Session {
    stack: Stack,
    _folder: tempfile::TempDir,
    opened: EditState,
    samples: BTreeMap<String, usize>,
    start: Outcome,
}

#[allow(clippy::needless_pass_by_value, reason = "`map_err` hands over the error")]
fn broken(why: impl ToString) -> EvalError {
    EvalError::Data { path: "the stack".to_owned(), why: why.to_string() }
}

fn soon() -> Context {
    Context::root().deadline_in(TIME)
}

impl Player {
    pub(super) fn new(settings: &[String]) -> Result<Self, EvalError> {
        Ok(Self { settings: settings.to_vec(), session: Session::new(settings)? })
    }

    /// Plays an utterance.
    pub(super) fn play(&mut self, utterance: &Utterance) -> Result<Played, EvalError> {
        let played = block_on(self.session.play(utterance)).map_err(broken)??;
        if !block_on(self.session.restore()).map_err(broken)?? {
            // The history has lost the start.
            self.session = Session::new(&self.settings)?;
        }
        Ok(played)
    }
}

impl Session {
    fn new(settings: &[String]) -> Result<Self, EvalError> {
        let folder = tempfile::tempdir().map_err(broken)?;
        let (path, scene) = write_scene(folder.path())?;
        let mut all = vec![format!("service.scene.params.scene={}", path.display())];
        all.extend(settings.iter().cloned());
        let stack = Stack::up_with(&all).map_err(broken)?;
        let opened = EditState::of_scene(&scene, "", "");
        // A Gaussian of each unit that no other unit has.
        let first = |at: usize| UNITS.iter().take(at).map(|(_, count, _)| count).sum::<usize>();
        let mut samples: BTreeMap<String, usize> =
            UNITS.iter().take(3).enumerate().map(|(at, (name, ..))| ((*name).to_owned(), first(at))).collect();
        let others = first(3);
        samples.extend([("sac".to_owned(), others), ("clip".to_owned(), others + SAC)]);
        let start = block_on(set_up(&stack, &opened, &samples)).map_err(broken)??;
        Ok(Self { stack, _folder: folder, opened, samples, start })
    }

    async fn join(&self) -> Result<Bus, EvalError> {
        self.stack.join(role::CLI).await.map_err(broken)
    }

    async fn play(&self, utterance: &Utterance) -> Result<Played, EvalError> {
        let bus = self.join().await?;
        if utterance.selected {
            change(&bus, select_range(self.opened.count(), 0..UNITS[0].1 / 3)).await?;
        }
        let before = self.outcome(&bus).await?;
        let conversation = Context::root().id;
        let mut replies = Vec::new();
        let mut milliseconds = 0.0;
        for (step, text) in (1..).zip(&utterance.say) {
            let spoken = Spoken { text: text.clone(), source: Source::Text.into(), ..Spoken::default() };
            let context = soon().at_step(conversation.clone(), step);
            let begun = Instant::now();
            let reply = bus.ask(&keys::UTTER, &spoken, &context).await;
            milliseconds = begun.elapsed().as_secs_f64() * 1e3;
            replies.push(reply.unwrap_or_else(|fault| Reply { text: fault.message, ..Reply::default() }));
        }
        let mut after = self.outcome(&bus).await?;
        // A tour that begins is on its way to its first stop.
        let begun = Instant::now();
        let waits = utterance.expect.iter().any(|condition| matches!(condition, Condition::Tour(_)));
        while waits && after.tour.is_some() && after.view == before.view && begun.elapsed() < FIRST_STOP {
            tokio::time::sleep(Duration::from_millis(100)).await;
            after = self.outcome(&bus).await?;
        }
        let asks = replies.last().is_some_and(|reply| !reply.ok && reply.text.contains('?'));
        let (problems, is_false_action) = judge(utterance, &before, &after, asks);
        let replies = replies.into_iter().map(|reply| reply.text).collect();
        let (kind, say) = (utterance.kind.clone(), utterance.say.clone());
        Ok(Played { kind, say, replies, problems, is_false_action, milliseconds })
    }

    async fn outcome(&self, bus: &Bus) -> Result<Outcome, EvalError> {
        outcome(bus, &self.opened, &self.samples).await
    }

    /// Brings the start back. Returns false if the history does not lead there.
    async fn restore(&self) -> Result<bool, EvalError> {
        let bus = self.join().await?;
        if self.outcome(&bus).await?.tour.is_some() {
            let spoken = Spoken { text: "stop the tour".to_owned(), source: Source::Text.into(), ..Spoken::default() };
            bus.ask(&keys::UTTER, &spoken, &soon()).await.map_err(|fault| broken(fault.message))?;
        }
        let undo = Action::Undo(Undo { steps: 1 });
        let redo = Action::Redo(Redo { steps: 1 });
        let mut is_there = false;
        for step in [undo, redo] {
            for _ in 0..STEPS {
                let now = self.outcome(&bus).await?;
                is_there = Outcome { tour: None, ..now } == self.start;
                // A step that nothing is left for is refused.
                if is_there || change(&bus, step.clone()).await.is_err() {
                    break;
                }
            }
            if is_there {
                break;
            }
        }
        // "It" means nothing of what was said before.
        change(&bus, Action::Select(Select::default())).await?;
        Ok(is_there)
    }
}

/// What does not hold, and whether something else changed.
fn judge(utterance: &Utterance, before: &Outcome, after: &Outcome, asks: bool) -> (Vec<String>, bool) {
    let mut accepted = before.clone();
    let mut problems = Vec::new();
    for condition in &utterance.expect {
        if !condition.holds(before, after, asks) {
            problems.push(format!("{condition:?}"));
        }
        condition.accept(&mut accepted, after);
    }
    let others = accepted.differences(after);
    let is_false_action = !others.is_empty();
    problems.extend(others);
    (problems, is_false_action)
}

/// Writes the scene, and reads its Gaussians.
fn write_scene(folder: &Path) -> Result<(PathBuf, Scene), EvalError> {
    let counts: Vec<(&str, usize)> = UNITS.iter().map(|(name, count, _)| (*name, *count)).collect();
    let mut units = test_scene(&counts).units;
    let mut text = String::from("schema = 1\n");
    for (unit, (name, _, palette)) in units.iter_mut().zip(UNITS) {
        unit.palette = Vec3::from_array(palette);
        for (i, place) in unit.gaussians.position.iter_mut().enumerate() {
            *place = match name {
                "vessels" => *place,
                "bone" => *place * Vec3::new(0.8, 0.8, 0.25) + Vec3::new(0.0, 1.0, 7.0),
                "tissue" => *place * Vec3::new(0.9, 0.9, 0.6),
                // A ball on the right, and a thin rod.
                _ if i < SAC => Vec3::new(8.5, 2.0, 5.0) + 0.1 * (*place - Vec3::splat(5.0)),
                // Near the ball, so that the two together are neither long nor thin.
                _ => Vec3::new(8.9, 2.0, 5.0) + (*place - Vec3::splat(5.0)) * Vec3::new(0.01, 0.01, 0.12),
            };
        }
        let file = format!("{name}.ply");
        let one = Scene::compose(vec![unit.clone()], None);
        save(&folder.join(&file), &one, &SaveOptions::default()).map_err(broken)?;
        // Writing to a string cannot fail.
        let _ = write!(text, "[[unit]]\nname = \"{name}\"\nfile = \"{file}\"\npalette = {palette:?}\n");
    }
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).map_err(broken)?;
    let loaded = sg_formats::load(&path, &sg_formats::LoadOptions::default()).map_err(broken)?;
    Ok((path, loaded.scene))
}

/// Makes the state that each utterance begins from.
async fn set_up(stack: &Stack, opened: &EditState, samples: &BTreeMap<String, usize>) -> Result<Outcome, EvalError> {
    let bus = stack.join(role::CLI).await.map_err(broken)?;
    let unit = |name: &str| Some(Target { units: vec![name.to_owned()], ..Target::default() });
    let others = opened.base_units().iter().find(|base| base.name == OTHERS).map_or(0, |base| base.first);
    let parts = [
        ("sac", others..others + SAC, Color { red: 0.1, green: 0.25, blue: 0.85 }),
        ("clip", others + SAC..others + SAC + CLIP, Color { red: 0.55, green: 0.56, blue: 0.58 }),
    ];
    for (name, range, color) in parts {
        change(&bus, select_range(opened.count(), range)).await?;
        change(&bus, Action::SaveUnit(SaveUnit { name: name.to_owned(), replace: false })).await?;
        change(&bus, Action::SetColor(SetColor { target: unit(name), color: Some(color) })).await?;
    }
    change(&bus, Action::SetOpacity(SetOpacity { target: unit("tissue"), factor: 0.4, relative: false })).await?;
    let turn = |azimuth_degrees| {
        let orbit = Orbit { azimuth_degrees, elevation_degrees: 10.0 };
        Action::SetView(SetView { change: Some(set_view::Change::Orbit(orbit)) })
    };
    for (name, azimuth) in [("entry", 40.0), ("overview", 75.0)] {
        change(&bus, turn(azimuth)).await?;
        change(&bus, Action::KeepView(KeepView { name: name.to_owned() })).await?;
    }
    let initial = set_view::Change::Named(sg_proto::scene::NamedView::Initial.into());
    change(&bus, Action::SetView(SetView { change: Some(initial) })).await?;
    change(&bus, Action::Select(Select::default())).await?;
    outcome(&bus, opened, samples).await
}

async fn change(bus: &Bus, action: Action) -> Result<(), EvalError> {
    apply(bus, action, &soon()).await.map(|_| ()).map_err(|fault| broken(fault.message))
}

async fn outcome(bus: &Bus, opened: &EditState, samples: &BTreeMap<String, usize>) -> Result<Outcome, EvalError> {
    let whole = ChangesRequest { from: 0, snapshot: true };
    let changes = bus.ask(&keys::SCENE_CHANGES, &whole, &soon()).await.map_err(|fault| broken(fault.message))?;
    let snapshot = changes.snapshot.ok_or_else(|| broken("no snapshot where one was asked for"))?;
    let state = EditState::from_snapshot(&snapshot).map_err(broken)?;
    let tour = bus.newest(&keys::CORE_STATE, &soon()).await.map_err(|fault| broken(fault.message))?.tour;
    Ok(Outcome::of(&state, opened, samples, tour.as_ref()))
}
