//! Sentences, and answers of language models.

use std::sync::LazyLock;

use sg_language::intent_prompt::IntentPrompt;
use sg_language::{commands, grammar, paraphrase, unit_choice};
use sg_proto::language::{Intent, IntentRequest, Observation, Turn};
use sg_proto::scene::State;

use crate::parts::Parts;
use crate::stage::Stage;

static OBSERVATION: LazyLock<Observation> =
    LazyLock::new(|| grammar::sample_observation(&["sac", "parent vessel", "bone 2"]));
static PROMPT: LazyLock<IntentPrompt> = LazyLock::new(|| IntentPrompt::new().unwrap());

pub(crate) fn utterance(_: &Stage, input: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(input) else { return false };
    let Ok(intent) = grammar::parse(text, &OBSERVATION) else { return false };
    let turn = Turn { utterance: "make the sac red".to_owned(), undo_steps: 1, ..Turn::default() };
    let request =
        IntentRequest { text: text.to_owned(), observation: Some(OBSERVATION.clone()), conversation: vec![turn] };
    let interpreted = grammar::interpret(&request).unwrap();
    // What is understood as it was said keeps its meaning.
    let literal = intent.not_understood.is_empty() && interpreted.read_as.is_empty();
    assert!(!literal || interpreted.not_understood.is_empty());
    resolve(&interpreted);
    resolve(&intent)
}

/// The first block is the answer, the second the utterance; the first byte chooses the question.
pub(crate) fn model_answer(_: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let question = parts.byte();
    let (spoken, answer) = (parts.block(), parts.rest());
    let (Ok(spoken), Ok(answer)) = (std::str::from_utf8(spoken), std::str::from_utf8(answer)) else { return false };
    match question % 3 {
        0 => {
            let observation = Some(OBSERVATION.clone());
            let request = IntentRequest { text: spoken.to_owned(), observation, ..IntentRequest::default() };
            PROMPT.parse_answer(answer, &request).is_ok_and(|intent| resolve(&intent))
        }
        1 => unit_choice::parse_answer(answer, state()).is_ok(),
        _ => paraphrase::parse_answer(answer, spoken, "coloured sac #ff0000").is_ok(),
    }
}

fn state() -> &'static State {
    OBSERVATION.scene.as_ref().unwrap()
}

/// Tries every clause, and says whether every word was understood.
fn resolve(intent: &Intent) -> bool {
    for clause in &intent.clauses {
        // A refusal is an answer.
        let _ = commands::resolve(clause, state(), None);
    }
    intent.not_understood.is_empty()
}
