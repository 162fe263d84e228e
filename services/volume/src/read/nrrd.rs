//! NRRD, attached (`.nrrd`) and detached (`.nhdr`): <https://teem.sourceforge.net/nrrd/format.html>.
//!
//! The reader takes scalar 3-D volumes in the encodings raw, gzip and ascii. It drops axes of one sample without a
//! direction. The grid keeps the file's own world frame, for example `left-posterior-superior`. One exception is
//! `left-anterior-superior`, which is left-handed: its x axis is turned round, so that pictures do not swap a patient's sides.
//! `space units`, or else `units`, gives the length unit. A patient's frame without units is in millimetres, as 3D Slicer writes it.
//! Its names and colours of segments are read too.

use std::io::{BufRead, Read, Seek, SeekFrom};
use std::path::PathBuf;

use glam::{DMat3, DVec3};

use crate::grid::Grid;
use crate::label_table::LabelTable;
use crate::scalars::ScalarType;
use crate::volume::Volume;
use crate::world_frame::{LengthUnit, PatientFrame, WorldFrame};

use super::decode::{Packing, Voxels, read_text_stream};
use super::error::{ActualSize, ReadError};
use super::format::VolumeFormat;
use super::source::Source;

/// Start of every NRRD file; the version follows.
const MAGIC: &str = "NRRD000";
/// Longest header.
const MAX_HEADER_BYTES: u64 = 1 << 20;
const REMEDY: &str = "correct `sizes` or `type` in the header, or fetch the file again";

/// NRRD.
pub(super) struct Nrrd;

impl VolumeFormat for Nrrd {
    type Data = Volume;

    const NAME: &'static str = "NRRD";
    const ENDINGS: &'static [&'static str] = &[".nrrd", ".nhdr"];
    const READS_BESIDE: bool = true;

    fn sniff(_name: &str, first: &[u8]) -> bool {
        first.starts_with(MAGIC.as_bytes())
    }

    fn read(source: Source<'_>) -> Result<Volume, ReadError> {
        read(source)
    }
}

fn read(source: Source<'_>) -> Result<Volume, ReadError> {
    let (mut reader, length) = source.reader()?;
    let header = Header::read(source, &mut reader)?;
    let (dims, grid) = header.grid(source)?;
    let after_header = reader.stream_position().map_err(|e| source.io(e))?;

    let data_path: PathBuf;
    let (data_source, mut reader, length, start) = match &header.data_file {
        None => (source, reader, length, after_header),
        Some(name) => {
            data_path = source.beside(name)?;
            let data_source = Source { path: &data_path, ..source };
            let (reader, length) = data_source.reader()?;
            (data_source, reader, length, 0)
        }
    };
    let scalars = match header.encoding {
        Encoding::Ascii => {
            header.skip_lines(data_source, &mut reader)?;
            read_text_stream(data_source, reader, dims, header.scalar)?
        }
        Encoding::Raw | Encoding::Gzip => {
            let packing = if header.encoding == Encoding::Raw { Packing::Plain } else { Packing::Gzip };
            let voxels = Voxels { dims, scalar: header.scalar, big_endian: header.big_endian, packing, remedy: REMEDY };
            let bytes = data_source.voxel_bytes(dims, header.scalar)?;
            let at = match (header.byte_skip, header.encoding) {
                // The data are the end of the file.
                (-1, Encoding::Raw) => length.checked_sub(bytes),
                (skip, Encoding::Raw) => {
                    header.skip_lines(data_source, &mut reader)?;
                    let lines = reader.stream_position().map_err(|e| data_source.io(e))?.max(start);
                    u64::try_from(skip).ok().and_then(|s| lines.checked_add(s))
                }
                _ => Some(start),
            };
            let Some(at) = at.filter(|&at| at <= length) else {
                let found = ActualSize::Bytes(length.saturating_sub(start));
                return Err(voxels.wrong_size(data_source, bytes, found));
            };
            reader.seek(SeekFrom::Start(at)).map_err(|e| data_source.io(e))?;
            voxels.read(data_source, reader, length - at)?
        }
    };
    let volume = Volume::new(grid, scalars, header.content);
    let told = |volume: Volume| volume.in_frame(header.frame).with_labels(header.labels);
    volume.map(told).map_err(|e| source.format("voxels", e.to_string(), REMEDY))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Raw,
    Gzip,
    Ascii,
}

/// One axis of the file.
#[derive(Debug, Clone, Copy)]
struct Axis {
    size: usize,
    spacing: Option<f64>,
    direction: Option<DVec3>,
}

struct Header {
    scalar: ScalarType,
    axes: Vec<Axis>,
    origin: DVec3,
    encoding: Encoding,
    big_endian: bool,
    data_file: Option<String>,
    line_skip: u64,
    byte_skip: i64,
    content: Option<String>,
    frame: WorldFrame,
    /// Names and colours of the segments that 3D Slicer has written.
    labels: LabelTable,
    /// Whether the x axis of the world is turned round.
    mirrored: bool,
}

/// The patient's frame of a `space`, and whether the file's x axis points to the other side.
fn patient_frame(space: &str) -> Option<(PatientFrame, bool)> {
    let space = space.to_ascii_lowercase();
    match space.as_str() {
        "left-posterior-superior" | "lps" => Some((PatientFrame::Lps, false)),
        "right-anterior-superior" | "ras" => Some((PatientFrame::Ras, false)),
        "left-anterior-superior" | "las" => Some((PatientFrame::Ras, true)),
        _ => None,
    }
}

/// The length unit of words in quotation marks, if all name the same one. `???` and the empty word stand for an unknown unit,
/// and `none` for an axis without one.
fn length_unit(value: &str) -> Option<LengthUnit> {
    let words = value.split('"').skip(1).step_by(2).map(LengthUnit::of_name);
    let mut units = words.take(3);
    let first = units.next()??;
    units.all(|unit| unit == Some(first)).then_some(first)
}

/// What the header says.
#[derive(Default)]
struct Fields {
    /// Line number, name and value of each field.
    fields: Vec<(usize, String, String)>,
    /// Keys and values of other programs.
    pairs: Vec<(String, String)>,
}

impl Fields {
    fn get(&self, names: &[&str]) -> Option<(usize, &str)> {
        self.fields.iter().find(|(_, n, _)| names.contains(&n.as_str())).map(|(line, _, v)| (*line, v.as_str()))
    }
}

impl Header {
    fn read(source: Source<'_>, reader: &mut impl BufRead) -> Result<Self, ReadError> {
        let fields = read_fields(source, reader)?;
        let need = |names: &[&str]| {
            fields.get(names).ok_or_else(|| {
                source.format("header", format!("no field `{}`", names[0]), "add it (see the NRRD specification)")
            })
        };
        let wrong = |line: usize, name: &str, value: &str, remedy: &str| {
            source.format(format!("line {line}"), format!("`{name}: {value}` is not supported"), remedy)
        };

        let (line, name) = need(&["type"])?;
        let scalar = ScalarType::from_name(&name.to_ascii_lowercase())
            .ok_or_else(|| wrong(line, "type", name, "use one of int8 to uint64, float or double"))?;
        let (line, value) = need(&["dimension"])?;
        let dimension: usize = value
            .parse()
            .ok()
            .filter(|d| (1..=16).contains(d))
            .ok_or_else(|| wrong(line, "dimension", value, "give a whole number from 1 to 16"))?;
        let (line, value) = need(&["sizes"])?;
        let sizes: Vec<usize> = value.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        if sizes.len() != dimension || value.split_whitespace().count() != dimension {
            return Err(wrong(line, "sizes", value, "give one whole number for each dimension"));
        }
        let mut axes: Vec<Axis> = sizes.iter().map(|&size| Axis { size, spacing: None, direction: None }).collect();

        if let Some((line, value)) = fields.get(&["spacings"]) {
            let words: Vec<&str> = value.split_whitespace().collect();
            for (i, axis) in axes.iter_mut().enumerate() {
                let word = words.get(i).and_then(|w| w.parse::<f64>().ok());
                let word = word.ok_or_else(|| wrong(line, "spacings", value, "give one number for each dimension"))?;
                // `nan` marks an axis without spacing.
                axis.spacing = (!word.is_nan()).then_some(word);
            }
        }
        if let Some((line, value)) = fields.get(&["space directions"]) {
            let vectors = parse_vectors(value)
                .filter(|v| v.len() == dimension)
                .ok_or_else(|| wrong(line, "space directions", value, "give `none` or `(x,y,z)` for each dimension"))?;
            for (axis, vector) in axes.iter_mut().zip(vectors) {
                axis.direction = vector;
            }
        }
        let origin = match fields.get(&["space origin"]) {
            None => DVec3::ZERO,
            Some((line, value)) => match parse_vectors(value).as_deref() {
                Some(&[Some(origin)]) => origin,
                _ => return Err(wrong(line, "space origin", value, "give one `(x,y,z)`")),
            },
        };

        // Without directions the axes of the file lie anywhere in the patient.
        let spatial = axes.iter().filter(|axis| axis.direction.is_some()).count();
        let patient = fields.get(&["space"]).and_then(|(_, space)| patient_frame(space)).filter(|_| spatial >= 3);
        let units = fields.get(&["space units"]).or_else(|| fields.get(&["units"]).filter(|_| spatial == 0));
        let unit = match units {
            Some((_, value)) => length_unit(value),
            None => patient.map(|_| LengthUnit::Millimetre),
        };
        let mirrored = patient.is_some_and(|(_, mirrored)| mirrored);
        let frame = WorldFrame { patient: patient.map(|(frame, _)| frame), unit };

        let (line, value) = need(&["encoding"])?;
        let encoding = match value.to_ascii_lowercase().as_str() {
            "raw" => Encoding::Raw,
            "gz" | "gzip" => Encoding::Gzip,
            "ascii" | "text" | "txt" => Encoding::Ascii,
            _ => return Err(wrong(line, "encoding", value, "convert the file to raw, gzip or ascii")),
        };
        let big_endian = match fields.get(&["endian"]).map(|(l, v)| (l, v.to_ascii_lowercase())) {
            Some((_, v)) if v == "little" => false,
            Some((_, v)) if v == "big" => true,
            Some((line, v)) => return Err(wrong(line, "endian", &v, "give little or big")),
            None if scalar.bytes() == 1 || encoding == Encoding::Ascii => false,
            None => return Err(source.format("header", "no field `endian`", "add `endian: little` or `endian: big`")),
        };
        let data_file = fields.get(&["data file", "datafile"]);
        if let Some((line, value)) = data_file
            && (value.starts_with("LIST") || value.contains('%'))
        {
            return Err(wrong(line, "data file", value, "join the slices into one data file first"));
        }
        let line_skip = match fields.get(&["line skip", "lineskip"]) {
            None => 0,
            Some((line, v)) => v.parse().map_err(|_| wrong(line, "line skip", v, "give a whole number"))?,
        };
        let byte_skip = match fields.get(&["byte skip", "byteskip"]) {
            None => 0,
            Some((line, v)) => v
                .parse()
                .ok()
                .filter(|&n: &i64| n >= 0 || (n == -1 && encoding == Encoding::Raw))
                .ok_or_else(|| wrong(line, "byte skip", v, "give a whole number, or -1 with raw encoding"))?,
        };
        if encoding == Encoding::Gzip && (line_skip > 0 || byte_skip > 0) {
            return Err(source.format("header", "skips inside gzip data are not supported", "store the data without"));
        }
        Ok(Self {
            scalar,
            axes,
            origin,
            encoding,
            big_endian,
            data_file: data_file.map(|(_, v)| v.to_owned()),
            line_skip,
            byte_skip,
            content: fields.get(&["content"]).map(|(_, v)| v.to_owned()).filter(|v| !v.is_empty()),
            frame,
            labels: LabelTable::of_segments(&fields.pairs),
            mirrored,
        })
    }

    /// The three spatial axes as a grid.
    fn grid(&self, source: Source<'_>) -> Result<([usize; 3], Grid), ReadError> {
        let mut axes = self.axes.clone();
        while axes.len() > 3
            && let Some(i) = axes.iter().position(|a| a.size == 1 && a.direction.is_none())
        {
            axes.remove(i);
        }
        let &[x, y, z] = axes.as_slice() else {
            return Err(source.format(
                "header",
                format!("{} axes of sizes {:?}", self.axes.len(), self.axes.iter().map(|a| a.size).collect::<Vec<_>>()),
                "give a scalar volume of 3 dimensions",
            ));
        };
        let units = [DVec3::X, DVec3::Y, DVec3::Z];
        let mut spacing = DVec3::ONE;
        let mut direction = DMat3::IDENTITY;
        for (k, axis) in [x, y, z].iter().enumerate() {
            match (axis.direction, axis.spacing) {
                (Some(d), _) => {
                    spacing[k] = d.length();
                    *direction.col_mut(k) = d;
                }
                // A negative spacing runs the axis backwards.
                (None, Some(s)) => {
                    spacing[k] = s.abs();
                    *direction.col_mut(k) = units[k] * s.signum();
                }
                (None, None) => {}
            }
        }
        let dims = [x.size, y.size, z.size];
        let turn = DVec3::new(if self.mirrored { -1.0 } else { 1.0 }, 1.0, 1.0);
        let direction = DMat3::from_diagonal(turn) * direction;
        let grid = Grid::new(dims, spacing, turn * self.origin, direction).map_err(|e| source.grid(e))?;
        Ok((dims, grid))
    }

    fn skip_lines(&self, source: Source<'_>, reader: &mut impl BufRead) -> Result<(), ReadError> {
        for _ in 0..self.line_skip {
            if reader.skip_until(b'\n').map_err(|e| source.io(e))? == 0 {
                return Err(source.format("data", "fewer lines than `line skip` says", "correct `line skip`"));
            }
        }
        if self.encoding == Encoding::Ascii {
            let skip = u64::try_from(self.byte_skip).unwrap_or(0);
            std::io::copy(&mut reader.take(skip), &mut std::io::sink()).map_err(|e| source.io(e))?;
        }
        Ok(())
    }
}

fn read_fields(source: Source<'_>, reader: &mut impl BufRead) -> Result<Fields, ReadError> {
    let mut fields = Fields::default();
    let mut budget = MAX_HEADER_BYTES;
    for number in 1.. {
        let mut bytes = Vec::new();
        let got = reader.take(budget).read_until(b'\n', &mut bytes).map_err(|e| source.io(e))? as u64;
        budget -= got;
        if budget == 0 {
            let what = format!("no empty line within {MAX_HEADER_BYTES} bytes");
            return Err(source.format("header", what, "end the header with an empty line"));
        }
        let line = String::from_utf8_lossy(&bytes);
        let line = line.trim_end_matches(['\r', '\n']);
        if number == 1 {
            if !line.starts_with(MAGIC) {
                return Err(source.format("line 1", "no NRRD000x magic", "give an NRRD file"));
            }
            continue;
        }
        // A detached header may end with the file.
        if line.is_empty() {
            break;
        }
        if line.starts_with('#') {
            continue;
        }
        // `key:=value` pairs belong to other programs. Their values may contain ": ".
        let field = line.find(": ").or_else(|| line.strip_suffix(':').map(str::len));
        match (line.find(":="), field) {
            (Some(pair), at) if at.is_none_or(|at| pair < at) => {
                let value = line.get(pair + 2..).unwrap_or("");
                fields.pairs.push((line[..pair].trim().to_owned(), value.to_owned()));
            }
            (_, Some(at)) => {
                let name = line[..at].trim().to_ascii_lowercase();
                let value = line.get(at + 1..).unwrap_or("").trim().to_owned();
                // A list of data files ends the header.
                let is_list = name.starts_with("data") && value.starts_with("LIST");
                fields.fields.push((number, name, value));
                if is_list {
                    break;
                }
            }
            (_, None) => {
                let what = format!("`{}` is not `field: value`", line.chars().take(60).collect::<String>());
                return Err(source.format(format!("line {number}"), what, "correct or remove the line"));
            }
        }
    }
    Ok(fields)
}

/// Parses vectors such as `(1,0,0) none (0,0,2)`; `None` for malformed text.
fn parse_vectors(text: &str) -> Option<Vec<Option<DVec3>>> {
    let mut rest = text.trim();
    let mut vectors = Vec::new();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
        let mut numbers = inside.split(',').map(|w| w.trim().parse::<f64>().ok());
        let vector = DVec3::new(numbers.next()??, numbers.next()??, numbers.next()??);
        if numbers.next().is_some() {
            return None;
        }
        vectors.push(Some(vector));
        rest = after.trim_start();
    }
    Some(vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_units_are_those_that_all_axes_share() {
        assert_eq!(length_unit(r#""mm" "mm" "mm""#), Some(LengthUnit::Millimetre));
        assert_eq!(length_unit("\"microns\" \"um\" \"\u{b5}m\""), Some(LengthUnit::Micrometre));
        for unknown in [r#""mm" "mm" "cm""#, r#""" "" """#, "mm mm mm", ""] {
            assert_eq!(length_unit(unknown), None, "{unknown}");
        }
    }

    #[test]
    fn vectors_are_parsed() {
        let v = parse_vectors("none (1,0,0)(0, 2 ,0) (0,0,-3e0)").unwrap();
        assert_eq!(v, [None, Some(DVec3::X), Some(DVec3::Y * 2.0), Some(DVec3::Z * -3.0)]);
        for bad in ["(1,0)", "(1,0,0", "1,0,0", "(a,0,0)", "(1,2,3,4)"] {
            assert_eq!(parse_vectors(bad), None, "{bad}");
        }
    }
}
