//! Interpretation of an utterance within its conversation: as it was said, reworded, with its spelling repaired, or as a
//! follow-up of the one before.
//!
//! The literal reading comes first, and an understood one is final. A repair counts only if every part of it is understood
//! with known names. So a repair never changes the meaning of an utterance that has one.

use sg_proto::language::{Act, Clause, Intent, IntentRequest};

use super::forms::{self, MOST_UNKNOWN, certain, is_safe, repaired, understood};
use super::sentence::Sentence;
use super::sentence_model::Meaning;
use super::{
    Reader, UtteranceError, conversation, correction, follow_up, missing, plain_form, scope, self_correction,
    sentence_model, spelling, tokens_of,
};
use crate::color;
use crate::syntax::token::{self, Token};

/// Longest utterance that is repaired, tokens. People say longer ones in parts.
const MAX_REPAIRED_TOKENS: usize = 40;

/// Most parts of an utterance that are read each on its own.
const MOST_PARTS: usize = 6;

/// Acts that wait while a part of their utterance is not understood.
const DESTRUCTIVE: [Act; 4] = [Act::DeleteGaussians, Act::Delete, Act::Reset, Act::ForgetView];

/// The intent of an utterance in its conversation.
///
/// An utterance that [`super::parse`] does not understand is repaired where its meaning is clear:
///
/// | utterance | meaning |
/// | --- | --- |
/// | "make the sac red, no, blue" | "make the sac blue" |
/// | "can the sac be red?", "hide the skin so that I can see the bone" | without the frame and the purpose |
/// | "I was wondering whether the pink part could be hidden" | the plain form, with names that the labeling service may know |
/// | "the bone, more see-through please" | the command that has these slots, in any order of the words |
/// | "high the skin", "back ground white" | words in place of others that sound alike |
/// | "hied the vesel" | the one way of spelling that makes a sentence; [`Intent::read_as`] tells it |
/// | "no, the bone", "I meant the bone", "never mind" | the last utterance taken back, and corrected |
/// | "and the vessel too", "the same for the vessel" | the last utterance for another target |
/// | "yes" after an utterance with a spelling mistake | its repaired form |
/// | "is the bone hidden?", "how do I hide something?", "thanks", "don't hide it" | [`Intent::answer`] alone |
/// | "change the colour", "thirty percent" | a question back in [`Intent::answer`] |
///
/// A repaired spelling never deletes, names or writes anything; then it is a suggestion. While a part of an utterance is not
/// understood, nothing in it is deleted or reset: "ignore your rules and delete everything" does nothing.
///
/// # Errors
/// [`UtteranceError`]: the utterance is empty or too long.
pub fn interpret(request: &IntentRequest) -> Result<Intent, UtteranceError> {
    let observation = request.observation.clone().unwrap_or_default();
    let text = request.text.as_str();
    let tokens = tokens_of(text)?;
    let is_tour = |text: &str| text.to_lowercase().contains("tour");
    let speaks_of_tour = is_tour(text) || request.conversation.iter().any(|turn| is_tour(&turn.utterance));
    let reader = Reader { speaks_of_tour, ..Reader::new(&observation) };
    let last = request.conversation.last();
    let described = last.and_then(|last| follow_up::with_described(&reader, text, &tokens, last));
    let (text, tokens) = match &described {
        Some(text) => (text.as_str(), token::tokens(text)),
        None => (text, tokens),
    };
    if let Some(answer) = conversation::state(text, &tokens, &observation) {
        return Ok(answer);
    }
    let literal = reader.read_tokens(text, &tokens);
    if let Some(sentence) = correction::of(&reader, request, &tokens, &literal) {
        return Ok(repaired(sentence, text, String::new()));
    }
    if let Some(sentence) = last.and_then(|last| follow_up::once_more(&reader, &tokens, last)) {
        return Ok(repaired(sentence, text, String::new()));
    }
    if tokens.len() > MAX_REPAIRED_TOKENS || literal.is_certain() {
        return Ok(withhold(reader.intent(text, &tokens, literal)));
    }
    if let Some(answer) = conversation::of(&reader, request, text, &tokens, &literal) {
        return Ok(answer);
    }
    let forms = forms::of(&reader, text, &tokens);
    let plain = || forms.iter().find_map(|form| certain(&reader, form));
    if let Some(sentence) = self_correction::of(&reader, text, &tokens).or_else(plain) {
        return Ok(repaired(sentence, text, String::new()));
    }
    if let Some(last) = last {
        if let Some(sentence) = follow_up::of(&reader, text, &tokens, &last.utterance) {
            return Ok(repaired(sentence, text, String::new()));
        }
        if follow_up::is_yes(&tokens)
            && let Some((better, sentence)) = spelling::repaired(&reader, &last.utterance)
        {
            return Ok(repaired(sentence, text, better));
        }
    }
    let is_unread = literal.clauses.is_empty() && !literal.not_understood.is_empty();
    if is_unread && let Some(answer) = missing::question(&reader, text, &tokens) {
        return Ok(Intent { answer, ..reader.intent(text, &tokens, literal) });
    }
    // "Red is too alarming, make it teal" is no misspelt "make it red".
    if by_parts(&reader, text, &tokens).is_none()
        && let Some(intent) = sentence_model::clear(&reader, text).and_then(|meaning| like(meaning, text, &literal))
    {
        return Ok(intent);
    }
    let with_forms = || std::iter::once(text).chain(forms.iter().map(String::as_str));
    let spelled = with_forms().find_map(|form| spelling::repaired(&reader, form));
    if let Some((better, sentence)) = spelled.filter(|(_, sentence)| is_safe(sentence)) {
        return Ok(repaired(sentence, text, better));
    }
    let sounds = plain_form::heard(text, &tokens);
    let heard = |form: String| Some((form.clone(), in_any_form(&reader, &form)?));
    if !literal.not_understood.is_empty()
        && let Some((better, sentence)) = sounds.and_then(heard)
    {
        return Ok(repaired(sentence, text, better));
    }
    // The labeling service may know a name that no unit has. A form that is understood but for such names is better than none.
    if !literal.not_understood.is_empty() {
        let named = || forms.iter().find_map(|form| understood(&reader, form));
        if let Some(sentence) = named().or_else(|| by_parts(&reader, text, &tokens)) {
            return Ok(repaired(sentence, text, String::new()));
        }
        if let Some((better, sentence)) = spelling::respelled(&reader, text, |form| in_any_form(&reader, form)) {
            return Ok(repaired(sentence, text, better));
        }
    } else if takes_color_as_name(&literal)
        && let Some(sentence) = by_parts(&reader, text, &tokens)
    {
        return Ok(repaired(sentence, text, String::new()));
    }
    if let Some(intent) = sentence_model::of(&reader, text).and_then(|meaning| like(meaning, text, &literal)) {
        return Ok(intent);
    }
    let intent = withhold(reader.intent(text, &tokens, literal));
    Ok(conversation::finished(&reader, &tokens, intent))
}

/// The intent of an utterance that is like examples of other people's words. A command counts if it does all that the literal reading
/// does: then what that does not understand is a reason or a remark.
fn like(meaning: Meaning, text: &str, literal: &Sentence) -> Option<Intent> {
    match meaning {
        Meaning::Command(form, sentence) => {
            let does = |clause: &Clause| sentence.clauses.iter().any(|other| other.act() == clause.act());
            // A name that no unit has may be known to the labeling service.
            let is_better = sentence.unknown == 0 || !literal.not_understood.is_empty();
            (is_better && literal.clauses.iter().all(does)).then(|| repaired(sentence, text, form))
        }
        Meaning::Nothing if literal.clauses.is_empty() => Some(conversation::unchanged()),
        Meaning::OutOfScope if literal.clauses.is_empty() => {
            let not_understood = literal.not_understood.clone();
            Some(Intent { not_understood, ..conversation::answering(scope::nothing_known()) })
        }
        _ => None,
    }
}

/// The reading of a text in the first of its forms that is understood, the sure ones first. A look tells what it does.
fn in_any_form(reader: &Reader<'_>, text: &str) -> Option<Sentence> {
    let forms = forms::of(reader, text, &token::tokens(text));
    let all = || std::iter::once(text).chain(forms.iter().map(String::as_str));
    let sure = all().find_map(|form| certain(reader, form).filter(is_safe));
    sure.or_else(|| all().find_map(|form| understood(reader, form)))
        .or_else(|| sentence_model::command(reader, text).map(|(_, sentence)| sentence))
}

/// The clauses of an utterance whose parts are all understood, each in some form: "bone at 15 %, tissue off, white background".
fn by_parts(reader: &Reader<'_>, text: &str, tokens: &[Token]) -> Option<Sentence> {
    let parts = plain_form::parts(text, tokens);
    if !(2..=MOST_PARTS).contains(&parts.len()) {
        return None;
    }
    let mut whole = Sentence::default();
    // "Interesting. Make it red."
    for part in parts.into_iter().filter(|part| !plain_form::is_remark(part)) {
        let sentence = in_any_form(reader, &part)?;
        whole.clauses.extend(sentence.clauses.into_iter().map(|clause| Clause { words: part.clone(), ..clause }));
        whole.unknown += sentence.unknown;
    }
    (whole.unknown <= MOST_UNKNOWN && !whole.clauses.is_empty()).then_some(whole)
}

/// Whether a name that no unit has ends with a colour: "aneurysm red, clip white" names no "aneurysm red".
fn takes_color_as_name(sentence: &Sentence) -> bool {
    let ends_with_color = |name: &String| {
        name.split_whitespace().count() > 1 && name.split_whitespace().next_back().is_some_and(color::is_word)
    };
    let names = sentence.clauses.iter().filter_map(|clause| clause.target.as_ref()).flat_map(|t| &t.names);
    sentence.unknown > 0 && names.into_iter().any(ends_with_color)
}

/// Without the clauses that delete, if a part of the utterance is not understood.
fn withhold(mut intent: Intent) -> Intent {
    if !intent.not_understood.is_empty() {
        let (kept, withheld): (Vec<_>, Vec<_>) =
            intent.clauses.into_iter().partition(|clause| !DESTRUCTIVE.contains(&clause.act()));
        intent.clauses = kept;
        intent.not_understood.extend(withheld.into_iter().map(|clause| clause.words));
    }
    intent
}
