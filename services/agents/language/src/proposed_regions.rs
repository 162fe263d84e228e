//! Regions that nobody has named, for a name that no unit has. Selecting one is safe: it changes nothing but the selection, and
//! undo takes it back. Other commands ask first.

use sg_proto::labeling::ProposedRegion;
use sg_proto::language::{Act, Clause};
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{SelectionStep, SetOperation};
use sg_proto::selection::StrokesRequest;

use crate::text::{grouped, is_plural};

/// The request that selects a region, or all of them for a plural, where that is all that a clause asks for. `None` for another
/// command, or for a target with more to it.
#[must_use]
pub fn selection(clause: &Clause, spoken: &str, regions: &[ProposedRegion]) -> Option<StrokesRequest> {
    let target = clause.target.as_ref().filter(|_| clause.act() == Act::Select)?;
    let is_alone = matches!(target.names.as_slice(), [only] if only == spoken)
        && !(target.everything || target.selection || target.complement);
    let restart = match clause.operation() {
        SetOperation::Replace | SetOperation::Unspecified => true,
        SetOperation::Add => false,
        SetOperation::Remove | SetOperation::Intersect => return None,
    };
    if !is_alone {
        return None;
    }
    let step = |region: &ProposedRegion| SelectionStep { step: region.members.clone().map(Step::Mask) };
    let steps = taken(spoken, regions).iter().map(step).collect();
    Some(StrokesRequest { restart, steps, ..StrokesRequest::default() })
}

/// The regions that a name takes.
fn taken<'r>(spoken: &str, regions: &'r [ProposedRegion]) -> &'r [ProposedRegion] {
    if is_plural(spoken) { regions } else { regions.get(..1).unwrap_or(regions) }
}

/// What a region is, as the end of a sentence.
fn found(spoken: &str, regions: &[ProposedRegion]) -> String {
    let taken = taken(spoken, regions);
    let gaussians = grouped(taken.iter().map(|region| region.gaussians).sum());
    let why = taken.first().map_or("", |region| region.explanation.as_str());
    let what = match taken.len() {
        1 => format!("a region of {gaussians} Gaussians"),
        several => format!("{several} regions of {gaussians} Gaussians"),
    };
    if why.is_empty() { what } else { format!("{what} ({why})") }
}

/// The reply where the proposed region is selected.
#[must_use]
pub fn selected(spoken: &str, regions: &[ProposedRegion]) -> String {
    let others = regions.len() - taken(spoken, regions).len();
    let more = match others {
        0 => String::new(),
        1 => " One other region may be meant too.".to_owned(),
        n => format!(" {n} other regions may be meant too."),
    };
    format!(
        "No unit is “{spoken}”. Selected {} that nobody has named.{more} Say “label this …” to keep it, or “undo”.",
        found(spoken, regions)
    )
}

/// The question of another command than a selection.
#[must_use]
pub fn question(spoken: &str, regions: &[ProposedRegion]) -> String {
    format!(
        "No unit is “{spoken}”. It may be {} that nobody has named. Say “select the {}” to see it.",
        found(spoken, regions),
        spoken.trim_start_matches("the ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::language::Reference;
    use sg_proto::scene::Mask;

    fn region(gaussians: u64) -> ProposedRegion {
        let members = Some(Mask { length: 8, bits: vec![gaussians as u8] });
        ProposedRegion { members, gaussians, score: 0.9, explanation: "looks red".into() }
    }

    fn clause(act: Act, names: &[&str], operation: SetOperation) -> Clause {
        let names = names.iter().map(|n| (*n).to_owned()).collect();
        let target = Some(Reference { names, ..Reference::default() });
        Clause { act: act.into(), target, operation: operation.into(), ..Clause::default() }
    }

    #[test]
    fn a_selection_takes_the_best_region_and_a_plural_all() {
        let regions = [region(3), region(1)];
        let of = |name: &str, operation| selection(&clause(Act::Select, &[name], operation), name, &regions);
        let one = of("red part", SetOperation::Replace).unwrap();
        assert!(one.restart && one.steps == [SelectionStep { step: region(3).members.map(Step::Mask) }], "{one:?}");
        let all = of("red parts", SetOperation::Add).unwrap();
        assert!(!all.restart && all.steps.len() == 2);
        assert!(of("red part", SetOperation::Remove).is_none());
    }

    #[test]
    fn other_commands_and_targets_ask() {
        let regions = [region(3)];
        let hide = clause(Act::Hide, &["red part"], SetOperation::Unspecified);
        assert!(selection(&hide, "red part", &regions).is_none());
        let both = clause(Act::Select, &["red part", "bone"], SetOperation::Replace);
        assert!(selection(&both, "red part", &regions).is_none());
        let mut other = clause(Act::Select, &["red part"], SetOperation::Replace);
        other.target.as_mut().unwrap().complement = true;
        assert!(selection(&other, "red part", &regions).is_none());
    }

    #[test]
    fn replies_say_that_nobody_has_named_it() {
        let regions = [region(1234), region(5)];
        assert_eq!(
            selected("red part", &regions),
            "No unit is “red part”. Selected a region of 1,234 Gaussians (looks red) that nobody has named. One other region \
             may be meant too. Say “label this …” to keep it, or “undo”."
        );
        assert!(selected("red parts", &regions).contains("2 regions of 1,239 Gaussians"));
        assert!(question("the handle", &regions[..1]).ends_with("Say “select the handle” to see it."));
    }
}
