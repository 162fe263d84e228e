//! `scene.toml`: the unit files of a scene, their placement and colours, and the scene's box.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::{DMat4, Vec3};
use serde::Deserialize;
use sg_input::{file, limits};
use toml::{Spanned, Value};

use crate::splat::toml_number::{exact_f32, row_major, transform};
use crate::splat::unit_comments::{convention_name, shading_name};
use crate::staged_file;
use sg_scene::model::{BaseUnit, Convention, Scene, SceneBox, ShadingModel};
use sg_scene::orientation::{Axis, LengthUnit, Orientation, PatientFrame};

/// The version that is written, and the greatest that is read.
const SCHEMA: i64 = 1;
/// Longest file that is read: [`MAX_UNITS`] entries with every key.
const MAX_BYTES: u64 = 4 << 20;
/// Most base units.
const MAX_UNITS: usize = 4096;

/// The content of a `scene.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFile {
    /// The stored box, if there is one; without it the box of the finite centres is taken.
    pub bounds: Option<SceneBox>,
    /// Directions and length unit, as far as the file tells them.
    pub orientation: Orientation,
    /// Base units in scene order.
    pub units: Vec<UnitEntry>,
}

/// One `[[unit]]`.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitEntry {
    /// Name, unique within the scene.
    pub name: String,
    /// The file of its Gaussians, relative to the scene file.
    pub file: PathBuf,
    /// Palette colour, RGB 0 to 1; without it the file's own is taken.
    pub palette: Option<Vec3>,
    /// Factor on every opacity, at least 0.
    pub opacity: f32,
    /// Local frame to scene frame.
    pub transform: DMat4,
    /// Activation of the file's shading columns; without it the file decides, or it is guessed.
    pub convention: Option<Convention>,
    /// Shading model; without it the paper's.
    pub shading: Option<ShadingModel>,
    /// Whether normals point consistently to one side; without it the file decides.
    pub oriented_normals: Option<bool>,
    /// The transfer function behind the unit, relative to the scene file.
    pub transfer_function: Option<PathBuf>,
    /// Least and greatest value of the volume behind the unit, raw.
    pub values: Option<[f64; 2]>,
}

/// A scene file that cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum SceneFileError {
    /// The file could not be read.
    #[error("{path}: {source}; give the path of a scene.toml")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file could not be written.
    #[error("{path}: {source}; nothing was changed")]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The content is wrong.
    #[error("{path}: line {line}, column {column}: {message}")]
    Content {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Character within the line, from 1.
        column: usize,
        /// The cause and the remedy.
        message: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    schema: Spanned<i64>,
    #[serde(rename = "box")]
    bounds: Option<Spanned<BoxTable>>,
    #[serde(default)]
    orientation: OrientationTable,
    #[serde(default)]
    unit: Vec<UnitTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxTable {
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct OrientationTable {
    patient: Option<Spanned<String>>,
    unit: Option<Spanned<String>>,
    up: Option<Spanned<String>>,
}

impl OrientationTable {
    fn check(self) -> Result<Orientation, (Range<usize>, String)> {
        fn value<T>(
            name: Option<Spanned<String>>,
            of_name: fn(&str) -> Option<T>,
            what: &str,
        ) -> Result<Option<T>, (Range<usize>, String)> {
            let Some(name) = name else { return Ok(None) };
            let found = of_name(name.get_ref());
            found.map(Some).ok_or_else(|| (name.span(), format!("`{}` is no {what}", name.get_ref())))
        }
        Ok(Orientation {
            patient: value(self.patient, PatientFrame::of_name, "frame of a patient; give LPS or RAS")?,
            unit: value(self.unit, LengthUnit::of_name, "length unit; give m, mm or um")?,
            up: value(self.up, Axis::of_name, "direction; give +X, -X, +Y, -Y, +Z or -Z")?,
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct UnitTable {
    name: Spanned<String>,
    file: Spanned<PathBuf>,
    palette: Option<Spanned<[f64; 3]>>,
    opacity: Option<Spanned<f64>>,
    transform: Option<Spanned<Vec<f64>>>,
    convention: Option<Convention>,
    shading: Option<ShadingModel>,
    oriented_normals: Option<bool>,
    transfer_function: Option<PathBuf>,
    values: Option<Spanned<[f64; 2]>>,
}

impl SceneFile {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`SceneFileError`] names the line and column of the problem.
    pub fn read(path: &Path) -> Result<Self, SceneFileError> {
        let failed = |source| SceneFileError::Read { path: path.to_path_buf(), source };
        Self::parse(&file::read_text(path, MAX_BYTES).map_err(failed)?, path)
    }

    /// Parses a file's text; `path` names it in errors.
    ///
    /// # Errors
    /// [`SceneFileError::Content`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, SceneFileError> {
        let wrong = |span: Range<usize>, message: String| {
            let (line, column) = place(text, span.start);
            SceneFileError::Content { path: path.to_path_buf(), line, column, message }
        };
        limits::check_toml_parts(text).map_err(|what| wrong(0..0, what))?;
        let document: Document = toml::from_str(text)
            .map_err(|e| wrong(e.span().unwrap_or(0..0), e.message().trim().replace('\n', ", ")))?;
        let schema = *document.schema.get_ref();
        if schema != SCHEMA {
            let message = format!("schema {schema} is not known; this program reads schema {SCHEMA}: update it");
            return Err(wrong(document.schema.span(), message));
        }
        if document.unit.is_empty() {
            return Err(wrong(text.len()..text.len(), "there is no [[unit]]; a scene has at least one".to_owned()));
        }
        let mut bounds = None;
        if let Some(table) = document.bounds {
            let (min, max) = (table.get_ref().min, table.get_ref().max);
            let fine = min.iter().zip(&max).all(|(a, b)| a.is_finite() && b.is_finite() && a <= b);
            if !fine {
                return Err(wrong(table.span(), "the box's numbers must be finite and min not above max".to_owned()));
            }
            bounds = Some(SceneBox { min: min.into(), max: max.into() });
        }
        let orientation = document.orientation.check().map_err(|(span, message)| wrong(span, message))?;
        if let Some(extra) = document.unit.get(MAX_UNITS) {
            let message = format!("more than {MAX_UNITS} units; join some of their files");
            return Err(wrong(extra.name.span(), message));
        }
        let mut names = HashSet::new();
        let mut units: Vec<UnitEntry> = Vec::with_capacity(document.unit.len());
        for table in document.unit {
            if table.name.get_ref().trim().is_empty() {
                return Err(wrong(table.name.span(), "the name is empty; give the unit a name".to_owned()));
            }
            if !names.insert(table.name.get_ref().clone()) {
                let message = format!("a second unit is named `{}`; give each its own name", table.name.get_ref());
                return Err(wrong(table.name.span(), message));
            }
            if table.file.get_ref().as_os_str().is_empty() {
                return Err(wrong(table.file.span(), "the file is empty; give the path of a Gaussian file".to_owned()));
            }
            units.push(table.check().map_err(|(span, message)| wrong(span, message))?);
        }
        Ok(Self { bounds, orientation, units })
    }

    /// The file of a scene whose units stand in `files`, in order, stored as used.
    #[must_use]
    pub fn of_scene(scene: &Scene, files: &[PathBuf]) -> Self {
        let entry = |(unit, file): (&BaseUnit, &PathBuf)| UnitEntry {
            name: unit.name.clone(),
            file: file.clone(),
            palette: Some(unit.palette),
            opacity: unit.opacity,
            transform: unit.transform,
            convention: Some(Convention::Ours),
            shading: Some(unit.shading),
            oriented_normals: Some(unit.oriented_normals),
            transfer_function: unit.transfer_function.clone(),
            values: unit.values,
        };
        Self {
            bounds: Some(scene.bounds),
            orientation: scene.orientation,
            units: scene.units.iter().zip(files).map(entry).collect(),
        }
    }

    /// The file's text; parsing it gives the same values, bit for bit.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = format!("schema = {SCHEMA}\n");
        if let Some(b) = self.bounds {
            // Writing into a String cannot fail.
            let _ = writeln!(text, "\n[box]\nmin = {}\nmax = {}", list(b.min.to_array()), list(b.max.to_array()));
        }
        if self.orientation != Orientation::default() {
            let _ = writeln!(text, "\n[orientation]");
        }
        for (key, name) in self.orientation.names() {
            let _ = writeln!(text, "{key} = {}", string(name));
        }
        for unit in &self.units {
            let mut line = |key: &str, value: Value| {
                let _ = writeln!(text, "{key} = {value}");
            };
            line("\n[[unit]]\nname", string(&unit.name));
            line("file", path_string(&unit.file));
            if let Some(palette) = unit.palette {
                line("palette", list(palette.to_array().map(exact_f32)));
            }
            line("opacity", Value::Float(exact_f32(unit.opacity)));
            line("transform", list(row_major(&unit.transform)));
            if let Some(convention) = unit.convention {
                line("convention", string(convention_name(convention)));
            }
            if let Some(shading) = unit.shading {
                line("shading", string(shading_name(shading)));
            }
            if let Some(oriented) = unit.oriented_normals {
                line("oriented_normals", Value::Boolean(oriented));
            }
            if let Some(file) = &unit.transfer_function {
                line("transfer_function", path_string(file));
            }
            if let Some(values) = unit.values {
                line("values", list(values));
            }
        }
        text
    }

    /// Writes the file under a temporary name and renames it.
    ///
    /// # Errors
    /// [`SceneFileError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), SceneFileError> {
        staged_file::replace(path, self.to_text().as_bytes())
            .map_err(|source| SceneFileError::Write { path: path.to_path_buf(), source })
    }
}

impl UnitTable {
    fn check(self) -> Result<UnitEntry, (Range<usize>, String)> {
        let palette = match self.palette {
            None => None,
            Some(p) if p.get_ref().iter().all(|x| (0.0..=1.0).contains(x)) => {
                Some(Vec3::from_array(p.get_ref().map(|x| x as f32)))
            }
            Some(p) => return Err((p.span(), "a palette is three numbers from 0 to 1, [r, g, b]".to_owned())),
        };
        let opacity = match self.opacity {
            None => 1.0,
            Some(o) if *o.get_ref() >= 0.0 && (*o.get_ref() as f32).is_finite() => *o.get_ref() as f32,
            Some(o) => return Err((o.span(), "the opacity factor must be finite and at least 0".to_owned())),
        };
        let matrix = match self.transform {
            None => DMat4::IDENTITY,
            Some(t) => match transform(t.get_ref()) {
                Some(matrix) => matrix,
                None => {
                    let message =
                        "a transform is 16 finite numbers, row major, with last row 0 0 0 1, of an invertible map";
                    return Err((t.span(), message.to_owned()));
                }
            },
        };
        let values = match self.values {
            None => None,
            Some(v) if matches!(*v.get_ref(), [low, high] if low.is_finite() && high.is_finite() && low <= high) => {
                Some(v.into_inner())
            }
            Some(v) => return Err((v.span(), "the values are two finite numbers, the least first".to_owned())),
        };
        Ok(UnitEntry {
            name: self.name.into_inner(),
            file: self.file.into_inner(),
            palette,
            opacity,
            transform: matrix,
            convention: self.convention,
            shading: self.shading,
            oriented_normals: self.oriented_normals,
            transfer_function: self.transfer_function,
            values,
        })
    }
}

fn string(text: &str) -> Value {
    Value::String(text.to_owned())
}

/// Always with slashes, so that a scene folder can move between systems.
fn path_string(path: &Path) -> Value {
    let text = path.to_string_lossy();
    Value::String(if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() })
}

fn list<const N: usize>(numbers: [f64; N]) -> Value {
    Value::Array(numbers.into_iter().map(Value::Float).collect())
}

/// Line and column of a byte, both from 1, the column in characters.
fn place(text: &str, at: usize) -> (usize, usize) {
    let before = text.get(..at.min(text.len())).unwrap_or(text);
    let start = before.rfind('\n').map_or(0, |i| i + 1);
    (before.matches('\n').count() + 1, before.get(start..).unwrap_or_default().chars().count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<SceneFile, SceneFileError> {
        SceneFile::parse(text, Path::new("scene.toml"))
    }

    fn finite() -> impl Strategy<Value = f64> {
        any::<u64>().prop_map(f64::from_bits).prop_filter("finite", |x| x.is_finite())
    }

    proptest! {
        #[test]
        fn a_scene_file_reads_back_bit_for_bit(
            name in "[^\\x00]{1,12}",
            palette in proptest::array::uniform3(0.0_f32..=1.0),
            opacity in 0.0_f32..1e30,
            shift in proptest::array::uniform3(finite()),
            min in proptest::array::uniform3(-1e9_f64..0.0),
            oriented in proptest::option::of(any::<bool>()),
            convention in 0..4_usize,
            shading in 0..3_usize,
            directions in (0..3_usize, 0..4_usize, 0..7_usize),
        ) {
            prop_assume!(!name.trim().is_empty());
            let file = SceneFile {
                bounds: Some(SceneBox { min: DVec3::from_array(min), max: DVec3::from_array(min) + 1.0 }),
                orientation: Orientation {
                    patient: [None, Some(PatientFrame::Lps), Some(PatientFrame::Ras)][directions.0],
                    unit: [None, Some(LengthUnit::Metre), Some(LengthUnit::Millimetre), Some(LengthUnit::Micrometre)]
                        [directions.1],
                    up: Axis::ALL.get(directions.2).copied(),
                },
                units: vec![UnitEntry {
                    name: name.clone(),
                    file: format!("sub/{}.ply", name.replace('/', "_")).into(),
                    palette: Some(palette.into()),
                    opacity,
                    transform: DMat4::from_translation(DVec3::from_array(shift)),
                    convention: [None, Some(Convention::Legacy), Some(Convention::HeadRaw), Some(Convention::HeadActivated)][convention],
                    shading: [None, Some(ShadingModel::IvrgsTrain), Some(ShadingModel::IvrgsViewer)][shading],
                    oriented_normals: oriented,
                    transfer_function: oriented.map(|_| "tf.json".into()),
                    values: oriented.map(|_| [shift[0] - 1.0, shift[0]]),
                }],
            };
            prop_assert_eq!(parse(&file.to_text()).unwrap(), file);
        }
    }

    #[test]
    fn a_short_file_has_defaults() {
        let file =
            parse("schema = 1\n[[unit]]\nname = \"bone\"\nfile = \"bone.ply\"\npalette = [1, 0, 0.5]\n").unwrap();
        let unit = &file.units[0];
        assert_eq!((file.bounds, file.orientation), (None, Orientation::default()));
        assert_eq!((unit.opacity, unit.transform), (1.0, DMat4::IDENTITY));
        assert_eq!(unit.palette, Some(Vec3::new(1.0, 0.0, 0.5)));
        assert_eq!((unit.convention, unit.shading, unit.oriented_normals), (None, None, None));
    }

    #[test]
    fn errors_name_line_and_column() {
        let unit = "[[unit]]\nname = \"a\"\nfile = \"a.ply\"\n";
        let table = [
            (format!("schema = 1\n{unit}colour = [1, 0, 0]\n"), 5, 1, "unknown field `colour`"),
            (format!("schema = 1\nbox2 = 1\n{unit}"), 2, 1, "unknown field `box2`"),
            (format!("schema = 2\n{unit}"), 1, 10, "schema 2"),
            (format!("schema = 1\n{unit}{unit}"), 6, 8, "second unit"),
            (format!("schema = 1\n{unit}palette = [1.5, 0.0, 0.0]\n"), 5, 11, "from 0 to 1"),
            (format!("schema = 1\n{unit}palette = [1.0, 0.0]\n"), 5, 11, "length 2"),
            (format!("schema = 1\n{unit}opacity = -1.0\n"), 5, 11, "at least 0"),
            (format!("schema = 1\n{unit}opacity = nan\n"), 5, 11, "at least 0"),
            (format!("schema = 1\n{unit}transform = [1.0, 2.0]\n"), 5, 13, "16 finite numbers"),
            (format!("schema = 1\n{unit}convention = \"theirs\"\n"), 5, 14, "theirs"),
            (format!("schema = 1\n{unit}values = [2.0, 1.0]\n"), 5, 10, "the least first"),
            (format!("schema = 1\n{unit}[box]\nmin = [0, 0, 0]\nmax = [-1, 0, 0]\n"), 5, 1, "min not above max"),
            (format!("schema = 1\n{unit}[orientation]\npatient = \"LAS\"\n"), 6, 11, "LPS or RAS"),
            (format!("schema = 1\n{unit}[orientation]\nunit = \"inch\"\n"), 6, 8, "m, mm or um"),
            (format!("schema = 1\n{unit}[orientation]\nup = \"Z\"\n"), 6, 6, "give +X"),
            ("schema = 1\n".to_owned(), 2, 1, "no [[unit]]"),
            ("schema = 1\n[[unit]]\nname = \"a\"\n".to_owned(), 2, 1, "missing field `file`"),
            ("schema = \n".to_owned(), 1, 10, ""),
        ];
        for (text, line, column, want) in table {
            match parse(&text).unwrap_err() {
                SceneFileError::Content { line: l, column: c, message, .. } => {
                    assert_eq!((l, c), (line, column), "{text}: {message}");
                    assert!(message.contains(want) && !message.contains('\n'), "{message} should say {want}");
                }
                other => panic!("{other}"),
            }
        }
    }
}
