//! Raw samples without a header, as named pipes carry them.

use super::{AudioError, MAX_CHANNELS, check_rate, sane};
use crate::audio::wav::to_i16;

/// How a raw sample is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Integers of 16 bits, little-endian: what `arecord -f S16_LE` and `sox -e signed -b 16` write.
    S16,
    /// Floats of 32 bits, little-endian.
    F32,
}

impl Encoding {
    fn bytes(self) -> usize {
        match self {
            Self::S16 => 2,
            Self::F32 => 4,
        }
    }

    fn decode(self, bytes: &[u8]) -> f32 {
        match (self, bytes) {
            (Self::S16, &[a, b]) => f32::from(i16::from_le_bytes([a, b])) / 32_768.0,
            (Self::F32, &[a, b, c, d]) => sane(f32::from_le_bytes([a, b, c, d])),
            _ => 0.0,
        }
    }
}

/// Layout of raw samples: what a header would say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PcmLayout {
    /// Frames a second.
    pub rate: u32,
    /// Samples of a frame, one for each channel.
    pub channels: u16,
    /// How a sample is stored.
    pub encoding: Encoding,
}

impl PcmLayout {
    /// Mono, 16 bits.
    #[must_use]
    pub fn mono(rate: u32) -> Self {
        Self { rate, channels: 1, encoding: Encoding::S16 }
    }

    /// Checks rate and channels.
    ///
    /// # Errors
    /// [`AudioError::Rate`], [`AudioError::Channels`].
    pub fn check(self) -> Result<(), AudioError> {
        check_rate(self.rate)?;
        if self.channels == 0 || self.channels > MAX_CHANNELS {
            return Err(AudioError::Channels(self.channels));
        }
        Ok(())
    }

    pub(crate) fn frame_bytes(self) -> usize {
        self.encoding.bytes() * usize::from(self.channels)
    }

    /// Samples as bytes of this layout; each channel gets all of them.
    #[must_use]
    pub fn encode(self, samples: &[f32]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(samples.len() * self.frame_bytes());
        for sample in samples {
            for _ in 0..self.channels {
                match self.encoding {
                    Encoding::S16 => bytes.extend(to_i16(*sample).to_le_bytes()),
                    Encoding::F32 => bytes.extend(sane(*sample).to_le_bytes()),
                }
            }
        }
        bytes
    }
}

/// Turns bytes into mono samples. Pieces may end within a frame; the channels of a frame are averaged.
#[derive(Debug, Clone)]
pub struct PcmDecoder {
    layout: PcmLayout,
    rest: Vec<u8>,
}

impl PcmDecoder {
    /// A decoder at the start of a frame.
    #[must_use]
    pub fn new(layout: PcmLayout) -> Self {
        Self { layout, rest: Vec::new() }
    }

    /// Takes the next bytes and appends the samples of all whole frames to `out`.
    pub fn push(&mut self, bytes: &[u8], out: &mut Vec<f32>) {
        let (size, encoding) = (self.layout.frame_bytes().max(1), self.layout.encoding);
        let frame = |frame: &[u8]| {
            let sum: f32 = frame.chunks_exact(encoding.bytes()).map(|sample| encoding.decode(sample)).sum();
            sum / f32::from(self.layout.channels)
        };
        let mut bytes = bytes;
        if !self.rest.is_empty() {
            let missing = (size - self.rest.len()).min(bytes.len());
            self.rest.extend_from_slice(&bytes[..missing]);
            bytes = &bytes[missing..];
            if self.rest.len() < size {
                return;
            }
            out.push(frame(&self.rest));
            self.rest.clear();
        }
        let frames = bytes.chunks_exact(size);
        let rest = frames.remainder();
        out.extend(frames.map(frame));
        self.rest.extend_from_slice(rest);
    }

    /// Drops a frame that was begun, as when a new writer opens the pipe.
    pub fn reset(&mut self) {
        self.rest.clear();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn pieces_of_any_length_give_the_same_samples(
            bytes in proptest::collection::vec(any::<u8>(), 0..400),
            cuts in proptest::collection::vec(1_usize..23, 1..80),
            channels in 1_u16..4,
            encoding in proptest::sample::select(vec![Encoding::S16, Encoding::F32]),
        ) {
            let layout = PcmLayout { rate: 16_000, channels, encoding };
            let (mut whole, mut parts) = (Vec::new(), Vec::new());
            PcmDecoder::new(layout).push(&bytes, &mut whole);
            let mut decoder = PcmDecoder::new(layout);
            let (mut rest, mut cuts) = (&bytes[..], cuts.iter().cycle());
            while !rest.is_empty() {
                let (part, after) = rest.split_at((*cuts.next().unwrap()).min(rest.len()));
                decoder.push(part, &mut parts);
                rest = after;
            }
            prop_assert_eq!(whole.len(), bytes.len() / layout.frame_bytes());
            prop_assert!(whole.iter().all(|s| s.abs() <= 1.0));
            prop_assert_eq!(whole, parts);
        }

        #[test]
        fn what_is_encoded_is_decoded(samples in proptest::collection::vec(-1.0_f32..=1.0, 0..50), channels in 1_u16..4) {
            let layout = PcmLayout { rate: 8_000, channels, encoding: Encoding::F32 };
            let mut back = Vec::new();
            PcmDecoder::new(layout).push(&layout.encode(&samples), &mut back);
            let off = back.iter().zip(&samples).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            prop_assert!(back.len() == samples.len() && off < 1e-6);
        }
    }

    #[test]
    fn layouts_out_of_bounds_are_refused() {
        assert!(PcmLayout::mono(16_000).check().is_ok());
        assert!(PcmLayout::mono(1).check().is_err());
        assert!(PcmLayout { channels: 0, ..PcmLayout::mono(16_000) }.check().is_err());
    }
}
