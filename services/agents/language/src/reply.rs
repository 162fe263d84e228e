//! The answer to an utterance: what was done, what was seen of it, what was not understood.

use sg_proto::language::{ActionResult, Clause, Intent, Observation, PlanResult, Reply};
use sg_proto::scene::State;

use crate::commands::command::Effect;
use crate::commands::table::effect;
use crate::text::{is_plural, join, percent, the};

/// What the picture shows of what was done.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence<'o> {
    /// Before understanding.
    pub before: &'o Observation,
    /// After acting; absent when nothing was done, or nothing that changes a picture.
    pub after: Option<&'o Observation>,
    /// Whether the two pictures differ where an 8-bit display could show it; `None` if that could not be compared.
    pub changed: Option<bool>,
}

/// Whether a clause may change the image.
#[must_use]
pub fn changes_image(clause: &Clause) -> bool {
    effect(clause) != Effect::None
}

/// The reply where nothing at all was understood.
#[must_use]
pub fn not_understood(intent: &Intent, revision: u64) -> Reply {
    let mut text = missed(intent);
    if text.is_empty() {
        "There was nothing to do in that. Say “help” for what can be said.".clone_into(&mut text);
    }
    Reply { text, ok: false, revision, ..Reply::default() }
}

fn missed(intent: &Intent) -> String {
    if intent.not_understood.is_empty() {
        return String::new();
    }
    let quoted = |items: &[String]| -> Vec<String> { items.iter().map(|i| format!("“{i}”")).collect() };
    let mut text = format!("I did not understand {}.", join(&quoted(&intent.not_understood)));
    if !intent.suggestions.is_empty() {
        text.push_str(&format!(" You could say {}.", quoted(&intent.suggestions).join(" or ")));
    }
    text
}

/// The reply after a plan was carried out, or as much of it as could be.
#[must_use]
pub fn compose(intent: &Intent, outcome: &PlanResult, evidence: &Evidence<'_>) -> Reply {
    let mut sentences = Vec::new();
    for (place, action) in outcome.actions.iter().enumerate() {
        let clause = usize::try_from(action.clause).ok().and_then(|i| intent.clauses.get(i));
        let mut text = action.text.clone();
        // The picture shows what the last change to a unit has left.
        let last = outcome.actions.iter().skip(place + 1).all(|later| later.units != action.units);
        if action.ok
            && last
            && let Some(more) = clause.and_then(|c| coverage(c, action, evidence))
        {
            text = format!("{}; {more}.", text.trim_end_matches('.'));
        }
        sentences.push(text);
    }
    let failed = outcome.actions.iter().any(|a| !a.ok);
    let left = intent.clauses.len().saturating_sub(outcome.actions.len());
    if left > 0 {
        let words: Vec<String> =
            intent.clauses.iter().skip(outcome.actions.len()).map(|c| format!("“{}”", c.words)).collect();
        sentences.push(format!("So this was not tried: {}.", join(&words)));
    }
    if let Some(text) = unseen(intent, outcome, evidence) {
        sentences.push(text);
    }
    let missed = missed(intent);
    let understood_all = missed.is_empty();
    if !understood_all {
        sentences.push(missed);
    }
    Reply {
        text: sentences.join(if sentences.iter().any(|s| s.contains('\n')) { "\n" } else { " " }),
        ok: !failed && left == 0 && understood_all,
        revision: outcome.revision,
        actions: outcome.actions.clone(),
        ..Reply::default()
    }
}

/// What the one unit that an action was about covers of the picture now.
fn coverage(clause: &Clause, action: &ActionResult, evidence: &Evidence<'_>) -> Option<String> {
    let reported = effect(clause) == Effect::Coverage;
    let complement = clause.target.as_ref().is_some_and(|t| t.complement);
    let [unit] = action.units.as_slice() else { return None };
    if !reported || complement || evidence.changed == Some(false) {
        return None;
    }
    let after = evidence.after?;
    if !is_visible(unit, after.scene.as_ref()?) {
        return None;
    }
    let share = after.frame.as_ref()?.units.iter().find(|u| u.unit == *unit)?.share;
    let (pronoun, verb) = if is_plural(unit) { ("they", "cover") } else { ("it", "covers") };
    Some(format!("{pronoun} {verb} {} of the picture", percent(share)))
}

fn is_visible(unit: &str, scene: &State) -> bool {
    let base = scene.base_units.iter().find(|u| u.name == unit).map(|u| u.visible && u.opacity > 0.0);
    base.or_else(|| scene.units.iter().find(|u| u.name == unit).map(|u| u.visible && u.opacity > 0.0)).unwrap_or(true)
}

/// What is to be said where a change of look cannot be evidence, or nobody could look.
fn unseen(intent: &Intent, outcome: &PlanResult, evidence: &Evidence<'_>) -> Option<String> {
    let done: Vec<(&Clause, &ActionResult)> = outcome
        .actions
        .iter()
        .filter(|a| a.ok && a.command.is_some())
        .filter_map(|a| Some((intent.clauses.get(usize::try_from(a.clause).ok()?)?, a)))
        .filter(|(clause, _)| matches!(effect(clause), Effect::Visible | Effect::Coverage))
        .collect();
    if done.is_empty() {
        return None;
    }
    let after = evidence.after?;
    let Some(frame) = &after.frame else {
        let why = if after.missing.is_empty() { "no picture came" } else { after.missing.as_str() };
        return Some(format!("I could not look at the result: {}.", why.trim_end_matches('.')));
    };
    if evidence.changed != Some(false) {
        return None;
    }
    let scene = after.scene.as_ref();
    let mut reasons = Vec::new();
    for unit in done.iter().flat_map(|(_, action)| &action.units) {
        let hidden = scene.is_some_and(|s| !is_visible(unit, s));
        let share = frame.units.iter().find(|u| u.unit == *unit).map(|u| u.share);
        let (is, lies, they) = if is_plural(unit) { ("are", "lie", "they") } else { ("is", "lies", "it") };
        let reason = match (hidden, share) {
            (true, _) => format!("{} {is} hidden", the(unit)),
            (false, Some(share)) if share <= 0.0 => format!("{} {lies} outside the picture", the(unit)),
            (false, Some(_)) => format!("{} {is} covered by other things or looked so before", the(unit)),
            (false, None) => format!("{they} may be hidden, covered or outside the picture"),
        };
        if !reasons.contains(&reason) {
            reasons.push(reason);
        }
    }
    let why = if reasons.is_empty() { String::new() } else { format!(": {}", join(&reasons)) };
    Some(format!("The picture shows no change{why}."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::language::{Act, Reference};
    use sg_proto::render::{Frame, UnitCoverage};
    use sg_proto::scene::{BaseUnit, Command};

    fn intent(acts: &[Act]) -> Intent {
        let clause = |act: &Act| Clause {
            act: (*act).into(),
            target: Some(Reference { names: vec!["sac".into()], ..Reference::default() }),
            words: format!("{act:?}"),
            ..Clause::default()
        };
        Intent { clauses: acts.iter().map(clause).collect(), ..Intent::default() }
    }

    fn outcome(results: &[(bool, &str)]) -> PlanResult {
        let action = |(i, (ok, text)): (usize, &(bool, &str))| ActionResult {
            clause: i as u32,
            ok: *ok,
            text: (*text).to_owned(),
            command: Some(Command::default()),
            units: vec!["sac".into()],
            ..ActionResult::default()
        };
        PlanResult { actions: results.iter().enumerate().map(action).collect(), revision: 7 }
    }

    fn observation(visible: bool, share: Option<f64>) -> Observation {
        let scene = State {
            base_units: vec![BaseUnit { name: "sac".into(), visible, opacity: 1.0, ..BaseUnit::default() }],
            ..State::default()
        };
        let frame = share.map(|share| Frame {
            units: vec![UnitCoverage { unit: "sac".into(), share, mean_color: None }],
            ..Frame::default()
        });
        let missing = if frame.is_some() { String::new() } else { "nobody draws pictures at the moment".to_owned() };
        Observation { moment: "after".into(), scene: Some(scene), frame, missing }
    }

    fn text(acts: &[Act], results: &[(bool, &str)], after: &Observation, changed: Option<bool>) -> Reply {
        let before = Observation::default();
        compose(&intent(acts), &outcome(results), &Evidence { before: &before, after: Some(after), changed })
    }

    #[test]
    fn a_change_is_told_with_what_was_seen() {
        let reply =
            text(&[Act::SetColor], &[(true, "The sac is now red.")], &observation(true, Some(0.03)), Some(true));
        assert_eq!((reply.text.as_str(), reply.ok), ("The sac is now red; it covers 3 % of the picture.", true));
    }

    #[test]
    fn no_visible_change_is_admitted_with_its_reason() {
        let done = [(true, "The sac is now red.")];
        let hidden = text(&[Act::SetColor], &done, &observation(false, Some(0.0)), Some(false));
        assert_eq!(hidden.text, "The sac is now red. The picture shows no change: the sac is hidden.");
        let outside = text(&[Act::SetColor], &done, &observation(true, Some(0.0)), Some(false));
        assert!(outside.text.ends_with("the sac lies outside the picture."), "{}", outside.text);
        let covered = text(&[Act::SetColor], &done, &observation(true, Some(0.2)), Some(false));
        assert!(covered.text.contains("covered"), "{}", covered.text);
    }

    #[test]
    fn a_picture_that_did_not_come_is_admitted() {
        let reply = text(&[Act::SetColor], &[(true, "The sac is now red.")], &observation(true, None), None);
        assert_eq!(
            reply.text,
            "The sac is now red. I could not look at the result: nobody draws pictures at the moment."
        );
        assert!(reply.ok, "the change itself was made");
    }

    #[test]
    fn a_failure_stops_and_says_what_was_left() {
        let reply = text(
            &[Act::SetColor, Act::Hide],
            &[(false, "No unit is called “sack”.")],
            &observation(true, Some(0.1)),
            Some(false),
        );
        assert_eq!(reply.text, "No unit is called “sack”. So this was not tried: “Hide”.");
        assert!(!reply.ok);
    }

    #[test]
    fn what_was_not_understood_is_said_and_fails_the_whole() {
        let mut intent = intent(&[Act::SetColor]);
        intent.not_understood = vec!["dance".into()];
        intent.suggestions = vec!["help".into()];
        let before = Observation::default();
        let reply =
            compose(&intent, &outcome(&[(true, "Done.")]), &Evidence { before: &before, after: None, changed: None });
        assert_eq!(reply.text, "Done. I did not understand “dance”. You could say “help”.");
        assert!(!reply.ok);
        assert_eq!(not_understood(&intent, 3).text, "I did not understand “dance”. You could say “help”.");
    }
}
