//! A list of sentences as a tree of tokens, in which sentences share their beginnings.

use std::collections::HashMap;

use crate::error::WhisperError;
use crate::model::Whisper;
use crate::spelling::{normalized, spellings};

/// Most sentences of a list.
pub const MAX_SENTENCES: usize = 20_000;
/// Most tokens of a sentence's spelling.
pub const MAX_SENTENCE_TOKENS: usize = 64;
/// Most tokens of a tree.
const MAX_NODES: usize = 400_000;

/// Sentences that may have been said, for one model.
pub struct Phrases {
    sentences: Vec<String>,
    by_normalized: HashMap<String, usize>,
    pub(crate) nodes: Vec<PhraseNode>,
    /// Tokens of each sentence's shortest spelling, its end included.
    pub(crate) lengths: Vec<usize>,
}

/// A token of the tree. The first node is the root and has none.
#[derive(Debug, Default)]
pub(crate) struct PhraseNode {
    pub(crate) token: u32,
    pub(crate) children: Vec<usize>,
    /// Sentences that end here.
    pub(crate) ends: Vec<usize>,
    /// Tokens from here to the farthest end, that end included.
    pub(crate) height: usize,
}

impl Phrases {
    /// The sentences as they were given.
    #[must_use]
    pub fn sentences(&self) -> &[String] {
        &self.sentences
    }

    /// Number of tokens in the tree.
    #[must_use]
    pub fn tokens(&self) -> usize {
        self.nodes.len() - 1
    }

    /// The place of the sentence that sounds like this text, if one does.
    #[must_use]
    pub fn find(&self, text: &str) -> Option<usize> {
        self.by_normalized.get(&normalized(text)).copied()
    }
}

impl Whisper {
    /// The tree of a list of sentences. Of those that sound the same, the first one counts. Building it does not need the sound.
    ///
    /// # Errors
    /// [`WhisperError::Sentence`] for one that is empty or too long, [`WhisperError::Option`] for too many.
    pub fn phrases<S: AsRef<str>>(&self, sentences: &[S]) -> Result<Phrases, WhisperError> {
        let count = sentences.len();
        if !(1..=MAX_SENTENCES).contains(&count) {
            return Err(WhisperError::option("phrases", format!("{count} sentences; it can be 1 to {MAX_SENTENCES}")));
        }
        let mut nodes = vec![PhraseNode::default()];
        let mut places: HashMap<(usize, u32), usize> = HashMap::new();
        let mut by_normalized = HashMap::with_capacity(count);
        let mut lengths = vec![1; count];
        for (index, sentence) in sentences.iter().enumerate() {
            let wrong = |problem: String| WhisperError::Sentence { index, problem };
            let sentence = sentence.as_ref();
            let normal = normalized(sentence);
            if normal.is_empty() {
                return Err(wrong("it has no word; leave it out".into()));
            }
            if by_normalized.contains_key(&normal) {
                continue;
            }
            by_normalized.insert(normal, index);
            let mut shortest = MAX_SENTENCE_TOKENS;
            for spelling in spellings(sentence) {
                let ids = self.vocabulary.ids(&spelling).map_err(wrong)?;
                if ids.len() > MAX_SENTENCE_TOKENS {
                    return Err(wrong(format!(
                        "it has {} tokens; a sentence has at most {MAX_SENTENCE_TOKENS}",
                        ids.len()
                    )));
                }
                shortest = shortest.min(ids.len());
                let mut at = 0;
                for token in ids {
                    at = *places.entry((at, token)).or_insert_with(|| {
                        nodes.push(PhraseNode { token, ..PhraseNode::default() });
                        let child = nodes.len() - 1;
                        nodes[at].children.push(child);
                        child
                    });
                }
                if !nodes[at].ends.contains(&index) {
                    nodes[at].ends.push(index);
                }
                if nodes.len() > MAX_NODES {
                    let problem = format!("the sentences have more than {MAX_NODES} tokens; give fewer");
                    return Err(WhisperError::option("phrases", problem));
                }
            }
            lengths[index] = shortest + 1;
        }
        // A child stands behind its parent.
        for at in (0..nodes.len()).rev() {
            nodes[at].height =
                1 + nodes[at].children.iter().map(|child| nodes[*child].height).max().unwrap_or_default();
        }
        Ok(Phrases {
            sentences: sentences.iter().map(|sentence| sentence.as_ref().to_owned()).collect(),
            by_normalized,
            nodes,
            lengths,
        })
    }
}
