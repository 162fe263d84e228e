//! NIfTI-1 and NIfTI-2 single files (`.nii`, `.nii.gz`): <https://nifti.nimh.nih.gov/>.
//!
//! The reader takes scalar 3-D volumes of either byte order, plain or gzip. It skips header extensions. Stored values
//! become `scl_slope · value + scl_inter` if `scl_slope` is finite and not zero.
//!
//! The grid keeps the file's own world frame, as the other readers do: nothing is flipped. For NIfTI this frame is RAS+
//! (x to the patient's right, y to the front, z up), in the file's length unit. An `sform_code` above 0 selects the
//! affine map of the sform. Otherwise a `qform_code` above 0 selects the quaternion of the qform. Otherwise the grid has
//! the spacing from `pixdim`, origin 0 and axes along x, y and z.

use std::io::{BufReader, Read, Seek, SeekFrom};

use flate2::read::MultiGzDecoder;
use glam::{DMat3, DQuat, DVec3};

use crate::grid::Grid;
use crate::scalars::ScalarType;
use crate::volume::Volume;
use crate::world_frame::{LengthUnit, PatientFrame, WorldFrame};

use super::decode::{Packing, Voxels, read_full};
use super::error::ReadError;
use super::format::VolumeFormat;
use super::source::Source;

const REMEDY: &str = "correct `dim` or `datatype` in the header, or fetch the file again";
const PAIR_REMEDY: &str = "convert the pair of .hdr and .img files to one .nii file";
/// Endings of the files of a pair; the pair is refused with a remedy.
const PAIR_ENDINGS: [&str; 4] = [".hdr", ".img", ".hdr.gz", ".img.gz"];
/// Longest header with its extensions.
const MAX_OFFSET: u64 = 64 << 20;

/// NIfTI-1 and NIfTI-2.
pub(super) struct Nifti;

impl VolumeFormat for Nifti {
    type Data = Volume;

    const NAME: &'static str = "NIfTI";
    const ENDINGS: &'static [&'static str] = &[".nii", ".nii.gz"];

    fn sniff(name: &str, first: &[u8]) -> bool {
        let has_magic = |layout: &Layout| {
            first.get(layout.magic..).is_some_and(|bytes| layout.magics.iter().any(|magic| bytes.starts_with(magic)))
        };
        is_pair(name) || Layout::ALL.iter().any(has_magic)
    }

    fn read(source: Source<'_>) -> Result<Volume, ReadError> {
        if is_pair(&source.file_name().to_ascii_lowercase()) {
            return Err(source.format("file name", "a file of a NIfTI or Analyze pair", PAIR_REMEDY));
        }
        let (file, length) = source.open()?;
        let mut reader = BufReader::with_capacity(1 << 18, file);
        let mut start = [0; 2];
        let got = read_full(&mut reader, &mut start).map_err(|e| source.io(e))?;
        let packing = if got == 2 && start == [0x1f, 0x8b] { Packing::Gzip } else { Packing::Plain };
        rewind(source, &mut reader)?;
        let header = match packing {
            Packing::Gzip => Header::read(source, &mut MultiGzDecoder::new(&mut reader))?,
            _ => Header::read(source, &mut reader)?,
        };
        rewind(source, &mut reader)?;

        let dims = header.dims(source)?;
        let scalar = header.scalar_type(source)?;
        let grid = header.grid(source, dims)?;
        let scaling = header.scaling(source)?;
        if scaling.is_some() {
            source.voxel_bytes(dims, scalar.scaled())?;
        }
        let voxels = Voxels { dims, scalar, big_endian: header.big_endian, packing, remedy: REMEDY };
        let mut scalars = voxels.read_after(header.voxel_offset(source)?, source, reader, length)?;
        if let Some((slope, intercept)) = scaling {
            scalars = scalars.scaled(slope, intercept);
        }
        let volume = Volume::new(grid, scalars, header.intent_name()).map(|volume| volume.in_frame(header.frame()));
        volume.map_err(|e| source.format("voxels", e.to_string(), REMEDY))
    }
}

fn rewind(source: Source<'_>, reader: &mut impl Seek) -> Result<(), ReadError> {
    reader.seek(SeekFrom::Start(0)).map(|_| ()).map_err(|e| source.io(e))
}

fn is_pair(name: &str) -> bool {
    PAIR_ENDINGS.iter().any(|ending| name.ends_with(ending))
}

/// Byte offsets of the header fields of one version.
struct Layout {
    /// Bytes of the header; also the value of its first field.
    size: usize,
    /// Least offset of the voxels: the header and four bytes of extension flags.
    least_offset: u64,
    magic: usize,
    /// Magic of a single file, then of the header of a pair.
    magics: [&'static [u8]; 2],
    dim: usize,
    datatype: usize,
    bitpix: usize,
    pixdim: usize,
    vox_offset: usize,
    scl_slope: usize,
    scl_inter: usize,
    qform_code: usize,
    sform_code: usize,
    quatern: usize,
    qoffset: usize,
    srow: usize,
    intent_name: usize,
    xyzt_units: usize,
    /// NIfTI-2: dimensions and offset are int64, codes int32 and reals float64; else int16, int16 and float32.
    wide: bool,
}

impl Layout {
    const ALL: [Self; 2] = [
        Self {
            size: 348,
            least_offset: 352,
            magic: 344,
            magics: [b"n+1\0", b"ni1\0"],
            dim: 40,
            datatype: 70,
            bitpix: 72,
            pixdim: 76,
            vox_offset: 108,
            scl_slope: 112,
            scl_inter: 116,
            qform_code: 252,
            sform_code: 254,
            quatern: 256,
            qoffset: 268,
            srow: 280,
            intent_name: 328,
            xyzt_units: 123,
            wide: false,
        },
        Self {
            size: 540,
            least_offset: 544,
            magic: 4,
            magics: [b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n"],
            dim: 16,
            datatype: 12,
            bitpix: 14,
            pixdim: 104,
            vox_offset: 168,
            scl_slope: 176,
            scl_inter: 184,
            qform_code: 344,
            sform_code: 348,
            quatern: 352,
            qoffset: 376,
            srow: 400,
            intent_name: 508,
            xyzt_units: 500,
            wide: true,
        },
    ];
}

/// Longest header of all versions.
const LONGEST: usize = 540;

struct Header {
    layout: &'static Layout,
    big_endian: bool,
    bytes: [u8; LONGEST],
}

impl Header {
    /// Reads and recognizes the header at the start of a decoded stream.
    fn read(source: Source<'_>, reader: &mut impl Read) -> Result<Self, ReadError> {
        let mut bytes = [0; LONGEST];
        let length = read_full(reader, &mut bytes).map_err(|e| source.io(e))?;
        let first = [bytes[0], bytes[1], bytes[2], bytes[3]];
        let found = Layout::ALL.iter().find_map(|layout| {
            let size = layout.size as u32;
            let big_endian = u32::from_be_bytes(first) == size;
            (big_endian || u32::from_le_bytes(first) == size).then_some((layout, big_endian))
        });
        let wrong = |what: &str, remedy: &str| Err(source.format("header", what, remedy));
        let Some((layout, big_endian)) = found else {
            return wrong("sizeof_hdr is not 348 or 540", "give a NIfTI-1 or NIfTI-2 file");
        };
        if length < layout.size {
            return wrong(&format!("{length} of {} bytes", layout.size), "fetch the file again");
        }
        let magic = &bytes[layout.magic..];
        if magic.starts_with(layout.magics[1]) {
            return wrong("the magic of a pair of files", PAIR_REMEDY);
        }
        if !magic.starts_with(layout.magics[0]) {
            return wrong("no magic of a single NIfTI file", "convert the file to NIfTI (.nii)");
        }
        Ok(Self { layout, big_endian, bytes })
    }

    /// `N` bytes in big-endian order. The offsets of [`Layout`] lie within the header.
    fn field<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes = [0; N];
        for (out, byte) in bytes.iter_mut().zip(&self.bytes[at..]) {
            *out = *byte;
        }
        if !self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    fn int16(&self, at: usize) -> i16 {
        i16::from_be_bytes(self.field(at))
    }

    /// Entry `k` of an array of sizes.
    fn size(&self, at: usize, k: usize) -> i64 {
        if self.layout.wide { i64::from_be_bytes(self.field(at + 8 * k)) } else { i64::from(self.int16(at + 2 * k)) }
    }

    /// Whether the code of a coordinate system is above 0.
    fn has_code(&self, at: usize) -> bool {
        if self.layout.wide { i32::from_be_bytes(self.field(at)) > 0 } else { self.int16(at) > 0 }
    }

    /// Entry `k` of an array of reals.
    fn real(&self, at: usize, k: usize) -> f64 {
        if self.layout.wide {
            f64::from_be_bytes(self.field(at + 8 * k))
        } else {
            f64::from(f32::from_be_bytes(self.field(at + 4 * k)))
        }
    }

    fn real3(&self, at: usize, k: usize) -> DVec3 {
        DVec3::new(self.real(at, k), self.real(at, k + 1), self.real(at, k + 2))
    }

    fn dims(&self, source: Source<'_>) -> Result<[usize; 3], ReadError> {
        let dim = self.layout.dim;
        let axes = usize::try_from(self.size(dim, 0)).ok().filter(|n| (1..=7).contains(n)).ok_or_else(|| {
            let what = format!("dim[0] is {}", self.size(dim, 0));
            source.format("header", what, "give a number of axes from 1 to 7")
        })?;
        let sizes: Vec<i64> = (1..=axes).map(|k| self.size(dim, k)).collect();
        if sizes.iter().skip(3).any(|&n| n > 1) {
            let remedy = "extract one 3-D volume first, for example with `fslroi IN OUT 0 1`";
            return Err(source.format("header", format!("{axes} axes of sizes {sizes:?}"), remedy));
        }
        let mut dims = [1; 3];
        for (k, (dim, &size)) in dims.iter_mut().zip(&sizes).enumerate() {
            *dim = usize::try_from(size)
                .ok()
                .filter(|&n| n > 0)
                .ok_or_else(|| source.format("header", format!("dim[{}] is {size}", k + 1), "give a size above 0"))?;
        }
        Ok(dims)
    }

    fn scalar_type(&self, source: Source<'_>) -> Result<ScalarType, ReadError> {
        let code = self.int16(self.layout.datatype);
        let wrong = |what: String, remedy: &str| Err(source.format("header", what, remedy));
        let scalar = match code {
            2 => ScalarType::U8,
            4 => ScalarType::I16,
            8 => ScalarType::I32,
            16 => ScalarType::F32,
            64 => ScalarType::F64,
            256 => ScalarType::I8,
            512 => ScalarType::U16,
            768 => ScalarType::U32,
            1024 => ScalarType::I64,
            1280 => ScalarType::U64,
            1536 => return wrong("datatype 1536 (float128)".to_owned(), "convert the values to float64"),
            32 | 1792 | 2048 => {
                return wrong(format!("datatype {code} (complex)"), "store the magnitude as float32");
            }
            128 | 2304 => return wrong(format!("datatype {code} (colour)"), "store one channel as uint8"),
            _ => return wrong(format!("datatype {code}"), "convert the values to uint8, int16, uint16 or float32"),
        };
        let bits = self.int16(self.layout.bitpix);
        // Some writers leave bitpix 0.
        if bits != 0 && usize::try_from(bits) != Ok(8 * scalar.bytes()) {
            let what = format!("bitpix is {bits} for {}", scalar.name());
            return wrong(what, "correct `bitpix` or `datatype`");
        }
        Ok(scalar)
    }

    /// Slope and intercept; `None` for unscaled values.
    fn scaling(&self, source: Source<'_>) -> Result<Option<(f64, f64)>, ReadError> {
        let (slope, intercept) = (self.real(self.layout.scl_slope, 0), self.real(self.layout.scl_inter, 0));
        // Writers mark absent scaling with 0 or NaN.
        if slope == 0.0 || !slope.is_finite() || (slope, intercept) == (1.0, 0.0) {
            return Ok(None);
        }
        if !intercept.is_finite() {
            let what = format!("scl_inter is {intercept} for scl_slope {slope}");
            return Err(source.format("header", what, "give a finite `scl_inter`, or `scl_slope` 0"));
        }
        Ok(Some((slope, intercept)))
    }

    /// Offset of the voxels in the decoded file; extensions lie before it.
    fn voxel_offset(&self, source: Source<'_>) -> Result<u64, ReadError> {
        let least = self.layout.least_offset;
        let at = self.layout.vox_offset;
        let stored = if self.layout.wide { self.size(at, 0) as f64 } else { self.real(at, 0) };
        // Some writers leave 0: the voxels follow the header.
        if stored == 0.0 {
            return Ok(least);
        }
        if stored.fract() != 0.0 || !(least as f64..=MAX_OFFSET as f64).contains(&stored) {
            let remedy = format!("give a whole number from {least} to {MAX_OFFSET}");
            return Err(source.format("header", format!("vox_offset is {stored}"), remedy));
        }
        Ok(stored as u64)
    }

    /// RAS where the file gives a map to the patient, and the length unit of `xyzt_units`.
    fn frame(&self) -> WorldFrame {
        let at = self.layout.xyzt_units;
        let code = if self.layout.wide { i32::from_be_bytes(self.field(at)) } else { i32::from(self.bytes[at]) };
        let unit = match code & 0b111 {
            1 => Some(LengthUnit::Metre),
            2 => Some(LengthUnit::Millimetre),
            3 => Some(LengthUnit::Micrometre),
            _ => None,
        };
        let is_mapped = self.has_code(self.layout.sform_code) || self.has_code(self.layout.qform_code);
        WorldFrame { patient: is_mapped.then_some(PatientFrame::Ras), unit }
    }

    fn grid(&self, source: Source<'_>, dims: [usize; 3]) -> Result<Grid, ReadError> {
        let mut spacing = self.real3(self.layout.pixdim, 1).abs();
        for k in 0..3 {
            // Files of one slice often leave its thickness 0.
            if dims[k] == 1 && spacing[k] == 0.0 {
                spacing[k] = 1.0;
            }
        }
        let (origin, spacing, direction) = if self.has_code(self.layout.sform_code) {
            let rows = [0, 4, 8].map(|k| self.real3(self.layout.srow, k));
            let origin = DVec3::from_array([3, 7, 11].map(|k| self.real(self.layout.srow, k)));
            let axes = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            (origin, DVec3::new(axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length()), axes)
        } else if self.has_code(self.layout.qform_code) {
            let bcd = self.real3(self.layout.quatern, 0);
            let mut axes = rotation(bcd).ok_or_else(|| {
                let what = format!("quatern_b, c and d are {bcd}: no part of a unit quaternion");
                source.format("header", what, "correct them, or set qform_code to 0")
            })?;
            // The sign of pixdim[0] is qfac: it mirrors the third axis.
            if self.real(self.layout.pixdim, 0) < 0.0 {
                axes.z_axis = -axes.z_axis;
            }
            (self.real3(self.layout.qoffset, 0), spacing, axes)
        } else {
            (DVec3::ZERO, spacing, DMat3::IDENTITY)
        };
        Grid::new(dims, spacing, origin, direction).map_err(|e| source.grid(e))
    }

    fn intent_name(&self) -> Option<String> {
        let bytes = &self.bytes[self.layout.intent_name..][..16];
        let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
        let name = String::from_utf8_lossy(&bytes[..end]).trim().to_owned();
        (!name.is_empty()).then_some(name)
    }
}

/// The rotation of a unit quaternion from its parts b, c and d; a ≥ 0 follows from them, as in the NIfTI-1 standard.
/// `None` for parts that are not finite or too long.
fn rotation(bcd: DVec3) -> Option<DMat3> {
    let squares = bcd.length_squared();
    let unit =
        if 1.0 - squares < 1e-7 { bcd.normalize_or_zero().extend(0.0) } else { bcd.extend((1.0 - squares).sqrt()) };
    // Parts stored as float32 miss the unit length by rounding alone.
    (squares <= 1.001).then(|| DMat3::from_quat(DQuat::from_vec4(unit)))
}
