//! A robot that corrects a selection: each further click goes to the largest error.

use std::sync::Arc;

use glam::DVec3;
use sg_clusters::neighbours::Graph;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_selection::answers::Scale;
use sg_selection::mask_agreement::Agreement;
use sg_selection::selection_index::SelectionIndex;
use sg_selection::session::{SelectionError, SelectionSession};
use sg_selection::strokes::{Kind, Mode, Stroke};
use sg_selection::tuning::Tuning;

/// Most strokes and choices of one target.
pub const MOST: usize = 12;

/// IoU with the target.
#[must_use]
pub fn iou(mask: &Mask, target: &[bool]) -> f64 {
    Agreement::of(target.iter().enumerate().map(|(g, t)| (mask.get(g), *t))).iou
}

/// The IoU of the three answers to one stroke: narrower, first, wider. A missing one counts as the first.
///
/// # Errors
/// [`SelectionError`].
pub fn three(index: &Arc<SelectionIndex>, stroke: &Stroke, target: &[bool]) -> Result<[f64; 3], SelectionError> {
    let mut session = SelectionSession::new(Arc::clone(index));
    session.add_stroke(stroke.clone())?;
    let first = iou(session.mask(), target);
    let mut out = [first; 3];
    let answers = session.answers()?.cloned();
    for (to, scale) in out.iter_mut().zip([Scale::Narrower, Scale::Default, Scale::Wider]) {
        if let Some(answer) = answers.as_ref().and_then(|a| a.at(scale)) {
            session.tune(Tuning { leak: answer.leak, ..session.tuning() })?;
            *to = iou(session.mask(), target);
        }
    }
    Ok(out)
}

/// The IoU after each click: the stroke first, then a click at the largest error. With `choose` the second click goes to a
/// neighbour in scale if that is better.
///
/// # Errors
/// [`SelectionError`].
pub fn clicks(
    index: &Arc<SelectionIndex>,
    (scene, graph): (&Scene, &Graph),
    stroke: &Stroke,
    target: &[bool],
    choose: bool,
) -> Result<Vec<f64>, SelectionError> {
    let mut session = SelectionSession::new(Arc::clone(index));
    session.add_stroke(stroke.clone())?;
    let mut reached = vec![iou(session.mask(), target)];
    if let Some(answers) = session.answers()?.cloned().filter(|_| choose) {
        let mut best = (reached[0], None);
        for answer in [Scale::Narrower, Scale::Wider].into_iter().filter_map(|scale| answers.at(scale)) {
            let mut other = session.clone();
            other.tune(Tuning { leak: answer.leak, ..session.tuning() })?;
            let found = iou(other.mask(), target);
            if found > best.0 {
                best = (found, Some(other));
            }
        }
        if let (found, Some(other)) = best {
            reached.push(found);
            session = other;
        }
    }
    while reached.len() < MOST {
        let Some((place, kind)) = largest_error(scene, graph, session.mask(), target) else { break };
        let points = vec![scene.bounds.normalize(place).to_array()];
        let radius = 0.5 * stroke.radius;
        session.add_stroke(Stroke { mode: Mode::Walk, kind, radius, points, pressure: Vec::new(), depth: None })?;
        reached.push(iou(session.mask(), target));
    }
    Ok(reached)
}

/// The middle of the largest connected piece of wrong Gaussians, and the brush that mends it.
fn largest_error(scene: &Scene, graph: &Graph, mask: &Mask, target: &[bool]) -> Option<(DVec3, Kind)> {
    let n = target.len();
    let wrong = |g: usize| mask.get(g) != target[g];
    let mut seen = vec![false; n];
    let mut largest: Vec<u32> = Vec::new();
    for start in 0..n {
        if seen[start] || !wrong(start) {
            continue;
        }
        seen[start] = true;
        let mut piece = vec![start as u32];
        let mut at = 0;
        while let Some(&g) = piece.get(at) {
            at += 1;
            for (h, _) in graph.neighbours(g) {
                if !seen[h as usize] && wrong(h as usize) && target[h as usize] == target[start] {
                    seen[h as usize] = true;
                    piece.push(h);
                }
            }
        }
        if piece.len() > largest.len() {
            largest = piece;
        }
    }
    let at = |g: &u32| scene.position(*g as usize).unwrap_or(DVec3::ZERO);
    let middle = largest.iter().map(at).sum::<DVec3>() / largest.len().max(1) as f64;
    let far = |g: &u32| at(g).distance_squared(middle);
    let centre = largest.iter().min_by(|a, b| far(a).total_cmp(&far(b)).then(a.cmp(b)))?;
    Some((at(centre), if target[*centre as usize] { Kind::Foreground } else { Kind::Background }))
}
