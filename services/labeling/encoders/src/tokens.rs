//! Token ids of texts, by a model's `tokenizer.json`.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use sg_input::file;
use tokenizers::{PostProcessor, Tokenizer, TruncationParams};

use crate::error::EncoderError;

/// Most bytes of a tokenizer. The largest vocabularies have 35 MB.
const MAX_BYTES: u64 = 64 << 20;
/// Most bytes of a text. No context has room for more.
const MAX_TEXT_BYTES: usize = 64 << 10;

/// The tokenizer of one model.
pub(crate) struct TextTokens {
    tokenizer: Tokenizer,
    path: PathBuf,
    vocabulary: usize,
}

impl TextTokens {
    /// Opens a tokenizer for texts of at most `context` tokens, each below `vocabulary`.
    pub(crate) fn open(path: &Path, context: usize, vocabulary: usize) -> Result<Self, EncoderError> {
        let wrong = |problem: String| EncoderError::file(path, problem);
        let bytes = file::read(path, MAX_BYTES).map_err(|error| wrong(error.to_string()))?;
        let mut tokenizer =
            Tokenizer::from_bytes(bytes).map_err(|error| wrong(format!("not a tokenizer of Hugging Face: {error}")))?;
        // Marks of start and end are added after a text is cut, so that a cut text keeps its end.
        let marks = tokenizer.get_post_processor().map_or(0, |processor| processor.added_tokens(false));
        if marks >= context {
            return Err(wrong(format!("it adds {marks} marks to a text, but the model takes {context} tokens in all")));
        }
        tokenizer.with_padding(None);
        let cut = TruncationParams { max_length: context, ..TruncationParams::default() };
        tokenizer.with_truncation(Some(cut)).map_err(|error| wrong(error.to_string()))?;
        Ok(Self { tokenizer, path: path.to_owned(), vocabulary })
    }

    /// The ids of each text with its marks, cut to the context.
    pub(crate) fn encode(&self, texts: &[&str]) -> Result<Vec<Vec<u32>>, EncoderError> {
        texts.par_iter().enumerate().map(|(index, text)| self.ids(index, text)).collect()
    }

    fn ids(&self, index: usize, text: &str) -> Result<Vec<u32>, EncoderError> {
        let wrong = |problem| EncoderError::Text { index, problem };
        if text.len() > MAX_TEXT_BYTES {
            let bytes = text.len();
            return Err(wrong(format!("it has {bytes} bytes; a text has at most {MAX_TEXT_BYTES}")));
        }
        let encoding = self.tokenizer.encode_fast(text, true).map_err(|error| wrong(error.to_string()))?;
        let ids = encoding.get_ids().to_vec();
        if let Some(id) = ids.iter().find(|id| **id as usize >= self.vocabulary) {
            let (path, most) = (self.path.display(), self.vocabulary);
            return Err(wrong(format!(
                "{path} gives token {id}, but the model has {most}; take tokenizer and weights from the same model"
            )));
        }
        if ids.is_empty() {
            return Err(wrong(format!("{} gives no token for it; encode a text with words", self.path.display())));
        }
        Ok(ids)
    }
}
