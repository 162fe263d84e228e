//! VTK unstructured grids (`.vtu`): <https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html#unstructuredgrid>.
//!
//! Pieces of a file become one mesh. The file may be packed as a whole by gzip or Zstandard.

use crate::mesh::Mesh;
use crate::scalars::Scalars;

use super::error::ReadError;
use super::format::VolumeFormat;
use super::mesh_data::{Cells, Quantity, choose, part_of, point_numbers, positions};
use super::source::Source;
use super::vtk_xml::{self, Document, Section};

const REMEDY: &str = "repair the file, or write it again";

/// VTK unstructured grids.
pub(super) struct VtkUnstructuredGrid;

impl VolumeFormat for VtkUnstructuredGrid {
    type Data = Mesh;

    const NAME: &'static str = "VTK unstructured grid";
    const ENDINGS: &'static [&'static str] = &[".vtu", ".vtu.gz", ".vtu.zst"];
    const HAS_VARIABLES: bool = true;

    fn sniff(_name: &str, first: &[u8]) -> bool {
        vtk_xml::sniff(first, "UnstructuredGrid")
    }

    fn read(source: Source<'_>) -> Result<Mesh, ReadError> {
        let bytes = source.unpacked()?;
        let document = Document::parse(source, &bytes, "UnstructuredGrid")?;
        let file = File { source, bytes: &bytes, document: &document };
        // The first piece with cells tells the quantities; all others have the same.
        let pieces = 0..document.pieces.len();
        let mut filled = Vec::new();
        for piece in pieces {
            let [points, cells] = file.counts(piece)?;
            if points > 0 && cells > 0 {
                filled.push(piece);
            }
        }
        let quantities = file.quantities(filled.first().copied().unwrap_or(0));
        let active = [document.point_scalars.as_deref(), document.cell_scalars.as_deref()];
        let choice = choose(source, &quantities, active)?;
        let quantity = quantities.get(choice.quantity).cloned();
        let quantity = quantity.ok_or_else(|| source.format("PointData", "no quantity", REMEDY))?;
        let mut cells = Cells::default();
        let mut values: Option<Scalars> = None;
        let mut decoded = 0_u64;
        for piece in filled {
            let [points, cells_of_piece] = file.counts(piece)?;
            let entries = if quantity.of_cells { cells_of_piece } else { points };
            let own = file.cells(piece)?;
            // Several pieces may name the same bytes, so that a small file could fill any memory.
            let bytes = own.points.len() * size_of::<[f64; 3]>() + own.connectivity.len() * 4 + own.ends.len() * 9;
            decoded = decoded.saturating_add(bytes as u64);
            source.check_expanded(decoded, file.bytes.len() as u64)?;
            let section = if quantity.of_cells { Section::CellData } else { Section::PointData };
            let numbers = file.array(piece, section, Some(&quantity.name), entries, quantity.components)?;
            let part = part_of(numbers, quantity.components, choice.part);
            values = Some(match values {
                None => part,
                Some(before) => before.joined(part).ok_or_else(|| {
                    source.format(format!("quantity `{}`", quantity.name), "its type differs between pieces", REMEDY)
                })?,
            });
            cells.append(source, own)?;
        }
        let values = values.ok_or_else(|| source.format("Piece", "no point or no cell", REMEDY))?;
        cells.mesh(source, values, quantity.of_cells, quantity.name)
    }
}

/// A parsed file.
struct File<'a> {
    source: Source<'a>,
    bytes: &'a [u8],
    document: &'a Document,
}

impl File<'_> {
    fn quantities(&self, piece: usize) -> Vec<Quantity> {
        let of = self
            .document
            .arrays_of(piece)
            .iter()
            .filter(|a| matches!(a.section, Section::PointData | Section::CellData));
        of.map(vtk_xml::Array::quantity).collect()
    }

    /// Numbers of points and of cells of a piece.
    fn counts(&self, piece: usize) -> Result<[usize; 2], ReadError> {
        let Some(attributes) = self.document.pieces.get(piece) else { return Ok([0; 2]) };
        let count = |key| attributes.count(self.source, key);
        Ok([count("NumberOfPoints")?, count("NumberOfCells")?])
    }

    /// The points and cells of a piece.
    fn cells(&self, piece: usize) -> Result<Cells, ReadError> {
        let [point_count, cell_count] = self.counts(piece)?;
        let points = positions(&self.array(piece, Section::Points, None, point_count, 3)?);
        let ends = self.indices(piece, "offsets", cell_count)?;
        let length = ends.last().copied().unwrap_or(0);
        // The array itself is checked against the bytes of the file before memory is taken.
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        let connectivity = point_numbers(self.source, self.indices(piece, "connectivity", length)?, point_count)?;
        let kinds = self.indices(piece, "types", cell_count)?;
        let kinds = kinds.into_iter().map(|kind| u8::try_from(kind).unwrap_or(u8::MAX)).collect();
        Ok(Cells { points, connectivity, ends, kinds })
    }

    fn indices(&self, piece: usize, name: &str, count: usize) -> Result<Vec<u64>, ReadError> {
        let values = self.array(piece, Section::Cells, Some(name), count, 1)?;
        values.indices().map_err(|(at, value)| {
            self.source.format(format!("DataArray `{name}`"), format!("entry {at} is {value}"), REMEDY)
        })
    }

    /// An array of a piece: the one of this name, or the only one.
    fn array(
        &self,
        piece: usize,
        section: Section,
        name: Option<&str>,
        entries: usize,
        components: usize,
    ) -> Result<Scalars, ReadError> {
        let mut of = self.document.arrays_of(piece).iter().filter(|a| a.section == section);
        let found = of.find(|a| name.is_none_or(|name| a.name == name));
        let array = found.ok_or_else(|| {
            let what = format!("no array `{}`", name.unwrap_or("Points"));
            self.source.format(format!("piece {piece}"), what, REMEDY)
        })?;
        if array.components != components {
            let what = format!("{} components in place of {components}", array.components);
            return Err(self.source.format(format!("DataArray `{}`", array.name), what, REMEDY));
        }
        array.scalars(self.source, self.bytes, self.document, [components, entries, 1])
    }
}
