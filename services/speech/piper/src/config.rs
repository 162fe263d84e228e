//! A voice's `NAME.onnx.json`, within limits.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use sg_layers::{ModelError, read_json};
use sg_speech::audio::RATES;

use crate::network::Scales;

/// Most characters of a symbol.
pub(crate) const MAX_SYMBOL: usize = 4;
/// Most ids of a symbol, and most phonemes that one is replaced by.
const MAX_IDS: usize = 8;
/// Largest scale of noise.
const MAX_NOISE: f32 = 4.0;
/// Durations of a voice in relation to what it has learnt.
const LENGTHS: std::ops::RangeInclusive<f32> = 0.1..=10.0;

/// How a text becomes phonemes.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PhonemeType {
    /// By espeak-ng.
    Espeak,
    /// The text's characters are the phonemes.
    Text,
}

#[derive(Deserialize)]
struct File {
    audio: Audio,
    espeak: Option<Espeak>,
    #[serde(default)]
    inference: Inference,
    phoneme_type: Option<PhonemeType>,
    #[serde(default)]
    phoneme_map: BTreeMap<String, Vec<String>>,
    phoneme_id_map: BTreeMap<String, Vec<u32>>,
    #[serde(default)]
    speaker_id_map: BTreeMap<String, usize>,
}

#[derive(Deserialize)]
struct Audio {
    sample_rate: u32,
}

#[derive(Deserialize)]
struct Espeak {
    voice: String,
}

#[derive(Deserialize)]
#[serde(default)]
struct Inference {
    noise_scale: f32,
    length_scale: f32,
    noise_w: f32,
}

impl Default for Inference {
    /// What Piper takes where a voice says nothing.
    fn default() -> Self {
        Self { noise_scale: 0.667, length_scale: 1.0, noise_w: 0.8 }
    }
}

/// What a voice's configuration says.
#[derive(Debug)]
pub(crate) struct Config {
    pub(crate) path: PathBuf,
    pub(crate) rate: u32,
    pub(crate) phoneme_type: PhonemeType,
    /// Name of espeak-ng's voice.
    pub(crate) espeak_voice: String,
    pub(crate) scales: Scales,
    /// Phonemes that are replaced by others.
    pub(crate) replaced: BTreeMap<String, Vec<String>>,
    /// Ids of symbols.
    pub(crate) ids: BTreeMap<String, Vec<u32>>,
    /// Names of speakers.
    pub(crate) speakers: BTreeMap<String, usize>,
}

impl Config {
    /// Reads the configuration beside a voice's file.
    pub(crate) fn read(voice: &Path) -> Result<Self, ModelError> {
        let mut name = voice.as_os_str().to_owned();
        name.push(".json");
        let path = PathBuf::from(name);
        let file: File = read_json(&path)?;
        let wrong = |key: &str, problem: String| ModelError::config(&path, key, problem);
        let rate = file.audio.sample_rate;
        if !RATES.contains(&rate) {
            let problem = format!("{rate}; it can be {} to {}", RATES.start(), RATES.end());
            return Err(wrong("audio.sample_rate", problem));
        }
        let Inference { noise_scale: noise, length_scale: length, noise_w: duration_noise } = file.inference;
        for (key, value) in [("inference.noise_scale", noise), ("inference.noise_w", duration_noise)] {
            if !(0.0..=MAX_NOISE).contains(&value) {
                return Err(wrong(key, format!("{value}; it can be 0 to {MAX_NOISE}")));
            }
        }
        if !LENGTHS.contains(&length) {
            let problem = format!("{length}; it can be {} to {}", LENGTHS.start(), LENGTHS.end());
            return Err(wrong("inference.length_scale", problem));
        }
        for mark in ["^", "_", "$"] {
            if !file.phoneme_id_map.contains_key(mark) {
                let problem = format!("it has no `{mark}`; take the configuration that the voice came with");
                return Err(wrong("phoneme_id_map", problem));
            }
        }
        let long = |symbol: &str| symbol.is_empty() || symbol.chars().count() > MAX_SYMBOL;
        let odd = |(symbol, ids): &(&String, &Vec<u32>)| long(symbol) || ids.len() > MAX_IDS;
        if let Some((symbol, ids)) = file.phoneme_id_map.iter().find(odd) {
            let symbol = sg_input::printable(symbol);
            let problem = format!(
                "`{symbol}` with {} ids; a symbol has 1 to {MAX_SYMBOL} characters and at most {MAX_IDS} ids",
                ids.len()
            );
            return Err(wrong("phoneme_id_map", problem));
        }
        let odd = |(symbol, others): &(&String, &Vec<String>)| {
            long(symbol) || others.len() > MAX_IDS || others.iter().any(|other| long(other))
        };
        if let Some((symbol, _)) = file.phoneme_map.iter().find(odd) {
            let symbol = sg_input::printable(symbol);
            let problem =
                format!("`{symbol}`; phonemes have 1 to {MAX_SYMBOL} characters, and at most {MAX_IDS} replace one");
            return Err(wrong("phoneme_map", problem));
        }
        let phoneme_type = file.phoneme_type.unwrap_or(PhonemeType::Espeak);
        let espeak_voice = file.espeak.map(|espeak| espeak.voice).unwrap_or_default();
        if phoneme_type == PhonemeType::Espeak && espeak_voice.is_empty() {
            return Err(wrong("espeak.voice", "it is missing; take the configuration that the voice came with".into()));
        }
        let scales = Scales { noise, length, duration_noise };
        let (replaced, ids, speakers) = (file.phoneme_map, file.phoneme_id_map, file.speaker_id_map);
        Ok(Self { rate, phoneme_type, espeak_voice, scales, replaced, ids, speakers, path })
    }

    /// Checks that the network knows all ids.
    pub(crate) fn check_ids(&self, symbols: usize) -> Result<(), ModelError> {
        let unknown = |(_, ids): &(&String, &Vec<u32>)| ids.iter().any(|id| *id as usize >= symbols);
        match self.ids.iter().find(unknown) {
            Some((symbol, ids)) => {
                let symbol = sg_input::printable(symbol);
                let problem = format!(
                    "`{symbol}` has ids {ids:?}, but the voice knows {symbols} symbols; take both from one voice"
                );
                Err(ModelError::config(&self.path, "phoneme_id_map", problem))
            }
            None => Ok(()),
        }
    }
}
