//! The network of a voice, from ids of phonemes to samples.
//!
//! It is the path of inference of VITS: Kim, Kong and Son 2021, "Conditional Variational Autoencoder with Adversarial Learning for
//! End-to-End Text-to-Speech".

use std::path::Path;

use crate::decoder::Decoder;
use crate::durations::DurationPredictor;
use crate::error::PiperError;
use crate::flow::Flow;
use crate::frames::Frames;
use crate::noise::Noise;
use crate::onnx::OnnxFile;
use crate::text_encoder::TextEncoder;
use crate::weights::VoiceWeights;

/// Most ids of one utterance. Its sound would be longer than a minute.
pub(crate) const MAX_IDS: usize = 4096;

/// Most frames of one utterance: a minute has 5,200 of most voices.
const MAX_FRAMES: usize = 1 << 14;

/// How a voice speaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scales {
    /// Deviation of the noise in the sound, as a share of what was learnt.
    pub(crate) noise: f32,
    /// Factor of all durations.
    pub(crate) length: f32,
    /// Deviation of the noise in the durations.
    pub(crate) duration_noise: f32,
}

/// An utterance that can be computed.
pub(crate) struct Request<'a> {
    pub(crate) ids: &'a [u32],
    pub(crate) speaker: usize,
    pub(crate) scales: Scales,
    /// Most samples of the sound.
    pub(crate) most: usize,
    pub(crate) seed: u64,
    /// Ends the work with an error. It is called before each layer.
    pub(crate) go_on: &'a dyn Fn() -> Result<(), PiperError>,
}

/// All parts of a voice.
pub(crate) struct Network {
    encoder: TextEncoder,
    durations: DurationPredictor,
    flow: Flow,
    decoder: Decoder,
    /// An embedding for each speaker, where there are several.
    speakers: Option<Frames>,
}

impl Network {
    pub(crate) fn read(path: &Path) -> Result<Self, PiperError> {
        let file = OnnxFile::read(path)?;
        let graph = file.graph()?;
        let weights = VoiceWeights(&graph);
        let speakers = if weights.has("/emb_g/Gather") { Some(weights.table("/emb_g/Gather")?) } else { None };
        let of_speaker = speakers.as_ref().map(|speakers| speakers.width);
        let encoder = TextEncoder::read(&weights)?;
        Ok(Self {
            durations: DurationPredictor::read(&weights, encoder.width(), of_speaker)?,
            flow: Flow::read(&weights, encoder.prior_width(), of_speaker)?,
            decoder: Decoder::read(&weights, encoder.prior_width(), of_speaker)?,
            encoder,
            speakers,
        })
    }

    /// Number of symbols that ids can mean.
    pub(crate) fn symbols(&self) -> usize {
        self.encoder.symbols()
    }

    /// Number of speakers.
    pub(crate) fn speakers(&self) -> usize {
        self.speakers.as_ref().map_or(1, Frames::len)
    }

    /// The samples of an utterance. Its ids are less than [`Self::symbols`], its speaker is less than [`Self::speakers`].
    pub(crate) fn speak(&self, request: &Request) -> Result<Vec<f32>, PiperError> {
        let Request { ids, scales, go_on, .. } = *request;
        if ids.len() > MAX_IDS {
            let problem = format!(
                "a sentence of {} phonemes is longer than the limit of {}; split it",
                ids.len() / 2,
                MAX_IDS / 2
            );
            return Err(PiperError::Limit(problem));
        }
        let row = |speakers: &Frames| speakers.between(request.speaker, request.speaker + 1);
        let speaker = self.speakers.as_ref().map(row);
        let mut noise = Noise::new(request.seed);
        let text = self.encoder.apply(ids, go_on)?;
        let for_durations = Frames { width: 2, values: noise.numbers(2 * ids.len(), scales.duration_noise) };
        let logarithms = self.durations.apply(&text.hidden, speaker.as_ref(), for_durations, go_on)?;
        let durations = durations(&logarithms, scales.length, self.most_frames(request))?;
        // Each phoneme's prior, for as many frames as it lasts, with noise (equation 4 in reverse).
        let mut state = Frames { width: text.means.width, values: Vec::new() };
        for (at, duration) in durations.iter().enumerate() {
            let (means, deviations) = (text.means.row(at), text.log_deviations.row(at));
            for _ in 0..*duration {
                let noise = noise.numbers(means.len(), scales.noise);
                let values = means.iter().zip(deviations).zip(noise);
                state.values.extend(values.map(|((mean, deviation), noise)| mean + noise * deviation.exp()));
            }
        }
        let state = self.flow.apply(state, speaker.as_ref(), go_on)?;
        let samples = self.decoder.apply(&state, speaker.as_ref(), go_on)?;
        match samples.iter().position(|sample| !sample.is_finite()) {
            Some(at) => {
                Err(candle_core::Error::Msg(format!("sample {at} of the sound is no number; get the voice again"))
                    .into())
            }
            None => Ok(samples),
        }
    }

    fn most_frames(&self, request: &Request) -> usize {
        (request.most / self.decoder.hop).min(MAX_FRAMES)
    }

    /// The durations in frames of an utterance's ids.
    #[cfg(test)]
    pub(crate) fn durations(&self, request: &Request) -> Result<Vec<usize>, PiperError> {
        let text = self.encoder.apply(request.ids, request.go_on)?;
        let logarithms =
            self.durations.apply(&text.hidden, None, Frames::zeros(request.ids.len(), 2), request.go_on)?;
        durations(&logarithms, request.scales.length, self.most_frames(request))
    }
}

/// Whole numbers of frames, at most `most` in all and at least one.
fn durations(logarithms: &[f32], scale: f32, most: usize) -> Result<Vec<usize>, PiperError> {
    let too_long = || PiperError::Limit("the sound would be longer than a minute; split the text".into());
    if most == 0 {
        return Err(too_long());
    }
    let mut frames: Vec<usize> = Vec::with_capacity(logarithms.len());
    let mut all = 0;
    for logarithm in logarithms {
        let duration = (logarithm.exp() * scale).ceil();
        // Not a number is too long too. A conversion to an integer saturates.
        let fits = duration <= most as f32;
        all += if fits { duration as usize } else { most + 1 };
        if all > most {
            return Err(too_long());
        }
        frames.push(duration as usize);
    }
    if let (0, Some(last)) = (all, frames.last_mut()) {
        *last = 1;
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_bounded() {
        let two = 2.0_f32.ln();
        assert_eq!(durations(&[two, 0.0, -9.0], 1.2, 10).unwrap(), [3, 2, 1]);
        assert_eq!(durations(&[f32::NEG_INFINITY; 2], 1.0, 10).unwrap(), [0, 1]);
        for hostile in [f32::NAN, f32::INFINITY, 80.0, 3.0] {
            let error = durations(&[two, hostile], 1.0, 10).unwrap_err().to_string();
            assert!(error.contains("split the text"), "{error}");
        }
        assert!(durations(&[f32::NEG_INFINITY], 1.0, 0).is_err());
    }
}
