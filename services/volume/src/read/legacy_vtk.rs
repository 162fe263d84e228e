//! Legacy VTK files (`.vtk`): <https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html#simple-legacy-formats>.
//!
//! Structured points become a volume. All other grids become a mesh of the tetrahedra of their cells. The file is read once
//! without decoding its numbers; then those of the geometry and of the chosen quantity are decoded. The file may be packed as
//! a whole by gzip or Zstandard.

mod content;
mod cursor;

use glam::{DMat3, DVec3};

use crate::dataset::Dataset;
use crate::grid::Grid;
use crate::scalars::Scalars;
use crate::volume::Volume;

use super::error::ReadError;
use super::format::VolumeFormat;
use super::mesh_data::{Cells, choose, part_of, point_numbers, positions};
use super::source::Source;

use content::{Array, CellBlocks, Content, Geometry};
use cursor::{Block, Cursor, REMEDY};

/// VTK's type number of a hexahedron.
const HEXAHEDRON: u8 = 12;

/// Legacy VTK files.
pub(super) struct LegacyVtk;

impl VolumeFormat for LegacyVtk {
    type Data = Dataset;

    const NAME: &'static str = "legacy VTK";
    const ENDINGS: &'static [&'static str] = &[".vtk", ".vtk.gz", ".vtk.zst"];
    const HAS_VARIABLES: bool = true;

    fn sniff(_name: &str, first: &[u8]) -> bool {
        first.starts_with(b"# vtk DataFile")
    }

    fn read(source: Source<'_>) -> Result<Dataset, ReadError> {
        let bytes = source.unpacked()?;
        let (cursor, content) = Content::parse(source, &bytes)?;
        let geometry = content.geometry.ok_or_else(|| source.format("DATASET", "there is none", REMEDY))?;
        let quantities: Vec<_> = content.arrays.iter().map(|array| array.quantity.clone()).collect();
        let [of_points, of_cells] = content.active.each_ref().map(Option::as_deref);
        let choice = choose(source, &quantities, [of_points, of_cells])?;
        let array = content.arrays.get(choice.quantity);
        let array = array.ok_or_else(|| source.format("POINT_DATA", "no quantity", REMEDY))?;
        let file = File { source, cursor, content: &content };
        let values = || Ok(part_of(cursor.numbers(&array.numbers)?, array.quantity.components, choice.part));
        match geometry {
            Geometry::StructuredPoints => file.volume(array, values),
            Geometry::UnstructuredGrid => file.mesh(array, file.unstructured(array)?, values),
            Geometry::StructuredGrid => file.mesh(array, file.structured(array)?, values),
            Geometry::RectilinearGrid => file.mesh(array, file.rectilinear(array)?, values),
        }
    }
}

/// A parsed file.
#[derive(Clone, Copy)]
struct File<'a> {
    source: Source<'a>,
    cursor: Cursor<'a>,
    content: &'a Content,
}

impl File<'_> {
    fn volume(self, array: &Array, values: impl FnOnce() -> Result<Scalars, ReadError>) -> Result<Dataset, ReadError> {
        let (source, quantity) = (self.source, &array.quantity);
        let points = self.dims()?;
        let dims = if quantity.of_cells { points.map(|n| n.saturating_sub(1)) } else { points };
        // Values of cells are in the middle between points.
        let first = DVec3::splat(if quantity.of_cells { 0.5 } else { 0.0 });
        let spacing = self.content.spacing.unwrap_or(DVec3::ONE);
        let origin = self.content.origin.unwrap_or_default() + spacing * first;
        let grid = Grid::new(dims, spacing, origin, DMat3::IDENTITY).map_err(|e| source.grid(e))?;
        self.check_entries(array, product(dims))?;
        let name = Some(quantity.name.clone()).filter(|name| !name.is_empty());
        let volume = Volume::new(grid, values()?, name);
        volume.map(Dataset::Volume).map_err(|e| source.format("voxels", e.to_string(), REMEDY))
    }

    fn mesh(
        self,
        array: &Array,
        cells: Cells,
        values: impl FnOnce() -> Result<Scalars, ReadError>,
    ) -> Result<Dataset, ReadError> {
        let quantity = &array.quantity;
        cells.mesh(self.source, values()?, quantity.of_cells, quantity.name.clone()).map(Dataset::Mesh)
    }

    fn unstructured(self, array: &Array) -> Result<Cells, ReadError> {
        let (source, cursor) = (self.source, self.cursor);
        let points = self.part("POINTS", self.content.points.as_ref())?;
        let types = self.part("CELL_TYPES", self.content.types.as_ref())?;
        let entries = if array.quantity.of_cells { types.entries } else { points.entries };
        self.check_entries(array, Some(entries))?;
        let (connectivity, ends) = match self.content.cells.as_ref() {
            None => return Err(source.format("CELLS", "there are none", REMEDY)),
            Some(CellBlocks::Counted { cells, numbers }) => self.counted(*cells, &cursor.indices(numbers)?)?,
            Some(CellBlocks::Offsets { offsets, connectivity }) => {
                self.with_offsets(cursor.indices(offsets)?, cursor.indices(connectivity)?)?
            }
        };
        let kinds = cursor.indices(types)?.into_iter().map(|kind| u8::try_from(kind).unwrap_or(u8::MAX)).collect();
        if types.entries != ends.len() {
            let what = format!("{} types for {} cells", types.entries, ends.len());
            return Err(source.format("CELL_TYPES", what, REMEDY));
        }
        let connectivity = point_numbers(source, connectivity, points.entries)?;
        Ok(Cells { points: positions(&cursor.numbers(points)?), connectivity, ends, kinds })
    }

    /// The points of all cells and the end of each, from numbers of points and points in turn.
    fn counted(self, cells: usize, numbers: &[u64]) -> Result<(Vec<u64>, Vec<u64>), ReadError> {
        let wrong = |what: String| self.source.format("CELLS", what, REMEDY);
        let mut connectivity = Vec::with_capacity(numbers.len());
        let mut ends = Vec::with_capacity(cells.min(numbers.len()));
        let mut rest = numbers;
        for cell in 0..cells {
            let Some((&count, after)) = rest.split_first() else {
                return Err(wrong(format!("the numbers end before cell {cell} of {cells}")));
            };
            let own = usize::try_from(count).ok().and_then(|count| after.split_at_checked(count));
            let Some((own, after)) = own else {
                return Err(wrong(format!("cell {cell} has {count} points, but {} numbers are left", after.len())));
            };
            connectivity.extend_from_slice(own);
            ends.push(connectivity.len() as u64);
            rest = after;
        }
        if rest.is_empty() {
            Ok((connectivity, ends))
        } else {
            Err(wrong(format!("{} numbers are left after {cells} cells", rest.len())))
        }
    }

    /// The points of all cells and the end of each, from ends that begin with 0.
    fn with_offsets(self, mut offsets: Vec<u64>, connectivity: Vec<u64>) -> Result<(Vec<u64>, Vec<u64>), ReadError> {
        let (first, last) = (offsets.first().copied().unwrap_or(0), offsets.last().copied().unwrap_or(0));
        if first != 0 || last != connectivity.len() as u64 {
            let what = format!("they go from {first} to {last} in place of 0 to {}", connectivity.len());
            return Err(self.source.format("OFFSETS", what, REMEDY));
        }
        offsets.drain(..1.min(offsets.len()));
        Ok((connectivity, offsets))
    }

    fn structured(self, array: &Array) -> Result<Cells, ReadError> {
        let points = self.part("POINTS", self.content.points.as_ref())?;
        let dims = self.dims()?;
        if product(dims) != Some(points.entries) {
            let what = format!("{} points for {} x {} x {}", points.entries, dims[0], dims[1], dims[2]);
            return Err(self.source.format("POINTS", what, REMEDY));
        }
        self.check_hexahedra(array, dims)?;
        Ok(hexahedra(dims, positions(&self.cursor.numbers(points)?)))
    }

    fn rectilinear(self, array: &Array) -> Result<Cells, ReadError> {
        let axis = |block: &Option<Block>| {
            let block = self.part("X_, Y_ and Z_COORDINATES", block.as_ref())?;
            let places = self.cursor.numbers(block)?;
            Ok((0..places.len()).filter_map(|i| places.get(i)).collect::<Vec<f64>>())
        };
        let [x, y, z] = &self.content.coordinates;
        let (x, y, z) = (axis(x)?, axis(y)?, axis(z)?);
        let dims = [x.len(), y.len(), z.len()];
        if self.content.dims.is_some_and(|given| given != dims) {
            let what = format!("they differ from {} x {} x {} coordinates", dims[0], dims[1], dims[2]);
            return Err(self.source.format("DIMENSIONS", what, REMEDY));
        }
        // The values are in the file, so a small file cannot ask for many points.
        self.check_hexahedra(array, dims)?;
        let rows = z.iter().flat_map(|&z| y.iter().map(move |&y| (y, z)));
        let points = rows.flat_map(|(y, z)| x.iter().map(move |&x| DVec3::new(x, y, z))).collect();
        Ok(hexahedra(dims, points))
    }

    fn dims(self) -> Result<[usize; 3], ReadError> {
        self.content.dims.ok_or_else(|| self.source.format("DIMENSIONS", "there are none", REMEDY))
    }

    fn part<'b>(self, keyword: &str, block: Option<&'b Block>) -> Result<&'b Block, ReadError> {
        block.ok_or_else(|| self.source.format(keyword, "there are none", REMEDY))
    }

    /// Refuses a quantity whose entries are not as many as its points or cells.
    fn check_entries(self, array: &Array, expected: Option<usize>) -> Result<(), ReadError> {
        let found = array.numbers.entries;
        if expected == Some(found) {
            return Ok(());
        }
        let expected = expected.map_or("too many".to_owned(), |n| n.to_string());
        let of = if array.quantity.of_cells { "cells" } else { "points" };
        let what = format!("{found} values for {expected} {of}");
        Err(self.source.format(format!("quantity `{}`", array.quantity.name), what, REMEDY))
    }

    /// Refuses a grid of points that does not fit the quantity or has no cells, or whose tetrahedra take too much memory.
    fn check_hexahedra(self, array: &Array, dims: [usize; 3]) -> Result<(), ReadError> {
        /// Of the points and of each cell's corners, type and six tetrahedra.
        const BYTES_OF_A_CELL: u64 = 24 + 32 + 9 + 96;
        let cells = dims.map(|n| n.saturating_sub(1));
        self.check_entries(array, product(if array.quantity.of_cells { cells } else { dims }))?;
        if cells.contains(&0) {
            let what = format!("{} x {} x {} points have no cell with a volume", dims[0], dims[1], dims[2]);
            return Err(self.source.format("DIMENSIONS", what, "give a grid of at least two points along each axis"));
        }
        let bytes = product(dims).map_or(u64::MAX, |points| BYTES_OF_A_CELL.saturating_mul(points as u64));
        let limit = self.source.limits.voxel_bytes;
        if bytes > limit {
            return Err(ReadError::TooLarge { path: self.source.path.to_owned(), bytes, limit });
        }
        Ok(())
    }
}

fn product(dims: [usize; 3]) -> Option<usize> {
    dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d))
}

/// The cells between points of a grid, x fastest. Their number was checked.
fn hexahedra(dims: [usize; 3], points: Vec<DVec3>) -> Cells {
    let [cells_x, cells_y, cells_z] = dims.map(|n| n.saturating_sub(1));
    let (row, layer) = (dims[0], dims[0] * dims[1]);
    let count = cells_x * cells_y * cells_z;
    let mut connectivity = Vec::with_capacity(8 * count);
    for z in 0..cells_z {
        for y in 0..cells_y {
            for x in 0..cells_x {
                let first = x + row * y + layer * z;
                let ring = [first, first + 1, first + 1 + row, first + row];
                connectivity.extend(ring.iter().chain(&ring.map(|point| point + layer)).map(|&point| point as u32));
            }
        }
    }
    let ends = (1..=count as u64).map(|cell| 8 * cell).collect();
    Cells { points, connectivity, ends, kinds: vec![HEXAHEDRON; count] }
}
