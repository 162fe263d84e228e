//! Parameters in the launch file.

use std::path::PathBuf;
use std::time::Duration;

use serde::Deserialize;
use sg_speech::endpoint::{BargeIn, EndpointSettings, Trigger};

use crate::remote::ServerParams;

/// What opens the microphone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Opening {
    /// Speech itself.
    #[default]
    Voice,
    /// A button or key that is held.
    Held,
}

/// Which recognizer is used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum RecognizerChoice {
    /// Whisper if there is a model, else sphinx if it is installed
    #[default]
    Auto,
    /// Whisper with a model in a folder
    Whisper,
    /// pocketsphinx with a grammar
    Sphinx,
    /// A server with OpenAI's `audio/transcriptions`
    Openai,
    /// A program that serves `supergaussian.backend.v1.SpeechBackendService`
    Grpc,
    /// None
    None,
}

/// Which synthesizer is used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SynthesizerChoice {
    /// Piper if there is a voice, else espeak-ng or flite, whichever is installed
    #[default]
    Auto,
    /// A neural voice of Piper in a folder
    Piper,
    /// espeak-ng
    Espeak,
    /// flite
    Flite,
    /// A server with OpenAI's `audio/speech`
    Openai,
    /// A program that serves `supergaussian.backend.v1.SpeechBackendService`
    Grpc,
    /// None
    None,
}

impl RecognizerChoice {
    /// Whether it is a server that must be named.
    pub(crate) fn is_server(self) -> bool {
        matches!(self, Self::Openai | Self::Grpc)
    }
}

impl SynthesizerChoice {
    /// Whether it speaks with the voice in a folder.
    pub(crate) fn takes_voice_model(self) -> bool {
        matches!(self, Self::Auto | Self::Piper)
    }

    /// Whether it is a server that must be named.
    pub(crate) fn is_server(self) -> bool {
        matches!(self, Self::Openai | Self::Grpc)
    }
}

/// Which recognizer and synthesizer, for the process and for its offline commands.
#[derive(Debug, Clone, Default)]
pub(crate) struct BackendParams {
    pub(crate) recognizer: RecognizerChoice,
    pub(crate) recognizer_server: ServerParams,
    pub(crate) model: Option<PathBuf>,
    pub(crate) language: String,
    /// Whether texts have the times of their parts.
    pub(crate) times: bool,
    pub(crate) synthesizer: SynthesizerChoice,
    pub(crate) synthesizer_server: ServerParams,
    pub(crate) voice_model: Option<PathBuf>,
    pub(crate) voice: String,
}

/// Parameters of the process.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Params {
    /// `device`, `device:NAME`, a WAV file or a named pipe; empty for none.
    pub(crate) input: String,
    /// Samples a second of a pipe: 16-bit mono, little-endian.
    pub(crate) input_rate: u32,
    /// As `input`: where replies go; empty for nowhere.
    pub(crate) output: String,
    /// Samples a second of the output.
    pub(crate) output_rate: u32,
    /// What opens the microphone.
    pub(crate) trigger: Opening,
    /// Whether speech stops a reply that sounds. Without it the microphone is closed meanwhile.
    pub(crate) barge_in: bool,
    /// Whether the microphone is closed at first.
    pub(crate) muted: bool,
    /// Whether any sentence goes to the agents, for a language model that understands more than the commands.
    pub(crate) free_text: bool,
    /// Silence that ends an utterance, seconds.
    pub(crate) silence: f64,
    /// Recognizer: `auto`, `whisper`, `sphinx`, `openai`, `grpc`, `none`.
    pub(crate) recognizer: RecognizerChoice,
    /// Server of the recognizers `openai` and `grpc`.
    pub(crate) recognizer_server: ServerParams,
    /// Folder of a Whisper model.
    pub(crate) model: Option<PathBuf>,
    /// Code of the spoken language, such as `en`; `auto`: a model of many languages finds it out.
    pub(crate) language: String,
    /// Synthesizer: `auto`, `piper`, `espeak`, `flite`, `openai`, `grpc`, `none`.
    pub(crate) synthesizer: SynthesizerChoice,
    /// Server of the synthesizers `openai` and `grpc`.
    pub(crate) synthesizer_server: ServerParams,
    /// Folder of a Piper voice.
    pub(crate) voice_model: Option<PathBuf>,
    /// Voice of the synthesizer, of Piper the speaker; empty for its default.
    pub(crate) voice: String,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            input: String::new(),
            input_rate: 16_000,
            output: String::new(),
            output_rate: 22_050,
            trigger: Opening::default(),
            barge_in: true,
            muted: false,
            free_text: false,
            silence: 0.5,
            recognizer: RecognizerChoice::default(),
            recognizer_server: ServerParams::default(),
            model: None,
            // The commands are English, and in noise a model may take them for another language.
            language: "en".to_owned(),
            synthesizer: SynthesizerChoice::default(),
            synthesizer_server: ServerParams::default(),
            voice_model: None,
            voice: String::new(),
        }
    }
}

impl Params {
    /// Recognizer and synthesizer. Without a microphone nothing needs to be recognised, and without an output no voice is loaded that
    /// nobody has chosen.
    pub(crate) fn backends(&self) -> BackendParams {
        let silent = self.output.is_empty() && self.synthesizer == SynthesizerChoice::Auto;
        BackendParams {
            recognizer: if self.input.is_empty() { RecognizerChoice::None } else { self.recognizer },
            recognizer_server: self.recognizer_server.clone(),
            model: self.model.clone(),
            language: self.language.clone(),
            times: false,
            synthesizer: if silent { SynthesizerChoice::None } else { self.synthesizer },
            synthesizer_server: self.synthesizer_server.clone(),
            voice_model: self.voice_model.clone(),
            voice: self.voice.clone(),
        }
    }

    /// Settings of the endpointer.
    ///
    /// # Errors
    /// One line: a time out of bounds.
    pub(crate) fn endpoints(&self) -> Result<EndpointSettings, String> {
        if !(0.1..=5.0).contains(&self.silence) {
            return Err(format!("silence = {}: take 0.1 to 5 seconds", self.silence));
        }
        let usual = EndpointSettings::default();
        Ok(EndpointSettings {
            trigger: match self.trigger {
                Opening::Voice => Trigger::Voice,
                Opening::Held => Trigger::Held,
            },
            barge_in: if self.barge_in { usual.barge_in } else { BargeIn::Off },
            hang_over: Duration::from_secs_f64(self.silence),
            ..usual
        })
    }
}
