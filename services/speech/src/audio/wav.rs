//! WAV files, within limits.

use std::io::{Cursor, Read, Seek, Write};
use std::path::Path;
use std::time::Duration;

use hound::{SampleFormat, WavReader, WavSpec, WavWriter};

use super::{AudioError, MAX_CHANNELS, RATES, Recording, duration_of, sane};

/// Longest sound that [`read_wav`] takes by default.
pub const MAX_DURATION: Duration = Duration::from_secs(600);

/// Bytes of a header and of chunks that are not sound.
const HEADER_BYTES: u64 = 1 << 20;

/// Largest integer sample of 16 bits.
const FULL_SCALE: f32 = 32_767.0;

/// Reads a WAV file: integers of 8 to 32 bits or floats of 32 bits, 4 to 192 kHz, up to eight channels, which are averaged.
///
/// # Errors
/// [`AudioError::File`]: no such file, no WAV, truncated, longer than `longest`, or of an unsupported kind.
pub fn read_wav(path: &Path, longest: Duration) -> Result<Recording, AudioError> {
    // The most bytes of that time: all channels in 32 bits at the highest rate.
    let most =
        longest.as_secs().saturating_add(1).saturating_mul(u64::from(*RATES.end()) * u64::from(MAX_CHANNELS) * 4);
    let bytes = sg_input::file::read(path, most.saturating_add(HEADER_BYTES)).map_err(|e| AudioError::file(path, e))?;
    decode_wav(Cursor::new(bytes), longest).map_err(|problem| AudioError::file(path, problem))
}

/// Decodes a WAV stream. The error is one line without a path.
///
/// # Errors
/// As [`read_wav`].
pub fn decode_wav(bytes: impl Read, longest: Duration) -> Result<Recording, String> {
    let mut reader = WavReader::new(bytes).map_err(|error| problem(&error))?;
    let spec = reader.spec();
    if !RATES.contains(&spec.sample_rate) {
        return Err(AudioError::Rate(spec.sample_rate).to_string());
    }
    if spec.channels == 0 || spec.channels > MAX_CHANNELS {
        return Err(AudioError::Channels(spec.channels).to_string());
    }
    let frames = reader.duration() as usize;
    let length = duration_of(frames, spec.sample_rate);
    if length > longest {
        return Err(format!(
            "{:.0} s of sound are more than the limit of {:.0} s; cut it into parts",
            length.as_secs_f64(),
            longest.as_secs_f64()
        ));
    }
    let channels = usize::from(spec.channels);
    let samples = match (spec.sample_format, spec.bits_per_sample) {
        (SampleFormat::Float, 32) => mono(reader.samples::<f32>().map(|s| s.map(sane)), channels, frames),
        (SampleFormat::Int, bits @ 8..=32) => {
            let scale = 1.0 / (1_i64 << (bits - 1)) as f32;
            mono(reader.samples::<i32>().map(|s| s.map(|v| sane(v as f32 * scale))), channels, frames)
        }
        (_, bits) => return Err(format!("samples of {bits} bits are not supported; convert it to 16-bit integers")),
    };
    Ok(Recording { rate: spec.sample_rate, samples: samples.map_err(|error| problem(&error))? })
}

/// Decodes a WAV stream whose writer did not know its length: its header claims more than there is, such as 0xFFFFFFFF bytes.
///
/// # Errors
/// As [`read_wav`].
pub fn decode_streamed_wav(mut bytes: Vec<u8>, longest: Duration) -> Result<Recording, String> {
    set_length(&mut bytes);
    decode_wav(Cursor::new(bytes), longest)
}

/// Writes the true length of the sound into its chunk, where the chunk claims more. RIFF is a header of 12 bytes and chunks, each
/// with a name and a length of 4 bytes and a content of an even length.
fn set_length(bytes: &mut [u8]) {
    let (mut at, mut frame) = (12_usize, 1);
    while let Some(&[a, b, c, d, e, f, g, h]) = bytes.get(at..).and_then(|rest| rest.first_chunk::<8>()) {
        let claimed = u32::from_le_bytes([e, f, g, h]) as usize;
        let there = bytes.len() - at - 8;
        match &[a, b, c, d] {
            b"fmt " => frame = bytes.get(at + 20).copied().map_or(1, usize::from).max(1),
            b"data" if claimed > there => {
                let whole = u32::try_from(there / frame * frame).unwrap_or(u32::MAX);
                bytes[at + 4..at + 8].copy_from_slice(&whole.to_le_bytes());
                return;
            }
            _ => {}
        }
        at = at.saturating_add(8 + claimed + claimed % 2);
    }
}

fn problem(error: &hound::Error) -> String {
    match error {
        // The bytes are in memory, so a failed read is their end.
        hound::Error::IoError(_) => "the file ends within its header or its sound; it is truncated".to_owned(),
        error => format!("no readable WAV file: {error}; convert it to 16-bit PCM"),
    }
}

fn mono(samples: impl Iterator<Item = hound::Result<f32>>, channels: usize, frames: usize) -> hound::Result<Vec<f32>> {
    // The header may claim more than there is, so it does not decide how much memory is taken at once.
    let mut out = Vec::with_capacity(frames.min(1 << 16));
    let (mut sum, mut seen) = (0.0_f32, 0);
    for sample in samples {
        sum += sample?;
        seen += 1;
        if seen == channels {
            out.push(sum / channels as f32);
            (sum, seen) = (0.0, 0);
        }
    }
    Ok(out)
}

/// The form of all files that are written: mono, integers of 16 bits.
fn spec(rate: u32) -> WavSpec {
    WavSpec { channels: 1, sample_rate: rate, bits_per_sample: 16, sample_format: SampleFormat::Int }
}

/// A sample as an integer of 16 bits, rounded and clamped.
#[must_use]
pub fn to_i16(sample: f32) -> i16 {
    (sane(sample) * FULL_SCALE).round() as i16
}

/// A writer of WAV that takes samples as they come.
pub(crate) struct WavStream<W: Write + Seek>(WavWriter<W>);

impl<W: Write + Seek> WavStream<W> {
    pub(crate) fn new(to: W, rate: u32) -> Result<Self, String> {
        if !RATES.contains(&rate) {
            return Err(AudioError::Rate(rate).to_string());
        }
        WavWriter::new(to, spec(rate)).map(Self).map_err(|error| error.to_string())
    }

    pub(crate) fn write(&mut self, samples: &[f32]) -> Result<(), String> {
        samples.iter().try_for_each(|s| self.0.write_sample(to_i16(*s))).map_err(|error| error.to_string())
    }

    pub(crate) fn finish(self) -> Result<(), String> {
        self.0.finalize().map_err(|error| error.to_string())
    }
}

/// A mono WAV file of 16-bit integers in memory.
///
/// # Errors
/// One line: a rate out of bounds.
pub fn encode_wav(recording: &Recording) -> Result<Vec<u8>, String> {
    let mut bytes = Cursor::new(Vec::new());
    let mut stream = WavStream::new(&mut bytes, recording.rate)?;
    stream.write(&recording.samples)?;
    stream.finish()?;
    Ok(bytes.into_inner())
}

/// Writes a mono WAV file of 16-bit integers, whole or not at all: beside its path, then renamed.
///
/// # Errors
/// [`AudioError::File`]: a rate out of bounds, or no room.
pub fn write_wav(path: &Path, recording: &Recording) -> Result<(), AudioError> {
    let fail = |problem: String| AudioError::file(path, problem);
    let mut part = part_beside(path)?;
    let mut to = std::io::BufWriter::new(part.as_file_mut());
    let mut stream = WavStream::new(&mut to, recording.rate).map_err(fail)?;
    stream.write(&recording.samples).map_err(fail)?;
    stream.finish().map_err(fail)?;
    to.flush().map_err(|error| fail(error.to_string()))?;
    drop(to);
    part.persist(path).map_err(|error| fail(error.error.to_string()))?;
    Ok(())
}

/// A temporary file in the folder of `path`, so that a rename puts it in place.
pub(crate) fn part_beside(path: &Path) -> Result<tempfile::NamedTempFile, AudioError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::NamedTempFile::new_in(folder).map_err(|error| AudioError::file(path, error))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LONG: Duration = MAX_DURATION;

    proptest! {
        #[test]
        fn a_file_gives_its_samples_back(
            samples in proptest::collection::vec(-1.0_f32..=1.0, 0..2000),
            rate in proptest::sample::select(vec![8_000, 16_000, 22_050, 48_000]),
        ) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.wav");
            let recording = Recording { rate, samples };
            write_wav(&path, &recording).unwrap();
            let read = read_wav(&path, LONG).unwrap();
            prop_assert_eq!(read.rate, rate);
            prop_assert_eq!(read.samples.len(), recording.samples.len());
            // Half a step of 16 bits, and the one step between the scales of reading and writing.
            let off = read.samples.iter().zip(&recording.samples).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            prop_assert!(off <= 2.0 / 32_768.0, "{off}");
            prop_assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        }

        #[test]
        fn any_bytes_give_sound_or_one_line(mut noise in proptest::collection::vec(any::<u8>(), 0..300), at in 0_usize..60) {
            let mut damaged = encode_wav(&Recording { rate: 16_000, samples: vec![0.5; 100] }).unwrap();
            let at = at.min(damaged.len());
            damaged.splice(at..(at + noise.len()).min(damaged.len()), noise.drain(..));
            let plain = decode_wav(Cursor::new(damaged.clone()), Duration::from_secs(60));
            for sound in [plain, decode_streamed_wav(damaged, Duration::from_secs(60))] {
                match sound {
                    Ok(sound) => prop_assert!(sound.samples.iter().all(|s| s.abs() <= 1.0)),
                    Err(line) => prop_assert!(!line.contains('\n') && !line.is_empty()),
                }
            }
        }
    }

    #[test]
    fn channels_are_averaged_and_floats_are_clamped() {
        let spec = WavSpec { channels: 2, sample_rate: 8_000, bits_per_sample: 32, sample_format: SampleFormat::Float };
        let mut to = Cursor::new(Vec::new());
        let mut writer = WavWriter::new(&mut to, spec).unwrap();
        for sample in [0.5, -0.25, f32::NAN, 9.0] {
            writer.write_sample(sample).unwrap();
        }
        writer.finalize().unwrap();
        let sound = decode_wav(Cursor::new(to.into_inner()), LONG).unwrap();
        assert_eq!(sound, Recording { rate: 8_000, samples: vec![0.125, 0.5] });
    }

    #[test]
    fn a_stream_whose_length_is_not_known_is_read_to_its_end() {
        let sound = Recording { rate: 24_000, samples: vec![0.25; 1_000] };
        let mut stream = encode_wav(&sound).unwrap();
        let whole = decode_streamed_wav(stream.clone(), LONG).unwrap();
        assert_eq!(whole.samples.len(), 1_000);
        for at in [4, 40] {
            stream[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        }
        assert!(decode_wav(Cursor::new(stream.clone()), LONG).is_err());
        assert_eq!(decode_streamed_wav(stream.clone(), LONG).unwrap(), whole);
        stream.pop();
        assert_eq!(decode_streamed_wav(stream, LONG).unwrap().samples.len(), 999);
    }

    #[test]
    fn bad_files_are_refused_in_one_line() {
        let good = encode_wav(&Recording { rate: 16_000, samples: vec![0.1; 32_000] }).unwrap();
        let truncated = decode_wav(Cursor::new(&good[..5_000]), LONG).unwrap_err();
        assert!(truncated.contains("truncated"), "{truncated}");
        let long = decode_wav(Cursor::new(&good[..]), Duration::from_secs(1)).unwrap_err();
        assert_eq!(long, "2 s of sound are more than the limit of 1 s; cut it into parts");
        assert!(decode_wav(Cursor::new(b"OggS and more".to_vec()), LONG).unwrap_err().contains("16-bit PCM"));
        let mut rate = good.clone();
        rate[24..28].copy_from_slice(&1_u32.to_le_bytes());
        assert!(decode_wav(Cursor::new(rate), LONG).is_err());
        let absent = read_wav(Path::new("/no/such/file.wav"), LONG).unwrap_err().to_string();
        assert!(absent.starts_with("/no/such/file.wav: "), "{absent}");
        let folder = tempfile::tempdir().unwrap();
        assert!(write_wav(&folder.path().join("a.wav"), &Recording { rate: 0, samples: vec![] }).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "a part is left");
    }
}
