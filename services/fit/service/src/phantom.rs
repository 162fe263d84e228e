//! The synthetic volume: a vessel tree with an aneurysm, with exact ground truth.

use std::io;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Serialize;
use sg_formats::staged_file;
use sg_input::print;
use sg_input::print::status as print_line;
use sg_volume::phantom::{self, VesselTree};
use sg_volume::{Volume, raw_file_name, write_volume};

use crate::failure::{Failure, input, work};
use crate::output::{make_folder, write};

/// Name of the file with the ground truth.
const TRUTH_FILE: &str = "truth.json";

/// Ground truth of the synthetic volume, in normalized coordinates of its box and in voxels.
#[derive(Serialize)]
struct PhantomGroundTruth {
    volume: String,
    labels: String,
    transfer_function: String,
    label_sac: u8,
    label_vessel: u8,
    sac_center: [f64; 3],
    sac_radius: f64,
    parent_point: [f64; 3],
    parent_radius: f64,
    parent_axis: Vec<[f64; 3]>,
    sac_center_voxels: [f64; 3],
    sac_radius_voxels: f64,
}

/// Writes the synthetic volume, its labels, its transfer function and its ground truth to a folder.
pub(crate) fn make(out: &Path, size: usize, seed: u64, json: bool) -> Result<(), Failure> {
    let tree = VesselTree::new();
    let raster = tree.rasterize(size, seed).map_err(input)?;
    let (volume, labels) = (raster.volume().map_err(work)?, raster.labels().map_err(work)?);
    let truth = PhantomGroundTruth {
        volume: raw_file_name("phantom", &volume),
        labels: raw_file_name("phantom_labels", &labels),
        transfer_function: "phantom.tf.json".to_owned(),
        label_sac: phantom::LABEL_SAC,
        label_vessel: phantom::LABEL_VESSEL,
        sac_center: tree.sac_center().to_array(),
        sac_radius: tree.sac_radius(),
        parent_point: tree.parent_point().to_array(),
        parent_radius: tree.parent_radius(),
        parent_axis: tree.parent_axis().iter().map(DVec3::to_array).collect(),
        sac_center_voxels: (tree.sac_center() * size as f64 - 0.5).to_array(),
        sac_radius_voxels: tree.sac_radius() * size as f64,
    };
    let names = [truth.volume.as_str(), truth.labels.as_str(), truth.transfer_function.as_str(), TRUTH_FILE];
    let outputs = names.map(|name| out.join(name));
    staged_file::check_outputs(outputs.iter().map(PathBuf::as_path), []).map_err(input)?;
    make_folder(out)?;
    save_volume(&out.join(&truth.volume), &volume)?;
    save_volume(&out.join(&truth.labels), &labels)?;
    let function = phantom::transfer_function().to_json().map_err(work)?;
    write(&out.join(&truth.transfer_function), function.as_bytes())?;
    let text = serde_json::to_string_pretty(&truth).map_err(work)? + "\n";
    write(&out.join(TRUTH_FILE), text.as_bytes())?;
    if json {
        print::result(&text).map_err(work)?;
    } else {
        print_line(&format!("{}: {size} x {size} x {size} voxels", out.join(&truth.volume).display()));
    }
    Ok(())
}

fn save_volume(target: &Path, volume: &Volume) -> Result<(), Failure> {
    let failed = |e: io::Error| work(format!("{}: {e}; nothing was written", target.display()));
    let mut file = staged_file::StagedFile::create(target).map_err(failed)?;
    write_volume(target, volume, &mut file).map_err(|e| work(format!("{e}; nothing was written")))?;
    file.commit().map_err(failed).map(|_| ())
}
