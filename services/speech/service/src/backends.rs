//! Recognizers and synthesizers: what is installed is used, and what is missing is named with its remedy.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use sg_endpoint::Endpoint;
use sg_layers::Precision;
use sg_piper::Piper;
use sg_speech::recognizer::{Recognizer, Synthesizer};
use sg_speech::sphinx::{MODELS, Sphinx};
use sg_speech::synthesis::{Espeak, Flite};
use sg_whisper::{RecognizerSettings, Whisper, WhisperRecognizer};
use tokio::runtime::Handle;

use crate::params::{BackendParams, RecognizerChoice, SynthesizerChoice};
use crate::remote::{Grpc, OpenAi, ServerError};

/// Model and voice that are used without a parameter, in the user's cache.
const USUAL_MODEL: &str = "models/whisper-tiny.en";
const USUAL_VOICE: &str = "models/piper-en_US-joe-medium";
/// Voice of espeak-ng without a parameter.
const ESPEAK_VOICE: &str = "en-us";
/// Voice of flite without a parameter.
const FLITE_VOICE: &str = "slt";
/// Most files of a voice's folder that are looked at.
const MAX_FILES: usize = 1_000;
/// Speed of espeak-ng.
const WORDS_PER_MINUTE: u32 = 165;

/// A folder in the user's cache, if it is there.
fn cached(folder: &str) -> Option<PathBuf> {
    let cache = directories::ProjectDirs::from("", "", "supergaussian")?.cache_dir().join(folder);
    cache.is_dir().then_some(cache)
}

fn search_path() -> Option<OsString> {
    std::env::var_os("PATH")
}

fn whisper(folder: &Path, language: &str, times: bool) -> Result<Box<dyn Recognizer>, String> {
    let model = Whisper::open(folder, Precision::F32).map_err(|e| e.to_string())?;
    let language = (!language.is_empty()).then(|| language.to_owned());
    model.check_language(language.as_deref()).map_err(|e| e.to_string())?;
    let settings = RecognizerSettings { language, times, ..RecognizerSettings::default() };
    Ok(Box::new(WhisperRecognizer::new(model, settings)))
}

fn sphinx(language: &str) -> Result<Box<dyn Recognizer>, String> {
    if !matches!(language, "" | "en") {
        return Err(format!("`language` is `{language}`, but pocketsphinx knows `en` alone; take another recognizer"));
    }
    let sphinx = Sphinx::find(search_path().as_deref(), Path::new(MODELS)).map_err(|e| e.to_string())?;
    Ok(Box::new(sphinx))
}

/// The Piper voice in a folder. `speaker`: one of the voice's speakers, or empty.
fn piper(folder: &Path, speaker: &str) -> Result<Box<dyn Synthesizer>, String> {
    let shown = || sg_input::printable(&folder.display().to_string()).into_owned();
    let entries = std::fs::read_dir(folder).map_err(|e| format!("`voice_model`: {}: {e}", shown()))?;
    let files = entries.flatten().take(MAX_FILES).map(|entry| entry.path());
    let mut voices = files.filter(|path| path.extension().is_some_and(|extension| extension == "onnx"));
    let (Some(voice), None) = (voices.next(), voices.next()) else {
        return Err(format!("`voice_model`: {}: name a folder with one voice, NAME.onnx and NAME.onnx.json", shown()));
    };
    let piper = Piper::open(&voice, search_path().as_deref()).map_err(|e| e.to_string())?;
    Ok(Box::new(if speaker.is_empty() {
        piper
    } else {
        piper.with_speaker(speaker).map_err(|e| format!("`voice`: {e}"))?
    }))
}

/// A backend, and a line about what is missing for one or for a better one.
pub(crate) struct Chosen<T> {
    pub(crate) backend: Option<T>,
    pub(crate) notice: Option<String>,
    /// Where it is, if it is another program behind an endpoint.
    pub(crate) endpoint: Option<Endpoint>,
}

impl<T> Chosen<T> {
    const NONE: Self = Self { backend: None, notice: None, endpoint: None };

    fn found(backend: T) -> Self {
        Self { backend: Some(backend), ..Self::NONE }
    }

    fn missing(notice: String) -> Self {
        Self { notice: Some(notice), ..Self::NONE }
    }

    fn remote(endpoint: Endpoint, backend: T) -> Self {
        Self { backend: Some(backend), endpoint: Some(endpoint), ..Self::NONE }
    }

    /// Whether data go to another machine.
    pub(crate) fn leaves_this_machine(&self) -> bool {
        self.endpoint.as_ref().is_some_and(|endpoint| !endpoint.is_local())
    }

    /// The backend for people: a name, and where it is if it is no part of this process.
    pub(crate) fn shown(&self, name: impl Fn(&T) -> &'static str) -> String {
        let name = self.backend.as_ref().map_or("", name);
        self.endpoint.as_ref().map_or_else(|| name.to_owned(), |endpoint| format!("{name} at {endpoint}"))
    }
}

/// The recognizer that the parameters choose.
///
/// # Errors
/// One line: a recognizer that was chosen by name is not there.
pub(crate) fn recognizer(params: &BackendParams, runtime: &Handle) -> Result<Chosen<Box<dyn Recognizer>>, String> {
    let model = params.model.clone().or_else(|| cached(USUAL_MODEL));
    let server = &params.recognizer_server;
    // An empty code leaves it to the recognizer.
    let language = if params.language == "auto" { "" } else { params.language.as_str() };
    let fault = |error: ServerError| format!("`recognizer_server`: {error}");
    match (params.recognizer, model) {
        (RecognizerChoice::None, _) => Ok(Chosen::NONE),
        (RecognizerChoice::Openai, _) => {
            let backend = OpenAi::recognizer(server, language, runtime).map_err(fault)?;
            Ok(Chosen::remote(backend.endpoint(), Box::new(backend)))
        }
        (RecognizerChoice::Grpc, _) => {
            let backend = Grpc::recognizer(server, language, runtime).map_err(fault)?;
            Ok(Chosen::remote(backend.endpoint(), Box::new(backend)))
        }
        (RecognizerChoice::Whisper | RecognizerChoice::Auto, Some(folder)) => {
            Ok(Chosen::found(whisper(&folder, language, params.times)?))
        }
        (RecognizerChoice::Whisper, None) => {
            Err("no Whisper model; name its folder by `model`, or run ops/models.sh".to_owned())
        }
        (RecognizerChoice::Sphinx, _) => Ok(Chosen::found(sphinx(language)?)),
        (RecognizerChoice::Auto, None) => Ok(match sphinx(language) {
            Ok(sphinx) => {
                let better = "pocketsphinx hears; a Whisper model hears better, name its folder by `model`";
                Chosen { notice: Some(better.to_owned()), ..Chosen::found(sphinx) }
            }
            Err(missing) => Chosen::missing(format!(
                "nothing recognises speech: {missing}, or name the folder of a Whisper model by `model`"
            )),
        }),
    }
}

/// The synthesizer that the parameters choose.
///
/// # Errors
/// One line: a synthesizer that was chosen by name is not there, or has no such voice.
pub(crate) fn synthesizer(params: &BackendParams, runtime: &Handle) -> Result<Chosen<Box<dyn Synthesizer>>, String> {
    let path = search_path();
    let voice = |usual: &'static str| if params.voice.is_empty() { usual.to_owned() } else { params.voice.clone() };
    let espeak = || -> Result<Box<dyn Synthesizer>, String> {
        let found = Espeak::find(path.as_deref(), &voice(ESPEAK_VOICE), WORDS_PER_MINUTE);
        Ok(Box::new(found.map_err(|e| e.to_string())?))
    };
    let flite = || -> Result<Box<dyn Synthesizer>, String> {
        Ok(Box::new(Flite::find(path.as_deref(), &voice(FLITE_VOICE)).map_err(|e| e.to_string())?))
    };
    let fault = |error: ServerError| format!("`synthesizer_server`: {error}");
    let server = &params.synthesizer_server;
    Ok(match params.synthesizer {
        SynthesizerChoice::Piper => {
            let folder = params.voice_model.clone().or_else(|| cached(USUAL_VOICE));
            let folder = folder.ok_or("no Piper voice; name its folder by `voice_model`, or run ops/models.sh")?;
            Chosen::found(piper(&folder, &params.voice)?)
        }
        SynthesizerChoice::Openai => {
            let backend = OpenAi::synthesizer(server, &params.voice, runtime).map_err(fault)?;
            Chosen::remote(backend.endpoint(), Box::new(backend))
        }
        SynthesizerChoice::Grpc => {
            let backend = Grpc::synthesizer(server, &params.voice, runtime).map_err(fault)?;
            Chosen::remote(backend.endpoint(), Box::new(backend))
        }
        SynthesizerChoice::None => Chosen::NONE,
        SynthesizerChoice::Espeak => Chosen::found(espeak()?),
        SynthesizerChoice::Flite => Chosen::found(flite()?),
        SynthesizerChoice::Auto => {
            if let Some(folder) = &params.voice_model {
                return Ok(Chosen::found(piper(folder, &params.voice)?));
            }
            // A voice that is named is one of the other synthesizers'.
            let usual = cached(USUAL_VOICE).filter(|_| params.voice.is_empty());
            let unused = match usual.map(|folder| piper(&folder, "")) {
                Some(Ok(piper)) => return Ok(Chosen::found(piper)),
                Some(Err(problem)) => Some(format!("the Piper voice is not used: {problem}")),
                None => None,
            };
            match espeak().or_else(|missing| flite().map_err(|_| missing)) {
                Ok(backend) => Chosen { notice: unused, ..Chosen::found(backend) },
                Err(missing) => Chosen::missing(format!("replies are not spoken: {missing}")),
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_one_voice_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |folder: &Path| piper(folder, "").err().unwrap();
        let names_folder = |message: &str| message.starts_with(&format!("`voice_model`: {}", folder.path().display()));
        let message = refused(folder.path());
        assert!(names_folder(&message) && message.contains("NAME.onnx.json"), "{message}");
        std::fs::write(folder.path().join("a.onnx"), b"no voice").unwrap();
        let message = refused(folder.path());
        assert!(message.contains("a.onnx.json"), "{message}");
        std::fs::write(folder.path().join("b.onnx"), b"another").unwrap();
        let message = refused(folder.path());
        assert!(names_folder(&message) && message.contains("one voice"), "{message}");
        let message = refused(&folder.path().join("none"));
        assert!(names_folder(&message), "{message}");
    }
}
