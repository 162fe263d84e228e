//! Cells of any shape with several quantities, as VTK's files hold them, and the mesh of tetrahedra of one quantity.

use glam::DVec3;

use crate::mesh::{CellShape, Mesh, MeshValues, split_cell};
use crate::scalars::{ScalarType, Scalars};

use super::error::ReadError;
use super::source::Source;

/// Points and cells of a file.
#[derive(Default)]
pub(super) struct Cells {
    pub(super) points: Vec<DVec3>,
    /// Points of all cells, one after the other.
    pub(super) connectivity: Vec<u32>,
    /// End of each cell in `connectivity`.
    pub(super) ends: Vec<u64>,
    /// Type number of each cell.
    pub(super) kinds: Vec<u8>,
}

/// A quantity of a file: its name, its numbers for each point or cell, and whether it is of the cells.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Quantity {
    pub(super) name: String,
    pub(super) components: usize,
    pub(super) of_cells: bool,
}

/// The part of a quantity that a mesh takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// One component.
    Component(usize),
    /// The length of the vector of all components.
    Magnitude,
}

/// A quantity and the part of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Choice {
    /// Place of the quantity in the file's list.
    pub(super) quantity: usize,
    pub(super) part: Part,
}

/// The quantity of a file that its name selects: `NAME`, or `NAME:K` for component K from 0, or `NAME:x`, `NAME:y`, `NAME:z`. A name
/// alone means the length of a vector. Without a name it is the preferred one, or the first of these: the active scalars, another
/// scalar of the points, one of the cells, the length of any other.
pub(super) fn choose(
    source: Source<'_>,
    quantities: &[Quantity],
    active: [Option<&str>; 2],
) -> Result<Choice, ReadError> {
    if let Some(name) = source.variable {
        return named(source, quantities, name);
    }
    if let Some(Ok(preferred)) = source.preferred.map(|name| named(source, quantities, name)) {
        return Ok(preferred);
    }
    let is_active = |q: &Quantity| active[usize::from(q.of_cells)] == Some(q.name.as_str());
    let scalar = |q: &Quantity| q.components == 1;
    let found = quantities.iter().position(|q| is_active(q) && scalar(q) && !q.of_cells);
    let found = found.or_else(|| quantities.iter().position(|q| scalar(q) && !q.of_cells));
    let found = found.or_else(|| quantities.iter().position(|q| is_active(q) && scalar(q)));
    let found = found.or_else(|| quantities.iter().position(scalar));
    let found = found.or_else(|| quantities.iter().position(|q| q.components > 0));
    found
        .map(|quantity| whole(quantities, quantity))
        .ok_or_else(|| source.format("PointData", "no quantity on the points or cells", "store a field with the mesh"))
}

/// All of a quantity.
fn whole(quantities: &[Quantity], quantity: usize) -> Choice {
    let is_scalar = quantities.get(quantity).is_some_and(|q| q.components == 1);
    Choice { quantity, part: if is_scalar { Part::Component(0) } else { Part::Magnitude } }
}

fn named(source: Source<'_>, quantities: &[Quantity], name: &str) -> Result<Choice, ReadError> {
    let place = |name: &str| quantities.iter().position(|q| q.name == name);
    if let Some(found) = place(name) {
        return Ok(whole(quantities, found));
    }
    if let Some((stem, component)) = name.rsplit_once(':')
        && let Some(quantity) = place(stem)
    {
        let components = quantities.get(quantity).map_or(0, |q| q.components);
        let number = match component {
            "x" => Some(0),
            "y" => Some(1),
            "z" => Some(2),
            other => other.parse().ok(),
        };
        return match number.filter(|k| *k < components) {
            Some(k) => Ok(Choice { quantity, part: Part::Component(k) }),
            None => Err(source.format(
                format!("quantity `{stem}`"),
                format!("no component `{component}` among {components}"),
                format!("give a number from 0 to {}", components.saturating_sub(1)),
            )),
        };
    }
    let item = |q: &Quantity| match q.components {
        1 => q.name.clone(),
        n => format!("{} ({n} components)", q.name),
    };
    let list = quantities.iter().map(item).collect::<Vec<_>>().join(", ");
    Err(source.format("quantities", format!("none is called `{name}`"), format!("give one of {list}")))
}

/// The chosen part of an array of `components` numbers for each entry. A scalar stays in its type; others become float64.
pub(super) fn part_of(values: Scalars, components: usize, part: Part) -> Scalars {
    if components == 1 {
        return values;
    }
    let entries = values.len() / components.max(1);
    let at = |entry: usize, k: usize| values.get(entry * components + k).unwrap_or(f64::NAN);
    let number = |entry: usize| match part {
        Part::Component(k) => at(entry, k),
        Part::Magnitude => (0..components).map(|k| at(entry, k).powi(2)).sum::<f64>().sqrt(),
    };
    let found: Vec<f64> = (0..entries).map(number).collect();
    match values.scalar_type() {
        // Lengths of f32 vectors need no more digits than their components have.
        ScalarType::F32 => found.into_iter().map(|x| x as f32).collect::<Vec<f32>>().into(),
        _ => found.into(),
    }
}

/// Points from three numbers each.
pub(super) fn positions(numbers: &Scalars) -> Vec<DVec3> {
    let number = |i: usize| numbers.get(i).unwrap_or(f64::NAN);
    (0..numbers.len() / 3).map(|i| DVec3::new(number(3 * i), number(3 * i + 1), number(3 * i + 2))).collect()
}

/// Point numbers of a file in 32 bits. Each is below the number of points.
pub(super) fn point_numbers(source: Source<'_>, numbers: Vec<u64>, points: usize) -> Result<Vec<u32>, ReadError> {
    let in_bounds = |point: u64| u32::try_from(point).ok().filter(|point| (*point as usize) < points);
    let checked = numbers.into_iter().map(|point| {
        let what = || format!("point {point} of {points}");
        in_bounds(point).ok_or_else(|| source.format("connectivity", what(), "repair the mesh, or write it again"))
    });
    checked.collect()
}

impl Cells {
    /// Adds the points and cells of another piece of the same file.
    pub(super) fn append(&mut self, source: Source<'_>, other: Self) -> Result<(), ReadError> {
        let first = u32::try_from(self.points.len()).unwrap_or(u32::MAX);
        let end = self.connectivity.len() as u64;
        let moved = other.connectivity.into_iter().map(|point| point.checked_add(first));
        let moved: Option<Vec<u32>> = moved.collect();
        let moved = moved.ok_or_else(|| source.format("Points", "more than 2³² points", "reduce the mesh"))?;
        self.connectivity.extend(moved);
        self.ends.extend(other.ends.into_iter().map(|own| own + end));
        self.points.extend(other.points);
        self.kinds.extend(other.kinds);
        Ok(())
    }

    /// The mesh of their tetrahedra with the values of one quantity.
    pub(super) fn mesh(
        self,
        source: Source<'_>,
        values: Scalars,
        of_cells: bool,
        name: String,
    ) -> Result<Mesh, ReadError> {
        let remedy = "repair the mesh, or write it again";
        let Self { points, connectivity, ends, kinds } = self;
        let expected = if of_cells { kinds.len() } else { points.len() };
        if values.len() != expected {
            let what = format!("{} values for {expected} {}", values.len(), if of_cells { "cells" } else { "points" });
            return Err(source.format(format!("quantity `{name}`"), what, remedy));
        }
        let mut tetrahedra = Vec::new();
        // The cell of each tetrahedron, if values are of cells.
        let mut cell_of = Vec::new();
        let mut unknown = None;
        let mut begin = 0;
        for (cell, (&kind, &end)) in kinds.iter().zip(&ends).enumerate() {
            let own = usize::try_from(end).ok().and_then(|end| connectivity.get(begin..end));
            let own = own.ok_or_else(|| {
                let what = format!("cell {cell} has points {begin} to {end} of {}", connectivity.len());
                source.format("offsets", what, remedy)
            })?;
            begin += own.len();
            match split_cell(kind, own, &mut tetrahedra) {
                CellShape::Solid => {}
                CellShape::Flat => continue,
                CellShape::Unknown => unknown = unknown.or(Some((cell, kind, own.len()))),
            }
            if of_cells {
                cell_of.resize(tetrahedra.len(), cell);
            }
        }
        if let Some((cell, kind, count)) = unknown {
            let what = format!("cell {cell} has type {kind} and {count} points, which no tetrahedra are made of");
            return Err(source.format("types", what, "triangulate the mesh in ParaView (filter Tetrahedralize)"));
        }
        let values = if of_cells { MeshValues::Cells(values.picked(&cell_of)) } else { MeshValues::Points(values) };
        let name = Some(name).filter(|name| !name.is_empty());
        Mesh::new(points, tetrahedra, values, name).map_err(|e| source.format("cells", e.to_string(), remedy))
    }
}
