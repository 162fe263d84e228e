//! The sentences that are expected of a scene, and what a recognised one means.

use sg_language::grammar;
use sg_language::spoken::{COMMANDS, needs_confirmation, slots};
use sg_proto::language::{Intent, Observation};
use sg_proto::scene::State;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::Recognition;
use sg_speech::spoken;

/// Confidence from which free text may be a command.
const WELL_HEARD: f32 = 0.5;

/// Least log-likelihood of another text beside the best one that may be a command.
const LIKELY: f32 = -4.0;

/// Log-likelihood from which another text is clearly likelier than an expected sentence that was accepted. Whisper looks for such
/// texts below its `clear_ratio`, which is the negative of this.
const LIKELIER: f32 = 5.0;

/// What people say for yes and no.
const YES: [&str; 5] = ["yes", "yes please", "yes do it", "confirm", "go ahead"];
const NO: [&str; 5] = ["no", "no thanks", "no don't", "cancel", "never mind"];

/// The sentences that are expected. `answers`: a yes or no as well.
///
/// # Errors
/// [`SpeechError::Limit`]: a name is too long to be said.
pub(crate) fn expected(state: &State, answers: bool) -> Result<PhraseGrammar, SpeechError> {
    let mut expected = PhraseGrammar::new();
    for (name, values) in slots(state) {
        expected.set_slot(name, values)?;
    }
    let own = COMMANDS.iter().flat_map(|command| command.templates).copied();
    let answers = YES.into_iter().chain(NO).filter(|_| answers);
    own.chain(answers).try_for_each(|template| expected.add(template))?;
    Ok(expected)
}

/// The intent of a text, if every part of it is understood.
pub(crate) fn understood(text: &str, state: &State) -> Option<Intent> {
    let observation = Observation { scene: Some(state.clone()), ..Observation::default() };
    let intent = grammar::parse(text, &observation).ok()?;
    (!intent.clauses.is_empty() && intent.not_understood.is_empty()).then_some(intent)
}

/// The recognition, accepted if it is a command. Free text is one if every part of it is understood and it was heard well. So is
/// another text that is nearly as likely: the sense decides between them. It also takes the place of an expected sentence that is
/// clearly less likely, if its names are units. With `any_text`, all text is accepted.
pub(crate) fn with_acceptance(heard: Recognition, state: &State, any_text: bool) -> Recognition {
    if heard.accepted {
        // A name that no unit has may be a misheard one, which the expected sentence has right.
        let is_command = |text: &String| understood(text, state).is_some_and(|intent| names_are_units(&intent, state));
        let mut likelier = heard.alternatives.iter().filter(|other| other.score >= LIKELIER).map(|other| &other.text);
        // The same words are better as the scene spells them.
        let other =
            likelier.find(|text| is_command(text)).filter(|text| spoken::words(text) != spoken::words(&heard.text));
        return match other.cloned() {
            Some(text) => heard.with_text(text),
            None => heard,
        };
    }
    if heard.text.is_empty() || any_text {
        return Recognition { accepted: !heard.text.is_empty(), ..heard };
    }
    let others = heard.alternatives.iter().filter(|other| other.score >= LIKELY).map(|other| &other.text);
    let texts = std::iter::once(&heard.text).chain(others).filter(|_| heard.confidence >= WELL_HEARD);
    match command_among(texts, state).cloned() {
        Some(text) if text == heard.text => Recognition { accepted: true, ..heard },
        Some(text) => Recognition { accepted: true, ..heard.with_text(text) },
        None => heard,
    }
}

/// The first text that is understood in every part. One whose names are all units goes before others, whose names may be misheard.
fn command_among<'t>(texts: impl Iterator<Item = &'t String>, state: &State) -> Option<&'t String> {
    let mut first = None;
    for text in texts {
        let Some(intent) = understood(text, state) else { continue };
        if names_are_units(&intent, state) {
            return Some(text);
        }
        first = first.or(Some(text));
    }
    first
}

fn names_are_units(intent: &Intent, state: &State) -> bool {
    let base = state.base_units.iter().map(|unit| unit.name.as_str());
    let units: Vec<Vec<String>> =
        base.chain(state.units.iter().map(|unit| unit.name.as_str())).map(spoken::words).collect();
    let targets = intent.clauses.iter().filter_map(|clause| clause.target.as_ref());
    let words = |name: &String| spoken::words(name.strip_prefix("the ").unwrap_or(name));
    targets.flat_map(|target| &target.names).all(|name| units.contains(&words(name)))
}

/// A question about a command that takes something away.
pub(crate) fn question(text: &str, state: &State) -> Option<String> {
    let intent = understood(text, state)?;
    let text = text.trim_end_matches(['.', '!', '?']);
    needs_confirmation(&intent).then(|| format!("Did you say “{text}”? Say yes or no."))
}

/// Whether a text is a yes or a no.
pub(crate) fn answer(text: &str) -> Option<bool> {
    let said = spoken::words(text).join(" ");
    let is_one_of = |answers: [&str; 5]| answers.iter().any(|answer| spoken::words(answer).join(" ") == said);
    match (is_one_of(YES), is_one_of(NO)) {
        (true, _) => Some(true),
        (_, true) => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use sg_speech::recognizer::{Alternative, TimedText};

    use super::*;

    fn scene(names: &[&str]) -> State {
        grammar::sample_observation(names).scene.unwrap()
    }

    #[test]
    fn every_expected_sentence_is_the_command_of_its_row() {
        let mut state = scene(&["sac", "left kidney"]);
        state.focus = vec!["sac".to_owned()];
        let mut wrong = Vec::new();
        for command in COMMANDS {
            let mut one = PhraseGrammar::new();
            for (name, values) in slots(&state) {
                // The second unit of a sentence is another one.
                let values: Vec<&str> = if name == "other" { vec!["left kidney"] } else { values };
                one.set_slot(name, values.into_iter().take(2)).unwrap();
            }
            command.templates.iter().for_each(|template| one.add(template).unwrap());
            let sentences = one.sentences(10_000);
            assert!(sentences.len() >= command.templates.len(), "{:?}", command.act);
            for sentence in sentences {
                let intent = understood(&sentence.written, &state);
                if !intent
                    .as_ref()
                    .is_some_and(|intent| intent.clauses.iter().all(|clause| clause.act() == command.act))
                {
                    wrong.push(format!(
                        "{:?}: {} -> {:?}",
                        command.act,
                        sentence.written,
                        intent.map(|i| i.clauses.iter().map(sg_proto::language::Clause::act).collect::<Vec<_>>())
                    ));
                }
            }
        }
        assert!(wrong.is_empty(), "{}\n{}", wrong.len(), wrong.join("\n"));
    }

    #[test]
    fn the_sense_decides_between_texts_that_are_nearly_as_likely() {
        let state = scene(&["sac", "bone"]);
        let heard = |text: &str, accepted, others: &[(&str, f32)]| {
            let alternatives =
                others.iter().map(|(text, score)| Alternative { text: (*text).to_owned(), score: *score });
            let (text, alternatives) = (text.to_owned(), alternatives.collect());
            let heard = Recognition { text, accepted, alternatives, confidence: 0.8, ..Recognition::default() };
            let heard = with_acceptance(heard, &state, false);
            (heard.accepted, heard.text)
        };
        let owned = |accepted, text: &str| (accepted, text.to_owned());
        let free = [("Hide the suck", -0.5), ("hide the sac", -2.0)];
        assert_eq!(heard("hide the sack of rice", false, &free), owned(true, "hide the sac"));
        assert_eq!(
            heard("hide the sack of rice", false, &[("hide the sac", -9.0)]),
            owned(false, "hide the sack of rice")
        );
        // What a person says in other words is no worse than an expected sentence.
        let free = [("Bring the bone back.", 8.0), ("Bring the bone bag.", 6.0)];
        assert_eq!(heard("put the bone back", true, &free), owned(true, "Bring the bone back."));
        assert_eq!(
            heard("put the bone back", true, &[("Bring the bone back.", 4.0)]),
            owned(true, "put the bone back")
        );
        assert_eq!(heard("put the bone back", true, &[("What a nice day.", 9.0)]), owned(true, "put the bone back"));
    }

    #[test]
    fn another_text_is_one_part_in_the_same_time() {
        let seconds = std::time::Duration::from_secs_f32;
        let part =
            |text: &str, start, end| TimedText { text: text.to_owned(), start: seconds(start), end: seconds(end) };
        let heard = Recognition {
            text: "put the bone back".to_owned(),
            accepted: true,
            alternatives: vec![Alternative { text: "Bring the bone back.".to_owned(), score: 8.0 }],
            parts: vec![part("put the", 0.5, 0.75), part("bone back", 0.75, 1.5)],
            ..Recognition::default()
        };
        let taken = with_acceptance(heard.clone(), &scene(&["bone"]), false);
        assert_eq!(taken.parts, [part("Bring the bone back.", 0.5, 1.5)]);
        let kept = with_acceptance(Recognition { alternatives: Vec::new(), ..heard.clone() }, &scene(&["bone"]), false);
        assert_eq!(kept.parts, heard.parts);
    }

    #[test]
    fn what_takes_away_is_asked_about() {
        let state = scene(&["sac", "vessel"]);
        assert_eq!(question("delete the sac", &state).unwrap(), "Did you say “delete the sac”? Say yes or no.");
        assert!(question("merge the sac and the vessel", &state).is_some());
        assert_eq!(question("Delete the sac.", &state).unwrap(), "Did you say “Delete the sac”? Say yes or no.");
        for harmless in ["hide the sac", "undo", "what a nice day"] {
            assert!(question(harmless, &state).is_none(), "{harmless}");
        }
        assert_eq!(["Yes.", "no, don't", "hide the sac"].map(answer), [Some(true), Some(false), None]);
    }
}
