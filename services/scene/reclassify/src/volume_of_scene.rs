//! The volume behind a scene, as far as the scene's file knows it.

use std::path::Path;
use std::sync::Arc;

use sg_scene::model::{BaseUnit, Scene};
use sg_volume::TransferFunction;

use crate::sources;

/// The volume behind a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeOfScene {
    /// The transfer function of the scene's file; `None` where the file names none, or it cannot be read.
    pub function: Option<Arc<TransferFunction>>,
    /// Least and greatest value of the volume, raw.
    pub range: [f64; 2],
}

impl VolumeOfScene {
    /// The volume of the first base unit that keeps its values and has a function, else of the first that keeps its values. `None`
    /// where no unit does. `functions` has the transfer function of each unit.
    #[must_use]
    pub fn of(scene: &Scene, functions: &[Option<TransferFunction>]) -> Option<Self> {
        let mut units = scene.units.iter().enumerate().filter(|(_, unit)| sources::keeps_values(&unit.gaussians));
        let (_, first) = units.clone().next()?;
        let known = units.find_map(|(i, unit)| Some((unit, functions.get(i)?.as_ref()?)));
        let (unit, function) = known.map_or((first, None), |(unit, function)| (unit, Some(function)));
        let range = unit.values.unwrap_or_else(|| ends(unit));
        Some(Self { function: function.cloned().map(Arc::new), range })
    }
}

/// Least and greatest mean value of a unit's Gaussians.
fn ends(unit: &BaseUnit) -> [f64; 2] {
    let values = sources::values(&unit.gaussians).into_iter().flatten().filter(|x| x.is_finite());
    let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], x| [l.min(x), h.max(x)]);
    if low <= high { [low, high] } else { [0.0, 0.0] }
}

/// The transfer functions behind a scene's base units, in scene order, `None` for units without one. Also returns the read
/// errors, a line each. `path` is the scene's source.
#[must_use]
pub fn functions(scene: &Scene, path: &Path) -> (Vec<Option<TransferFunction>>, Vec<String>) {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let mut problems = Vec::new();
    let mut function = |unit: &BaseUnit| {
        let file = folder.join(unit.transfer_function.as_ref()?);
        match TransferFunction::load(&file) {
            Ok(loaded) => Some(loaded.function),
            Err(error) => {
                problems.push(format!("no transfer function is shown for {}: {error}", unit.name));
                None
            }
        }
    };
    let functions = scene.units.iter().map(&mut function).collect();
    (functions, problems)
}
