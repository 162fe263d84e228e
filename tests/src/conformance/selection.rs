//! Checks of the role that turns strokes into selections.

use std::path::Path;
use std::time::Duration;

use sg_edit::wire::decode_mask;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::command::Action;
use sg_proto::scene::selection_operation::Operation;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{
    ChangesRequest, DeleteGaussians, Grow, InSphere, Invert, RestoreGaussians, Select, SelectionOperation,
    SelectionStep, SetVisibility, Stroke, StrokeKind, StrokeMode, Undo, WalkTuning,
};
use sg_proto::selection::{
    AnswerStep, Answers, ProposalsRequest, RegionsRequest, SampleRequest, StrokesReply, StrokesRequest, TuneRequest,
};

use super::question::{Question, hold, refused_as, soon};
use super::scene::{named, shift, show_from};
use super::stage::{Stage, decode};
use super::{Checks, Subject, content};
use crate::small_scene::{GAUSSIANS, SAC, STROKE};

pub(super) const ROLE: &str = role::SELECTION;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[role::SCENE], question, essence };

fn stroke(mode: StrokeMode) -> Stroke {
    let points = [SAC, SAC.map(|x| x + 0.01)].concat();
    Stroke {
        mode: mode.into(),
        kind: StrokeKind::Foreground.into(),
        radius: STROKE,
        points,
        pressure: Vec::new(),
        depth: None,
    }
}

fn strokes(mode: StrokeMode, restart: bool) -> StrokesRequest {
    StrokesRequest { strokes: vec![stroke(mode)], restart, ..StrokesRequest::default() }
}

fn question(_id: &str) -> Question {
    Question::of(&keys::SELECTION_STROKES, &strokes(StrokeMode::Point, true))
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let reply: StrokesReply = decode(payload)?;
    Ok(format!("{} selected, hash {}, revision {}", reply.selected, reply.selection_hash, reply.revision))
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("knows the scene's geometry", geometry(stage).await);
    checks.note("commits what strokes select", commit(stage).await);
    checks.note("takes operations among strokes", operations(stage).await);
    checks.note("selects nothing that is deleted", deleted(stage).await);
    checks.note("selects Gaussians where they are", moved(stage).await);
    checks.note("shows what a stroke would select while it is drawn", previews(stage).await);
    checks.note("tells what strokes select when they end", told(stage).await);
    checks.note("tries another leak and threshold after a walk", tunes(stage).await);
    checks.note("answers a walk at every scale", answers(stage).await);
    checks.note("says where a next stroke would tell most", proposes(stage).await);
    checks.note("has regions at several scales", regions(stage).await);
    checks.note("leaves out what is hidden", hidden(stage).await);
    checks.note("leaves out what the transfer function hides", hidden_by_function(stage).await);
    checks.note("refuses strokes that are none", misfits(stage).await);
    checks.note("goes on where it was after kill -9", goes_on(stage).await);
}

async fn draw(stage: &Stage<'_>, request: &StrokesRequest) -> Result<StrokesReply, String> {
    stage.cli.ask(&keys::SELECTION_STROKES, request, &soon()).await.map_err(|f| format!("cmd/strokes: {f}"))
}

async fn geometry(stage: &Stage<'_>) -> Result<(), String> {
    let state = stage.cli.newest(&keys::SELECTION_STATE, &soon()).await.map_err(|f| f.to_string())?;
    let scene = stage.scene_state().await?;
    hold(state.scene_hash == scene.scene_hash && state.clusters > 0, || {
        format!("{} clusters of geometry {}, the scene is {}", state.clusters, state.scene_hash, scene.scene_hash)
    })?;
    let labels = content::whole(stage, &keys::SELECTION_CONTENT, &state.labels_hash).await?;
    let kept = std::fs::read(&state.labels_path).map_err(|e| format!("{}: {e}", state.labels_path))?;
    hold(labels == kept, || format!("{}: other bytes are sent than are kept", state.labels_path))?;
    let labels = sg_formats::npy::read_labels(Path::new(&state.labels_path)).map_err(|e| e.to_string())?;
    let clusters = labels.iter().max().map_or(0, |l| l + 1);
    hold(labels.len() as u64 == scene.count && clusters == state.clusters as i32, || {
        format!("{} labels, {clusters} clusters in them", labels.len())
    })?;
    content::unknown(stage, &keys::SELECTION_CONTENT).await
}

async fn commit(stage: &Stage<'_>) -> Result<(), String> {
    for mode in [StrokeMode::Point, StrokeMode::Cluster, StrokeMode::Walk] {
        let reply = draw(stage, &strokes(mode, true)).await?;
        let sac = 1..=GAUSSIANS as u64;
        hold(sac.contains(&reply.selected) || mode == StrokeMode::Walk && reply.selected > 0, || {
            format!("{mode:?}: {} Gaussians selected by a stroke within the sac", reply.selected)
        })?;
        let scene = stage.scene_state().await?;
        let selection = scene.selection.unwrap_or_default();
        hold(selection.count == reply.selected && selection.hash == reply.selection_hash, || {
            format!("{mode:?}: the scene has {} selected, the reply says {}", selection.count, reply.selected)
        })?;
    }
    Ok(())
}

async fn deleted(stage: &mut Stage<'_>) -> Result<(), String> {
    stage.change(Action::DeleteGaussians(DeleteGaussians { target: named("sac") })).await?;
    for mode in [StrokeMode::Point, StrokeMode::Cluster, StrokeMode::Walk] {
        let reply = draw(stage, &strokes(mode, true)).await?;
        hold(reply.selected == 0, || format!("{mode:?}: {} selected by a stroke over deleted ones", reply.selected))?;
    }
    let all = draw(stage, &taken(vec![Operation::Invert(Invert {})], true)).await?;
    let selection = stage.scene_state().await?.selection.unwrap_or_default();
    hold(all.selected == GAUSSIANS as u64 && selection.hash == all.selection_hash, || {
        format!("{} selected where {GAUSSIANS} are left, the scene has {}", all.selected, selection.count)
    })?;
    stage.change(Action::RestoreGaussians(RestoreGaussians {})).await?;
    let back = draw(stage, &strokes(StrokeMode::Point, true)).await?;
    hold(back.selected > 0, || "a stroke selects nothing where Gaussians were restored".to_owned())
}

async fn moved(stage: &mut Stage<'_>) -> Result<(), String> {
    let edges = stage.scene_state().await?.r#box.ok_or("no box")?;
    let width = edges.max.unwrap_or_default().x - edges.min.unwrap_or_default().x;
    let at = |x: f64| {
        let points = [SAC, SAC.map(|x| x + 0.01)].concat();
        let points = points.chunks(3).flat_map(|p| [p[0] + x, p[1], p[2]]).collect();
        let strokes = vec![Stroke { points, ..stroke(StrokeMode::Point) }];
        StrokesRequest { strokes, restart: true, ..StrokesRequest::default() }
    };
    let here = draw(stage, &at(0.0)).await?;
    stage.change(shift("sac", 3.0 * width)).await?;
    let kept = stage.scene_state().await?.selection.unwrap_or_default();
    hold(kept.hash == here.selection_hash, || "a move changes what is selected".to_owned())?;
    let there = draw(stage, &at(3.0)).await?;
    hold(there.selection_hash == here.selection_hash, || {
        format!("{} selected there, {} here before the move", there.selected, here.selected)
    })?;
    let nothing = draw(stage, &at(0.0)).await?;
    hold(nothing.selected == 0, || format!("{} selected where nothing is any more", nothing.selected))?;
    stage.change(Action::Undo(Undo { steps: 3 })).await?;
    let back = draw(stage, &at(0.0)).await?;
    hold(back.selection_hash == here.selection_hash, || format!("{} selected after an undo", back.selected))
}

async fn operations(stage: &mut Stage<'_>) -> Result<(), String> {
    let all = draw(stage, &taken(vec![Operation::Invert(Invert {})], true)).await?;
    hold(all.selected == 2 * GAUSSIANS as u64, || format!("{} selected where nothing was inverted", all.selected))?;
    let near = InSphere { centre: SAC.to_vec(), radius: STROKE };
    let sphere = draw(stage, &taken(vec![Operation::Sphere(near.clone())], true)).await?;
    let point = Stroke { points: SAC.to_vec(), ..stroke(StrokeMode::Point) };
    let tube =
        draw(stage, &StrokesRequest { strokes: vec![point], restart: true, ..StrokesRequest::default() }).await?;
    hold(sphere.selected == tube.selected && sphere.selected > 0, || {
        format!("{} in a sphere, {} under a brush of one sample there", sphere.selected, tube.selected)
    })?;
    // Over the stroke that is there: grown, then inverted.
    let grown = draw(stage, &taken(vec![Operation::Grow(Grow { distance: 0.05 })], false)).await?;
    hold(grown.selected > tube.selected, || format!("{} grown to {}", tube.selected, grown.selected))?;
    let others = draw(stage, &taken(vec![Operation::Invert(Invert {})], false)).await?;
    hold(others.selected + grown.selected == GAUSSIANS as u64, || {
        format!("{} and its inverse in the unit, {}, are not all of it", grown.selected, others.selected)
    })?;
    // Each is taken back alone.
    stage.change(Action::Undo(Undo { steps: 1 })).await?;
    let selection = stage.scene_state().await?.selection.unwrap_or_default();
    hold(selection.hash == grown.selection_hash, || format!("{} selected after an undo", selection.count))?;
    // A selection by name is kept when a step follows.
    stage.change(Action::Select(Select { target: named("body"), ..Select::default() })).await?;
    let point = Stroke { points: SAC.to_vec(), ..stroke(StrokeMode::Point) };
    let both = draw(stage, &StrokesRequest { strokes: vec![point], ..StrokesRequest::default() }).await?;
    hold(both.selected == GAUSSIANS as u64 + tube.selected, || {
        format!("{} selected: a unit by name and {} by a stroke", both.selected, tube.selected)
    })
}

async fn hidden_by_function(stage: &mut Stage<'_>) -> Result<(), String> {
    for mode in [StrokeMode::Point, StrokeMode::Cluster, StrokeMode::Walk] {
        let shown = draw(stage, &strokes(mode, true)).await?;
        stage.change(show_from(300.0)).await?;
        let none = draw(stage, &strokes(mode, true)).await?;
        hold(none.selected == 0 && shown.selected > 0, || {
            format!("{mode:?}: {} selected of {} that the function hides", none.selected, shown.selected)
        })?;
        let all = draw(stage, &StrokesRequest { include_hidden: true, ..strokes(mode, true) }).await?;
        hold(all.selected == shown.selected, || {
            format!("{mode:?}: {} selected with what is hidden, {} while it was shown", all.selected, shown.selected)
        })?;
        stage.change(Action::Undo(Undo { steps: 3 })).await?;
    }
    Ok(())
}

/// Selections leave out hidden Gaussians, but for those selected before and those of a request that includes them.
async fn hidden(stage: &mut Stage<'_>) -> Result<(), String> {
    let seen = |visible| Action::SetVisibility(SetVisibility { target: named("sac"), visible });
    for mode in [StrokeMode::Point, StrokeMode::Cluster, StrokeMode::Walk] {
        let shown = draw(stage, &strokes(mode, true)).await?;
        stage.change(seen(false)).await?;
        let kept = draw(stage, &strokes(mode, false)).await?;
        hold(kept.selected == shown.selected, || {
            format!(
                "{mode:?}: {} selected, {} after a stroke over what was hidden since",
                shown.selected, kept.selected
            )
        })?;
        let none = draw(stage, &strokes(mode, true)).await?;
        let (name, samples) = (stage.new_id(), Some(stroke(mode)));
        let preview = SampleRequest { stroke: name, samples, ..SampleRequest::default() };
        let preview = stage.cli.ask(&keys::SELECTION_SAMPLE, &preview, &soon()).await;
        let preview = preview.map_err(|f| format!("cmd/sample: {f}"))?;
        let selected = selected(stage).await?;
        let of_sac = selected.iter().skip(GAUSSIANS).filter(|s| **s).count();
        hold(of_sac == 0, || format!("{mode:?}: {of_sac} hidden Gaussians of {} selected", none.selected))?;
        hold(preview.selected == none.selected, || {
            format!("{mode:?}: {} selected, {} in the preview of another stroke", none.selected, preview.selected)
        })?;
        let all = draw(stage, &StrokesRequest { include_hidden: true, ..strokes(mode, true) }).await?;
        hold(all.selected == shown.selected, || {
            format!("{mode:?}: {} selected with what is hidden, {} while it was shown", all.selected, shown.selected)
        })?;
        stage.change(seen(true)).await?;
    }
    let inverted = taken(vec![Operation::Invert(Invert {})], true);
    stage.change(seen(false)).await?;
    let body = draw(stage, &inverted).await?;
    stage.change(seen(true)).await?;
    hold(body.selected == GAUSSIANS as u64, || format!("{} selected by inverting nothing", body.selected))
}

/// Steps that are operations.
fn taken(operations: Vec<Operation>, restart: bool) -> StrokesRequest {
    let step = |operation| SelectionStep {
        step: Some(Step::Operation(SelectionOperation { operation: Some(operation), ..Default::default() })),
    };
    StrokesRequest { restart, steps: operations.into_iter().map(step).collect(), ..StrokesRequest::default() }
}

async fn previews(stage: &mut Stage<'_>) -> Result<(), String> {
    for mode in [StrokeMode::Point, StrokeMode::Cluster, StrokeMode::Walk] {
        draw(stage, &StrokesRequest { restart: true, ..StrokesRequest::default() }).await?;
        let revision = stage.scene_state().await?.revision;
        let mut shown = vec![false; 2 * GAUSSIANS];
        let (name, whole) = (stage.new_id(), stroke(mode));
        let mut newest = 0;
        for sample in whole.points.chunks(3) {
            let samples = Some(Stroke { points: sample.to_vec(), ..whole.clone() });
            let request = SampleRequest { stroke: name.clone(), samples, ..SampleRequest::default() };
            let reply = stage.cli.ask(&keys::SELECTION_SAMPLE, &request, &soon()).await;
            let reply = reply.map_err(|f| format!("cmd/sample: {f}"))?;
            if reply.relative_to_committed {
                shown.fill(false);
            }
            flip(&mut shown, &reply.changed)?;
            newest = reply.selected;
            let count = shown.iter().filter(|s| **s).count() as u64;
            hold(count == newest, || format!("{mode:?}: {count} shown, {newest} selected, it says"))?;
        }
        hold(stage.scene_state().await?.revision == revision, || "a preview changed the scene".to_owned())?;
        let done = draw(stage, &strokes(mode, false)).await?;
        hold(done.selected == newest, || format!("{mode:?}: {newest} previewed, {} selected", done.selected))?;
    }
    Ok(())
}

/// Takes runs of Gaussians, passed over and meant in turn, for otherwise than they were.
fn flip(shown: &mut [bool], runs: &[u32]) -> Result<(), String> {
    let mut at = 0;
    for run in runs.chunks(2) {
        let (skipped, length) = (run[0] as usize, run.get(1).copied().unwrap_or(0) as usize);
        at += skipped;
        let changed = shown.get_mut(at..at + length).ok_or("a run beyond the scene")?;
        changed.iter_mut().for_each(|s| *s = !*s);
        at += length;
    }
    Ok(())
}

async fn told(stage: &Stage<'_>) -> Result<(), String> {
    let empty = draw(stage, &StrokesRequest { restart: true, ..StrokesRequest::default() }).await?;
    let heard = stage.cli.subscribe(&keys::SELECTION_PREVIEW, ROLE, 64).await;
    let mut heard = heard.map_err(|e| e.to_string())?;
    let done = draw(stage, &strokes(StrokeMode::Point, false)).await?;
    let next = tokio::time::timeout(soon().remaining(), heard.next()).await;
    let (preview, _) = next.ok().flatten().ok_or("event/preview: nothing was told")?;
    let mut shown = vec![false; 2 * GAUSSIANS];
    flip(&mut shown, &preview.changed)?;
    let count = shown.iter().filter(|s| **s).count() as u64;
    hold(preview.selection_hash == empty.selection_hash, || "a preview over another selection".to_owned())?;
    hold(count == preview.selected && count == done.selected, || {
        format!("{count} shown, {} said, {} selected", preview.selected, done.selected)
    })
}

async fn tunes(stage: &mut Stage<'_>) -> Result<(), String> {
    let state = stage.cli.newest(&keys::SELECTION_STATE, &soon()).await.map_err(|f| f.to_string())?;
    let first = state.tuning.ok_or("its state does not say what walks are done with")?;
    let request = |tuning| TuneRequest { tuning: Some(tuning) };
    draw(stage, &StrokesRequest { restart: true, ..StrokesRequest::default() }).await?;
    let early = Question::of(&keys::SELECTION_TUNE, &request(first));
    let id = stage.new_id();
    refused_as(stage.put(&early, &id).await, &[Code::FailedPrecondition]).map_err(|why| format!("no walk: {why}"))?;
    let walked = draw(stage, &strokes(StrokeMode::Walk, true)).await?;
    // The first answer may have chosen another leak.
    let first = walked.answers.as_ref().and_then(|answers| answers.tuning).unwrap_or(first);
    let committed = selected(stage).await?;
    let revision = stage.scene_state().await?.revision;
    // Without a leak the walk has nothing to stop at within the unit.
    let mut newest = None;
    for tuning in [WalkTuning { threshold: 0.9, ..first }, first, WalkTuning { leak: 0.0, threshold: -0.5 }] {
        let reply = stage.cli.ask(&keys::SELECTION_TUNE, &request(tuning), &soon()).await;
        let reply = reply.map_err(|f| format!("cmd/tune: {f}"))?;
        let mut shown = committed.clone();
        flip(&mut shown, &reply.changed)?;
        let count = shown.iter().filter(|s| **s).count() as u64;
        hold(count == reply.selected && reply.selection_hash == walked.selection_hash, || {
            format!("{tuning:?}: {count} shown, {} selected, it says, over {}", reply.selected, reply.selection_hash)
        })?;
        let fits = match newest.map(|(_, before)| before) {
            None => reply.selected <= walked.selected,
            Some(_) if tuning == first => reply.selected == walked.selected,
            Some(_) => reply.selected >= walked.selected,
        };
        hold(fits, || format!("{tuning:?}: {} selected, {} by the walk as it was", reply.selected, walked.selected))?;
        newest = Some((tuning, reply.selected));
    }
    hold(stage.scene_state().await?.revision == revision, || "what was tried changed the scene".to_owned())?;
    let (tuning, previewed) = newest.unwrap_or_default();
    let steps = vec![SelectionStep { step: Some(Step::Tuning(tuning)) }];
    let done = draw(stage, &StrokesRequest { steps, ..StrokesRequest::default() }).await?;
    hold(done.selected == previewed, || format!("{previewed} tried, {} selected", done.selected))?;
    stage.change(Action::Undo(Undo { steps: 1 })).await?;
    let back = stage.scene_state().await?.selection.unwrap_or_default();
    hold(back.hash == walked.selection_hash, || format!("{} selected after an undo", back.count))?;
    let wrong = &[Code::InvalidArgument, Code::OutOfRange];
    for (what, bad) in [
        ("nothing", None),
        ("a negative leak", Some(WalkTuning { leak: -0.1, ..first })),
        ("a leak that is no number", Some(WalkTuning { leak: f64::NAN, ..first })),
        ("a threshold of 1", Some(WalkTuning { threshold: 1.0, ..first })),
    ] {
        let id = stage.new_id();
        let question = Question::of(&keys::SELECTION_TUNE, &TuneRequest { tuning: bad });
        refused_as(stage.put(&question, &id).await, wrong).map_err(|why| format!("{what}: {why}"))?;
    }
    Ok(())
}

/// The answers that the service's state has at this revision of the scene or a later one.
async fn told_answers(stage: &Stage<'_>, revision: u64) -> Result<Option<Answers>, String> {
    let context = soon();
    loop {
        let state = stage.cli.newest(&keys::SELECTION_STATE, &context).await.map_err(|f| f.to_string())?;
        if state.revision >= revision {
            return Ok(state.answers);
        }
        hold(!context.remaining().is_zero(), || format!("its state stays at revision {}", state.revision))?;
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Takes every answer to a stroke, one after another. A service may have a single one.
async fn answers(stage: &mut Stage<'_>) -> Result<(), String> {
    let other = |answer: AnswerStep| StrokesRequest { answer: answer.into(), ..StrokesRequest::default() };
    let refused = &[Code::FailedPrecondition];
    draw(stage, &StrokesRequest { restart: true, ..StrokesRequest::default() }).await?;
    let id = stage.new_id();
    let early = stage.put(&Question::of(&keys::SELECTION_STROKES, &other(AnswerStep::Wider)), &id).await;
    refused_as(early, refused).map_err(|why| format!("no walk: {why}"))?;
    let first = draw(stage, &strokes(StrokeMode::Walk, true)).await?;
    let told = told_answers(stage, first.revision).await?;
    hold(told == first.answers, || format!("its state has {told:?}, the reply says {:?}", first.answers))?;
    let Some(answers) = first.answers.clone() else { return Ok(()) };
    let steps = answers.steps.as_slice();
    hold(!steps.is_empty() && answers.taken == answers.first && answers.tuning.is_some(), || format!("{answers:?}"))?;
    let nested = steps.windows(2).all(|pair| pair[0].gaussians < pair[1].gaussians && pair[0].leak > pair[1].leak);
    hold(nested, || format!("its answers are not nested: {steps:?}"))?;
    let mut newest = draw(stage, &other(AnswerStep::Narrowest)).await.unwrap_or_else(|_| first.clone());
    let mut changes = u32::from(newest.revision != first.revision);
    for (step, answer) in (0..).zip(steps) {
        if step > 0 {
            newest = draw(stage, &other(AnswerStep::Wider)).await?;
            changes += 1;
        }
        let found = newest.answers.clone().unwrap_or_default();
        hold(found.taken == step && found.steps == answers.steps && found.first == answers.first, || {
            format!("answer {step} of {answers:?} became {found:?}")
        })?;
        hold(newest.selected == answer.gaussians && found.tuning.map(|t| t.leak) == Some(answer.leak), || {
            format!("{} selected by {answer:?}", newest.selected)
        })?;
        let told = told_answers(stage, newest.revision).await?;
        hold(told.as_ref() == Some(&found), || format!("its state has {told:?}, the reply says {found:?}"))?;
    }
    let id = stage.new_id();
    let beyond = stage.put(&Question::of(&keys::SELECTION_STROKES, &other(AnswerStep::Wider)), &id).await;
    refused_as(beyond, refused).map_err(|why| format!("wider than the widest: {why}"))?;
    // The choice is among the steps of the scene.
    stage.kill_and_serve().await?;
    let again = told_answers(stage, newest.revision).await?;
    hold(again == newest.answers, || format!("{again:?} after a restart, {:?} before", newest.answers))?;
    if changes > 0 {
        stage.change(Action::Undo(Undo { steps: changes })).await?;
    }
    let back = stage.scene_state().await?.selection.unwrap_or_default();
    hold(back.hash == first.selection_hash, || format!("{} selected after the choices were undone", back.count))?;
    let id = stage.new_id();
    let unknown = StrokesRequest { answer: 99, ..StrokesRequest::default() };
    let unknown = stage.put(&Question::of(&keys::SELECTION_STROKES, &unknown), &id).await;
    refused_as(unknown, &[Code::InvalidArgument]).map_err(|why| format!("no known answer: {why}"))
}

/// Whether each Gaussian is selected.
async fn selected(stage: &Stage<'_>) -> Result<Vec<bool>, String> {
    let whole = ChangesRequest { from: 0, snapshot: true };
    let changes = stage.cli.ask(&keys::SCENE_CHANGES, &whole, &soon()).await.map_err(|f| f.to_string())?;
    let mask = changes.snapshot.and_then(|s| s.selection).and_then(|s| s.mask).ok_or("a snapshot without a mask")?;
    let mask = decode_mask(&mask, 2 * GAUSSIANS, "mask").map_err(|e| e.to_string())?;
    Ok((0..mask.len()).map(|g| mask.get(g)).collect())
}

async fn proposes(stage: &mut Stage<'_>) -> Result<(), String> {
    let state = stage.cli.newest(&keys::SELECTION_STATE, &soon()).await.map_err(|f| f.to_string())?;
    hold(state.most_proposals > 0, || "its state says that it proposes nothing".to_owned())?;
    let request = |count| Question::of(&keys::SELECTION_PROPOSALS, &ProposalsRequest { count });
    draw(stage, &StrokesRequest { restart: true, ..StrokesRequest::default() }).await?;
    let id = stage.new_id();
    let early = stage.put(&request(1), &id).await;
    refused_as(early, &[Code::FailedPrecondition]).map_err(|why| format!("no walk: {why}"))?;
    let walked = draw(stage, &strokes(StrokeMode::Walk, true)).await?;
    let asked = ProposalsRequest { count: 3 };
    let reply = stage.cli.ask(&keys::SELECTION_PROPOSALS, &asked, &soon()).await;
    let reply = reply.map_err(|f| format!("cmd/proposals: {f}"))?;
    hold(reply.selection_hash == walked.selection_hash, || "proposals about another selection".to_owned())?;
    hold((1..=3).contains(&reply.proposals.len()), || format!("{} of 3 proposals", reply.proposals.len()))?;
    for one in &reply.proposals {
        let share = (0.0..=1.0).contains(&one.p) && (0.0..=1.0).contains(&one.q) && one.p + one.q < 1.0 + 1e-6;
        let numbers = one.expected_change >= 0.0 && one.expected_shift >= 0.0 && one.point.len() == 3;
        hold(share && numbers && one.cluster < state.clusters && one.gaussians > 0, || format!("{one:?}"))?;
    }
    // A walk stroke of no width at the place seeds it.
    let best = reply.proposals.first().cloned().unwrap_or_default();
    let there = Stroke { points: best.point, radius: 1e-6, ..stroke(StrokeMode::Walk) };
    let after = draw(stage, &StrokesRequest { strokes: vec![there], ..StrokesRequest::default() }).await?;
    hold(after.seeds_foreground == walked.seeds_foreground + 1, || {
        format!("{} clusters seeded before, {} after", walked.seeds_foreground, after.seeds_foreground)
    })?;
    for count in [0, state.most_proposals + 1] {
        let id = stage.new_id();
        let question = request(count);
        let wrong = &[Code::InvalidArgument, Code::OutOfRange];
        refused_as(stage.put(&question, &id).await, wrong).map_err(|why| format!("{count} places: {why}"))?;
    }
    Ok(())
}

async fn regions(stage: &mut Stage<'_>) -> Result<(), String> {
    let request = |count| Question::of(&keys::SELECTION_REGIONS, &RegionsRequest { count });
    let asked = RegionsRequest { count: 12 };
    let reply = stage.cli.ask(&keys::SELECTION_REGIONS, &asked, &soon()).await;
    let reply = reply.map_err(|f| format!("cmd/regions: {f}"))?;
    hold((1..=12).contains(&reply.regions.len()), || format!("{} of 12 regions", reply.regions.len()))?;
    let falls = reply.regions.windows(2).all(|pair| pair[0].prominence >= pair[1].prominence);
    hold(falls && reply.regions.iter().all(|r| (0.0..=1.0).contains(&r.prominence)), || format!("{reply:?}"))?;
    let labels = sg_formats::npy::read_labels(Path::new(&reply.labels_path)).map_err(|e| e.to_string())?;
    let state = stage.cli.newest(&keys::SELECTION_STATE, &soon()).await.map_err(|f| f.to_string())?;
    hold(reply.labels_hash == state.labels_hash, || "regions of other labels than those of its state".to_owned())?;
    for (at, region) in reply.regions.iter().enumerate() {
        let is_in = |label: &i32| region.clusters.iter().any(|c| i64::from(*c) == i64::from(*label));
        let members = labels.iter().filter(|label| is_in(label)).count() as u64;
        hold(members == region.gaussians && members > 0, || format!("{members} Gaussians are in {region:?}"))?;
        let is_new = reply.regions[..at].iter().all(|other| other.clusters != region.clusters);
        hold(is_new, || format!("twice: {region:?}"))?;
    }
    let id = stage.new_id();
    let wrong = &[Code::InvalidArgument, Code::OutOfRange];
    refused_as(stage.put(&request(257), &id).await, wrong).map_err(|why| format!("257 regions: {why}"))
}

async fn misfits(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = stage.scene_state().await?.revision;
    let good = stroke(StrokeMode::Point);
    let wrong = &[Code::InvalidArgument, Code::OutOfRange];
    for (what, bad) in [
        ("no mode", Stroke { mode: 0, ..good.clone() }),
        ("no kind", Stroke { kind: 0, ..good.clone() }),
        ("a negative radius", Stroke { radius: -1.0, ..good.clone() }),
        ("coordinates that are not triples", Stroke { points: vec![0.5; 4], ..good.clone() }),
        ("a coordinate that is no number", Stroke { points: vec![f64::NAN; 3], ..good }),
    ] {
        let id = stage.new_id();
        let request = StrokesRequest { strokes: vec![bad], ..StrokesRequest::default() };
        let question = Question::of(&keys::SELECTION_STROKES, &request);
        refused_as(stage.put(&question, &id).await, wrong).map_err(|why| format!("{what}: {why}"))?;
    }
    let id = stage.new_id();
    let nothing = Question::of(&keys::SELECTION_STROKES, &StrokesRequest::default());
    refused_as(stage.put(&nothing, &id).await, wrong).map_err(|why| format!("no strokes: {why}"))?;
    let after = stage.scene_state().await?.revision;
    hold(after == before, || "a refused stroke changed the scene".to_owned())
}

async fn goes_on(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = draw(stage, &strokes(StrokeMode::Point, true)).await?;
    stage.kill_and_serve().await?;
    let mut more = strokes(StrokeMode::Point, false);
    if let Some(stroke) = more.strokes.first_mut() {
        stroke.radius *= 1.5;
    }
    let after = draw(stage, &more).await?;
    hold(after.selected > before.selected, || {
        format!("{} selected before, {} after a wider stroke more", before.selected, after.selected)
    })?;
    let strokes = stage.scene_state().await?.selection.map_or(0, |s| s.count);
    hold(strokes == after.selected, || format!("the scene has {strokes} selected, the reply says {}", after.selected))
}
