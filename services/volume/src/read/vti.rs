//! VTK image data (`.vti`): <https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html#xml-file-formats>.
//!
//! The reader takes arrays of one component. The active scalars go before the first such array, and point data before cell data.

use glam::{DMat3, DVec3};

use crate::grid::Grid;
use crate::volume::Volume;

use super::error::ReadError;
use super::format::VolumeFormat;
use super::mesh_data::{Quantity, choose};
use super::source::Source;
use super::vtk_xml::{self, Array, Attributes, Document, Section};

/// VTK image data.
pub(super) struct VtkImageData;

impl VolumeFormat for VtkImageData {
    type Data = Volume;

    const NAME: &'static str = "VTK image data";
    const ENDINGS: &'static [&'static str] = &[".vti"];
    const HAS_VARIABLES: bool = true;

    fn sniff(_name: &str, first: &[u8]) -> bool {
        vtk_xml::sniff(first, "ImageData")
    }

    fn read(source: Source<'_>) -> Result<Volume, ReadError> {
        let bytes = source.unpacked()?;
        let document = Document::parse(source, &bytes, "ImageData")?;
        let array = active_array(source, &document)?;
        let (dims, grid) = grid(source, &document, array.section == Section::CellData)?;
        let scalars = array.scalars(source, &bytes, &document, dims)?;
        let name = Some(array.name.clone()).filter(|n| !n.is_empty());
        let remedy = "correct the extents or the type, or fetch the file again";
        Volume::new(grid, scalars, name).map_err(|e| source.format("voxels", e.to_string(), remedy))
    }
}

/// The array to read: one of one component.
fn active_array<'d>(source: Source<'_>, document: &'d Document) -> Result<&'d Array, ReadError> {
    let of_data = |a: &&Array| matches!(a.section, Section::PointData | Section::CellData);
    let scalars: Vec<&Array> = document.arrays.iter().filter(of_data).filter(|a| a.components == 1).collect();
    let quantities: Vec<Quantity> = scalars.iter().map(|array| array.quantity()).collect();
    let none = || {
        source.format(
            "PointData",
            format!("no array of one component among {}", document.arrays.len()),
            "store a scalar array (compute a magnitude or a component first)",
        )
    };
    if quantities.is_empty() {
        return Err(none());
    }
    let active = [document.point_scalars.as_deref(), document.cell_scalars.as_deref()];
    let choice = choose(source, &quantities, active)?;
    scalars.get(choice.quantity).copied().ok_or_else(none)
}

fn grid(source: Source<'_>, document: &Document, of_cells: bool) -> Result<([usize; 3], Grid), ReadError> {
    let remedy = "store the image as one piece with its WholeExtent";
    let image = &document.data_set;
    let whole = extent(source, image, "WholeExtent", "WholeExtent")?;
    let whole = whole.ok_or_else(|| source.format("ImageData", "no WholeExtent", remedy))?;
    let piece = match document.pieces.last() {
        Some(piece) => extent(source, piece, "Extent", "Extent of a Piece")?,
        None => None,
    };
    if document.pieces.len() > 1 || piece.is_some_and(|p| p != whole) {
        return Err(source.format("Piece", "the image is stored in parts", remedy));
    }
    let mut dims = [0_usize; 3];
    let mut first = DVec3::ZERO;
    for k in 0..3 {
        let points = whole[2 * k + 1].checked_sub(whole[2 * k]).and_then(|n| n.checked_add(1));
        let values = points.and_then(|n| if of_cells { n.checked_sub(1) } else { Some(n) });
        dims[k] = values.and_then(|n| usize::try_from(n).ok()).unwrap_or(0);
        first[k] = whole[2 * k] as f64 + if of_cells { 0.5 } else { 0.0 };
    }
    let spacing = triple(source, image, "Spacing")?.unwrap_or(DVec3::ONE);
    let direction = match image.numbers(source, "Direction")? {
        None => DMat3::IDENTITY,
        // Row major in the file.
        Some(d) => <[f64; 9]>::try_from(d)
            .map(|d| DMat3::from_cols_array(&d).transpose())
            .map_err(|d| source.format("Direction", format!("{} numbers", d.len()), "give 9 numbers"))?,
    };
    let origin = triple(source, image, "Origin")?.unwrap_or_default() + direction * (spacing * first);
    let grid = Grid::new(dims, spacing, origin, direction).map_err(|e| source.grid(e))?;
    Ok((dims, grid))
}

fn triple(source: Source<'_>, of: &Attributes, key: &str) -> Result<Option<DVec3>, ReadError> {
    let wrong = |n: Vec<f64>| source.format(key, format!("{} numbers", n.len()), "give 3 numbers");
    of.numbers(source, key)?.map(|n| <[f64; 3]>::try_from(n).map(DVec3::from_array).map_err(wrong)).transpose()
}

fn extent(source: Source<'_>, of: &Attributes, key: &str, place: &str) -> Result<Option<[i64; 6]>, ReadError> {
    let Some(n) = of.numbers(source, key)? else { return Ok(None) };
    match <[f64; 6]>::try_from(n) {
        Ok(n) if n.iter().all(|x| x.fract() == 0.0 && x.abs() < 1e9) => Ok(Some(n.map(|x| x as i64))),
        _ => Err(source.format(place, "six whole numbers are needed", "give x0 x1 y0 y1 z0 z1")),
    }
}
