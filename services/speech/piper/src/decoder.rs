//! The decoder from the flow's output to samples: HiFi-GAN's generator (Kong et al. 2020, section 2.2 and appendix A.1).
//!
//! Long sounds are decoded in parts, which bounds the memory. Each part is computed with all frames on both sides that its samples
//! depend on. So the parts are those of the whole.

use crate::convolution::{Convolution, Upsampling};
use crate::error::PiperError;
use crate::frames::Frames;
use crate::weights::VoiceWeights;

/// Slope below zero of all rectifiers except the last one.
const SLOPE: f32 = 0.1;
const LAST_SLOPE: f32 = 0.01;
/// Frames of a part: 1.5 s of most voices.
const PART: usize = 128;
/// Most samples of a frame.
const MAX_HOP: usize = 4096;
/// Most values of a signal within a part. Published voices have 2 million.
const MAX_VALUES: usize = 1 << 24;

/// HiFi-GAN's generator.
pub(crate) struct Decoder {
    before: Convolution,
    of_speaker: Option<Convolution>,
    stages: Vec<Stage>,
    behind: Convolution,
    /// Samples of a frame.
    pub(crate) hop: usize,
    /// Frames on each side that a frame's samples depend on.
    reach: usize,
}

struct Stage {
    upsampling: Upsampling,
    /// Their outputs are averaged.
    blocks: Vec<ResidualBlock>,
}

/// Each step is added to the signal. Steps of kind "1" have two convolutions, those of kind "2" have one.
struct ResidualBlock(Vec<Vec<Convolution>>);

impl Decoder {
    pub(crate) fn read(weights: &VoiceWeights, width: usize, speaker: Option<usize>) -> Result<Self, PiperError> {
        let before = weights.convolution("/dec/conv_pre", width)?;
        let stages = weights.count(|at| format!("/dec/ups.{at}/ConvTranspose"))?;
        let two = weights.has("/dec/resblocks.0/convs1.0/Conv");
        let first = if two { "convs1" } else { "convs" };
        let blocks = weights.count(|at| format!("/dec/resblocks.{at}/{first}.0/Conv"))?;
        if !blocks.is_multiple_of(stages) {
            let problem =
                format!("{blocks} residual blocks are no equal number for {stages} stages; get the voice again");
            return Err(weights.wrong("/dec/resblocks.0", problem));
        }
        let of_stage = blocks / stages;
        let (mut all, mut channels, mut hop) = (Vec::new(), before.outputs, 1);
        for stage in 0..stages {
            let upsampling = weights.upsampling(&format!("/dec/ups.{stage}"), channels)?;
            channels = upsampling.outputs;
            hop *= upsampling.stride;
            if hop > MAX_HOP {
                let problem = format!("a frame would have {hop} samples, more than {MAX_HOP}; get the voice again");
                return Err(weights.wrong(&format!("/dec/ups.{stage}"), problem));
            }
            let block = |at: usize| ResidualBlock::read(weights, at, channels, two);
            let blocks = (stage * of_stage..(stage + 1) * of_stage).map(block).collect::<Result<_, _>>()?;
            all.push(Stage { upsampling, blocks });
        }
        let behind = weights.convolution_to("/dec/conv_post", channels, 1)?;
        let of_speaker = weights.of_speaker("/dec/cond", speaker, before.outputs)?;
        let reach = all.iter().rev().fold(behind.reach(), |reach, stage| {
            let of_blocks = stage.blocks.iter().map(ResidualBlock::reach).max().unwrap_or_default();
            (reach + of_blocks).div_ceil(stage.upsampling.stride) + stage.upsampling.phases.reach()
        });
        let reach = reach + before.reach();
        let mut steps = PART + 2 * reach;
        for (at, stage) in all.iter().enumerate() {
            steps *= stage.upsampling.stride;
            if steps * stage.upsampling.outputs > MAX_VALUES {
                let problem = format!("{steps} steps at once would take too much memory; get the voice again");
                return Err(weights.wrong(&format!("/dec/ups.{at}"), problem));
            }
        }
        Ok(Self { reach, before, of_speaker, stages: all, behind, hop })
    }

    /// The samples of all frames, from −1 to 1.
    pub(crate) fn apply(
        &self,
        frames: &Frames,
        speaker: Option<&Frames>,
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<Vec<f32>, PiperError> {
        self.in_parts(frames, speaker, PART, go_on)
    }

    fn in_parts(
        &self,
        frames: &Frames,
        speaker: Option<&Frames>,
        part: usize,
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<Vec<f32>, PiperError> {
        let speaker = match (&self.of_speaker, speaker) {
            (Some(layer), Some(speaker)) => Some(layer.apply(speaker)?.values),
            _ => None,
        };
        let mut samples = Vec::with_capacity(frames.len() * self.hop);
        for from in (0..frames.len()).step_by(part) {
            let until = frames.len().min(from + part);
            let (first, end) = (from.saturating_sub(self.reach), frames.len().min(until + self.reach));
            let decoded = self.whole(&frames.between(first, end), speaker.as_deref(), go_on)?;
            samples.extend_from_slice(&decoded[(from - first) * self.hop..(until - first) * self.hop]);
        }
        Ok(samples)
    }

    fn whole(
        &self,
        frames: &Frames,
        speaker: Option<&[f32]>,
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<Vec<f32>, PiperError> {
        let mut signal = self.before.apply(frames)?;
        if let Some(row) = speaker {
            signal.add_row(row);
        }
        for stage in &self.stages {
            go_on()?;
            signal.rectify(SLOPE);
            let up = stage.upsampling.apply(&signal)?;
            let mut blocks = stage.blocks.iter();
            signal = blocks.next().map_or_else(|| Ok(up.clone()), |block| block.apply(&up, go_on))?;
            for block in blocks {
                signal.add(&block.apply(&up, go_on)?);
            }
            let share = (stage.blocks.len() as f32).recip();
            signal.each(|value| value * share);
        }
        signal.rectify(LAST_SLOPE);
        let mut samples = self.behind.apply(&signal)?;
        samples.each(f32::tanh);
        Ok(samples.values)
    }
}

impl ResidualBlock {
    fn read(weights: &VoiceWeights, at: usize, width: usize, two: bool) -> Result<Self, PiperError> {
        let module = format!("/dec/resblocks.{at}");
        let kinds: &[&str] = if two { &["convs1", "convs2"] } else { &["convs"] };
        let count = weights.count(|step| format!("{module}/{}.{step}/Conv", kinds[0]))?;
        let convolution =
            |kind: &str, step: usize| weights.convolution_to(&format!("{module}/{kind}.{step}"), width, width);
        let step = |step: usize| kinds.iter().map(|kind| convolution(kind, step)).collect::<Result<_, _>>();
        (0..count).map(step).collect::<Result<_, _>>().map(Self)
    }

    /// Steps that an output depends on, to each side.
    fn reach(&self) -> usize {
        self.0.iter().flatten().map(Convolution::reach).sum()
    }

    fn apply(&self, signal: &Frames, go_on: &dyn Fn() -> Result<(), PiperError>) -> Result<Frames, PiperError> {
        let mut sum = signal.clone();
        for step in &self.0 {
            go_on()?;
            let Some((last, others)) = step.split_last() else { continue };
            let mut inner = sum.rectified(SLOPE);
            for convolution in others {
                inner = convolution.apply(&inner)?;
                inner.rectify(SLOPE);
            }
            last.add_to(&inner, &mut sum)?;
        }
        Ok(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made_voice::{Kind, MadeVoice, PRIOR};
    use crate::noise::Noise;
    use crate::onnx::OnnxFile;

    #[test]
    fn parts_are_those_of_the_whole() {
        for two in [false, true] {
            let written = MadeVoice::new(Kind { two, speakers: 1 }).write();
            let file = OnnxFile::read(&written.path()).unwrap();
            let decoder = Decoder::read(&VoiceWeights(&file.graph().unwrap()), PRIOR, None).unwrap();
            assert_eq!(decoder.hop, 8);
            let frames = Frames { width: PRIOR, values: Noise::new(9).numbers(200 * PRIOR, 1.0) };
            let whole = decoder.in_parts(&frames, None, 1000, &|| Ok(())).unwrap();
            assert_eq!(whole.len(), 200 * 8);
            for part in [1, 7, PART] {
                let parts = decoder.in_parts(&frames, None, part, &|| Ok(())).unwrap();
                let pairs = parts.iter().zip(&whole);
                let most = pairs.map(|(part, whole)| (part - whole).abs()).fold(0.0, f32::max);
                assert!(parts.len() == whole.len() && most < 1e-6, "{part}: {most}");
            }
        }
    }
}
