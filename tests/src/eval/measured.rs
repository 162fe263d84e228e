//! Scenes fitted to measured volumes. Label maps give the part that each Gaussian belongs to.

use std::path::Path;

use glam::{DVec3, USizeVec3};
use sg_fit::labels::labels_of;
use sg_fit::{Options, direct_start};
use sg_volume::transfer::ControlPoint;
use sg_volume::{Grid, Scalars, TransferFunction, Volume, read_volume};

use super::EvalError;
use super::subject::{Origin, Parametrisation, Subject};

/// One measured scene: the volume that is fitted, its labels, and the parts to select.
struct Source {
    volume: &'static str,
    labels: &'static str,
    /// Size of a voxel; the files carry none.
    spacing: DVec3,
    /// Every so many voxels along each axis are used.
    stride: USizeVec3,
    /// Fit the box of the labels only, with this margin in voxels.
    margin: Option<usize>,
    /// Value and opacity, by rising value.
    points: &'static [(f64, f32)],
    /// Name and label of each target.
    targets: &'static [(&'static str, i32)],
}

const SOURCES: [Source; 2] = [
    Source {
        volume: "labels/frogtissue_labels_500x470x136_uint8.raw.zst",
        labels: "labels/frogtissue_labels_500x470x136_uint8.raw.zst",
        spacing: DVec3::new(1.0, 1.0, 1.5),
        stride: USizeVec3::new(2, 2, 1),
        margin: None,
        points: &[(0.0, 0.0), (0.5, 0.0), (0.5, 0.2), (29.0, 0.2)],
        targets: &[("frog liver", 10), ("frog stomach", 15)],
    },
    Source {
        volume: "labels/cit168_t1w_165x198x168_uint8.raw.zst",
        labels: "labels/cit168_labels_165x198x168_uint8.raw.zst",
        spacing: DVec3::ONE,
        stride: USizeVec3::ONE,
        margin: Some(4),
        points: &[(0.0, 0.0), (60.0, 0.01), (140.0, 0.05), (255.0, 0.10)],
        targets: &[("left putamen", 1), ("right caudate", 4)],
    },
];

/// The measured subjects of a folder of data, `n` Gaussians each; empty where their files are not there.
///
/// # Errors
/// [`EvalError`] if a file is there but cannot be used.
pub fn measured(data: &Path, n: usize, seed: u64, tell: &dyn Fn(&str)) -> Result<Vec<Subject>, EvalError> {
    let mut subjects = Vec::new();
    for source in &SOURCES {
        let (volume, labels) = (data.join(source.volume), data.join(source.labels));
        if !(volume.is_file() && labels.is_file()) {
            tell(&format!("SKIPPED: {} is not there", labels.display()));
            continue;
        }
        tell(&format!("fitting {}", source.targets[0].0));
        let wrong = |why: String| EvalError::Data { path: labels.display().to_string(), why };
        let read = |path: &Path| read_volume(path).map_err(|e| wrong(e.to_string()));
        let (values, truth) = (read(&volume)?, read(&labels)?);
        if values.grid().dims() != truth.grid().dims() {
            return Err(wrong("the labels are not those of the volume".to_owned()));
        }
        let (low, high) = source.margin.map_or_else(
            || (USizeVec3::ZERO, USizeVec3::from_array(truth.grid().dims())),
            |margin| labelled_box(&truth, margin),
        );
        let values = part_of(&values, low, high, source).map_err(wrong)?;
        let truth = part_of(&truth, low, high, source).map_err(wrong)?;
        let function = TransferFunction {
            domain: [source.points[0].0, source.points[source.points.len() - 1].0],
            units: sg_volume::transfer::Units::Raw,
            scale: sg_volume::transfer::Scale::Linear,
            variable: None,
            points: source
                .points
                .iter()
                .map(|&(value, opacity)| ControlPoint { value, color: [0.8, 0.7, 0.6], opacity })
                .collect(),
            base_units: Vec::new(),
        };
        let options = Options { gaussians: n, seed, ..Options::default() };
        let start = direct_start(&values.to_field(), &function, &options, |_| ()).map_err(|e| wrong(e.to_string()))?;
        let part = labels_of(&start.scene, &truth).map_err(|e| wrong(e.to_string()))?;
        for &(name, label) in source.targets {
            let target = part.iter().map(|p| *p == label).collect();
            subjects.push(Subject {
                name: name.to_owned(),
                origin: Origin::Measured,
                parametrisation: Parametrisation::Coherent,
                scene: start.scene.clone(),
                part: part.clone(),
                target,
            });
        }
    }
    Ok(subjects)
}

/// The box of all voxels with a label, least corner and one past the greatest.
fn labelled_box(labels: &Volume, margin: usize) -> (USizeVec3, USizeVec3) {
    let dims = USizeVec3::from_array(labels.grid().dims());
    let (mut low, mut high) = (dims, USizeVec3::ZERO);
    for i in 0..labels.grid().len() {
        if labels.scalars().get(i).is_some_and(|x| x > 0.0) {
            let v = labels.grid().voxel(i);
            low = low.min(v);
            high = high.max(v + 1);
        }
    }
    (low.saturating_sub(USizeVec3::splat(margin)), (high + margin).min(dims))
}

fn part_of(volume: &Volume, low: USizeVec3, high: USizeVec3, source: &Source) -> Result<Volume, String> {
    let axis = |a: usize| (low[a]..high[a]).step_by(source.stride[a]);
    let grid = volume.grid();
    let mut values: Vec<u8> = Vec::new();
    for z in axis(2) {
        for y in axis(1) {
            for x in axis(0) {
                values.push(volume.scalars().get(grid.index(x, y, z)).unwrap_or(0.0) as u8);
            }
        }
    }
    let dims = [axis(0).count(), axis(1).count(), axis(2).count()];
    let stride = source.stride;
    let spacing = source.spacing * DVec3::new(stride.x as f64, stride.y as f64, stride.z as f64);
    let grid = Grid::new(dims, spacing, DVec3::ZERO, glam::DMat3::IDENTITY).map_err(|e| e.to_string())?;
    Volume::new(grid, Scalars::from(values), None).map_err(|e| e.to_string())
}
