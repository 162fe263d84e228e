//! The marks before a text, decoded once for all that may follow.

use crate::decoder::{Branch, Node, TokenTree};
use crate::error::WhisperError;
use crate::model::{Hearing, Whisper};
use crate::options::{MAX_BEAMS, MAX_TOKENS, Options};
use crate::probability::log_sum;
use crate::rules::Rules;

/// Where texts begin.
pub(crate) struct Start {
    pub(crate) tree: TokenTree,
    /// The last mark.
    pub(crate) node: Node,
    /// What may follow it, before the rules.
    pub(crate) logits: Vec<f32>,
    /// Probability that nobody speaks.
    pub(crate) no_speech: f32,
    /// Code of the language, where the model knows several.
    pub(crate) language: Option<String>,
    /// Most tokens that there is room for behind the marks.
    pub(crate) room: usize,
    pub(crate) rules: Rules,
}

impl Whisper {
    /// Decodes the marks before a text.
    pub(crate) fn start(&self, hearing: &Hearing, options: &Options) -> Result<Start, WhisperError> {
        if !(1..=MAX_BEAMS).contains(&options.beams) {
            return Err(WhisperError::option("beams", format!("{}; it can be 1 to {MAX_BEAMS}", options.beams)));
        }
        if !(1..=MAX_TOKENS).contains(&options.most_tokens) {
            let problem = format!("{}; it can be 1 to {MAX_TOKENS}", options.most_tokens);
            return Err(WhisperError::option("most_tokens", problem));
        }
        let language = self.language(hearing, options)?;
        let context = self.decoder.context();
        let of_prompt = (context / 2).saturating_sub(1);
        let id = language.as_ref().map(|(_, id)| *id);
        let prefix = self.vocabulary.prefix(options.prompt.as_deref(), of_prompt, id, options.timestamps)?;
        let Some(room) = context.checked_sub(prefix.len()).filter(|room| *room > 0) else {
            let problem = format!("the model's context of {context} tokens has no room behind it; shorten it");
            return Err(WhisperError::option("prompt", problem));
        };
        let mut tree = self.decoder.tree();
        let chain: Vec<Branch> =
            prefix.iter().enumerate().map(|(at, token)| Branch { parent: at.checked_sub(1), token: *token }).collect();
        let outputs = self.decoder.advance(&hearing.keys, &mut tree, &chain)?;
        let first = prefix.iter().position(|token| *token == self.vocabulary.start).unwrap_or_default();
        let of_start = self.decoder.logits(&outputs.narrow(0, first, 1)?)?;
        let no_speech = (of_start[self.vocabulary.no_speech as usize] - log_sum(&of_start)).exp();
        let none = crate::config::Suppressed::default();
        let suppressed = if options.suppress { &self.suppressed } else { &none };
        Ok(Start {
            node: prefix.len() - 1,
            logits: self.decoder.logits(&outputs.narrow(0, prefix.len() - 1, 1)?)?,
            tree,
            no_speech,
            language: language.map(|(code, _)| code),
            room,
            rules: Rules::new(&self.vocabulary, suppressed, options.timestamps, hearing.frames),
        })
    }

    /// Checks the code of a language.
    ///
    /// # Errors
    /// [`WhisperError::Option`]: the model does not know it. The message lists some that it knows.
    pub fn check_language(&self, code: Option<&str>) -> Result<(), WhisperError> {
        code.map_or(Ok(()), |code| self.known_language(code).map(|_| ()))
    }

    /// A language by its code; none for English in a model of English.
    fn known_language(&self, code: &str) -> Result<Option<(String, u32)>, WhisperError> {
        let languages = self.vocabulary.languages();
        if languages.is_empty() {
            let other = || {
                WhisperError::option("language", format!("`{code}`, but the model knows `en` alone; take another one"))
            };
            return if code == "en" { Ok(None) } else { Err(other()) };
        }
        let found = languages.iter().find(|(own, _)| own == code).cloned();
        let unknown = || {
            let known: Vec<&str> = languages.iter().map(|(own, _)| own.as_str()).take(12).collect();
            WhisperError::option("language", format!("`{code}`; the model knows {} and so on", known.join(", ")))
        };
        found.map(Some).ok_or_else(unknown)
    }

    /// The wanted language, or the likeliest one; none for a model of English.
    fn language(&self, hearing: &Hearing, options: &Options) -> Result<Option<(String, u32)>, WhisperError> {
        let languages = self.vocabulary.languages();
        match options.language.as_deref() {
            Some(code) => self.known_language(code),
            None if languages.is_empty() => Ok(None),
            None => {
                let mut tree = self.decoder.tree();
                let start = [Branch { parent: None, token: self.vocabulary.start }];
                let outputs = self.decoder.advance(&hearing.keys, &mut tree, &start)?;
                let logits = self.decoder.logits(&outputs)?;
                let of = |id: u32| logits[id as usize];
                Ok(languages.iter().max_by(|(_, a), (_, b)| of(*a).total_cmp(&of(*b))).cloned())
            }
        }
    }
}
