//! A model in a folder, and what it hears of a sound.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use sg_layers::{Precision, Weights};

use crate::config::{HuggingFaceConfig, ModelSize, Suppressed, read_ctranslate2};
use crate::ctranslate2::CTranslate2Reader;
use crate::decoder::{Decoder, SoundKeys};
use crate::encoder::Encoder;
use crate::error::WhisperError;
use crate::layout::{LayerReader, Layout};
use crate::spectrogram::{FRAMES_OF_CONTEXT, MelFilters, SAMPLE_RATE, SAMPLES_OF_CONTEXT};
use crate::vocabulary::Vocabulary;

/// How much silence behind a sound the encoder looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AudioContext {
    /// As much as fills 30 s, as in training.
    #[default]
    Whole,
    /// As much as fills so many frames of 20 ms, or as many as the sound has where that is more. Shorter is faster.
    Frames(usize),
}

/// A Whisper model.
pub struct Whisper {
    filters: MelFilters,
    encoder: Encoder,
    pub(crate) decoder: Decoder,
    pub(crate) vocabulary: Vocabulary,
    pub(crate) suppressed: Suppressed,
    size: ModelSize,
}

/// A sound as a model heard it.
pub struct Hearing {
    pub(crate) keys: SoundKeys,
    /// Frames of 20 ms that the encoder looked at.
    pub frames: usize,
    /// Length of the sound in seconds.
    pub seconds: f32,
}

impl Whisper {
    /// Opens the model in a folder. In Hugging Face's layout it has `config.json`, `model.safetensors`, `tokenizer.json` and
    /// perhaps `generation_config.json`; in CTranslate2's `model.bin`, `tokenizer.json` and perhaps `config.json`.
    ///
    /// # Errors
    /// [`WhisperError`] with the file, the place in it and the remedy.
    pub fn open(folder: &Path, precision: Precision) -> Result<Self, WhisperError> {
        let (safetensors, binary) = (folder.join("model.safetensors"), folder.join("model.bin"));
        if safetensors.exists() {
            let config = HuggingFaceConfig::read(folder)?;
            let weights = Weights::open(&safetensors)?;
            let prefix = if weights.has("model.encoder.conv1.weight") { "model." } else { "" };
            let reader =
                LayerReader { weights, layout: Layout::HuggingFace { prefix }, precision, width: config.size.width };
            return Self::read(folder, reader, config.size, config.suppressed, config.multilingual);
        }
        if binary.exists() {
            let file = CTranslate2Reader::open(&binary)?;
            let size = file.size()?;
            let (suppressed, multilingual) = read_ctranslate2(folder, &size)?;
            let weights = Weights::of(Box::new(file));
            let reader = LayerReader { weights, layout: Layout::CTranslate2, precision, width: size.width };
            return Self::read(folder, reader, size, suppressed, multilingual);
        }
        let problem = "there is neither model.safetensors nor model.bin; name the folder of a Whisper model";
        Err(WhisperError::file(folder, problem))
    }

    fn read(
        folder: &Path,
        mut reader: LayerReader,
        size: ModelSize,
        suppressed: Suppressed,
        multilingual: bool,
    ) -> Result<Self, WhisperError> {
        let vocabulary = Vocabulary::open(&folder.join("tokenizer.json"), size.vocabulary, multilingual)?;
        Ok(Self {
            filters: MelFilters::new(size.bands),
            encoder: Encoder::read(&mut reader, &size)?,
            decoder: Decoder::read(&mut reader, &size)?,
            vocabulary,
            suppressed,
            size,
        })
    }

    /// Whether the model knows other languages than English.
    #[must_use]
    pub fn is_multilingual(&self) -> bool {
        self.vocabulary.is_multilingual()
    }

    /// The longest sound in seconds: 30 for published models.
    #[must_use]
    pub fn most_seconds(&self) -> f32 {
        (self.size.frames * SAMPLES_OF_CONTEXT) as f32 / SAMPLE_RATE as f32
    }

    /// Listens to a sound of mono samples at 16 kHz, from −1 to 1.
    ///
    /// # Errors
    /// [`WhisperError::Sound`] for a sound that is longer than [`Self::most_seconds`] or not finite, [`WhisperError::Cancelled`].
    pub fn listen(&self, samples: &[f32], context: AudioContext, cancel: &AtomicBool) -> Result<Hearing, WhisperError> {
        let (most, own) = (self.size.frames, samples.len().div_ceil(SAMPLES_OF_CONTEXT));
        let seconds = samples.len() as f32 / SAMPLE_RATE as f32;
        if own > most {
            let limit = self.most_seconds();
            return Err(WhisperError::Sound(format!(
                "it has {seconds:.1} s, more than {limit:.0} s; cut it at a pause"
            )));
        }
        let frames = match context {
            AudioContext::Whole => most,
            AudioContext::Frames(frames) => frames.max(own).clamp(1, most),
        };
        check(cancel)?;
        let spectrogram = self.filters.spectrogram(samples, frames * FRAMES_OF_CONTEXT)?;
        let rows = self.encoder.apply(&spectrogram)?;
        check(cancel)?;
        Ok(Hearing { keys: self.decoder.sound_keys(&rows)?, frames, seconds })
    }

    #[cfg(test)]
    pub(crate) fn parts(&self) -> (&MelFilters, &Encoder, &Decoder) {
        (&self.filters, &self.encoder, &self.decoder)
    }
}

/// Whether the caller's flag is down.
pub(crate) fn check(cancel: &AtomicBool) -> Result<(), WhisperError> {
    if cancel.load(Ordering::Relaxed) { Err(WhisperError::Cancelled) } else { Ok(()) }
}
