//! The scene of a label map, without training.

use sg_reclassify::sources;
use sg_volume::{Field, TransferFunction};

use crate::direct::{Progress, start_of};
use crate::label_units::LabelUnits;
use crate::options::{DirectError, Options};
use crate::report::DirectStart;

/// Makes a scene of the labels of a map: [`crate::direct_start`] with a base unit for each label. Labels without visible
/// voxels have none. `field` is the volume; for a map that stands alone, its own values, with its
/// [`LabelUnits::even_function`].
///
/// Another transfer function gives Gaussians of a label its opacities, and changes their colour by as much as its own
/// differs from the present one. Those of a map that stands alone keep no values.
///
/// # Errors
/// [`DirectError`]: the grids differ, nothing of the labels is visible, or the transfer function or an option is invalid.
pub fn direct_start_of_labels(
    field: &Field,
    function: &TransferFunction,
    labels: &LabelUnits,
    options: &Options,
    mut progress: impl FnMut(Progress),
) -> Result<DirectStart, DirectError> {
    labels.check_grid(field.grid())?;
    // Every voxel of a map that stands alone is shown.
    let hidden = if labels.stands_alone() { 0.0 } else { options.hidden };
    let mut start = start_of(field.into(), function, Some(labels), &Options { hidden, ..*options }, &mut progress)?;
    let classifier = function.classifier(field.range())?;
    for unit in &mut start.scene.units {
        if labels.stands_alone() {
            sources::forget(&mut unit.gaussians);
            unit.values = None;
        } else if labels.rest().is_none_or(|rest| labels.units()[rest].name != unit.name) {
            sources::store_colors(&mut unit.gaussians, unit.palette, &classifier);
        }
    }
    Ok(start)
}
