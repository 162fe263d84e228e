//! Checks of the role that owns the scene.

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    AdjustTransferFunction, Changes, ChangesRequest, Color, Command, CommandResult, ControlPoint, DeleteGaussians,
    DuplicateGaussians, FilesRequest, ForgetView, KeepView, MeasureRequest, MergeUnits, Placements, RestoreGaussians,
    SaveUnit, Select, SetBackground, SetColor, SetLock, SetOpacity, SetTone, SetTransferFunction, SetView, State,
    Target, TransferFunction, TransformGaussians, Undo, ValueRange, ValueScale, Vector, set_view,
};

use super::question::{Question, hold, refused_as, soon};
use super::stage::{Stage, decode, next_of, text_of};
use super::{Checks, Subject, content};

pub(super) const ROLE: &str = role::SCENE;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[], question, essence };

fn question(id: &str) -> Question {
    Question::of(&keys::SCENE_APPLY, &background(id, 0.25))
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let result: CommandResult = decode(payload)?;
    Ok(text_of(&CommandResult { repeated: false, ..result }))
}

fn background(id: &str, red: f32) -> Command {
    let color = Some(Color { red, green: 0.0, blue: 0.0 });
    Command { id: id.to_owned(), expected_revision: 0, action: Some(Action::SetBackground(SetBackground { color })) }
}

pub(super) fn named(name: &str) -> Option<Target> {
    Some(Target { units: vec![name.to_owned()], ..Target::default() })
}

fn red(name: &str) -> Action {
    let color = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
    Action::SetColor(SetColor { target: named(name), color })
}

/// Moves a unit along x.
pub(super) fn shift(name: &str, x: f64) -> Action {
    let shift = Some(Vector { x, y: 0.0, z: 0.0 });
    Action::TransformGaussians(TransformGaussians { target: named(name), shift, ..TransformGaussians::default() })
}

/// Shows values of the volume from `low` on.
pub(super) fn show_from(low: f64) -> Action {
    let point =
        |value, opacity| ControlPoint { value, color: Some(Color { red: 0.9, green: 0.8, blue: 0.2 }), opacity };
    let points = vec![point(low, 0.0), point(low, 0.6)];
    let function =
        TransferFunction { low: -200.0, high: 400.0, normalized: false, scale: ValueScale::Linear.into(), points };
    Action::SetTransferFunction(SetTransferFunction { function: Some(function) })
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("tells and shows an accepted change", change(stage).await);
    checks.note("refuses what does not fit the scene", misfits(stage).await);
    checks.note("applies a command once", once(stage).await);
    checks.note("refuses another command under the same id", taken(stage).await);
    checks.note("takes back what it is told to", undo(stage).await);
    checks.note("deletes Gaussians and brings them back", deletes(stage).await);
    checks.note("moves, turns and scales what it is told to", moves(stage).await);
    checks.note("duplicates Gaussians and takes the copies away", duplicates(stage).await);
    checks.note("keeps viewpoints under names", kept_views(stage).await);
    checks.note("merges units and changes tones", merges(stage).await);
    checks.note("takes another transfer function", transfer_functions(stage).await);
    checks.note("gives readers what they missed", catching_up(stage).await);
    checks.note("sends its files to other machines", files(stage).await);
    checks.note("keeps what it acknowledged through kill -9", kept(stage).await);
}

async fn files(stage: &mut Stage<'_>) -> Result<(), String> {
    let listed = stage.cli.ask(&keys::SCENE_FILES, &FilesRequest {}, &soon()).await.map_err(|f| f.to_string())?;
    hold(listed.files.iter().any(|f| f.name == listed.open), || format!("`{}` is not among the files", listed.open))?;
    for file in &listed.files {
        let sent = content::whole(stage, &keys::SCENE_CONTENT, &file.hash).await?;
        hold(sent.len() as u64 == file.bytes, || format!("{}: {} bytes were sent", file.name, sent.len()))?;
    }
    content::unknown(stage, &keys::SCENE_CONTENT).await
}

async fn change(stage: &mut Stage<'_>) -> Result<(), String> {
    let mut events = stage.cli.subscribe(&keys::SCENE_EVENT, ROLE, 64).await.map_err(|e| e.to_string())?;
    let id = stage.new_id();
    let command = Command { id: id.clone(), expected_revision: 0, action: Some(red("sac")) };
    let context = soon().at_step("talk", 3);
    let before = stage.scene_state().await?.revision;
    let result = stage.cli.ask(&keys::SCENE_APPLY, &command, &context).await.map_err(|f| f.to_string())?;
    hold(result.revision == before + 1 && !result.repeated, || format!("{result:?} after revision {before}"))?;
    let (event, told) = next_of(&mut events, "event/change", |e, _| e.command_id == id).await?;
    hold(event.revision == result.revision && !event.changes.is_empty(), || format!("event {event:?}"))?;
    hold(told.conversation == "talk" && told.step == 3, || {
        format!("the event belongs to `{}` step {}, the command to `talk` step 3", told.conversation, told.step)
    })?;
    let state = stage.scene_state().await?;
    let sac = state.base_units.iter().find(|u| u.name == "sac").and_then(|u| u.palette).unwrap_or_default();
    hold(state.revision == result.revision && sac.red > 0.99 && sac.green < 0.01, || {
        format!("the state shows {sac:?} at revision {}", state.revision)
    })
}

async fn misfits(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = stage.scene_state().await?;
    let command = |action| Command { id: "misfit".to_owned(), expected_revision: 0, action };
    let negative = SetOpacity { target: named("sac"), factor: -1.0, relative: false };
    let old = Command { expected_revision: before.revision + 1000, ..command(Some(red("sac"))) };
    let wrong = &[Code::InvalidArgument, Code::OutOfRange][..];
    for (n, (command, codes)) in [
        (command(None), wrong),
        (command(Some(red("no such unit"))), &[Code::NotFound]),
        (command(Some(Action::SetOpacity(negative))), wrong),
        (old, &[Code::FailedPrecondition, Code::Aborted]),
    ]
    .into_iter()
    .enumerate()
    {
        let id = format!("misfit-{n}");
        let question = Question::of(&keys::SCENE_APPLY, &Command { id: id.clone(), ..command });
        refused_as(stage.put(&question, &id).await, codes).map_err(|why| format!("misfit {n}: {why}"))?;
    }
    let after = stage.scene_state().await?;
    hold(after == before, || "a refused command changed the scene".to_owned())
}

async fn once(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    let command = background(&id, 0.5);
    let first = stage.cli.ask(&keys::SCENE_APPLY, &command, &soon()).await.map_err(|f| f.to_string())?;
    let second = stage.cli.ask(&keys::SCENE_APPLY, &command, &soon()).await.map_err(|f| f.to_string())?;
    hold(second == CommandResult { repeated: true, ..first.clone() }, || format!("{first:?}, then {second:?}"))?;
    let now = stage.scene_state().await?.revision;
    hold(now == first.revision, || format!("revision {now} after one change to {}", first.revision))
}

async fn taken(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    let first = stage.cli.ask(&keys::SCENE_APPLY, &background(&id, 0.5), &soon()).await.map_err(|f| f.to_string())?;
    let other = Question::of(&keys::SCENE_APPLY, &background(&id, 0.6));
    refused_as(stage.put(&other, &id).await, &[Code::AlreadyExists])?;
    let question = Command { id, ..Command::default() };
    let stored = stage.cli.ask(&keys::SCENE_APPLY, &question, &soon()).await.map_err(|f| f.to_string())?;
    hold(stored == CommandResult { repeated: true, ..first.clone() }, || format!("{first:?}, but stored {stored:?}"))?;
    let now = stage.scene_state().await?.revision;
    hold(now == first.revision, || format!("revision {now} after one change to {}", first.revision))
}

async fn undo(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = stage.scene_state().await?;
    stage.change(red("body")).await?;
    stage.change(Action::Undo(Undo { steps: 1 })).await?;
    let after = stage.scene_state().await?;
    hold(after.base_units == before.base_units, || "undo did not bring the palette back".to_owned())
}

async fn deletes(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = stage.scene_state().await?;
    let of = |state: &State| state.base_units.iter().map(|u| (u.name.clone(), u.deleted)).collect::<Vec<_>>();
    let whole = |state: &State| state.selection.as_ref().map_or(0, |s| s.count);
    let everything = Some(Target { everything: true, ..Target::default() });
    let select = || Action::Select(Select { target: everything.clone(), operation: 0 });
    stage.change(select()).await?;
    stage.change(Action::DeleteGaussians(DeleteGaussians { target: named("sac") })).await?;
    let sac = before.base_units.iter().find(|u| u.name == "sac").map_or(0, |u| u.count);
    let deleted = stage.scene_state().await?;
    hold(of(&deleted).contains(&("sac".to_owned(), sac)), || format!("the unit is not deleted: {:?}", of(&deleted)))?;
    let left = before.count - sac;
    hold(whole(&deleted) == left, || format!("{} of {left} stay selected", whole(&deleted)))?;
    stage.change(select()).await?;
    let again = stage.scene_state().await?;
    hold(whole(&again) == left, || format!("{} selected of the {left} that exist", whole(&again)))?;
    // What is locked is neither selected nor deleted.
    stage.change(Action::SetLock(SetLock { target: named("body"), locked: true })).await?;
    let none = stage.scene_state().await?;
    hold(whole(&none) == 0, || format!("{} of a locked unit stay selected", whole(&none)))?;
    let id = stage.new_id();
    let action = Some(Action::DeleteGaussians(DeleteGaussians { target: named("body") }));
    let refused = Question::of(&keys::SCENE_APPLY, &Command { id: id.clone(), expected_revision: 0, action });
    refused_as(stage.put(&refused, &id).await, &[Code::FailedPrecondition])?;
    stage.change(Action::RestoreGaussians(RestoreGaussians {})).await?;
    let restored = stage.scene_state().await?;
    hold(of(&restored) == of(&before), || format!("not all came back: {:?}", of(&restored)))?;
    stage.change(Action::Undo(Undo { steps: 5 })).await?;
    let undone = stage.scene_state().await?;
    hold(of(&undone) == of(&before), || format!("undo left {:?}", of(&undone)))
}

async fn merges(stage: &mut Stage<'_>) -> Result<(), String> {
    let of = |state: &State| {
        let units = state.units.iter().map(|u| (u.name.clone(), u.count, u.tone.map(|tone| tone.saturation)));
        units.collect::<Vec<_>>()
    };
    let before = of(&stage.scene_state().await?);
    let mut counts = Vec::new();
    for (part, name) in [("sac", "first part"), ("body", "second part")] {
        stage.change(Action::Select(Select { target: named(part), operation: 0 })).await?;
        stage.change(Action::SaveUnit(SaveUnit { name: name.to_owned(), replace: false })).await?;
        counts.push(stage.scene_state().await?.selection.map_or(0, |s| s.count));
    }
    let grey = SetTone { target: named("first part"), saturation: Some(0.5), ..SetTone::default() };
    stage.change(Action::SetTone(grey)).await?;
    let apart = of(&stage.scene_state().await?);
    let units = vec!["first part".to_owned(), "second part".to_owned()];
    stage.change(Action::MergeUnits(MergeUnits { units, name: "both".to_owned() })).await?;
    let merged = of(&stage.scene_state().await?);
    let made: Vec<_> = merged.iter().filter(|unit| !before.contains(unit)).cloned().collect();
    let want = vec![("both".to_owned(), counts.iter().sum(), Some(0.5))];
    hold(made == want && merged.len() == before.len() + 1, || format!("merged, the units are {merged:?}"))?;
    stage.change(Action::Undo(Undo { steps: 1 })).await?;
    let again = of(&stage.scene_state().await?);
    hold(again == apart, || format!("one step back, the units are {again:?}, not {apart:?}"))?;
    let id = stage.new_id();
    let action = Some(Action::MergeUnits(MergeUnits { units: vec!["first part".to_owned()], name: String::new() }));
    let refused = Question::of(&keys::SCENE_APPLY, &Command { id: id.clone(), expected_revision: 0, action });
    refused_as(stage.put(&refused, &id).await, &[Code::InvalidArgument])?;
    stage.change(Action::Undo(Undo { steps: 5 })).await?;
    let undone = of(&stage.scene_state().await?);
    hold(undone == before, || format!("undo left {undone:?}"))
}

async fn transfer_functions(stage: &mut Stage<'_>) -> Result<(), String> {
    let shown = async |stage: &Stage<'_>| {
        let whole = changes(stage, ChangesRequest { from: 0, snapshot: true }).await?.snapshot;
        Ok::<_, String>(whole.ok_or("no snapshot where one was asked for")?.transfer_function)
    };
    let Action::SetTransferFunction(set) = show_from(100.0) else { return Err("another action".to_owned()) };
    let before = shown(stage).await?;
    stage.change(Action::SetTransferFunction(set.clone())).await?;
    hold(shown(stage).await? == set.function, || "the scene has another function than the one it took".to_owned())?;
    stage.kill_and_serve().await?;
    hold(shown(stage).await? == set.function, || "the function is lost in a restart".to_owned())?;
    let change = Some(Change::Hide(ValueRange { low: None, high: Some(150.0) }));
    stage.change(Action::AdjustTransferFunction(AdjustTransferFunction { change })).await?;
    hold(shown(stage).await? != set.function, || "hiding values left the function as it was".to_owned())?;
    let change = Some(Change::Hide(ValueRange { low: Some(1e9), high: None }));
    let id = stage.new_id();
    let beyond = Action::AdjustTransferFunction(AdjustTransferFunction { change });
    let beyond = Command { id: id.clone(), expected_revision: 0, action: Some(beyond) };
    refused_as(stage.put(&Question::of(&keys::SCENE_APPLY, &beyond), &id).await, &[Code::OutOfRange])?;
    let mut unordered = set.clone();
    unordered.function.iter_mut().for_each(|f| f.points.reverse());
    unordered.function.iter_mut().flat_map(|f| f.points.first_mut()).for_each(|p| p.value += 1.0);
    let id = stage.new_id();
    let refused =
        Command { id: id.clone(), expected_revision: 0, action: Some(Action::SetTransferFunction(unordered)) };
    refused_as(stage.put(&Question::of(&keys::SCENE_APPLY, &refused), &id).await, &[Code::InvalidArgument])?;
    stage.change(Action::SetLock(SetLock { target: named("sac"), locked: true })).await?;
    let id = stage.new_id();
    let locked = Command { id: id.clone(), expected_revision: 0, action: Some(Action::SetTransferFunction(set)) };
    refused_as(stage.put(&Question::of(&keys::SCENE_APPLY, &locked), &id).await, &[Code::FailedPrecondition])?;
    stage.change(Action::Undo(Undo { steps: 3 })).await?;
    hold(shown(stage).await? == before, || "undo left another function".to_owned())
}

async fn moves(stage: &mut Stage<'_>) -> Result<(), String> {
    let edge = async |stage: &Stage<'_>| {
        let request = MeasureRequest { target: named("sac") };
        let measured = stage.cli.ask(&keys::SCENE_MEASURE, &request, &soon()).await.map_err(|f| f.to_string())?;
        Ok::<f64, String>(measured.edges.unwrap_or_default().x)
    };
    let parts = async |stage: &Stage<'_>| {
        let whole = changes(stage, ChangesRequest { from: 0, snapshot: true }).await?.snapshot;
        Ok::<Placements, String>(whole.ok_or("no snapshot where one was asked for")?.placements.unwrap_or_default())
    };
    let before = edge(stage).await?;
    stage.change(shift("sac", 0.25)).await?;
    let larger = TransformGaussians { target: named("sac"), factor: Some(2.0), ..TransformGaussians::default() };
    stage.change(Action::TransformGaussians(larger)).await?;
    let (after, placed) = (edge(stage).await?, parts(stage).await?);
    hold((after / before - 2.0).abs() < 1e-3, || format!("{before} long, twice as large {after}"))?;
    let scales: Vec<f64> = placed.parts.iter().map(|p| p.map.as_ref().map_or(0.0, |m| m.scale)).collect();
    hold(scales == [2.0], || format!("parts of scales {scales:?} after one unit was moved and scaled"))?;
    let back = TransformGaussians { target: named("sac"), restore: true, ..TransformGaussians::default() };
    stage.change(Action::TransformGaussians(back)).await?;
    hold(edge(stage).await? == before && parts(stage).await?.parts.is_empty(), || "put back, it is elsewhere".into())?;
    stage.change(Action::Undo(Undo { steps: 1 })).await?;
    hold(parts(stage).await? == placed, || "undo gave other places".to_owned())?;
    stage.change(Action::Undo(Undo { steps: 2 })).await?;
    stage.change(Action::SetLock(SetLock { target: named("sac"), locked: true })).await?;
    let id = stage.new_id();
    let refused = Command { id: id.clone(), expected_revision: 0, action: Some(shift("sac", 0.25)) };
    refused_as(stage.put(&Question::of(&keys::SCENE_APPLY, &refused), &id).await, &[Code::FailedPrecondition])?;
    stage.change(Action::Undo(Undo { steps: 1 })).await?;
    hold(edge(stage).await? == before, || "undo left it elsewhere".to_owned())
}

async fn duplicates(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = stage.scene_state().await?;
    let of = |state: &State, name: &str| state.base_units.iter().find(|unit| unit.name == name).cloned();
    let sac = stage.cli.ask(&keys::SCENE_MEASURE, &MeasureRequest { target: named("sac") }, &soon()).await;
    let sac = sac.map_err(|f| f.to_string())?;
    let duplicate = DuplicateGaussians { target: named("sac"), name: "twin".to_owned() };
    stage.change(Action::DuplicateGaussians(duplicate.clone())).await?;
    let after = stage.scene_state().await?;
    let copies = after.count - before.count;
    let twin = of(&after, "twin").ok_or("no base unit of the copies")?;
    hold(twin.duplicated && (twin.first, twin.count) == (before.count, copies) && copies > 0, || {
        format!("{copies} copies, and the unit {twin:?}")
    })?;
    hold(after.selection.as_ref().map(|s| s.count) == Some(copies), || "the copies are not selected".to_owned())?;
    let whole = changes(stage, ChangesRequest { from: 0, snapshot: true }).await?.snapshot;
    let whole = whole.ok_or("no snapshot where one was asked for")?;
    let mask = whole.selection.as_ref().and_then(|s| s.mask.as_ref()).map_or(0, |m| m.length);
    let parts = whole.duplicates.unwrap_or_default().parts;
    let originals: Vec<u64> = parts.iter().map(|p| p.originals.as_ref().map_or(0, |m| m.length)).collect();
    hold(mask == after.count && originals == [before.count], || {
        format!("a mask of {mask} and originals among {originals:?} of {} Gaussians", after.count)
    })?;
    stage.change(shift("twin", 0.25)).await?;
    let measured = stage.cli.ask(&keys::SCENE_MEASURE, &MeasureRequest { target: named("twin") }, &soon()).await;
    let measured = measured.map_err(|f| f.to_string())?;
    let edges = [&sac, &measured].map(|m| m.edges.unwrap_or_default().x);
    hold((edges[0] - edges[1]).abs() < 1e-3 * edges[0], || format!("the sac and its copy are {edges:?} long"))?;
    let id = stage.new_id();
    let taken = Command { id: id.clone(), expected_revision: 0, action: Some(Action::DuplicateGaussians(duplicate)) };
    refused_as(stage.put(&Question::of(&keys::SCENE_APPLY, &taken), &id).await, &[Code::AlreadyExists])?;
    stage.kill_and_serve().await?;
    let kept = stage.scene_state().await?;
    hold(of(&kept, "twin") == of(&stage.scene_state().await?, "twin") && kept.count == after.count, || {
        format!("{} Gaussians after a restart, not {}", kept.count, after.count)
    })?;
    stage.change(Action::Undo(Undo { steps: 2 })).await?;
    let undone = stage.scene_state().await?;
    hold(undone.count == before.count && undone.base_units == before.base_units, || {
        format!("undo left {} Gaussians in {:?}", undone.count, undone.base_units)
    })
}

async fn kept_views(stage: &mut Stage<'_>) -> Result<(), String> {
    let first = stage.scene_state().await?.view;
    let to = |change| Action::SetView(SetView { change: Some(change) });
    stage.change(Action::KeepView(KeepView { name: "entry".to_owned() })).await?;
    stage.change(to(set_view::Change::Zoom(2.0))).await?;
    stage.change(Action::KeepView(KeepView::default())).await?;
    stage.kill_and_serve().await?;
    let state = stage.scene_state().await?;
    let names: Vec<&str> = state.kept_views.iter().map(|kept| kept.name.as_str()).collect();
    hold(names == ["entry", "view 1"] && state.kept_views[1].view == state.view, || format!("{names:?} are kept"))?;
    stage.change(to(set_view::Change::Kept("Entry".to_owned()))).await?;
    let there = stage.scene_state().await?.view;
    hold(there == first && there != state.view, || format!("the view {there:?} in place of {first:?}"))?;
    stage.change(Action::ForgetView(ForgetView { name: "entry".to_owned() })).await?;
    let id = stage.new_id();
    let gone = to(set_view::Change::Kept("entry".to_owned()));
    let gone = Command { id: id.clone(), expected_revision: 0, action: Some(gone) };
    refused_as(stage.put(&Question::of(&keys::SCENE_APPLY, &gone), &id).await, &[Code::NotFound])?;
    stage.change(Action::Undo(Undo { steps: 5 })).await?;
    let undone = stage.scene_state().await?;
    hold(undone.kept_views.is_empty() && undone.view == first, || format!("undo left {:?}", undone.kept_views))
}

async fn changes(stage: &Stage<'_>, request: ChangesRequest) -> Result<Changes, String> {
    stage.cli.ask(&keys::SCENE_CHANGES, &request, &soon()).await.map_err(|f| format!("cmd/changes: {f}"))
}

async fn catching_up(stage: &mut Stage<'_>) -> Result<(), String> {
    let from = stage.scene_state().await?.revision;
    stage.change(red("body")).await?;
    stage.change(red("sac")).await?;
    let missed = changes(stage, ChangesRequest { from, snapshot: false }).await?;
    let revisions: Vec<u64> = missed.events.iter().map(|e| e.revision).collect();
    hold(missed.snapshot.is_some() || revisions == [from + 1, from + 2], || {
        format!("neither a snapshot nor the events {} and {}: {revisions:?}", from + 1, from + 2)
    })?;
    let whole = changes(stage, ChangesRequest { from: 0, snapshot: true }).await?.snapshot;
    let whole = whole.ok_or("no snapshot where one was asked for")?;
    let bits = whole.selection.as_ref().and_then(|s| s.mask.as_ref()).map_or(0, |m| m.length);
    hold(whole.revision == from + 2 && bits == whole.count, || {
        format!("a snapshot of revision {} whose selection has {bits} of {} Gaussians", whole.revision, whole.count)
    })
}

async fn kept(stage: &mut Stage<'_>) -> Result<(), String> {
    let id = stage.new_id();
    let command = background(&id, 0.75);
    let first = stage.cli.ask(&keys::SCENE_APPLY, &command, &soon()).await.map_err(|f| f.to_string())?;
    let before: State = stage.scene_state().await?;
    stage.kill_and_serve().await?;
    let after = stage.scene_state().await?;
    hold(after == before, || format!("revision {} before, {} after", before.revision, after.revision))?;
    let again = stage.cli.ask(&keys::SCENE_APPLY, &command, &soon()).await.map_err(|f| f.to_string())?;
    hold(again == CommandResult { repeated: true, ..first.clone() }, || format!("{first:?}, then {again:?}"))
}
