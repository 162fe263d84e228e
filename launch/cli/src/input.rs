//! Inputs of the demo: a synthetic volume, a volume file, or a scene.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::Value;
use sg_formats::Format;
use sg_input::{file, unreadable};
use sg_volume::is_volume;

use crate::opening_window::{OpeningWindow, PREPARED};
use crate::subcommands::{json_of, json_watched};
use crate::terminal::{self, Failure};

/// Default number of Gaussians for a volume.
pub(crate) const GAUSSIANS: u32 = 100_000;

/// Voxels along each edge of the synthetic volume.
const SYNTHETIC_SIZE: &str = "128";
/// Ending of a project's file.
const PROJECT: &str = "sgproj";
/// Volumes with shipped scripts, by the beginning of their file names.
pub(crate) const SHIPPED_VOLUMES: [&str; 3] = ["bonsai", "aneurism", "tooth"];

/// The input, as the user named it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Input {
    /// No file: a synthetic vessel tree.
    Synthetic,
    /// A volume.
    Volume(PathBuf),
    /// A scene file or folder.
    Scene(PathBuf),
    /// A project, with the edits of a scene.
    Project(PathBuf),
}

/// A scene that is ready to open.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Scene {
    /// Its file, absolute.
    pub(crate) path: PathBuf,
    /// Seconds from volume to Gaussians, for a volume.
    pub(crate) fit_seconds: Option<f64>,
}

impl Input {
    /// Tells scenes from volumes by the extension, and DICOM slices by their content. The tables in `sg-formats` and `sg-volume` are the only lists of files that can
    /// be read, so this program links them, as the window does for dropped files.
    ///
    /// # Errors
    /// [`Failure::Input`] for a path without a file or folder, and for a well-known format that cannot be read.
    pub(crate) fn of(path: Option<&Path>) -> Result<Self, Failure> {
        let Some(path) = path else { return Ok(Self::Synthetic) };
        let refuse = |path: &Path, why: &dyn std::fmt::Display| Failure::Input(format!("{}: {why}", path.display()));
        let path = std::fs::canonicalize(path).map_err(|e| refuse(path, &e))?;
        file::check_file_or_folder(&path).map_err(|e| refuse(&path, &e))?;
        if path.extension().is_some_and(|ending| ending == PROJECT) {
            return Ok(Self::Project(path));
        }
        let is_volume = is_volume(&path);
        let is_scene = !is_volume && Format::is_scene_path(&path);
        if !is_volume
            && !is_certain(&path, is_scene)
            && let Some(found) = unreadable::recognise(&path)
        {
            return Err(refuse(&path, &found));
        }
        Ok(if is_scene { Self::Scene(path) } else { Self::Volume(path) })
    }

    /// The name in [`SHIPPED_VOLUMES`], if it is one of these.
    pub(crate) fn shipped_name(&self) -> Option<&'static str> {
        match self {
            Self::Synthetic => Some("vessel"),
            Self::Scene(_) | Self::Project(_) => None,
            Self::Volume(path) => {
                let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
                SHIPPED_VOLUMES.into_iter().find(|known| name.starts_with(known))
            }
        }
    }

    /// Makes the scene from the volume, if necessary.
    pub(crate) fn scene(
        &self,
        out: &Path,
        function: Option<&Path>,
        gaussians: u32,
        seed: u64,
    ) -> Result<Scene, Failure> {
        let volume = match self {
            Self::Scene(path) => return Ok(Scene { path: path.clone(), fit_seconds: None }),
            Self::Volume(path) => path.clone(),
            Self::Synthetic => return make_synthetic(out, function, gaussians, seed),
            Self::Project(path) => return scene_of_project(path),
        };
        fit(&volume, FitTo::Folder(&out.join("scene")), function, (gaussians, seed))
    }

    /// The scene of a scene file, of a project or of a volume. That of a volume is kept where the user's projects are, so it is made once.
    ///
    /// The Gaussians are the same each time, so that earlier edits fit.
    ///
    /// `window` shows the progress. `None`: a person has cancelled there.
    pub(crate) fn kept_scene(
        &self,
        function: Option<&Path>,
        options: &VolumeOptions,
        window: &mut OpeningWindow,
    ) -> Result<Option<Scene>, Failure> {
        let volume = match self {
            Self::Scene(path) | Self::Project(path) if !options.given().is_empty() => {
                let names: Vec<&str> = options.given().into_iter().map(|(name, _)| name).collect();
                let what = "only for volumes and meshes, and this is none; leave it out";
                return Err(Failure::Input(format!("{}: {}: {what}", path.display(), names.join(", "))));
            }
            Self::Scene(path) => return Ok(Some(Scene { path: path.clone(), fit_seconds: None })),
            Self::Volume(path) => path,
            Self::Project(path) => return scene_of_project(path).map(Some),
            Self::Synthetic => return Err(Failure::Input("name a volume or a scene".to_owned())),
        };
        let places = json_of("scene", &["projects".as_ref(), "folders".as_ref()])?;
        let folder = places.get("scenes").and_then(Value::as_str);
        let folder =
            folder.ok_or_else(|| Failure::Work("`supergaussian scene` names no folder of scenes".to_owned()))?;
        // A person's own transfer function goes before a shipped one.
        let function = function.filter(|_| options.transfer_function.is_none() && !options.stands_alone());
        let fit = Fit::of(volume, FitTo::Kept(Path::new(folder)), function, (GAUSSIANS, 0));
        let watch = |news: Option<&str>| {
            if let Some((share, step)) = news.and_then(step) {
                window.tell(PREPARED * share, step);
            }
            !window.is_cancelled()
        };
        fit.watched(options, watch)
    }
}

/// The scene that a project is of.
fn scene_of_project(project: &Path) -> Result<Scene, Failure> {
    let found = json_of("scene", &["projects".as_ref(), "describe".as_ref(), project.as_os_str()])?;
    let path = found.get("scene").and_then(Value::as_str).map(PathBuf::from);
    let path = path.ok_or_else(|| Failure::Work("`supergaussian scene` names no scene".to_owned()))?;
    if path.exists() {
        return Ok(Scene { path, fit_seconds: None });
    }
    let gone =
        "its scene is gone; open a copy of that, or write the project with `supergaussian scene convert --scene`";
    Err(Failure::Input(format!("{}: {} {gone}", project.display(), path.display())))
}

/// Whether the name alone tells a scene. Content does not decide then.
fn is_certain(path: &Path, is_scene: bool) -> bool {
    // A folder without a scene file may hold the slices of another format.
    is_scene && (!path.is_dir() || path.join("scene.toml").exists())
}

/// How a volume or a mesh becomes a scene, as a person says it: options of `fit`.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct VolumeOptions {
    /// Millimetres between the voxels of a raw volume along x, y and z
    #[arg(long, value_name = "X,Y,Z")]
    spacing: Option<String>,
    /// Quantity of a file that holds several: NAME, or NAME:K for component K of a vector
    #[arg(long, value_name = "NAME")]
    variable: Option<String>,
    /// Series of a folder of DICOM slices with several: its number, as a note tells it. Default: the largest
    #[arg(long, value_name = "N")]
    series: Option<String>,
    /// Transfer function of a volume. Default: one from the histogram
    #[arg(long, value_name = "TF.json")]
    transfer_function: Option<PathBuf>,
    /// Importance of values that the transfer function hides, 0 to 1: other transfer functions can show them then
    #[arg(long, value_name = "S")]
    hidden: Option<String>,
    /// Make each label a unit: of --labels, or of the volume itself as a label map
    #[arg(long)]
    label_units: bool,
    /// Label map on the grid of the volume, for --label-units
    #[arg(long, value_name = "LABELVOLUME", requires = "label_units")]
    labels: Option<PathBuf>,
    /// Names and colours of the labels: a label description file of ITK-SNAP
    #[arg(long, value_name = "NAMES.txt", requires = "label_units")]
    label_names: Option<PathBuf>,
    /// Make the voxels without a label the unit `rest`
    #[arg(long, requires = "labels")]
    rest_unit: bool,
}

impl VolumeOptions {
    /// Whether the volume is a label map, to which no transfer function belongs.
    fn stands_alone(&self) -> bool {
        self.label_units && self.labels.is_none()
    }

    /// The given ones: names, and values except for flags.
    fn given(&self) -> Vec<(&'static str, Option<&OsStr>)> {
        let values = [
            ("--spacing", self.spacing.as_deref().map(OsStr::new)),
            ("--variable", self.variable.as_deref().map(OsStr::new)),
            ("--series", self.series.as_deref().map(OsStr::new)),
            ("--transfer-function", self.transfer_function.as_deref().map(Path::as_os_str)),
            ("--hidden", self.hidden.as_deref().map(OsStr::new)),
            ("--labels", self.labels.as_deref().map(Path::as_os_str)),
            ("--label-names", self.label_names.as_deref().map(Path::as_os_str)),
        ];
        let flags = [("--label-units", self.label_units), ("--rest-unit", self.rest_unit)];
        let values = values.into_iter().filter_map(|(name, value)| Some((name, Some(value?))));
        let flags = flags.into_iter().filter(|(_, is_given)| *is_given).map(|(name, _)| (name, None));
        values.chain(flags).collect()
    }
}

/// Where a fit puts its scene.
#[derive(Clone, Copy)]
enum FitTo<'a> {
    /// Into this folder.
    Folder(&'a Path),
    /// Into a folder of kept scenes, unless it is there already.
    Kept(&'a Path),
}

fn make_synthetic(out: &Path, function: Option<&Path>, gaussians: u32, seed: u64) -> Result<Scene, Failure> {
    let folder = out.join("volume");
    terminal::print_status(&format!("making a synthetic vessel tree with an aneurysm, {SYNTHETIC_SIZE}³ voxels"));
    let truth = fit_command(&[
        "phantom".as_ref(),
        "--out".as_ref(),
        folder.as_os_str(),
        "--size".as_ref(),
        SYNTHETIC_SIZE.as_ref(),
        "--seed".as_ref(),
        seed.to_string().as_ref(),
        "--json".as_ref(),
    ])?;
    let file = |key: &str| {
        let name = truth.get(key).and_then(Value::as_str);
        name.map(|n| folder.join(n)).ok_or_else(|| Failure::Work(format!("the synthetic volume has no `{key}`")))
    };
    let own = file("transfer_function")?;
    let to = out.join("scene");
    fit(&file("volume")?, FitTo::Folder(&to), Some(function.unwrap_or(&own)), (gaussians, seed))
}

/// Runs `supergaussian fit` to its end.
fn fit(volume: &Path, to: FitTo<'_>, function: Option<&Path>, amount: (u32, u64)) -> Result<Scene, Failure> {
    let fit = Fit::of(volume, to, function, amount);
    fit.announced();
    fit.scene(&fit_command(&fit.arguments())?)
}

/// A call of `supergaussian fit`.
struct Fit<'a> {
    volume: &'a Path,
    to: FitTo<'a>,
    function: Option<&'a Path>,
    gaussians: String,
    seed: String,
    began: Instant,
}

impl<'a> Fit<'a> {
    fn of(volume: &'a Path, to: FitTo<'a>, function: Option<&'a Path>, (gaussians, seed): (u32, u64)) -> Self {
        let (gaussians, seed) = (gaussians.to_string(), seed.to_string());
        Self { volume, to, function, gaussians, seed, began: Instant::now() }
    }

    fn announced(&self) {
        terminal::print_status(&format!("placing Gaussians in {}", self.volume.display()));
    }

    fn arguments(&self) -> Vec<&OsStr> {
        let (option, folder) = match self.to {
            FitTo::Folder(folder) => ("--out", folder),
            FitTo::Kept(folder) => ("--keep-in", folder),
        };
        let mut arguments = vec![
            self.volume.as_os_str(),
            "--initial-only".as_ref(),
            option.as_ref(),
            folder.as_os_str(),
            "--gaussians".as_ref(),
            self.gaussians.as_ref(),
            "--seed".as_ref(),
            self.seed.as_ref(),
            "--json".as_ref(),
        ];
        if let Some(function) = self.function {
            arguments.extend(["--transfer-function".as_ref(), function.as_os_str()]);
        }
        arguments
    }

    /// Runs it with `watch` at each of its steps. `None`: `watch` has returned `false`.
    fn watched(
        &self,
        options: &VolumeOptions,
        watch: impl FnMut(Option<&str>) -> bool,
    ) -> Result<Option<Scene>, Failure> {
        let mut arguments = self.arguments();
        arguments.push("--progress-lines".as_ref());
        for (option, value) in options.given() {
            arguments.push(OsStr::new(option));
            arguments.extend(value);
        }
        self.announced();
        json_watched("fit", &arguments, watch)?.map(|report| self.scene(&report)).transpose()
    }

    /// The scene of its report.
    fn scene(&self, report: &Value) -> Result<Scene, Failure> {
        let fit_seconds = self.began.elapsed().as_secs_f64();
        let placed = report.get("gaussians").and_then(Value::as_u64).unwrap_or(0);
        let placed = terminal::format_count(placed);
        if report.get("kept") == Some(&Value::Bool(true)) {
            terminal::print_status(&format!("{placed} Gaussians, kept from an earlier time"));
        } else {
            terminal::print_status(&format!("{placed} Gaussians after {fit_seconds:.1} s"));
        }
        let path = report.get("scene").and_then(Value::as_str).map(PathBuf::from);
        let path = path.ok_or_else(|| Failure::Work("`supergaussian fit` names no scene".to_owned()))?;
        Ok(Scene { path, fit_seconds: Some(fit_seconds) })
    }
}

/// The share and the step of a line `DONE OF STEP`.
fn step(news: &str) -> Option<(f32, &str)> {
    let mut parts = news.splitn(3, ' ');
    let mut number = || parts.next()?.parse::<f32>().ok();
    let (done, of) = (number()?, number()?);
    Some((done / of.max(1.0), parts.next()?))
}

/// Runs `supergaussian fit` and returns its report.
fn fit_command(arguments: &[&OsStr]) -> Result<Value, Failure> {
    json_of("fit", arguments)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_recognized_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let kind = |name: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, "").unwrap();
            Input::of(Some(&path)).unwrap()
        };
        assert!(matches!(kind("a.compressed.ply"), Input::Scene(_)));
        assert!(matches!(kind("a.splat"), Input::Scene(_)));
        assert!(matches!(kind("scene.toml"), Input::Scene(_)));
        assert_eq!(kind("Bonsai_256x256x256_uint8.raw.zst").shipped_name(), Some("bonsai"));
        assert_eq!(kind("tooth.nrrd").shipped_name(), Some("tooth"));
        assert_eq!(kind("skull.nrrd").shipped_name(), None);
        assert_eq!(Input::of(None).unwrap().shipped_name(), Some("vessel"));
        let absent = Input::of(Some(&folder.path().join("none.raw"))).unwrap_err();
        assert!(matches!(absent, Failure::Input(_)));
    }

    #[test]
    fn steps_of_a_fit_have_a_share() {
        assert_eq!(step("1 4 classifying voxels"), Some((0.25, "classifying voxels")));
        assert_eq!((step("soon"), step("1 4")), (None, None));
    }

    #[test]
    fn unreadable_formats_are_named_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        let gzip = folder.path().join("brain.nii.gz");
        std::fs::write(&gzip, b"\x1f\x8b\x08").unwrap();
        assert!(matches!(Input::of(Some(&gzip)).unwrap(), Input::Volume(_)));
        for (name, content, said) in
            [("cells.h5", &b""[..], "HDF5 cannot be read; "), ("IM0001", b"\x89HDF\r\n\x1a\n", "HDF5 cannot be read; ")]
        {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            let Err(Failure::Input(line)) = Input::of(Some(&path)) else { panic!("{name} is taken") };
            assert!(line.contains(said), "{line}");
        }
    }

    #[test]
    fn slices_of_dicom_are_a_volume_alone_and_in_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let slice = folder.path().join("IM0001");
        std::fs::write(&slice, [&[0; 128][..], b"DICM"].concat()).unwrap();
        let named = folder.path().join("slice.dcm");
        std::fs::write(&named, "").unwrap();
        for path in [slice.as_path(), &named, folder.path()] {
            assert!(matches!(Input::of(Some(path)).unwrap(), Input::Volume(_)), "{}", path.display());
        }
        std::fs::write(folder.path().join("scene.toml"), "").unwrap();
        assert!(matches!(Input::of(Some(folder.path())).unwrap(), Input::Scene(_)));
    }
}
