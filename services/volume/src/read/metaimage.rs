//! MetaImage, attached (`.mha`) and detached (`.mhd`): <https://itk.org/Wiki/MetaIO/Documentation>.
//!
//! The reader takes scalar 3-D volumes: binary of either byte order, plain, zlib or gzip, and text. It drops trailing axes
//! of one sample. A row of `TransformMatrix` is the direction of an axis, as ITK reads it.
//!
//! The grid keeps the file's own world frame. It is a patient's (LPS+, as in ITK and 3D Slicer) where the file has a
//! `TransformMatrix` and an `AnatomicalOrientation`. `DistanceUnits` gives the length unit; a patient's frame without it is in
//! millimetres. As in ITK, `CenterOfRotation` and `ElementToIntensityFunction…` change nothing.

use std::io::{BufRead, Read, Seek, SeekFrom};
use std::path::PathBuf;

use glam::{DMat3, DVec3};

use crate::grid::Grid;
use crate::scalars::ScalarType;
use crate::volume::Volume;
use crate::world_frame::{LengthUnit, PatientFrame, WorldFrame};

use super::decode::{Packing, Voxels, read_full, read_text_stream};
use super::error::{ActualSize, ReadError};
use super::format::VolumeFormat;
use super::source::Source;

/// Longest header.
const MAX_HEADER_BYTES: u64 = 1 << 20;
const REMEDY: &str = "correct `DimSize` or `ElementType` in the header, or fetch the file again";
/// Names of keys that first lines have.
const FIRST_KEYS: [&str; 3] = ["ObjectType", "NDims", "Comment"];

/// MetaImage.
pub(super) struct MetaImage;

impl VolumeFormat for MetaImage {
    type Data = Volume;

    const NAME: &'static str = "MetaImage";
    const ENDINGS: &'static [&'static str] = &[".mha", ".mhd"];
    const READS_BESIDE: bool = true;

    fn sniff(_name: &str, first: &[u8]) -> bool {
        let line = first.split(|&b| b == b'\n').next().unwrap_or_default();
        let known = |line: &[u8]| {
            let key = line.split(|&b| b == b'=').next().unwrap_or_default().trim_ascii();
            line.contains(&b'=') && FIRST_KEYS.iter().any(|name| name.as_bytes() == key)
        };
        known(line) && first.windows(5).any(|word| word == b"NDims")
    }

    fn read(source: Source<'_>) -> Result<Volume, ReadError> {
        read(source)
    }
}

fn read(source: Source<'_>) -> Result<Volume, ReadError> {
    let (mut reader, length) = source.reader()?;
    let header = Header::read(source, &mut reader)?;
    let grid = Grid::new(header.dims, header.spacing, header.origin, header.direction).map_err(|e| source.grid(e))?;

    let data_path: PathBuf;
    let (data_source, mut reader, length, start) = match &header.data_file {
        None => {
            let after_header = reader.stream_position().map_err(|e| source.io(e))?;
            (source, reader, length, after_header)
        }
        Some(name) => {
            data_path = source.beside(name)?;
            let data_source = Source { path: &data_path, ..source };
            let (reader, length) = data_source.reader()?;
            (data_source, reader, length, 0)
        }
    };
    let bytes = data_source.voxel_bytes(header.dims, header.scalar)?;
    let at = match header.skip {
        // The data are the end of the file.
        Skip::ToTheEnd => length.checked_sub(bytes),
        Skip::Bytes(skip) => start.checked_add(skip),
    };
    let scalars = if header.binary {
        let mut voxels = Voxels {
            dims: header.dims,
            scalar: header.scalar,
            big_endian: header.big_endian,
            packing: Packing::Plain,
            remedy: REMEDY,
        };
        let Some(at) = at.filter(|&at| at <= length) else {
            return Err(voxels.wrong_size(data_source, bytes, ActualSize::Bytes(length.saturating_sub(start))));
        };
        reader.seek(SeekFrom::Start(at)).map_err(|e| data_source.io(e))?;
        if header.compressed {
            // MetaIO writes zlib streams, and reads gzip too.
            let mut magic = [0; 2];
            read_full(&mut reader, &mut magic).map_err(|e| data_source.io(e))?;
            voxels.packing = if magic == [0x1f, 0x8b] { Packing::Gzip } else { Packing::Zlib };
            reader.seek(SeekFrom::Start(at)).map_err(|e| data_source.io(e))?;
        }
        voxels.read(data_source, reader, length - at)?
    } else {
        reader.seek(SeekFrom::Start(at.unwrap_or(start))).map_err(|e| data_source.io(e))?;
        read_text_stream(data_source, reader, header.dims, header.scalar)?
    };
    let volume = Volume::new(grid, scalars, header.name);
    volume.map(|volume| volume.in_frame(header.frame)).map_err(|e| source.format("voxels", e.to_string(), REMEDY))
}

/// Bytes in front of the voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Skip {
    Bytes(u64),
    /// Everything but the voxels, which are the end of the file.
    ToTheEnd,
}

struct Header {
    scalar: ScalarType,
    dims: [usize; 3],
    spacing: DVec3,
    origin: DVec3,
    direction: DMat3,
    binary: bool,
    compressed: bool,
    big_endian: bool,
    skip: Skip,
    /// `None` for voxels behind the header.
    data_file: Option<String>,
    name: Option<String>,
    frame: WorldFrame,
}

/// The fields of the header: line number, key and value. Keys are without regard to case, as in MetaIO.
struct Fields(Vec<(usize, String, String)>);

impl Fields {
    /// The first of these keys that the header has.
    fn get(&self, keys: &[&str]) -> Option<(usize, &str)> {
        let find = |key: &&str| self.0.iter().find(|(_, name, _)| name.eq_ignore_ascii_case(key));
        keys.iter().find_map(find).map(|(line, _, value)| (*line, value.as_str()))
    }

    fn is_true(&self, keys: &[&str]) -> bool {
        self.get(keys).is_some_and(|(_, v)| matches!(v.as_bytes().first(), Some(b'T' | b't' | b'1')))
    }
}

impl Header {
    fn read(source: Source<'_>, reader: &mut impl BufRead) -> Result<Self, ReadError> {
        let fields = read_fields(source, reader)?;
        let wrong = |line: usize, key: &str, value: &str, remedy: &str| {
            let value: String = value.chars().take(60).collect();
            source.format(format!("line {line}"), format!("`{key} = {value}` is not supported"), remedy)
        };
        let need = |key: &str| {
            fields.get(&[key]).ok_or_else(|| {
                source.format("header", format!("no field `{key}`"), "add it (see the documentation of MetaIO)")
            })
        };
        // Up to `count` numbers; more are a text of another layout.
        let numbers = |keys: &[&str], count: usize| match fields.get(keys) {
            None => Ok(None),
            Some((line, value)) => {
                let parsed: Option<Vec<f64>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
                let parsed = parsed.filter(|numbers| numbers.len() == count);
                parsed.map(Some).ok_or_else(|| wrong(line, keys[0], value, &format!("give {count} numbers")))
            }
        };

        if let Some((line, value)) = fields.get(&["ObjectType"])
            && !value.eq_ignore_ascii_case("Image")
        {
            return Err(wrong(line, "ObjectType", value, "give an object of type Image"));
        }
        let (line, value) = need("NDims")?;
        let dimension: usize = value
            .parse()
            .ok()
            .filter(|d| (1..=10).contains(d))
            .ok_or_else(|| wrong(line, "NDims", value, "give a whole number from 1 to 10"))?;
        let (line, value) = need("DimSize")?;
        let sizes: Option<Vec<usize>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
        let sizes = sizes
            .filter(|sizes| sizes.len() == dimension)
            .ok_or_else(|| wrong(line, "DimSize", value, "give one whole number for each dimension"))?;
        if dimension < 3 || sizes[3..].iter().any(|&size| size != 1) {
            return Err(wrong(line, "DimSize", value, "give a scalar volume of 3 dimensions"));
        }
        if let Some((line, value)) = fields.get(&["ElementNumberOfChannels"])
            && value != "1"
        {
            return Err(wrong(line, "ElementNumberOfChannels", value, "give a volume of one value a voxel"));
        }
        let (line, value) = need("ElementType")?;
        let scalar =
            scalar_type(value).ok_or_else(|| wrong(line, "ElementType", value, "use one of MET_CHAR to MET_DOUBLE"))?;

        let spacing = match numbers(&["ElementSpacing"], dimension)? {
            Some(spacing) => Some(spacing),
            // Older files have the extent of a voxel only.
            None => numbers(&["ElementSize"], dimension)?,
        };
        let origin = numbers(&["Offset", "Position", "Origin"], dimension)?;
        let matrix = numbers(&["TransformMatrix", "Rotation", "Orientation"], dimension * dimension)?;
        let vector = |values: &[f64]| DVec3::new(values[0], values[1], values[2]);
        let direction = matrix.as_ref().map_or(DMat3::IDENTITY, |m| {
            DMat3::from_cols(vector(m), vector(&m[dimension..]), vector(&m[2 * dimension..]))
        });

        // ITK writes both for every volume that it knows the axes of.
        let sides = fields.get(&["AnatomicalOrientation"]).is_some_and(|(_, letters)| !letters.contains('?'));
        let patient = (matrix.is_some() && sides).then_some(PatientFrame::Lps);
        let unit = fields.get(&["DistanceUnits"]).and_then(|(_, name)| LengthUnit::of_name(name));
        let unit = unit.or(patient.map(|_| LengthUnit::Millimetre));

        let binary = fields.get(&["BinaryData"]).is_none() || fields.is_true(&["BinaryData"]);
        let compressed = fields.is_true(&["CompressedData"]);
        let skip =
            match fields.get(&["HeaderSize"]) {
                None => Skip::Bytes(0),
                Some((_, "-1")) if binary && !compressed => Skip::ToTheEnd,
                Some((line, value)) => Skip::Bytes(value.parse().map_err(|_| {
                    wrong(line, "HeaderSize", value, "give a whole number, or -1 for plain binary data")
                })?),
            };
        let (line, value) = need("ElementDataFile")?;
        let data_file = match value {
            "LOCAL" | "Local" | "local" => None,
            "" => return Err(wrong(line, "ElementDataFile", value, "name the file of the voxels, or LOCAL")),
            list if list.starts_with("LIST") || list.contains('%') => {
                return Err(wrong(line, "ElementDataFile", value, "join the slices into one data file first"));
            }
            name => Some(name.to_owned()),
        };
        Ok(Self {
            scalar,
            dims: [sizes[0], sizes[1], sizes[2]],
            spacing: spacing.map_or(DVec3::ONE, |s| vector(&s)),
            origin: origin.map_or(DVec3::ZERO, |o| vector(&o)),
            direction,
            binary,
            compressed,
            big_endian: fields.is_true(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]),
            skip,
            data_file,
            name: fields.get(&["Name"]).map(|(_, name)| name.to_owned()).filter(|name| !name.is_empty()),
            frame: WorldFrame { patient, unit },
        })
    }
}

/// The type of a name. MetaIO's long has 4 bytes on every machine.
fn scalar_type(name: &str) -> Option<ScalarType> {
    Some(match name.to_ascii_uppercase().as_str() {
        "MET_CHAR" => ScalarType::I8,
        "MET_UCHAR" | "MET_ASCII_CHAR" => ScalarType::U8,
        "MET_SHORT" => ScalarType::I16,
        "MET_USHORT" => ScalarType::U16,
        "MET_INT" | "MET_LONG" => ScalarType::I32,
        "MET_UINT" | "MET_ULONG" => ScalarType::U32,
        "MET_LONG_LONG" => ScalarType::I64,
        "MET_ULONG_LONG" => ScalarType::U64,
        "MET_FLOAT" => ScalarType::F32,
        "MET_DOUBLE" => ScalarType::F64,
        _ => return None,
    })
}

/// Reads up to `ElementDataFile`, which ends the header.
fn read_fields(source: Source<'_>, reader: &mut impl BufRead) -> Result<Fields, ReadError> {
    let mut fields = Fields(Vec::new());
    let mut budget = MAX_HEADER_BYTES;
    for number in 1.. {
        let mut bytes = Vec::new();
        let got = reader.take(budget).read_until(b'\n', &mut bytes).map_err(|e| source.io(e))? as u64;
        budget -= got;
        if budget == 0 {
            let what = format!("no `ElementDataFile` within {MAX_HEADER_BYTES} bytes");
            return Err(source.format("header", what, "end the header with that field"));
        }
        if got == 0 {
            break;
        }
        let line = String::from_utf8_lossy(&bytes);
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        let Some((key, value)) = line.split_once('=').or_else(|| line.split_once(':')) else {
            let what = format!("`{}` is not `Key = Value`", line.chars().take(60).collect::<String>());
            return Err(source.format(format!("line {number}"), what, "correct or remove the line"));
        };
        let (key, value) = (key.trim().to_owned(), value.trim().to_owned());
        let last = key.eq_ignore_ascii_case("ElementDataFile");
        fields.0.push((number, key, value));
        if last {
            break;
        }
    }
    Ok(fields)
}
