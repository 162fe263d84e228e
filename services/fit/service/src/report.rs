//! The report of a fit, and its lines for a person.

use std::path::{Path, PathBuf};

use serde::Serialize;
use sg_fit::Report;
use sg_fit::labels::LabelScore;
use sg_fit::training::TrainingReport;
use sg_input::number_format::{decimals, grouped};
use sg_input::print::status as print_line;
use sg_volume::Dataset;
use sg_volume::suggestion::SuggestedUnit;

/// The JSON report of a fit.
#[derive(Serialize)]
pub(crate) struct FitReport<'a> {
    pub(crate) volume: &'a Path,
    /// The scene's file.
    pub(crate) scene: &'a Path,
    /// Voxels along x, y and z; `None` for a mesh.
    pub(crate) dims: Option<[usize; 3]>,
    /// The mesh; `None` for voxels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mesh: Option<MeshReport>,
    /// Name of the quantity, if the file has one.
    pub(crate) variable: Option<&'a str>,
    pub(crate) scalar_type: &'static str,
    /// The file; `None` for an automatic transfer function.
    pub(crate) transfer_function: Option<&'a Path>,
    pub(crate) files: Vec<PathBuf>,
    pub(crate) read_seconds: f64,
    pub(crate) write_seconds: f64,
    /// Suggested base units, if they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) suggested: Option<&'a [SuggestedUnit]>,
    /// Scores of suggested base units against each label, if labels of the same voxels were given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) label_scores: Option<&'a [LabelScore]>,
    /// Labels without a base unit, if base units are labels: they have no voxel, or nothing of them is visible.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) labels_left_out: Option<usize>,
    #[serde(flatten)]
    pub(crate) direct: Option<&'a Report>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) training: Option<&'a TrainingReport>,
    /// Whether a signal has ended the training.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(crate) stopped: bool,
}

/// Counts of a mesh.
#[derive(Serialize)]
pub(crate) struct MeshReport {
    points: usize,
    tetrahedra: usize,
    /// Tetrahedra without volume, which were left out.
    flat: usize,
    /// Tetrahedra with points that are not finite, which were left out.
    non_finite: usize,
}

impl MeshReport {
    /// That of a mesh; `None` for voxels.
    pub(crate) fn of(data: &Dataset) -> Option<Self> {
        let Dataset::Mesh(mesh) = data else { return None };
        Some(Self {
            points: mesh.points().len(),
            tetrahedra: mesh.cells().len(),
            flat: mesh.left_out().flat,
            non_finite: mesh.left_out().non_finite,
        })
    }
}

/// Tells of tetrahedra that a mesh has lost, and what the reader of voxels has to tell.
pub(crate) fn note_left_out(path: &Path, volume: &Dataset) {
    let mesh = match volume {
        Dataset::Mesh(mesh) => mesh,
        Dataset::Volume(volume) => {
            volume.notes().iter().for_each(|note| print_line(&format!("note: {}: {note}", path.display())));
            return;
        }
    };
    let lost = mesh.left_out();
    if lost.flat + lost.non_finite > 0 {
        print_line(&format!(
            "note: {}: {} tetrahedra without volume and {} with points that are not finite were left out",
            path.display(),
            grouped(lost.flat as u64),
            grouped(lost.non_finite as u64)
        ));
    }
}

/// A suggested base unit, for a person.
pub(crate) fn suggestion_line(unit: &SuggestedUnit) -> String {
    let [low, high] = unit.range.map(|x| decimals(x, 2));
    format!(
        "suggested base unit `{}`: values {low} to {high}, most often {}, {} voxels",
        unit.name,
        decimals(unit.value, 2),
        grouped(unit.voxels)
    )
}

/// What a training has reached.
pub(crate) fn training_line(trained: &TrainingReport) -> String {
    let TrainingReport { iterations, seconds, held_out, result, measurements, .. } = trained;
    let before = measurements.first().map_or(f64::NAN, |first| first.footprint_psnr_db);
    format!(
        "trained in {seconds:.1} s, {} steps: {before:.1} dB before, {:.1} dB now, on {held_out} held-out picture{}",
        grouped(*iterations as u64),
        result.footprint_psnr_db,
        if *held_out == 1 { "" } else { "s" }
    )
}
