//! Replies to utterances: executed commands, their effect on the image, parts that were not understood.

use sg_proto::language::{Act, ActionResult, Clause, Intent, Observation, PlanResult, Reply};
use sg_proto::scene::{State, set_view};

use crate::commands::command::Effect;
use crate::commands::table::effect;
use crate::report::lower;
use crate::text::{is_plural, join, percent, the};

/// The observations before and after the commands.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence<'o> {
    /// The observation before the commands.
    pub before: &'o Observation,
    /// The observation after the commands. `None`: no command changes the image.
    pub after: Option<&'o Observation>,
    /// Whether the two images differ. `None`: they could not be compared.
    pub changed: Option<bool>,
}

/// Whether a clause may change the image.
#[must_use]
pub fn changes_image(clause: &Clause) -> bool {
    effect(clause) != Effect::None
}

/// The reply to an intent without clauses: its answer, or what was not understood.
#[must_use]
pub fn without_clauses(intent: &Intent, revision: u64) -> Reply {
    if intent.answer.is_empty() {
        return not_understood(intent, revision);
    }
    Reply { text: intent.answer.clone(), ok: intent.not_understood.is_empty(), revision, ..Reply::default() }
}

/// The reply where nothing was understood.
#[must_use]
pub fn not_understood(intent: &Intent, revision: u64) -> Reply {
    let mut text = not_understood_text(intent);
    if text.is_empty() {
        "That holds no command. Say “help” for examples.".clone_into(&mut text);
    }
    Reply { text, ok: false, revision, ..Reply::default() }
}

fn not_understood_text(intent: &Intent) -> String {
    if intent.not_understood.is_empty() {
        return String::new();
    }
    let quoted = |items: &[String]| -> Vec<String> { items.iter().map(|i| format!("“{i}”")).collect() };
    let mut text = format!("I did not understand {}.", join(&quoted(&intent.not_understood)));
    if !intent.suggestions.is_empty() {
        text.push_str(&format!(" Try {}.", quoted(&intent.suggestions).join(" or ")));
    }
    text
}

/// The reply after a plan was executed, completely or in part.
#[must_use]
pub fn compose(intent: &Intent, outcome: &PlanResult, evidence: &Evidence<'_>) -> Reply {
    let mut sentences = Vec::new();
    if !intent.read_as.is_empty() {
        sentences.push(format!("I read that as “{}”.", intent.read_as.trim_end_matches('.')));
    }
    sentences.extend(action_texts(intent, outcome, evidence));
    let failed = outcome.actions.iter().any(|a| !a.ok);
    let left = intent.clauses.len().saturating_sub(outcome.actions.len());
    if left > 0 {
        let words: Vec<String> =
            intent.clauses.iter().skip(outcome.actions.len()).map(|c| format!("“{}”", c.words)).collect();
        sentences.push(format!("Not executed: {}.", join(&words)));
    }
    if let Some(text) = invisible_change(intent, outcome, evidence) {
        sentences.push(text);
    }
    let text = not_understood_text(intent);
    let understood_all = text.is_empty();
    if !understood_all {
        sentences.push(text);
    }
    Reply {
        text: sentences.join(if sentences.iter().any(|s| s.contains('\n')) { "\n" } else { " " }),
        ok: !failed && left == 0 && understood_all,
        revision: outcome.revision,
        actions: outcome.actions.clone(),
        ..Reply::default()
    }
}

/// What was done, one text for each action that a person asked for.
fn action_texts(intent: &Intent, outcome: &PlanResult, evidence: &Evidence<'_>) -> Vec<String> {
    let mut texts = Vec::new();
    // An undo that belongs to what follows it.
    let mut undone: Option<String> = None;
    for (place, action) in outcome.actions.iter().enumerate() {
        let clause = usize::try_from(action.clause).ok().and_then(|i| intent.clauses.get(i));
        let mut text = action.text.clone();
        let goes_on = place + 1 < outcome.actions.len();
        if action.ok && goes_on && clause.is_some_and(|c| c.act() == Act::Undo) {
            texts.extend(undone.replace(taken_back(&text)).map(|earlier| format!("{earlier}.")));
            continue;
        }
        if action.ok && clause.is_some_and(keeps_view) {
            continue;
        }
        // The image shows only the last change of a unit.
        let last = outcome.actions.iter().skip(place + 1).all(|later| later.units != action.units);
        if action.ok
            && last
            && let Some(more) = clause.and_then(|c| coverage(c, action, evidence))
        {
            text = format!("{}; {more}.", text.trim_end_matches('.'));
        }
        texts.push(match undone.take() {
            // A list has lines of its own, and "I" has a capital.
            Some(undone) if action.ok && !text.contains('\n') && !text.starts_with("I ") => {
                format!("{undone}; {}", lower(&text))
            }
            Some(undone) => format!("{undone}. {text}"),
            None => text,
        });
    }
    texts.extend(undone.map(|undone| format!("{undone}.")));
    texts
}

/// The report of an undo as the beginning of a sentence.
fn taken_back(report: &str) -> String {
    let report = report.trim_end_matches('.');
    report.strip_prefix("Undid").map_or_else(|| report.to_owned(), |what| format!("Took back{what}"))
}

/// Whether a clause only keeps the viewpoint beside an undo. Nobody has said it.
fn keeps_view(clause: &Clause) -> bool {
    let change = clause.view.as_ref().and_then(|view| view.change.as_ref());
    clause.words.is_empty() && matches!(change, Some(set_view::Change::View(_)))
}

/// The coverage of the one unit of an action.
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

/// The sentence where a change is not visible, or the image is missing.
fn invisible_change(intent: &Intent, outcome: &PlanResult, evidence: &Evidence<'_>) -> Option<String> {
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
        let why = if after.missing.is_empty() { "the picture is missing" } else { after.missing.as_str() };
        return Some(format!("I could not check the result: {}.", why.trim_end_matches('.')));
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
            (false, Some(_)) => format!("{} {is} covered by other structures or looked like this already", the(unit)),
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
    use sg_proto::language::Reference;
    use sg_proto::render::{Frame, UnitCoverage};
    use sg_proto::scene::{BaseUnit, Command, SetView, View};

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
        let missing = if frame.is_some() { String::new() } else { "no render process is running".to_owned() };
        Observation { moment: "after".into(), scene: Some(scene), frame, missing }
    }

    fn text(acts: &[Act], results: &[(bool, &str)], after: &Observation, changed: Option<bool>) -> Reply {
        let before = Observation::default();
        compose(&intent(acts), &outcome(results), &Evidence { before: &before, after: Some(after), changed })
    }

    #[test]
    fn a_change_is_reported_with_its_coverage() {
        let reply =
            text(&[Act::SetColor], &[(true, "The sac is now red.")], &observation(true, Some(0.03)), Some(true));
        assert_eq!((reply.text.as_str(), reply.ok), ("The sac is now red; it covers 3 % of the picture.", true));
    }

    #[test]
    fn an_invisible_change_is_reported_with_its_reason() {
        let done = [(true, "The sac is now red.")];
        let hidden = text(&[Act::SetColor], &done, &observation(false, Some(0.0)), Some(false));
        assert_eq!(hidden.text, "The sac is now red. The picture shows no change: the sac is hidden.");
        let outside = text(&[Act::SetColor], &done, &observation(true, Some(0.0)), Some(false));
        assert!(outside.text.ends_with("the sac lies outside the picture."), "{}", outside.text);
        let covered = text(&[Act::SetColor], &done, &observation(true, Some(0.2)), Some(false));
        assert!(covered.text.contains("covered"), "{}", covered.text);
    }

    #[test]
    fn a_missing_image_is_reported() {
        let reply = text(&[Act::SetColor], &[(true, "The sac is now red.")], &observation(true, None), None);
        assert_eq!(reply.text, "The sac is now red. I could not check the result: no render process is running.");
        assert!(reply.ok, "the change itself was made");
    }

    #[test]
    fn a_failure_is_reported_with_the_skipped_clauses() {
        let reply = text(
            &[Act::SetColor, Act::Hide],
            &[(false, "Nothing is named “sack”.")],
            &observation(true, Some(0.1)),
            Some(false),
        );
        assert_eq!(reply.text, "Nothing is named “sack”. Not executed: “Hide”.");
        assert!(!reply.ok);
    }

    #[test]
    fn what_was_taken_back_is_told_with_what_follows() {
        let said = |acts: &[Act], results: &[(bool, &str)]| text(acts, results, &observation(true, None), None).text;
        let undid = (true, "Undid: coloured bone #ff0000.");
        let told = said(&[Act::Undo, Act::SetColor], &[undid, (true, "The sac is now red.")]);
        assert!(told.starts_with("Took back: coloured bone #ff0000; the sac is now red. "), "{told}");
        let told = said(&[Act::Undo, Act::SetColor], &[(true, "Undid 2 changes."), (true, "I took it as red.")]);
        assert!(told.starts_with("Took back 2 changes. I took it as red."), "{told}");
        let told = said(&[Act::Undo, Act::SetColor], &[undid, (false, "Nothing is named “sack”.")]);
        assert_eq!(told, "Took back: coloured bone #ff0000. Nothing is named “sack”.");
        let told = said(&[Act::Undo, Act::SetColor], &[(false, "There is nothing to undo.")]);
        assert_eq!(told, "There is nothing to undo. Not executed: “SetColor”.");
        assert_eq!(said(&[Act::Undo], &[undid]), undid.1);
    }

    #[test]
    fn a_viewpoint_that_only_stays_is_not_told() {
        let mut intent = intent(&[Act::Undo, Act::SetView]);
        let stay = SetView { change: Some(set_view::Change::View(View::default())) };
        intent.clauses[1] = Clause { view: Some(stay), words: String::new(), ..intent.clauses[1].clone() };
        let done = outcome(&[(true, "Undid: coloured bone #ff0000."), (true, "The view has changed.")]);
        let before = Observation::default();
        let reply = compose(&intent, &done, &Evidence { before: &before, after: None, changed: None });
        assert_eq!(reply.text, "Took back: coloured bone #ff0000.");
    }

    #[test]
    fn an_answer_takes_the_place_of_what_was_not_understood() {
        let answer = Intent { answer: "You're welcome.".into(), ..Intent::default() };
        let reply = without_clauses(&answer, 3);
        assert_eq!((reply.text.as_str(), reply.ok, reply.revision), ("You're welcome.", true, 3));
        let asked = Intent { answer: "Which colour?".into(), not_understood: vec!["colour".into()], ..answer };
        let reply = without_clauses(&asked, 3);
        assert_eq!((reply.text.as_str(), reply.ok), ("Which colour?", false), "a question back is no success");
        let unread = Intent { not_understood: vec!["dance".into()], ..Intent::default() };
        assert_eq!(without_clauses(&unread, 3).text, "I did not understand “dance”.");
    }

    #[test]
    fn parts_that_are_not_understood_fail_the_reply() {
        let mut intent = intent(&[Act::SetColor]);
        intent.not_understood = vec!["dance".into()];
        intent.suggestions = vec!["help".into()];
        let before = Observation::default();
        let reply =
            compose(&intent, &outcome(&[(true, "Done.")]), &Evidence { before: &before, after: None, changed: None });
        assert_eq!(reply.text, "Done. I did not understand “dance”. Try “help”.");
        assert!(!reply.ok);
        assert_eq!(not_understood(&intent, 3).text, "I did not understand “dance”. Try “help”.");
    }
}
