//! Tokens of texts and the marks around them, by a model's `tokenizer.json`.

use std::path::Path;

use sg_input::file;
use tokenizers::Tokenizer;

use crate::error::WhisperError;

/// Most bytes of a tokenizer. The multilingual ones have 4 MB.
const MAX_BYTES: u64 = 64 << 20;
/// Most bytes of a text. No context has room for more.
const MAX_TEXT_BYTES: usize = 8 << 10;

/// The tokenizer of one model, with the ids of its marks.
pub(crate) struct Vocabulary {
    tokenizer: Tokenizer,
    /// Number of tokens, those of times included.
    pub(crate) size: usize,
    /// `<|endoftext|>`. Tokens of text have lower ids; marks and times have higher ones.
    pub(crate) end: u32,
    /// `<|startoftranscript|>`.
    pub(crate) start: u32,
    /// `<|startofprev|>`, before a prompt.
    previous: u32,
    /// `<|nospeech|>`.
    pub(crate) no_speech: u32,
    no_timestamps: u32,
    transcribe: u32,
    /// Languages by their codes; empty for a model of English.
    languages: Vec<(String, u32)>,
}

impl Vocabulary {
    /// Opens a tokenizer for a model with `size` tokens.
    pub(crate) fn open(path: &Path, size: usize, multilingual: bool) -> Result<Self, WhisperError> {
        let wrong = |problem: String| WhisperError::file(path, problem);
        let bytes = file::read(path, MAX_BYTES).map_err(|error| wrong(error.to_string()))?;
        let mut tokenizer =
            Tokenizer::from_bytes(bytes).map_err(|error| wrong(format!("not a tokenizer of Hugging Face: {error}")))?;
        tokenizer.with_padding(None);
        tokenizer.with_truncation(None).map_err(|error| wrong(error.to_string()))?;
        let mark = |names: &[&str]| {
            let found = names.iter().find_map(|name| tokenizer.token_to_id(name));
            found.filter(|id| (*id as usize) < size).ok_or_else(|| {
                let name = names[0];
                wrong(format!("no token `{name}` below {size}; take tokenizer and weights from the same Whisper model"))
            })
        };
        let languages = if multilingual { languages(&tokenizer, size) } else { Vec::new() };
        if multilingual && languages.is_empty() {
            return Err(wrong(
                "the model is multilingual, but no token names a language; take both from one model".into(),
            ));
        }
        let vocabulary = Self {
            size,
            end: mark(&["<|endoftext|>"])?,
            start: mark(&["<|startoftranscript|>"])?,
            previous: mark(&["<|startofprev|>"])?,
            no_speech: mark(&["<|nospeech|>", "<|nocaptions|>"])?,
            no_timestamps: mark(&["<|notimestamps|>"])?,
            transcribe: mark(&["<|transcribe|>"])?,
            languages,
            tokenizer,
        };
        if vocabulary.start <= vocabulary.end {
            return Err(wrong(
                "`<|startoftranscript|>` does not stand behind `<|endoftext|>`; get the tokenizer again".into(),
            ));
        }
        Ok(vocabulary)
    }

    /// Whether the model knows other languages than English.
    pub(crate) fn is_multilingual(&self) -> bool {
        !self.languages.is_empty()
    }

    /// The tokens of languages.
    pub(crate) fn languages(&self) -> &[(String, u32)] {
        &self.languages
    }

    /// The first token of a time. Times have steps of 20 ms.
    pub(crate) fn first_time(&self) -> u32 {
        self.no_timestamps + 1
    }

    /// The marks before a text. The first is a prompt, cut at its start to `most_of_prompt` tokens, where there is one.
    pub(crate) fn prefix(
        &self,
        prompt: Option<&str>,
        most_of_prompt: usize,
        language: Option<u32>,
        times: bool,
    ) -> Result<Vec<u32>, WhisperError> {
        let mut prefix = Vec::new();
        if let Some(prompt) = prompt.map(str::trim).filter(|prompt| !prompt.is_empty()) {
            let ids = self.ids(&format!(" {prompt}")).map_err(|problem| WhisperError::option("prompt", problem))?;
            prefix.push(self.previous);
            prefix.extend(&ids[ids.len().saturating_sub(most_of_prompt)..]);
        }
        prefix.push(self.start);
        if let Some(language) = language {
            prefix.extend([language, self.transcribe]);
        }
        if !times {
            prefix.push(self.no_timestamps);
        }
        Ok(prefix)
    }

    /// The tokens of a text without marks, or what is wrong with it.
    pub(crate) fn ids(&self, text: &str) -> Result<Vec<u32>, String> {
        if text.len() > MAX_TEXT_BYTES {
            return Err(format!("it has {} bytes; a text has at most {MAX_TEXT_BYTES}", text.len()));
        }
        let encoding = self.tokenizer.encode_fast(text, false).map_err(|error| error.to_string())?;
        let ids = encoding.get_ids().to_vec();
        match ids.iter().find(|id| **id >= self.end) {
            Some(id) => Err(format!("its token {id} is a mark; leave marks of the model out of texts")),
            None => Ok(ids),
        }
    }

    /// The text of tokens. Marks and times are left out.
    pub(crate) fn text(&self, ids: &[u32]) -> Result<String, WhisperError> {
        let ids: Vec<u32> = ids.iter().copied().filter(|id| *id < self.end).collect();
        let text = self.tokenizer.decode(&ids, false);
        text.map_err(|error| WhisperError::Sound(format!("its tokens are no text: {error}; get the model again")))
    }
}

/// Tokens such as `<|en|>`.
fn languages(tokenizer: &Tokenizer, size: usize) -> Vec<(String, u32)> {
    let mut languages: Vec<(String, u32)> = tokenizer
        .get_added_tokens_decoder()
        .into_iter()
        .filter(|(id, _)| (*id as usize) < size)
        .filter_map(|(id, token)| {
            let code = token.content.strip_prefix("<|")?.strip_suffix("|>")?;
            let is_code = (2..=3).contains(&code.len()) && code.bytes().all(|byte| byte.is_ascii_lowercase());
            is_code.then(|| (code.to_owned(), id))
        })
        .collect();
    languages.sort_by_key(|(_, id)| *id);
    languages
}
