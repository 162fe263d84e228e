//! The arguments of a fit.

use std::path::PathBuf;

use clap::Args;
use glam::DVec3;
use sg_fit::{MAX_GAUSSIANS, Options};
use sg_input::print::status as print_line;
use sg_volume::suggestion::MOST_UNITS;
use sg_volume::{Limits, ReadOptions, SERIES_ENDINGS, TransferFunction, formats_help};

use crate::failure::{Failure, input};
use crate::training_run::TrainingArgs;

#[derive(Args)]
pub(crate) struct FitArgs {
    #[arg(required = true, value_name = "VOLUME", help = volume_help())]
    pub(crate) volumes: Vec<PathBuf>,
    /// Transfer function. Default: an automatic one from the histogram.
    #[arg(long, value_name = "TF.json")]
    pub(crate) transfer_function: Option<PathBuf>,
    /// Suggest base units, at most N: clusters of the volume's values and gradients. The transfer function with them is beside the
    /// scene, to be edited.
    #[arg(
        long,
        value_name = "N",
        num_args = 0..=1,
        default_missing_value = "6",
        value_parser = clap::value_parser!(u8).range(1..=MOST_UNITS as i64),
        conflicts_with_all = ["transfer_function", "start"]
    )]
    pub(crate) suggest_units: Option<u8>,
    /// Folder for scene.toml, the PLY files and the transfer function. The command creates it. Time steps get folders in it, and
    /// series.toml names them.
    #[arg(long, value_name = "DIR", required_unless_present = "keep_in")]
    pub(crate) out: Option<PathBuf>,
    /// Folder of kept scenes, in place of --out. A volume with the same options is not fitted again; the report names the
    /// scene.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "out_truth", "report"])]
    pub(crate) keep_in: Option<PathBuf>,
    /// Place Gaussians directly from the volume, without training.
    #[arg(long)]
    pub(crate) initial_only: bool,
    /// Scene of the same volume to train further, in place of a direct start: the `scene.toml` of an earlier run, or of the step
    /// before in a series.
    #[arg(long, value_name = "scene.toml", conflicts_with_all = ["initial_only", "gaussians", "flattening", "interior", "hidden"])]
    pub(crate) start: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) training: TrainingArgs,
    /// Write each step as a line `progress DONE OF STEP` to standard error.
    #[arg(long, hide = true)]
    pub(crate) progress_lines: bool,
    /// Largest number of Gaussians in all base units.
    #[arg(long, value_name = "N", default_value_t = Options::default().gaussians, value_parser = gaussians)]
    pub(crate) gaussians: usize,
    /// Seed of the placement. A seed gives the same scene on any number of threads.
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Thickness of Gaussians along the gradient at clear boundaries, relative to their cell. 1 does not flatten.
    #[arg(long, value_name = "F", default_value_t = Options::default().flattening, value_parser = flattening)]
    pub(crate) flattening: f64,
    /// Importance of what its own base unit hides, relative to what is seen. Fading and cuts show it. With 0 nothing is placed
    /// there.
    #[arg(long, value_name = "S", default_value_t = Options::default().interior, value_parser = importance)]
    pub(crate) interior: f64,
    /// Importance of values that the transfer function hides, relative to what it shows. Other transfer functions can show them
    /// then. With 0 nothing is placed there.
    #[arg(long, value_name = "S", default_value_t = Options::default().hidden, value_parser = importance)]
    pub(crate) hidden: f64,
    /// Millimetres between voxels along x, y and z, for raw volumes: they store none. Label volumes get the same.
    #[arg(long, value_name = "X,Y,Z", value_parser = spacing)]
    pub(crate) spacing: Option<DVec3>,
    /// Quantity to take, of a file that holds several. NAME:K is component K of a vector; NAME alone is its length. Default: that of the
    /// transfer function, or the first one.
    #[arg(long, value_name = "NAME")]
    pub(crate) variable: Option<String>,
    /// Series to take, of a folder of DICOM slices with several: its number from 1, as a note tells it. Default: that of the named
    /// file, or the largest one.
    #[arg(long, value_name = "N")]
    pub(crate) series: Option<usize>,
    /// JSON file for the report.
    #[arg(long, value_name = "R.json")]
    pub(crate) report: Option<PathBuf>,
    /// Label volume of the same place: for --label-units. --out-truth gets the label at each Gaussian's centre, and the report the
    /// scores of suggested base units against the labels.
    #[arg(long, value_name = "LABELVOLUME")]
    pub(crate) labels: Option<PathBuf>,
    /// Make each label a base unit: of --labels, on the grid of the volume, or of the volume itself, as a label map that stands
    /// alone. Opacities are those of the transfer function; alone, one for all. The scene is the direct start, without training.
    #[arg(
        long,
        conflicts_with_all = ["suggest_units", "start", "seconds", "iterations", "target_psnr", "views", "view_size"]
    )]
    pub(crate) label_units: bool,
    /// Names and colours of the labels: a label description file of ITK-SNAP. Default: those of the segments of a NRRD file by 3D
    /// Slicer, or `label 3` and colours for the colour-blind.
    #[arg(long, value_name = "NAMES.txt")]
    pub(crate) label_names: Option<PathBuf>,
    /// Make the voxels without a label the base unit `rest`. Without this they are left out.
    #[arg(long, requires = "labels")]
    pub(crate) rest_unit: bool,
    /// File for the labels of the Gaussians in scene order: int32 (n,), or uint8 0/1 with --truth-value.
    #[arg(long, value_name = "labels.npy", requires = "labels")]
    pub(crate) out_truth: Option<PathBuf>,
    /// Write 1 for the label K and 0 for other labels.
    #[arg(long, value_name = "K", requires = "labels", allow_negative_numbers = true)]
    pub(crate) truth_value: Option<i32>,
    /// Keep all rights of this user. Without this, the command can read and write its own files only, where the kernel has
    /// Landlock; a NRRD header can name data in its own folder only.
    #[arg(long)]
    pub(crate) unconfined: bool,
}

impl FitArgs {
    /// The options of direct starts.
    pub(crate) fn options(&self) -> Options {
        Options {
            gaussians: self.gaussians,
            seed: self.seed,
            flattening: self.flattening,
            interior: self.interior,
            hidden: self.hidden,
            ..Options::default()
        }
    }

    /// The transfer function of the command line, if there is one.
    pub(crate) fn given_function(&self) -> Result<Option<TransferFunction>, Failure> {
        let Some(file) = &self.transfer_function else { return Ok(None) };
        let loaded = TransferFunction::load(file).map_err(input)?;
        loaded.notes(file).for_each(|note| print_line(&note));
        Ok(Some(loaded.function))
    }

    /// How volumes are read, for this transfer function if one is given.
    pub(crate) fn read_options(&self, given: Option<&TransferFunction>) -> ReadOptions {
        ReadOptions {
            spacing: self.spacing,
            variable: self.variable.clone(),
            preferred: given.and_then(|function| function.variable.clone()),
            series: self.series,
            limits: Limits::default(),
        }
    }
}

fn volume_help() -> String {
    let series = SERIES_ENDINGS.map(|ending| format!("*{ending}")).join(", ");
    format!(
        "The volume, or all time steps of a series in their order. {series} name the steps of one. A folder of DICOM slices is one \
         volume. Formats: {}",
        formats_help()
    )
}

fn gaussians(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|n| (1..=MAX_GAUSSIANS).contains(n))
        .ok_or_else(|| format!("give a whole number from 1 to {MAX_GAUSSIANS}"))
}

fn flattening(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|&f| f > 0.0 && f <= 1.0).ok_or_else(|| "give a number above 0 and at most 1".to_owned())
}

fn importance(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s| (0.0..=1.0).contains(s)).ok_or_else(|| "give a number from 0 to 1".to_owned())
}

fn spacing(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|&s| s > 0.0 && s.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => Err("give three lengths above 0, such as 0.5,0.5,1.25".to_owned()),
    }
}
