//! The keywords of a legacy VTK file: its geometry and its arrays, not yet decoded.

use glam::DVec3;

use super::cursor::{Block, Cursor, Kind, REMEDY, shown};
use crate::read::error::ReadError;
use crate::read::mesh_data::Quantity;
use crate::read::source::Source;
use crate::scalars::ScalarType;

/// A kind of geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Geometry {
    StructuredPoints,
    StructuredGrid,
    RectilinearGrid,
    UnstructuredGrid,
}

/// The cells of an unstructured grid.
pub(super) enum CellBlocks {
    /// The number of points before the points of each cell, as up to version 4.
    Counted { cells: usize, numbers: Block },
    /// Ends of the cells in an array of all their points, as from version 5.
    Offsets { offsets: Block, connectivity: Block },
}

/// A quantity of the points or cells.
pub(super) struct Array {
    pub(super) quantity: Quantity,
    pub(super) numbers: Block,
}

/// All that a file holds, not yet decoded.
#[derive(Default)]
pub(super) struct Content {
    pub(super) geometry: Option<Geometry>,
    pub(super) dims: Option<[usize; 3]>,
    pub(super) origin: Option<DVec3>,
    pub(super) spacing: Option<DVec3>,
    pub(super) points: Option<Block>,
    /// Places along x, y and z of a rectilinear grid.
    pub(super) coordinates: [Option<Block>; 3],
    pub(super) cells: Option<CellBlocks>,
    pub(super) types: Option<Block>,
    pub(super) arrays: Vec<Array>,
    /// Names of the first scalars of the points and of the cells.
    pub(super) active: [Option<String>; 2],
}

/// Values of the points or of the cells follow.
struct Section {
    of_cells: bool,
    entries: usize,
}

impl Content {
    /// Parses a file. The cursor stays valid for the blocks.
    pub(super) fn parse<'a>(source: Source<'a>, bytes: &'a [u8]) -> Result<(Cursor<'a>, Self), ReadError> {
        let mut cursor = Cursor::new(source, bytes);
        header(&mut cursor)?;
        let mut content = Self::default();
        let mut section = None;
        loop {
            cursor.skip_spaces();
            let before = cursor;
            let Some(word) = cursor.word() else { break };
            let keyword =
                String::from_utf8_lossy(word.get(..word.len().min(60)).unwrap_or_default()).to_ascii_uppercase();
            let keyword = keyword.as_str();
            let is_known = match &section {
                _ if keyword == "METADATA" => {
                    cursor.line();
                    cursor.skip_paragraph();
                    true
                }
                _ if matches!(keyword, "POINT_DATA" | "CELL_DATA") => {
                    section = Some(Section { of_cells: keyword == "CELL_DATA", entries: cursor.count(keyword)? });
                    true
                }
                Some(section) => content.attribute(&mut cursor, keyword, section)?,
                None => content.part(&mut cursor, keyword)?,
            };
            if !is_known {
                return Err(before.wrong(format!("`{}` is no keyword that can stand here", shown(word))));
            }
        }
        Ok((cursor, content))
    }

    /// Takes the geometry after a keyword; false if there is no such keyword.
    fn part(&mut self, cursor: &mut Cursor<'_>, keyword: &str) -> Result<bool, ReadError> {
        match keyword {
            "DATASET" => self.geometry = Some(geometry(cursor)?),
            "FIELD" => {
                fields(cursor, |_, _| {})?;
            }
            "DIMENSIONS" => {
                self.dims = Some([cursor.count(keyword)?, cursor.count(keyword)?, cursor.count(keyword)?]);
            }
            "ORIGIN" => self.origin = Some(triple(cursor, keyword)?),
            "SPACING" | "ASPECT_RATIO" => self.spacing = Some(triple(cursor, keyword)?),
            "POINTS" => self.points = Some(typed_block(cursor, keyword, 3)?),
            "X_COORDINATES" | "Y_COORDINATES" | "Z_COORDINATES" => {
                let axis = ["X_COORDINATES", "Y_COORDINATES", "Z_COORDINATES"].iter().position(|k| *k == keyword);
                let block = typed_block(cursor, keyword, 1)?;
                if let Some(own) = axis.and_then(|axis| self.coordinates.get_mut(axis)) {
                    *own = Some(block);
                }
            }
            "CELLS" => self.cells = Some(cells(cursor)?),
            "CELL_TYPES" => {
                let entries = cursor.count(keyword)?;
                self.types = Some(cursor.block(keyword.to_owned(), Kind::Number(ScalarType::I32), entries, 1)?);
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Takes the array after a keyword; false if there is no such keyword.
    fn attribute(&mut self, cursor: &mut Cursor<'_>, keyword: &str, section: &Section) -> Result<bool, ReadError> {
        let of_cells = section.of_cells;
        if keyword == "FIELD" {
            fields(cursor, |name, numbers| {
                let quantity = Quantity { name, components: numbers.components, of_cells };
                self.arrays.push(Array { quantity, numbers });
            })?;
            return Ok(true);
        }
        if keyword == "LOOKUP_TABLE" {
            cursor.name(keyword)?;
            let colours = cursor.count(keyword)?;
            cursor.block(keyword.to_owned(), colour_kind(cursor), colours, 4)?;
            return Ok(true);
        }
        let name = cursor.name(keyword);
        let (kind, components) = match keyword {
            "SCALARS" => {
                let active = self.active.get_mut(usize::from(of_cells)).filter(|active| active.is_none());
                if let (Some(active), Ok(name)) = (active, &name) {
                    *active = Some(name.clone());
                }
                scalars_head(cursor)?
            }
            "COLOR_SCALARS" => (colour_kind(cursor), cursor.count(keyword)?),
            "VECTORS" | "NORMALS" => (cursor.kind(keyword)?, 3),
            "TENSORS" => (cursor.kind(keyword)?, 9),
            "TENSORS6" => (cursor.kind(keyword)?, 6),
            "TEXTURE_COORDINATES" => {
                let components = cursor.count(keyword)?;
                (cursor.kind(keyword)?, components)
            }
            "GLOBAL_IDS" | "PEDIGREE_IDS" | "EDGE_FLAGS" => (cursor.kind(keyword)?, 1),
            _ => return Ok(false),
        };
        let name = name?;
        let numbers = cursor.block(format!("{keyword} `{name}`"), kind, section.entries, components)?;
        if kind != Kind::Texts {
            self.arrays.push(Array { quantity: Quantity { name, components, of_cells }, numbers });
        }
        Ok(true)
    }
}

/// Reads the first three lines.
fn header(cursor: &mut Cursor<'_>) -> Result<(), ReadError> {
    let source = cursor.source;
    let first = String::from_utf8_lossy(cursor.line()).to_ascii_lowercase();
    let Some(version) = first.trim().strip_prefix("# vtk datafile version").map(str::trim) else {
        return Err(source.format("line 1", "no `# vtk DataFile Version`", "give a legacy VTK file"));
    };
    let major = version.split('.').next().and_then(|major| major.parse::<u32>().ok());
    if !major.is_some_and(|major| (1..=5).contains(&major)) {
        let what = format!("version `{}`", shown(version.as_bytes()));
        return Err(source.format("line 1", what, "write the file in version 5.1 or before"));
    }
    cursor.line();
    if cursor.takes("BINARY") {
        cursor.is_binary = true;
        return Ok(());
    }
    if cursor.takes("ASCII") {
        return Ok(());
    }
    Err(source.format("line 3", "neither ASCII nor BINARY", REMEDY))
}

fn geometry(cursor: &mut Cursor<'_>) -> Result<Geometry, ReadError> {
    let name = cursor.name("DATASET")?.to_ascii_uppercase();
    let refused = |what: String, remedy| Err(cursor.source.format("DATASET", what, remedy));
    match name.as_str() {
        "STRUCTURED_POINTS" => Ok(Geometry::StructuredPoints),
        "STRUCTURED_GRID" => Ok(Geometry::StructuredGrid),
        "RECTILINEAR_GRID" => Ok(Geometry::RectilinearGrid),
        "UNSTRUCTURED_GRID" => Ok(Geometry::UnstructuredGrid),
        "POLYDATA" => refused(
            "POLYDATA holds surfaces, lines and points, and no cells with a volume".to_owned(),
            "fill it with cells in ParaView (filter Delaunay 3D) and save it as .vtu",
        ),
        other => refused(
            format!("`{}` is no grid", shown(other.as_bytes())),
            "give STRUCTURED_POINTS, STRUCTURED_GRID, RECTILINEAR_GRID or UNSTRUCTURED_GRID",
        ),
    }
}

fn triple(cursor: &mut Cursor<'_>, keyword: &str) -> Result<DVec3, ReadError> {
    Ok(DVec3::new(cursor.number(keyword)?, cursor.number(keyword)?, cursor.number(keyword)?))
}

/// A block after `keyword n type`.
fn typed_block(cursor: &mut Cursor<'_>, keyword: &str, components: usize) -> Result<Block, ReadError> {
    let entries = cursor.count(keyword)?;
    let kind = cursor.kind(keyword)?;
    cursor.block(keyword.to_owned(), kind, entries, components)
}

/// The cells of an unstructured grid. The word after the sizes tells the layout, whatever the version is.
fn cells(cursor: &mut Cursor<'_>) -> Result<CellBlocks, ReadError> {
    let (first, second) = (cursor.count("CELLS")?, cursor.count("CELLS")?);
    if !cursor.takes("OFFSETS") {
        let kind = Kind::Number(if cursor.is_binary { ScalarType::I32 } else { ScalarType::I64 });
        let numbers = cursor.block("CELLS".to_owned(), kind, second, 1)?;
        return Ok(CellBlocks::Counted { cells: first, numbers });
    }
    let kind = cursor.kind("OFFSETS")?;
    let offsets = cursor.block("OFFSETS".to_owned(), kind, first, 1)?;
    if !cursor.takes("CONNECTIVITY") {
        return Err(cursor.source.format("CELLS", "no CONNECTIVITY after the OFFSETS", REMEDY));
    }
    let kind = cursor.kind("CONNECTIVITY")?;
    let connectivity = cursor.block("CONNECTIVITY".to_owned(), kind, second, 1)?;
    Ok(CellBlocks::Offsets { offsets, connectivity })
}

/// The type and components of `SCALARS`, up to its values. The line of its lookup table may be absent.
fn scalars_head(cursor: &mut Cursor<'_>) -> Result<(Kind, usize), ReadError> {
    let kind = cursor.kind("SCALARS")?;
    let before = *cursor;
    let components = match cursor.rest_of_line().trim_ascii() {
        b"" => 1,
        _ => {
            *cursor = before;
            cursor.count("SCALARS")?
        }
    };
    if cursor.takes("LOOKUP_TABLE") {
        cursor.name("LOOKUP_TABLE")?;
    }
    Ok((kind, components))
}

/// The type of colours: bytes, or numbers from 0 to 1 in text.
fn colour_kind(cursor: &Cursor<'_>) -> Kind {
    Kind::Number(if cursor.is_binary { ScalarType::U8 } else { ScalarType::F32 })
}

/// The arrays after `FIELD`. Those of texts are skipped.
fn fields(cursor: &mut Cursor<'_>, mut found: impl FnMut(String, Block)) -> Result<(), ReadError> {
    cursor.name("FIELD")?;
    let arrays = cursor.count("FIELD")?;
    for _ in 0..arrays {
        while cursor.takes("METADATA") {
            cursor.line();
            cursor.skip_paragraph();
        }
        if cursor.takes("NULL_ARRAY") {
            continue;
        }
        let name = cursor.name("FIELD")?;
        let (components, entries) = (cursor.count("FIELD")?, cursor.count("FIELD")?);
        let kind = cursor.kind("FIELD")?;
        let block = cursor.block(format!("FIELD array `{name}`"), kind, entries, components)?;
        if kind != Kind::Texts {
            found(name, block);
        }
    }
    Ok(())
}
