//! Recognizers and synthesizers: what is installed is used, and what is missing is named with its remedy.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use sg_layers::Precision;
use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::{Recognition, Recognizer, Synthesizer};
use sg_speech::sphinx::{MODELS, Sphinx};
use sg_speech::synthesis::{Espeak, Flite};
use sg_whisper::{RecognizerSettings, Whisper, WhisperRecognizer};

use crate::params::{BackendParams, RecognizerChoice, SynthesizerChoice};

/// Model that is used without a parameter, in the user's cache.
const USUAL_MODEL: &str = "models/whisper-tiny.en";
/// Voice of espeak-ng without a parameter.
const ESPEAK_VOICE: &str = "en-us";
/// Voice of flite without a parameter.
const FLITE_VOICE: &str = "slt";
/// Speed of espeak-ng.
const WORDS_PER_MINUTE: u32 = 165;

/// A recognizer that can prepare a grammar before it is needed.
pub(crate) enum AnyRecognizer {
    Whisper(Box<WhisperRecognizer>),
    Sphinx(Box<Sphinx>),
}

impl AnyRecognizer {
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Whisper(whisper) => whisper.name(),
            Self::Sphinx(sphinx) => sphinx.name(),
        }
    }

    /// Takes in a grammar. Returns a line about words that cannot be recognised, if there are any.
    pub(crate) fn prepare(&mut self, grammar: &PhraseGrammar, limits: &Limits) -> Result<Option<String>, SpeechError> {
        match self {
            Self::Whisper(whisper) => whisper.prepare(grammar).map(|_| None),
            Self::Sphinx(sphinx) => {
                let unknown = sphinx.prepare(grammar, limits)?;
                let line = || {
                    format!(
                        "names with these words cannot be recognised, since no rule says how they sound: {}",
                        unknown.join(", ")
                    )
                };
                Ok((!unknown.is_empty()).then(line))
            }
        }
    }

    pub(crate) fn recognize(
        &mut self,
        samples: &[f32],
        grammar: &PhraseGrammar,
        limits: &Limits,
    ) -> Result<Recognition, SpeechError> {
        match self {
            Self::Whisper(whisper) => whisper.recognize(samples, grammar, limits),
            Self::Sphinx(sphinx) => sphinx.recognize(samples, grammar, limits),
        }
    }
}

/// The folder of the usual model, if it is there.
fn usual_model() -> Option<PathBuf> {
    let cache = directories::ProjectDirs::from("", "", "supergaussian")?.cache_dir().join(USUAL_MODEL);
    cache.is_dir().then_some(cache)
}

fn search_path() -> Option<OsString> {
    std::env::var_os("PATH")
}

fn whisper(folder: &Path) -> Result<AnyRecognizer, String> {
    let model = Whisper::open(folder, Precision::F32).map_err(|e| e.to_string())?;
    Ok(AnyRecognizer::Whisper(Box::new(WhisperRecognizer::new(model, RecognizerSettings::default()))))
}

fn sphinx() -> Result<AnyRecognizer, String> {
    let sphinx = Sphinx::find(search_path().as_deref(), Path::new(MODELS)).map_err(|e| e.to_string())?;
    Ok(AnyRecognizer::Sphinx(Box::new(sphinx)))
}

/// A backend, and a line about what is missing for one or for a better one.
pub(crate) struct Chosen<T> {
    pub(crate) backend: Option<T>,
    pub(crate) notice: Option<String>,
}

impl<T> Chosen<T> {
    const NONE: Self = Self { backend: None, notice: None };

    fn found(backend: T) -> Self {
        Self { backend: Some(backend), notice: None }
    }
}

/// The recognizer that the parameters choose.
///
/// # Errors
/// One line: a recognizer that was chosen by name is not there.
pub(crate) fn recognizer(params: &BackendParams) -> Result<Chosen<AnyRecognizer>, String> {
    let model = params.model.clone().or_else(usual_model);
    match (params.recognizer, model) {
        (RecognizerChoice::None, _) => Ok(Chosen::NONE),
        (RecognizerChoice::Whisper | RecognizerChoice::Auto, Some(folder)) => Ok(Chosen::found(whisper(&folder)?)),
        (RecognizerChoice::Whisper, None) => {
            Err("no Whisper model; name its folder by `model`, or run ops/models.sh".to_owned())
        }
        (RecognizerChoice::Sphinx, _) => Ok(Chosen::found(sphinx()?)),
        (RecognizerChoice::Auto, None) => Ok(match sphinx() {
            Ok(sphinx) => {
                let better = "pocketsphinx hears; a Whisper model hears better, name its folder by `model`";
                Chosen { backend: Some(sphinx), notice: Some(better.to_owned()) }
            }
            Err(missing) => {
                let nothing =
                    format!("nothing recognises speech: {missing}, or name the folder of a Whisper model by `model`");
                Chosen { backend: None, notice: Some(nothing) }
            }
        }),
    }
}

/// The synthesizer that the parameters choose.
///
/// # Errors
/// One line: a synthesizer that was chosen by name is not there, or has no such voice.
pub(crate) fn synthesizer(params: &BackendParams) -> Result<Chosen<Box<dyn Synthesizer>>, String> {
    let path = search_path();
    let voice = |usual: &'static str| if params.voice.is_empty() { usual.to_owned() } else { params.voice.clone() };
    let espeak = || Espeak::find(path.as_deref(), &voice(ESPEAK_VOICE), WORDS_PER_MINUTE).map_err(|e| e.to_string());
    let flite = || Flite::find(path.as_deref(), &voice(FLITE_VOICE)).map_err(|e| e.to_string());
    Ok(match params.synthesizer {
        SynthesizerChoice::None => Chosen::NONE,
        SynthesizerChoice::Espeak => Chosen::found(Box::new(espeak()?)),
        SynthesizerChoice::Flite => Chosen::found(Box::new(flite()?)),
        SynthesizerChoice::Auto => match (espeak(), flite()) {
            (Ok(espeak), _) => Chosen::found(Box::new(espeak)),
            (Err(_), Ok(flite)) => Chosen::found(Box::new(flite)),
            (Err(missing), Err(_)) => {
                Chosen { backend: None, notice: Some(format!("replies are not spoken: {missing}")) }
            }
        },
    })
}
