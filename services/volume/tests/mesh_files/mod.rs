//! Writers of VTK's files for tests: one model in every layout.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot be set up fails")]
#![allow(dead_code, reason = "each test uses a part")]

pub(crate) mod model;

use std::fmt::Write as _;
use std::io::Write as _;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use sg_volume::ScalarType;

/// Values of points or cells.
#[derive(Debug, Clone)]
pub(crate) struct Array {
    pub(crate) name: String,
    pub(crate) components: usize,
    pub(crate) scalar: ScalarType,
    pub(crate) values: Vec<f64>,
}

impl Array {
    pub(crate) fn new(name: &str, components: usize, scalar: ScalarType, values: Vec<f64>) -> Self {
        Self { name: name.to_owned(), components, scalar, values }
    }

    fn entries(&self) -> usize {
        self.values.len() / self.components
    }
}

/// An unstructured grid with quantities.
#[derive(Debug, Clone, Default)]
pub(crate) struct Model {
    pub(crate) points: Vec<f64>,
    pub(crate) cells: Vec<(u8, Vec<u32>)>,
    pub(crate) point_data: Vec<Array>,
    pub(crate) cell_data: Vec<Array>,
}

impl Model {
    fn offsets(&self) -> Vec<f64> {
        let ends = self.cells.iter().scan(0, |end, (_, points)| {
            *end += points.len();
            Some(*end as f64)
        });
        ends.collect()
    }

    fn connectivity(&self) -> Vec<f64> {
        self.cells.iter().flat_map(|(_, points)| points).map(|&point| f64::from(point)).collect()
    }

    fn kinds(&self) -> Vec<f64> {
        self.cells.iter().map(|(kind, _)| f64::from(*kind)).collect()
    }
}

/// The numbers as bytes of a type.
pub(crate) fn encoded(values: &[f64], scalar: ScalarType, big: bool) -> Vec<u8> {
    let one = |value: f64| {
        let mut bytes = match scalar {
            ScalarType::U8 => (value as u8).to_le_bytes().to_vec(),
            ScalarType::I8 => (value as i8).to_le_bytes().to_vec(),
            ScalarType::U16 => (value as u16).to_le_bytes().to_vec(),
            ScalarType::I16 => (value as i16).to_le_bytes().to_vec(),
            ScalarType::U32 => (value as u32).to_le_bytes().to_vec(),
            ScalarType::I32 => (value as i32).to_le_bytes().to_vec(),
            ScalarType::U64 => (value as u64).to_le_bytes().to_vec(),
            ScalarType::I64 => (value as i64).to_le_bytes().to_vec(),
            ScalarType::F32 => (value as f32).to_le_bytes().to_vec(),
            ScalarType::F64 => value.to_le_bytes().to_vec(),
        };
        if big {
            bytes.reverse();
        }
        bytes
    };
    values.iter().flat_map(|&value| one(value)).collect()
}

/// The numbers as text, a few on each line.
pub(crate) fn text(values: &[f64]) -> String {
    let mut out = String::new();
    for (i, value) in values.iter().enumerate() {
        let end = if i % 7 == 6 { '\n' } else { ' ' };
        let _ = write!(out, "{value}{end}");
    }
    out
}

pub(crate) fn gzip(data: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

fn zlib(data: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

/// Where a `.vtu` file has its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    Ascii,
    Binary,
    Raw,
    Base64,
}

/// How a `.vtu` file is written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct XmlLayout {
    pub(crate) place: Place,
    pub(crate) zlib: bool,
    pub(crate) wide: bool,
    pub(crate) big: bool,
}

impl XmlLayout {
    pub(crate) const ASCII: Self = Self { place: Place::Ascii, zlib: false, wide: false, big: false };

    pub(crate) fn all() -> Vec<Self> {
        let places = [Place::Binary, Place::Raw, Place::Base64];
        let layouts = (0..24).map(|k| Self {
            place: places[k % 3],
            zlib: k / 3 % 2 == 1,
            wide: k / 6 % 2 == 1,
            big: k / 12 == 1,
        });
        std::iter::once(Self::ASCII).chain(layouts).collect()
    }

    /// A header and data, which base64 pads one by one.
    fn packed(self, bytes: &[u8]) -> [Vec<u8>; 2] {
        let numbers = |values: &[usize]| {
            let scalar = if self.wide { ScalarType::U64 } else { ScalarType::U32 };
            encoded(&values.iter().map(|&v| v as f64).collect::<Vec<_>>(), scalar, self.big)
        };
        if !self.zlib {
            return [numbers(&[bytes.len()]), bytes.to_vec()];
        }
        const BLOCK: usize = 64;
        let blocks: Vec<Vec<u8>> = bytes.chunks(BLOCK).map(zlib).collect();
        let mut head = vec![blocks.len(), BLOCK, bytes.len() % BLOCK];
        head.extend(blocks.iter().map(Vec::len));
        [numbers(&head), blocks.concat()]
    }
}

struct XmlWriter {
    layout: XmlLayout,
    xml: String,
    appended: Vec<u8>,
}

impl XmlWriter {
    fn array(&mut self, array: &Array) {
        let Array { name, components, scalar, values } = array;
        let kind = scalar.vtk_name();
        let _ = write!(self.xml, "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" ");
        let parts = self.layout.packed(&encoded(values, *scalar, self.layout.big));
        let base64 = parts.each_ref().map(|part| STANDARD.encode(part)).concat();
        let offset = self.appended.len();
        match self.layout.place {
            Place::Ascii => _ = write!(self.xml, "format=\"ascii\">\n{}\n</DataArray>\n", text(values)),
            Place::Binary => _ = write!(self.xml, "format=\"binary\">\n{base64}\n</DataArray>\n"),
            Place::Raw => {
                let _ = writeln!(self.xml, "format=\"appended\" offset=\"{offset}\"/>");
                self.appended.extend(parts.concat());
            }
            Place::Base64 => {
                let _ = writeln!(self.xml, "format=\"appended\" offset=\"{offset}\"/>");
                self.appended.extend(base64.as_bytes());
            }
        }
    }

    fn section(&mut self, name: &str, attributes: &str, arrays: &[Array]) {
        let _ = writeln!(self.xml, "<{name}{attributes}>");
        arrays.iter().for_each(|array| self.array(array));
        let _ = writeln!(self.xml, "</{name}>");
    }
}

/// The bytes of a `.vtu` file with these pieces. `active` is the name of the active scalars of the points.
pub(crate) fn vtu(pieces: &[Model], layout: XmlLayout, active: Option<&str>) -> Vec<u8> {
    let order = if layout.big { "BigEndian" } else { "LittleEndian" };
    let header = if layout.wide { "UInt64" } else { "UInt32" };
    let compressor = if layout.zlib { " compressor=\"vtkZLibDataCompressor\"" } else { "" };
    let xml = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"{order}\" \
         header_type=\"{header}\"{compressor}>\n<UnstructuredGrid>\n"
    );
    let mut writer = XmlWriter { layout, xml, appended: Vec::new() };
    for piece in pieces {
        let (points, cells) = (piece.points.len() / 3, piece.cells.len());
        let _ = writeln!(writer.xml, "<Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{cells}\">");
        let scalars = active.map(|name| format!(" Scalars=\"{name}\"")).unwrap_or_default();
        writer.section("PointData", &scalars, &piece.point_data);
        writer.section("CellData", "", &piece.cell_data);
        writer.section("Points", "", &[Array::new("Points", 3, ScalarType::F64, piece.points.clone())]);
        let own = [
            Array::new("connectivity", 1, ScalarType::I64, piece.connectivity()),
            Array::new("offsets", 1, ScalarType::I32, piece.offsets()),
            Array::new("types", 1, ScalarType::U8, piece.kinds()),
        ];
        writer.section("Cells", "", &own);
        writer.xml.push_str("</Piece>\n");
    }
    writer.xml.push_str("</UnstructuredGrid>\n");
    let mut bytes = writer.xml.into_bytes();
    if matches!(layout.place, Place::Raw | Place::Base64) {
        let encoding = if layout.place == Place::Raw { "raw" } else { "base64" };
        bytes.extend(format!("<AppendedData encoding=\"{encoding}\">\n_").bytes());
        bytes.extend(writer.appended);
        bytes.extend(b"\n</AppendedData>\n");
    }
    bytes.extend(b"</VTKFile>\n");
    bytes
}

/// How a legacy file is written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Legacy {
    pub(crate) binary: bool,
    /// The layout of cells as from version 5.
    pub(crate) offsets: bool,
    /// With the line ends of Windows.
    pub(crate) crlf: bool,
}

impl Legacy {
    pub(crate) const ASCII: Self = Self { binary: false, offsets: false, crlf: false };

    pub(crate) fn all() -> Vec<Self> {
        (0..8).map(|k| Self { binary: k % 2 == 1, offsets: k / 2 % 2 == 1, crlf: k / 4 == 1 }).collect()
    }
}

/// The name of a type in legacy files.
pub(crate) fn legacy_name(scalar: ScalarType) -> &'static str {
    match scalar {
        ScalarType::U8 => "unsigned_char",
        ScalarType::I8 => "char",
        ScalarType::U16 => "unsigned_short",
        ScalarType::I16 => "short",
        ScalarType::U32 => "unsigned_int",
        ScalarType::I32 => "int",
        ScalarType::U64 => "vtktypeuint64",
        ScalarType::I64 => "vtktypeint64",
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
    }
}

/// A legacy file line by line.
pub(crate) struct LegacyWriter {
    layout: Legacy,
    pub(crate) bytes: Vec<u8>,
}

impl LegacyWriter {
    pub(crate) fn new(layout: Legacy) -> Self {
        let mut writer = Self { layout, bytes: Vec::new() };
        writer.line(if layout.offsets { "# vtk DataFile Version 5.1" } else { "# vtk DataFile Version 3.0" });
        writer.line("a title; with BINARY and ASCII in it");
        writer.line(if layout.binary { "BINARY" } else { "ASCII" });
        writer
    }

    pub(crate) fn line(&mut self, line: &str) {
        self.bytes.extend(line.bytes());
        self.bytes.extend(if self.layout.crlf { "\r\n" } else { "\n" }.bytes());
    }

    pub(crate) fn numbers(&mut self, values: &[f64], scalar: ScalarType) {
        if self.layout.binary {
            self.bytes.extend(encoded(values, scalar, true));
            self.line("");
        } else {
            text(values).lines().for_each(|line| self.line(line));
        }
    }

    pub(crate) fn points(&mut self, points: &[f64]) {
        self.line(&format!("POINTS {} double", points.len() / 3));
        self.numbers(points, ScalarType::F64);
        self.line("METADATA\nINFORMATION 0\n");
    }

    pub(crate) fn cells(&mut self, model: &Model) {
        let (count, connectivity) = (model.cells.len(), model.connectivity());
        if self.layout.offsets {
            self.line(&format!("CELLS {} {}", count + 1, connectivity.len()));
            self.line("OFFSETS vtktypeint64");
            let offsets: Vec<f64> = std::iter::once(0.0).chain(model.offsets()).collect();
            self.numbers(&offsets, ScalarType::I64);
            self.line("CONNECTIVITY vtktypeint64");
            self.numbers(&connectivity, ScalarType::I64);
        } else {
            self.line(&format!("CELLS {count} {}", count + connectivity.len()));
            let own = |points: &[u32]| -> Vec<f64> {
                std::iter::once(points.len() as f64).chain(points.iter().map(|&p| f64::from(p))).collect()
            };
            let all: Vec<f64> = model.cells.iter().flat_map(|(_, points)| own(points)).collect();
            self.numbers(&all, ScalarType::I32);
        }
        self.line(&format!("CELL_TYPES {count}"));
        self.numbers(&model.kinds(), ScalarType::I32);
    }

    /// Arrays as SCALARS, VECTORS and the arrays of a FIELD in turn.
    pub(crate) fn data(&mut self, keyword: &str, arrays: &[Array]) {
        let Some(first) = arrays.first() else { return };
        self.line(&format!("{keyword} {}", first.entries()));
        for (i, array) in arrays.iter().enumerate() {
            let (kind, name) = (legacy_name(array.scalar), array.name.replace(' ', "%20"));
            match array.components {
                1 if i % 3 == 0 => {
                    self.line(&format!("SCALARS {name} {kind}"));
                    self.line("LOOKUP_TABLE default");
                }
                3 if i % 2 == 1 => self.line(&format!("VECTORS {name} {kind}")),
                n => {
                    self.line("FIELD FieldData 1");
                    self.line(&format!("{name} {n} {} {kind}", array.entries()));
                }
            }
            self.numbers(&array.values, array.scalar);
        }
    }
}

/// The bytes of a legacy file with an unstructured grid.
pub(crate) fn legacy(model: &Model, layout: Legacy) -> Vec<u8> {
    let mut writer = LegacyWriter::new(layout);
    writer.line("DATASET UNSTRUCTURED_GRID");
    writer.points(&model.points);
    writer.cells(model);
    writer.data("CELL_DATA", &model.cell_data);
    writer.data("POINT_DATA", &model.point_data);
    writer.bytes
}
