//! Answers of servers that an endpoint names.

use supergaussian_speech::transcription::Transcription;

use crate::stage::Stage;

/// An answer of `chat/completions`.
pub(crate) fn chat_completion(_: &Stage, input: &[u8]) -> bool {
    match sg_llm::completion_text(input) {
        Ok(text) => !text.trim().is_empty(),
        Err(error) => {
            let error = error.to_string();
            assert!(!error.is_empty() && !error.contains('\n'), "{error:?}");
            false
        }
    }
}

/// An answer of `audio/transcriptions`.
pub(crate) fn transcription(_: &Stage, input: &[u8]) -> bool {
    match Transcription::parse(input) {
        Ok(heard) => {
            let (text, confidence) = (heard.text(), heard.confidence());
            assert!(text.len() <= input.len() && confidence >= 0.0, "{confidence}");
            true
        }
        Err(error) => {
            let error = error.to_string();
            assert!(!error.is_empty() && !error.contains('\n'), "{error:?}");
            false
        }
    }
}
