//! Base units of labels: their options, their start, and their note.

use std::path::Path;

use sg_fit::label_start::direct_start_of_labels;
use sg_fit::label_units::{Background, LabelUnits};
use sg_fit::labels::LabelError;
use sg_fit::{DirectStart, Options};
use sg_input::print::status as print_line;
use sg_volume::{Dataset, Field, LabelTable, TransferFunction, Volume};

use crate::arguments::FitArgs;
use crate::failure::{Failure, input};
use crate::progress::Display;

/// Refuses options about labels that go without each other.
pub(crate) fn check_options(args: &FitArgs) -> Result<(), Failure> {
    if !args.label_units {
        let needless = [("--rest-unit", args.rest_unit), ("--label-names", args.label_names.is_some())];
        if let Some((option, _)) = needless.iter().find(|(_, is_given)| *is_given) {
            return Err(input(format!("{option} is for --label-units; add that, or leave it out")));
        }
        if args.labels.is_some() && args.keep_in.is_some() {
            return Err(input("--labels goes with --keep-in for --label-units alone; add that, or give --out"));
        }
        if args.labels.is_some() && args.out_truth.is_none() && args.suggest_units.is_none() {
            return Err(input("--labels is for --label-units, for --out-truth FILE, or for --suggest-units; add one"));
        }
    } else if args.labels.is_none() && args.transfer_function.is_some() {
        let what = "a label map that stands alone has one opacity everywhere";
        return Err(input(format!("--transfer-function: {what}; leave it out, or give a volume and --labels")));
    }
    Ok(())
}

/// The base units of the labels, if they are asked for: of the label map, or of the volume itself as one.
pub(crate) fn label_units(
    args: &FitArgs,
    path: &Path,
    volume: &Dataset,
    labels: Option<&Volume>,
) -> Result<Option<LabelUnits>, Failure> {
    if !args.label_units {
        return Ok(None);
    }
    let Dataset::Volume(voxels) = volume else {
        let what = "--label-units is for voxels, and this is a mesh; give a transfer function with base_units";
        return Err(input(format!("{}: {what}", path.display())));
    };
    let given = args.label_names.as_deref().map(LabelTable::load).transpose().map_err(input)?;
    let table = given.as_ref().unwrap_or_else(|| labels.unwrap_or(voxels).labels());
    let found = match labels {
        None => LabelUnits::alone(voxels, table),
        Some(map) => of_volume(map, table, args.rest_unit, voxels),
    };
    let file = args.labels.as_deref().unwrap_or(path);
    found.map(Some).map_err(|e| input(format!("{}: {e}", file.display())))
}

fn of_volume(map: &Volume, table: &LabelTable, rest: bool, volume: &Volume) -> Result<LabelUnits, LabelError> {
    let units = LabelUnits::new(map, table, if rest { Background::Rest } else { Background::LeftOut })?;
    units.check_grid(volume.grid())?;
    Ok(units)
}

/// The direct start of labels, with its progress and its note.
pub(crate) fn start(
    args: &FitArgs,
    path: &Path,
    field: &Field,
    function: &TransferFunction,
    labels: &LabelUnits,
    options: &Options,
) -> Result<DirectStart, Failure> {
    let display = Display::new(args.progress_lines);
    let result = direct_start_of_labels(field, function, labels, options, |p| display.stage(p));
    display.finish();
    let start = result.map_err(|e| input(format!("{}: {e}", path.display())))?;
    let (empty, hidden) = left_out(labels, &start);
    if empty + hidden > 0 {
        print_line(&format!(
            "note: labels without a base unit: {empty} of the table with no voxel, {hidden} of the map with nothing visible"
        ));
    }
    if !args.initial_only {
        print_line("note: base units of labels are not trained; this is the direct start");
    }
    Ok(start)
}

/// Labels of the table that no voxel has, and labels of the map without anything visible.
pub(crate) fn left_out(labels: &LabelUnits, start: &DirectStart) -> (usize, usize) {
    (labels.without_voxels(), labels.units().len().saturating_sub(start.scene.units.len()))
}
