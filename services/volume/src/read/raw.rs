//! Raw volumes with size and type in the file name: `name_XxYxZ_type[_le|_be].raw[.gz|.zst]`.

use std::io::{self, BufReader, Write};
use std::path::Path;

use crate::grid::Grid;
use crate::scalars::{ScalarType, Scalars};
use crate::volume::Volume;

use super::decode::{Packing, Voxels};
use super::error::{ReadError, WriteError};
use super::format::VolumeFormat;
use super::source::Source;

const REMEDY: &str = "correct the dimensions or the type in the file name, or fetch the file again";

/// Raw voxels.
pub(super) struct Raw;

impl VolumeFormat for Raw {
    type Data = Volume;

    const NAME: &'static str = "raw voxels with _XxYxZ_type in the name";
    const ENDINGS: &'static [&'static str] = &[".raw", ".raw.gz", ".raw.zst"];

    /// Never: only the name describes the voxels.
    fn sniff(_name: &str, _first: &[u8]) -> bool {
        false
    }

    fn read(source: Source<'_>) -> Result<Volume, ReadError> {
        read(source)
    }

    fn write(path: &Path, volume: &Volume, mut writer: &mut dyn Write) -> Result<(), WriteError> {
        let name = super::lower_case_name(path);
        let Some(stem) = name.strip_suffix(".raw") else {
            return Err(WriteError::Ending { path: path.to_owned() });
        };
        let wanted = Layout { dims: volume.grid().dims(), scalar: volume.scalars().scalar_type(), big_endian: false };
        if Layout::from_stem(stem) != Some(wanted) {
            return Err(WriteError::Name { path: path.to_owned(), ending: raw_file_name("", volume) });
        }
        write_raw(volume.scalars(), &mut writer).map_err(|source| WriteError::Io { path: path.to_owned(), source })
    }
}

fn read(source: Source<'_>) -> Result<Volume, ReadError> {
    let lower = source.file_name().to_ascii_lowercase();
    let (stem, packing) = if let Some(s) = lower.strip_suffix(".raw.gz") {
        (s, Packing::Gzip)
    } else if let Some(s) = lower.strip_suffix(".raw.zst") {
        (s, Packing::Zstd)
    } else {
        (lower.strip_suffix(".raw").unwrap_or(&lower), Packing::Plain)
    };
    let Some(layout) = Layout::from_stem(stem) else {
        return Err(source.format(
            "file name",
            "it carries no _XxYxZ_type",
            "rename it like bonsai_256x256x256_uint8.raw (types uint8 int8 uint16 int16 float32 float64, then _be if big \
             endian)",
        ));
    };
    let (file, available) = source.open()?;
    let grid = Grid::unit(layout.dims).map_err(|e| source.grid(e))?;
    let voxels =
        Voxels { dims: layout.dims, scalar: layout.scalar, big_endian: layout.big_endian, packing, remedy: REMEDY };
    let scalars = voxels.read(source, BufReader::with_capacity(1 << 18, file), available)?;
    Volume::new(grid, scalars, None).map_err(|e| source.format("voxels", e.to_string(), REMEDY))
}

#[derive(Debug, PartialEq)]
struct Layout {
    dims: [usize; 3],
    scalar: ScalarType,
    big_endian: bool,
}

impl Layout {
    /// The last `_XxYxZ_type` of a name without extension.
    fn from_stem(stem: &str) -> Option<Self> {
        let parts: Vec<&str> = stem.split('_').collect();
        (1..parts.len().saturating_sub(1)).rev().find_map(|i| {
            let mut dims = parts[i].split('x').map(|d| d.parse::<usize>().ok());
            let (x, y, z) = (dims.next()??, dims.next()??, dims.next()??);
            if dims.next().is_some() {
                return None;
            }
            let scalar = ScalarType::ALL.iter().copied().find(|t| t.name() == parts[i + 1])?;
            Some(Self { dims: [x, y, z], scalar, big_endian: parts.get(i + 2) == Some(&"be") })
        })
    }
}

/// The file name of a raw volume with its size and type: `stem_XxYxZ_type.raw`.
#[must_use]
pub fn raw_file_name(stem: &str, volume: &Volume) -> String {
    let [x, y, z] = volume.grid().dims();
    format!("{stem}_{x}x{y}x{z}_{}.raw", volume.scalars().scalar_type().name())
}

/// Writes the values as a raw little-endian volume, x fastest. The file does not store spacing, origin and orientation.
///
/// # Errors
/// The error of the writer.
pub fn write_raw(scalars: &Scalars, writer: &mut impl Write) -> io::Result<()> {
    scalars.for_each_piece(1 << 16, |bytes| writer.write_all(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_gives_the_layout() {
        let layout = |dims, scalar, big_endian| Some(Layout { dims, scalar, big_endian });
        assert_eq!(Layout::from_stem("bonsai_256x256x256_uint8"), layout([256; 3], ScalarType::U8, false));
        assert_eq!(Layout::from_stem("a_b_2x3x4_int16_be"), layout([2, 3, 4], ScalarType::I16, true));
        assert_eq!(Layout::from_stem("a_2x3x4_float64_le"), layout([2, 3, 4], ScalarType::F64, false));
        assert_eq!(Layout::from_stem("a_1x1x1_uint8_2x3x4_float32"), layout([2, 3, 4], ScalarType::F32, false));
        for none in ["a", "a_2x3_uint8", "a_2x3x4", "a_2x3x4_int12", "a_2x3x4x5_uint8", "2x3x4_uint8", "a_2x-3x4_uint8"]
        {
            assert_eq!(Layout::from_stem(none), None, "{none}");
        }
    }
}
