//! The state of a training between two steps, as a file.
//!
//! | part | content |
//! | --- | --- |
//! | begin | `SGFITC`, format (u32), version of the program (length in a byte, text) |
//! | origin | digests of sources, options and start, 32 bytes each; number of Gaussians (u64) |
//! | course | steps (u64), seconds (f64), step of the best scene (u64), measurements (number as u64; step as u64 and six f64) |
//! | numbers | of the best scene, unless that is the start; then those of now, their means and their mean squares: 21 f32 a Gaussian each |
//! | end | BLAKE3 of all before, 32 bytes |
//!
//! All is little-endian. Rates and views of a step follow from its number, and Adam counts by it too.

use std::io::{self, Write};

use sg_scene::model::Scene;

use super::Measurement;
use super::optimizer::{NUMBERS, Numbers, Optimizer};

/// First bytes of a checkpoint.
const MAGIC: &[u8; 6] = b"SGFITC";
/// Changes with the layout of the file, and whenever a training would make other steps.
const FORMAT: u32 = 1;
/// The version of the program.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Bytes of a measurement.
const MEASUREMENT_BYTES: usize = 7 * 8;
/// Most measurements of a checkpoint.
const MOST_MEASUREMENTS: usize = 1 << 20;
/// Bytes of a digest.
const DIGEST: usize = 32;
/// Bytes that are gathered before they are written.
const BLOCK: usize = 1 << 16;

/// What a checkpoint belongs to. It goes on with the same only.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    sources: [u8; DIGEST],
    options: [u8; DIGEST],
    start: [u8; DIGEST],
    gaussians: usize,
}

impl Origin {
    /// The origin of a training: digests of what the views show and of all options, and the start.
    #[must_use]
    pub fn new(sources: [u8; DIGEST], options: [u8; DIGEST], start: &Scene) -> Self {
        Self { sources, options, start: digest(start), gaussians: start.len() }
    }

    /// Most bytes of a checkpoint of this origin.
    #[must_use]
    pub fn most_bytes(&self) -> u64 {
        let rest = BLOCK + MOST_MEASUREMENTS * MEASUREMENT_BYTES;
        (4 * 4 * NUMBERS as u64).saturating_mul(self.gaussians as u64).saturating_add(rest as u64)
    }
}

/// The digest of what a training starts from.
fn digest(start: &Scene) -> [u8; DIGEST] {
    let mut hasher = blake3::Hasher::new();
    for unit in &start.units {
        let rest = (unit.first, unit.palette, unit.opacity, unit.transform, unit.shading);
        hasher.update(format!("{rest:?}").as_bytes());
    }
    let mut bytes = Vec::with_capacity(2 * BLOCK);
    for numbers in Optimizer::new(start).numbers() {
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        if bytes.len() >= BLOCK {
            hasher.update(&bytes);
            bytes.clear();
        }
    }
    hasher.update(&bytes);
    *hasher.finalize().as_bytes()
}

/// A file that is no checkpoint of this training.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// A file of another kind.
    #[error("it is no checkpoint of a training")]
    Foreign,
    /// Written by another version.
    #[error("it is of version {version} of this program (format {format}), and this is {VERSION} (format {FORMAT})")]
    Version {
        /// The version of the program.
        version: String,
        /// The format.
        format: u32,
    },
    /// The views show something else.
    #[error("it is of another volume, quantity or transfer function")]
    Sources,
    /// The options differ.
    #[error("it is of a training with other options")]
    Options,
    /// The start differs.
    #[error("it is of a training of another start")]
    Start,
    /// The content is wrong.
    #[error("it is damaged: {0}")]
    Damaged(&'static str),
}

/// A training between two steps, as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    pub(super) iteration: usize,
    pub(super) seconds: f64,
    pub(super) measurements: Vec<Measurement>,
    pub(super) best: Measurement,
    pub(super) best_numbers: Option<Vec<Numbers>>,
    /// Numbers, means and mean squares.
    pub(super) state: [Vec<Numbers>; 3],
}

/// A training between two steps, to be written.
pub(super) struct Moment<'a> {
    pub(super) iteration: usize,
    pub(super) seconds: f64,
    pub(super) measurements: &'a [Measurement],
    pub(super) best: &'a Measurement,
    pub(super) best_numbers: Option<&'a [Numbers]>,
    pub(super) optimizer: &'a Optimizer,
}

/// Writes a checkpoint.
pub(super) fn write(to: impl Write, moment: &Moment<'_>, origin: &Origin) -> io::Result<()> {
    if moment.measurements.len() > MOST_MEASUREMENTS {
        let what = format!("more than {MOST_MEASUREMENTS} measurements; measure less often");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    let mut out = Sealed { to, hasher: blake3::Hasher::new(), block: Vec::with_capacity(2 * BLOCK) };
    out.put(MAGIC)?;
    out.put(&FORMAT.to_le_bytes())?;
    out.put(&[VERSION.len() as u8])?;
    out.put(VERSION.as_bytes())?;
    for digest in [&origin.sources, &origin.options, &origin.start] {
        out.put(digest)?;
    }
    out.put(&(origin.gaussians as u64).to_le_bytes())?;
    out.put(&(moment.iteration as u64).to_le_bytes())?;
    out.put(&moment.seconds.to_le_bytes())?;
    out.put(&(moment.best.iteration as u64).to_le_bytes())?;
    out.put(&(moment.measurements.len() as u64).to_le_bytes())?;
    for measurement in moment.measurements {
        out.put(&(measurement.iteration as u64).to_le_bytes())?;
        for number in values(measurement) {
            out.put(&number.to_le_bytes())?;
        }
    }
    out.numbers(moment.best_numbers.unwrap_or_default().iter())?;
    out.numbers(moment.optimizer.numbers())?;
    out.numbers(moment.optimizer.means())?;
    out.numbers(moment.optimizer.squares())?;
    out.seal()
}

/// The numbers of a measurement after its step.
fn values(measurement: &Measurement) -> [f64; 6] {
    let Measurement { iteration: _, seconds, psnr_db, footprint_psnr_db, least_footprint_psnr_db, ssim, coverage } =
        *measurement;
    [seconds, psnr_db, footprint_psnr_db, least_footprint_psnr_db, ssim, coverage]
}

/// A stream that ends with the digest of all that was written.
struct Sealed<W> {
    to: W,
    hasher: blake3::Hasher,
    block: Vec<u8>,
}

impl<W: Write> Sealed<W> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.block.extend_from_slice(bytes);
        if self.block.len() >= BLOCK { self.flush() } else { Ok(()) }
    }

    fn numbers<'a>(&mut self, rows: impl Iterator<Item = &'a Numbers>) -> io::Result<()> {
        for row in rows {
            self.block.extend(row.iter().flat_map(|number| number.to_le_bytes()));
            self.put(&[])?;
        }
        Ok(())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.hasher.update(&self.block);
        self.to.write_all(&self.block)?;
        self.block.clear();
        Ok(())
    }

    fn seal(mut self) -> io::Result<()> {
        self.flush()?;
        self.to.write_all(self.hasher.finalize().as_bytes())?;
        self.to.flush()
    }
}

impl Checkpoint {
    /// Reads a checkpoint of this origin. Takes memory in proportion to the bytes.
    ///
    /// # Errors
    /// [`CheckpointError`].
    pub fn read(bytes: &[u8], origin: &Origin) -> Result<Self, CheckpointError> {
        let mut left = Bytes(bytes);
        if !bytes.starts_with(MAGIC) {
            return Err(CheckpointError::Foreign);
        }
        left.take(MAGIC.len())?;
        let format = u32::from_le_bytes(left.array()?);
        let [length] = left.array()?;
        let version = left.take(usize::from(length))?;
        if format != FORMAT || version != VERSION.as_bytes() {
            let version = String::from_utf8_lossy(version).into_owned();
            return Err(CheckpointError::Version { version, format });
        }
        left.open_seal(bytes)?;
        let digests: [[u8; DIGEST]; 3] = [left.array()?, left.array()?, left.array()?];
        let gaussians = left.count()?;
        match digests {
            [sources, ..] if sources != origin.sources => return Err(CheckpointError::Sources),
            [_, options, _] if options != origin.options => return Err(CheckpointError::Options),
            [.., start] if start != origin.start || gaussians != origin.gaussians => {
                return Err(CheckpointError::Start);
            }
            _ => {}
        }
        let iteration = left.count()?;
        let seconds = f64::from_le_bytes(left.array()?);
        let best = left.count()?;
        let measurements = left.measurements()?;
        let best = measurements.iter().find(|measurement| measurement.iteration == best).copied();
        let Some(best) = best.filter(|_| seconds >= 0.0 && seconds.is_finite()) else {
            return Err(CheckpointError::Damaged("its course makes no sense"));
        };
        let best_numbers = if best.iteration > 0 { Some(left.numbers(gaussians)?) } else { None };
        let state = [left.numbers(gaussians)?, left.numbers(gaussians)?, left.numbers(gaussians)?];
        if !left.0.is_empty() {
            return Err(CheckpointError::Damaged("it is too long"));
        }
        Ok(Self { iteration, seconds, measurements, best, best_numbers, state })
    }

    /// Steps so far.
    #[must_use]
    pub fn iteration(&self) -> usize {
        self.iteration
    }
}

/// Bytes that are still to be read.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], CheckpointError> {
        let (part, rest) = self.0.split_at_checked(count).ok_or(CheckpointError::Damaged("it ends too early"))?;
        self.0 = rest;
        Ok(part)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], CheckpointError> {
        let (part, rest) = self.0.split_first_chunk::<N>().ok_or(CheckpointError::Damaged("it ends too early"))?;
        self.0 = rest;
        Ok(*part)
    }

    fn count(&mut self) -> Result<usize, CheckpointError> {
        let count = u64::from_le_bytes(self.array()?);
        usize::try_from(count).map_err(|_| CheckpointError::Damaged("a count is too large"))
    }

    /// Takes the digest off the end, and compares it with all before it.
    fn open_seal(&mut self, all: &[u8]) -> Result<(), CheckpointError> {
        let ends_early = CheckpointError::Damaged("it ends too early");
        let (rest, _) = self.0.split_last_chunk::<DIGEST>().ok_or(ends_early.clone())?;
        let (content, seal) = all.split_last_chunk::<DIGEST>().ok_or(ends_early)?;
        self.0 = rest;
        if blake3::hash(content) == *seal { Ok(()) } else { Err(CheckpointError::Damaged("its checksum differs")) }
    }

    fn measurements(&mut self) -> Result<Vec<Measurement>, CheckpointError> {
        let count = self.count()?;
        if count > MOST_MEASUREMENTS {
            return Err(CheckpointError::Damaged("it has too many measurements"));
        }
        let (words, _) = self.take(count * MEASUREMENT_BYTES)?.as_chunks::<8>();
        let (rows, _) = words.as_chunks::<7>();
        let measurement = |&[step, rest @ ..]: &[[u8; 8]; 7]| {
            let [seconds, psnr_db, footprint_psnr_db, least_footprint_psnr_db, ssim, coverage] =
                rest.map(f64::from_le_bytes);
            let iteration = usize::try_from(u64::from_le_bytes(step)).unwrap_or(usize::MAX);
            Measurement { iteration, seconds, psnr_db, footprint_psnr_db, least_footprint_psnr_db, ssim, coverage }
        };
        Ok(rows.iter().map(measurement).collect())
    }

    fn numbers(&mut self, count: usize) -> Result<Vec<Numbers>, CheckpointError> {
        let bytes = count.checked_mul(4 * NUMBERS).ok_or(CheckpointError::Damaged("a count is too large"))?;
        let (numbers, _) = self.take(bytes)?.as_chunks::<4>();
        let (rows, _) = numbers.as_chunks::<NUMBERS>();
        Ok(rows.iter().map(|row| row.map(f32::from_le_bytes)).collect())
    }
}
