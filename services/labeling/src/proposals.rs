//! Regions that nobody has named, as answers to a text that no unit suits.
//!
//! Regions come from a hierarchy, so a text suits a region, a part of it, and what it is a part of. One of them is proposed.

use crate::query::{LEAD, Outcome, Ranked};

/// The regions to propose, at most `most`, the best first. `outcome` is that of the text among all regions as items, `sizes` are
/// their numbers of Gaussians, and `overlap` says whether two share some.
///
/// Of regions that share Gaussians, the largest with a score within [`LEAD`] of the best one is taken. A part of a red thing is no
/// better answer to "the red thing" than the whole of it.
#[must_use]
pub fn proposals(
    outcome: Outcome,
    sizes: &[usize],
    overlap: impl Fn(usize, usize) -> bool,
    most: usize,
) -> Vec<Ranked> {
    let mut open = match outcome {
        Outcome::Match { items } => items,
        Outcome::Ambiguous { candidates } => candidates,
        Outcome::NothingMatches { .. } => return Vec::new(),
    };
    let size = |ranked: &Ranked| sizes.get(ranked.item).copied().unwrap_or_default();
    let mut chosen = Vec::new();
    while chosen.len() < most {
        let best = open.iter().map(|ranked| ranked.score).fold(0.0, f64::max);
        let contenders = open.iter().filter(|ranked| ranked.score >= best - LEAD);
        // The first of equal ones: `max_by` takes the last.
        let order = |a: &&Ranked, b: &&Ranked| {
            size(a).cmp(&size(b)).then(a.score.total_cmp(&b.score)).then(b.item.cmp(&a.item))
        };
        let Some(next) = contenders.max_by(order).cloned() else { break };
        open.retain(|ranked| ranked.item != next.item && !overlap(ranked.item, next.item));
        chosen.push(next);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attributes::{Attributes, Gaussian};
    use crate::frame::Frame;
    use crate::query::{Item, Scene};

    use glam::DVec3;

    /// A ball of a colour.
    fn look(color: [f32; 3]) -> Attributes {
        let gaussian = |at: i32| Gaussian {
            position: DVec3::splat(f64::from(at)),
            color,
            opacity: 1.0,
            deviation: 1.0,
            area: 1.0,
        };
        Attributes::of((0..4).map(gaussian)).unwrap()
    }

    const RED: [f32; 3] = [0.9, 0.05, 0.05];
    const GREEN: [f32; 3] = [0.05, 0.7, 0.1];

    #[test]
    fn the_whole_of_what_a_text_suits_is_proposed() {
        // 0 holds 1 and 2, 3 is apart, 4 is green.
        let colors = [RED, RED, RED, RED, GREEN];
        let items = colors.map(|color| Item { label: None, attributes: Some(look(color)) });
        let scene = Scene::new(items, Frame::XYZ).unwrap();
        let sizes = [90, 40, 50, 60, 99];
        let overlap = |a: usize, b: usize| a.min(b) == 0 && a.max(b) < 3;
        let found = |text: &str, most| {
            let found = proposals(scene.find(text), &sizes, overlap, most);
            found.iter().map(|ranked| ranked.item).collect::<Vec<_>>()
        };
        assert_eq!(found("the red part", 4), [0, 3]);
        assert_eq!(found("the red part", 1), [0]);
        assert_eq!(found("the green part", 4), [4]);
        assert!(found("the blue part", 4).is_empty() && found("the handle", 4).is_empty());
        assert!(proposals(scene.find("the red part"), &sizes, overlap, 4)[0].explanation().contains("red"));
    }
}
