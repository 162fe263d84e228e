//! Base units of the labels of a label map.
//!
//! Each label becomes a base unit with one colour. Its Gaussians have their centres in voxels of the label. The volume's transfer
//! function gives their opacity; in a map that stands alone it is the same everywhere. Near the boundary of a label, normals
//! and shading are those of the boundary, as of a surface of values. So labels with the values of their surroundings have a
//! shape too.

use std::collections::{BTreeMap, HashSet};

use glam::{DVec3, UVec3, Vec3};
use sg_volume::label_table::color_at;
use sg_volume::opacity::correct_opacity;
use sg_volume::transfer::{ControlPoint, Scale, Units};
use sg_volume::{Field, Grid, LabelTable, TransferFunction, Volume};

use crate::labels::{LabelError, MAX_UNITS, label_at};

/// Standard deviation in voxels of the smoothing before gradients, of values and of the boundaries of labels. Without it normals follow
/// the noise of single voxels.
pub(crate) const GRADIENT_SMOOTHING: f32 = 1.0;

/// Voxels of no base unit. Base units have lower numbers.
pub(crate) const LEFT_OUT: u8 = MAX_UNITS as u8;
/// Name of the base unit of voxels without a label.
const REST: &str = "rest";
/// Labels that are counted before a map is refused.
const COUNTED: usize = 65_536;
/// Opacity of a voxel of a label map that stands alone.
const VOXEL_OPACITY: f64 = 0.8;
/// Largest distance between corners of grids that count as equal, in voxels.
const SLACK: f64 = 0.1;
/// Voxels around a label that its smoothed boundary reaches.
const REACH: u32 = 4;

/// What becomes of voxels with the label 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Background {
    /// They have no Gaussians.
    LeftOut,
    /// They are the base unit `rest`, in the colours of the transfer function.
    Rest,
}

/// The base unit of a label.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelUnit {
    /// The label; 0 for the voxels without one.
    pub label: i32,
    /// Name of the base unit.
    pub name: String,
    /// Its colour, RGB from 0 to 1; `None` for those of the transfer function.
    pub color: Option<Vec3>,
    /// Its voxels.
    pub voxels: u64,
    /// Least and greatest voxel along each axis.
    extent: [UVec3; 2],
}

/// The base units of a label map.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelUnits {
    grid: Grid,
    units: Vec<LabelUnit>,
    /// Base unit of each voxel, or [`LEFT_OUT`].
    of_voxels: Vec<u8>,
    without_voxels: usize,
    stands_alone: bool,
}

impl LabelUnits {
    /// The base units of a map for a volume on the same grid: one for each label, by increasing number, and the rest at the end.
    /// `table` has names and colours; labels that it lacks are `label 3`, and have colours of the Okabe-Ito set.
    ///
    /// # Errors
    /// [`LabelError`]: a value is no label, there are too many labels, or none.
    pub fn new(map: &Volume, table: &LabelTable, background: Background) -> Result<Self, LabelError> {
        let counts = counts_of(map)?;
        let labels: Vec<(i32, u64)> = counts.iter().filter(|(label, _)| **label != 0).map(|(a, b)| (*a, *b)).collect();
        let rest = counts.get(&0).copied().filter(|_| background == Background::Rest);
        if labels.is_empty() {
            return Err(LabelError::NoLabel);
        }
        if labels.len() + usize::from(rest.is_some()) > MAX_UNITS {
            return Err(LabelError::TooMany { found: labels.len().to_string() });
        }
        let mut taken: HashSet<String> = rest.iter().map(|_| REST.to_owned()).collect();
        let none = [UVec3::MAX, UVec3::ZERO];
        let unit = |(place, (label, voxels)): (usize, (i32, u64))| {
            let told = table.get(label).cloned().unwrap_or_default();
            let name = free_name(&told.name.unwrap_or_else(|| format!("label {label}")), &mut taken);
            let color = Some(Vec3::from_array(told.color.unwrap_or_else(|| color_at(place))));
            LabelUnit { label, name, color, voxels, extent: none }
        };
        let mut units: Vec<LabelUnit> = labels.into_iter().enumerate().map(unit).collect();
        let rest = rest.map(|voxels| LabelUnit { label: 0, name: REST.to_owned(), color: None, voxels, extent: none });
        units.extend(rest);
        let of_voxels = units_of_voxels(map, &mut units)?;
        let without_voxels = table.labels().filter(|label| *label != 0 && !counts.contains_key(label)).count();
        Ok(Self { grid: map.grid().clone(), units, of_voxels, without_voxels, stands_alone: false })
    }

    /// The base units of a map that stands alone: no volume gives it opacities, so all have the same one.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn alone(map: &Volume, table: &LabelTable) -> Result<Self, LabelError> {
        let units = Self::new(map, table, Background::LeftOut)?;
        Ok(Self { stands_alone: true, ..units })
    }

    /// Whether the map stands alone.
    #[must_use]
    pub fn stands_alone(&self) -> bool {
        self.stands_alone
    }

    /// The base units, in their order.
    #[must_use]
    pub fn units(&self) -> &[LabelUnit] {
        &self.units
    }

    /// Labels of the table that no voxel has.
    #[must_use]
    pub fn without_voxels(&self) -> usize {
        self.without_voxels
    }

    /// Base unit of each voxel, x fastest; 255 for those without one.
    #[must_use]
    pub fn of_voxels(&self) -> &[u8] {
        &self.of_voxels
    }

    /// Whether the map has the grid of a volume, to within a tenth of a voxel.
    ///
    /// # Errors
    /// [`LabelError::GridMismatch`] with both grids.
    pub fn check_grid(&self, volume: &Grid) -> Result<(), LabelError> {
        let own = &self.grid;
        let last = DVec3::from_array(own.dims().map(|size| size as f64 - 1.0));
        let corners =
            [DVec3::ZERO, last.with_y(0.0).with_z(0.0), last.with_x(0.0).with_z(0.0), last.with_x(0.0).with_y(0.0)];
        let slack = SLACK * own.spacing().min_element().min(volume.spacing().min_element());
        let is_near = |corner: &DVec3| own.to_world(*corner).distance(volume.to_world(*corner)) <= slack;
        let has_spacing = (own.spacing() - volume.spacing()).abs().max_element() <= slack;
        if own.dims() == volume.dims() && has_spacing && corners.iter().all(is_near) {
            return Ok(());
        }
        Err(LabelError::GridMismatch { labels: in_words(own), volume: in_words(volume) })
    }

    /// The transfer function of a map that stands alone: one opacity for every value. A voxel hides most of what is behind it.
    #[must_use]
    pub fn even_function(&self) -> TransferFunction {
        let voxel = self.grid.voxel_volume().cbrt();
        let opacity = correct_opacity(VOXEL_OPACITY, self.grid.reference_length(), voxel) as f32;
        let labels = || self.units.iter().map(|unit| f64::from(unit.label)).chain([0.0]);
        let (low, high) = (labels().fold(0.0, f64::min), labels().fold(1.0, f64::max));
        TransferFunction {
            domain: [low, high],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points: vec![ControlPoint { value: low, color: [0.5; 3], opacity }],
            base_units: Vec::new(),
        }
    }

    /// The number of the rest, if it is a base unit.
    pub(crate) fn rest(&self) -> Option<usize> {
        self.units.iter().position(|unit| unit.color.is_none())
    }

    /// The voxels of a base unit. `span` is the width of the range of values that a boundary counts as.
    pub(crate) fn part(&self, unit: usize, span: f64) -> Option<LabelPart<'_>> {
        let of = self.units.get(unit)?;
        let boundary = of.color.and_then(|_| self.boundary(unit, of.extent));
        Some(LabelPart {
            unit: u8::try_from(unit).ok()?,
            of_voxels: &self.of_voxels,
            boundary,
            span: span as f32,
            has_values: !self.stands_alone,
        })
    }

    fn boundary(&self, unit: usize, [low, high]: [UVec3; 2]) -> Option<Boundary> {
        let all = UVec3::from_array(self.grid.dims().map(|size| size as u32));
        let first = low.saturating_sub(UVec3::splat(REACH));
        let dims = (high.saturating_add(UVec3::splat(REACH + 1))).min(all).saturating_sub(first);
        let dims = dims.to_array().map(|size| size as usize);
        let grid = Grid::new(dims, self.grid.spacing(), DVec3::ZERO, self.grid.direction()).ok()?;
        let mut inside = Vec::with_capacity(grid.len());
        for row in 0..dims[1] * dims[2] {
            let (y, z) = (row % dims[1] + first.y as usize, row / dims[1] + first.z as usize);
            let start = self.grid.index(first.x as usize, y, z);
            let voxels = self.of_voxels.get(start..start + dims[0])?;
            inside.extend(voxels.iter().map(|own| if usize::from(*own) == unit { 1.0_f32 } else { 0.0 }));
        }
        let smooth = Volume::new(grid, inside.into(), None).ok()?.to_field().smoothed(GRADIENT_SMOOTHING);
        Some(Boundary { smooth, first: first.as_dvec3() })
    }
}

/// The voxels of one base unit of a label map.
pub(crate) struct LabelPart<'a> {
    unit: u8,
    of_voxels: &'a [u8],
    /// The boundary of a label; the rest has none of its own.
    boundary: Option<Boundary>,
    /// Width of the range of values that a boundary counts as.
    span: f32,
    /// Whether values have gradients of their own.
    has_values: bool,
}

/// 1 in the voxels of a label and 0 around it, smoothed, in the box of the label.
struct Boundary {
    smooth: Field,
    /// First voxel of the box.
    first: DVec3,
}

impl LabelPart<'_> {
    /// The gradient at a place in voxel coordinates: that of the values or that of the boundary, whichever is longer. The
    /// boundary counts as one between the least and the greatest value.
    pub(crate) fn gradient(&self, voxel: DVec3, of_values: Vec3) -> Vec3 {
        let of_values = if self.has_values { of_values } else { Vec3::ZERO };
        let Some(Boundary { smooth, first }) = &self.boundary else { return of_values };
        let of_boundary = smooth.gradient(voxel - *first) * self.span;
        if of_boundary.length_squared() > of_values.length_squared() { of_boundary } else { of_values }
    }

    /// Whether a place in voxel coordinates is in a voxel of the unit.
    pub(crate) fn holds(&self, grid: &Grid, voxel: DVec3) -> bool {
        self.of_voxels.get(grid.nearest(grid.to_world(voxel))) == Some(&self.unit)
    }
}

/// The voxels of each label.
fn counts_of(map: &Volume) -> Result<BTreeMap<i32, u64>, LabelError> {
    let mut counts = BTreeMap::new();
    // Neighbours are often equal, so they are counted together.
    let mut run = (0, 0_u64);
    for voxel in 0..map.grid().len() {
        let label = label_at(map, voxel)?;
        if label != run.0 {
            add(&mut counts, run);
            run = (label, 0);
            if counts.len() > COUNTED {
                return Err(LabelError::TooMany { found: format!("more than {COUNTED}") });
            }
        }
        run.1 += 1;
    }
    add(&mut counts, run);
    Ok(counts)
}

fn add(counts: &mut BTreeMap<i32, u64>, (label, voxels): (i32, u64)) {
    if voxels > 0 {
        *counts.entry(label).or_default() += voxels;
    }
}

/// The base unit of each voxel. The units get their extents.
fn units_of_voxels(map: &Volume, units: &mut [LabelUnit]) -> Result<Vec<u8>, LabelError> {
    let numbers: BTreeMap<i32, u8> = units.iter().map(|unit| unit.label).zip(0..LEFT_OUT).collect();
    let number = |label: i32| numbers.get(&label).copied().unwrap_or(LEFT_OUT);
    let mut last = (0, number(0));
    let mut of_voxels = Vec::with_capacity(map.grid().len());
    for voxel in 0..map.grid().len() {
        let label = label_at(map, voxel)?;
        if label != last.0 {
            last = (label, number(label));
        }
        of_voxels.push(last.1);
        if let Some(unit) = units.get_mut(usize::from(last.1)) {
            let at = map.grid().voxel(voxel).as_uvec3();
            unit.extent = [unit.extent[0].min(at), unit.extent[1].max(at)];
        }
    }
    Ok(of_voxels)
}

/// A name that no other base unit has in any capitals: the name itself, or with a number behind it.
fn free_name(name: &str, taken: &mut HashSet<String>) -> String {
    let numbered = (2..).map(|number: u32| format!("{name} {number}"));
    // There are at most 255 names, so one of the first 256 is free.
    let mut free = std::iter::once(name.to_owned()).chain(numbered.take(MAX_UNITS));
    let name = free.find(|name| !taken.contains(&name.to_lowercase())).unwrap_or_else(|| name.to_owned());
    taken.insert(name.to_lowercase());
    name
}

fn in_words(grid: &Grid) -> String {
    let [x, y, z] = grid.dims();
    format!("{x} x {y} x {z} voxels of {} from {} on", grid.spacing(), grid.origin())
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    fn map(dims: [usize; 3], of: impl Fn(usize) -> f32) -> Volume {
        let grid = Grid::unit(dims).unwrap();
        let values: Vec<f32> = (0..grid.len()).map(of).collect();
        Volume::new(grid, values.into(), None).unwrap()
    }

    #[test]
    fn labels_are_named_and_numbered() {
        let map = map([4, 1, 1], |i| [0.0, 9.0, -2.0, 9.0][i]);
        let units = LabelUnits::new(&map, &LabelTable::default(), Background::LeftOut).unwrap();
        let found: Vec<_> = units.units().iter().map(|unit| (unit.label, unit.name.as_str(), unit.voxels)).collect();
        assert_eq!(found, [(-2, "label -2", 1), (9, "label 9", 2)]);
        assert_eq!((units.of_voxels(), units.rest()), (&[LEFT_OUT, 1, 0, 1][..], None));
        assert_eq!(units.units()[1].extent, [UVec3::new(1, 0, 0), UVec3::new(3, 0, 0)]);
        let with_rest = LabelUnits::new(&map, &LabelTable::default(), Background::Rest).unwrap();
        assert_eq!((with_rest.of_voxels(), with_rest.rest()), (&[2, 1, 0, 1][..], Some(2)));
        let mut taken = HashSet::from(["rest".to_owned()]);
        let names = ["Rest", "a", "A", "a 2"].map(|name| free_name(name, &mut taken));
        assert_eq!(names, ["Rest 2", "a", "A 2", "a 2 2"]);
    }

    #[test]
    fn what_is_no_label_map_is_refused() {
        let refused = |volume: &Volume| LabelUnits::new(volume, &LabelTable::default(), Background::Rest).unwrap_err();
        assert_eq!(refused(&map([2, 1, 1], |_| 0.0)), LabelError::NoLabel);
        assert_eq!(refused(&map([2, 1, 1], |i| i as f32 / 2.0)), LabelError::NotInteger { voxel: 1, value: 0.5 });
        assert!(matches!(refused(&map([2, 1, 1], |_| f32::NAN)), LabelError::NotInteger { voxel: 0, .. }));
        // 255 labels fit, and the rest does not beside them.
        let full = map([256, 1, 1], |i| i as f32);
        assert!(LabelUnits::new(&full, &LabelTable::default(), Background::LeftOut).is_ok());
        assert!(refused(&full).to_string().contains("255 labels; at most 255"));
        let many = map([300, 300, 1], |i| i as f32);
        assert!(refused(&many).to_string().contains("more than 65536 labels"), "{}", refused(&many));
    }

    #[test]
    fn grids_are_compared_in_the_world() {
        let units = LabelUnits::alone(&map([4, 4, 4], |_| 1.0), &LabelTable::default()).unwrap();
        let grid = |dims, spacing: f64, origin: f64| {
            Grid::new(dims, DVec3::splat(spacing), DVec3::splat(origin), DMat3::IDENTITY).unwrap()
        };
        assert_eq!(units.check_grid(&grid([4; 3], 1.0, 0.05)), Ok(()), "within a tenth of a voxel");
        for (other, part) in [
            (grid([4, 4, 5], 1.0, 0.0), "4 x 4 x 5 voxels of [1, 1, 1]"),
            (grid([4; 3], 1.5, 0.0), "4 x 4 x 4 voxels of [1.5, 1.5, 1.5]"),
            (grid([4; 3], 1.0, 7.0), "from [7, 7, 7] on"),
        ] {
            let said = units.check_grid(&other).unwrap_err().to_string();
            assert!(said.contains(part) && said.contains("4 x 4 x 4 voxels of [1, 1, 1] from [0, 0, 0] on"), "{said}");
        }
    }
}
