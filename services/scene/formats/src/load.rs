//! Reading a scene, whatever it is stored as.

use std::io::{self, Read};
use std::path::{Path, PathBuf};

use glam::{DMat4, Vec3};

use crate::census::Census;
use crate::format::read::{Decoded, read_ply};
use crate::format::{Format, Problem, Warning, WarningCode, ivrgs_folder, palette};
use crate::scene_file::{SceneFile, SceneFileError, UnitEntry};
use sg_scene::model::{BaseUnit, Convention, Scene, SceneBox, ShadingModel};

/// What the caller knows better than the files.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LoadOptions {
    /// Activation of the shading columns of every file.
    pub convention: Option<Convention>,
    /// Shading model of every unit.
    pub shading: Option<ShadingModel>,
    /// Palette colour of every unit with shading columns.
    pub palette: Option<Vec3>,
}

/// A scene and what its reader took for granted.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// What was guessed, narrowed, passed over or not finite.
    pub warnings: Vec<Warning>,
    /// How the whole was stored.
    pub format: Format,
    /// How each unit was stored, in scene order.
    pub unit_formats: Vec<Format>,
}

/// A scene that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A file could not be read.
    #[error("{path}: {source}; give the path of a Gaussian file, a scene.toml or an iVR-GS output folder")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file's content cannot be used.
    #[error("{path}: {problem}")]
    Content {
        /// The file.
        path: PathBuf,
        /// Where and why.
        problem: Problem,
    },
    /// A `scene.toml` cannot be used.
    #[error(transparent)]
    SceneFile(#[from] SceneFileError),
}

/// Reads a scene: a `scene.toml` (or a folder with one), a PLY of any kind in [`crate::format`], or iVR-GS's output folder.
///
/// NaN and infinite values are kept and counted in the warnings. Units follow one another in the order of the scene file,
/// or of the folders' names; the box is the stored one, else that of the finite centres without unit transforms.
///
/// # Errors
/// [`LoadError`]: one line that names the file, the place in it and what to do. Memory stays within a small multiple of the
/// files' sizes, whatever their headers say.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let read = |source| LoadError::Read { path: path.to_path_buf(), source };
    if std::fs::metadata(path).map_err(read)?.is_dir() {
        let scene_file = path.join("scene.toml");
        return if scene_file.is_file() { load_scene_file(&scene_file, options) } else { load_folder(path, options) };
    }
    let mut start = Vec::new();
    std::fs::File::open(path).map_err(read)?.take(4).read_to_end(&mut start).map_err(read)?;
    if start.starts_with(b"ply") {
        return load_ply(path, options);
    }
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        return load_scene_file(path, options);
    }
    let problem = Problem::new(
        "byte 0",
        "the content is of no known format",
        "give a PLY (3DGS, compressed, iVR-GS or Super-Gaussian), a scene.toml, or an iVR-GS output folder",
    );
    Err(LoadError::Content { path: path.to_path_buf(), problem })
}

fn load_ply(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let mut warnings = Vec::new();
    let unit = load_unit(path, None, None, options, &mut warnings)?;
    Ok(finish(vec![unit.unit], unit.bounds, unit.format, vec![unit.format], warnings))
}

fn load_folder(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let found = ivrgs_folder::find(path).map_err(|problem| LoadError::Content { path: path.to_path_buf(), problem })?;
    let mut warnings = Vec::new();
    let (mut units, mut formats, mut bounds): (Vec<BaseUnit>, _, _) = (Vec::new(), Vec::new(), None);
    for (name, file) in found {
        let mut loaded = load_unit(&file, None, Some(&name), options, &mut warnings)?;
        if units.iter().any(|u| u.name == loaded.unit.name) {
            loaded.unit.name = name;
        }
        bounds = bounds.or(loaded.bounds);
        formats.push(loaded.format);
        units.push(loaded.unit);
    }
    let format = formats.first().copied().unwrap_or(Format::IvrGs);
    Ok(finish(units, bounds, format, formats, warnings))
}

fn load_scene_file(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let file = SceneFile::read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut warnings = Vec::new();
    let (mut units, mut formats) = (Vec::new(), Vec::new());
    for entry in &file.units {
        let loaded = load_unit(&folder.join(&entry.file), Some(entry), None, options, &mut warnings)?;
        formats.push(loaded.format);
        units.push(loaded.unit);
    }
    Ok(finish(units, file.bounds, Format::SceneToml, formats, warnings))
}

fn finish(
    units: Vec<BaseUnit>,
    bounds: Option<SceneBox>,
    format: Format,
    unit_formats: Vec<Format>,
    mut warnings: Vec<Warning>,
) -> Loaded {
    let scene = Scene::compose(units, bounds);
    if scene.is_empty() {
        warnings.push(Warning::new(WarningCode::Empty, "the scene holds no Gaussian"));
    }
    Loaded { scene, warnings, format, unit_formats }
}

struct LoadedUnit {
    unit: BaseUnit,
    format: Format,
    bounds: Option<SceneBox>,
}

/// Reads one unit's file. What the scene file says goes before what the file says of itself.
fn load_unit(
    path: &Path,
    entry: Option<&UnitEntry>,
    folder_name: Option<&str>,
    options: &LoadOptions,
    warnings: &mut Vec<Warning>,
) -> Result<LoadedUnit, LoadError> {
    let content = |problem| LoadError::Content { path: path.to_path_buf(), problem };
    let bytes = std::fs::read(path).map_err(|source| LoadError::Read { path: path.to_path_buf(), source })?;
    let forced = options.convention.or(entry.and_then(|e| e.convention));
    let mut told = Vec::new();
    let Decoded { gaussians, format, convention, comments } = read_ply(bytes, forced, &mut told).map_err(content)?;
    let is_ivrgs = matches!(format, Format::IvrGs | Format::IvrGsQuantised);
    let palette = match options.palette.or(entry.and_then(|e| e.palette)).or(comments.palette) {
        _ if gaussians.shading.is_none() => Vec3::ZERO,
        Some(palette) => palette,
        None => match palette_beside(path)? {
            Some(palette) => palette,
            None => {
                let message = "there is no palette beside it; middle grey was taken; --palette r,g,b says otherwise";
                told.push(Warning::new(WarningCode::Palette, message));
                Vec3::splat(0.5)
            }
        },
    };
    let shading = options.shading.or(entry.and_then(|e| e.shading)).or(comments.shading);
    if is_ivrgs && shading.is_none() {
        let message =
            "it is drawn with the paper's one-sided shading; iVR-GS trains two-sided, which `ivrgs-train` draws";
        told.push(Warning::new(WarningCode::Shading, message));
    }
    told.extend(Census::of(&gaussians).warnings());
    warnings.extend(told.into_iter().map(|w| Warning { file: Some(path.to_path_buf()), ..w }));
    let name = entry.map(|e| e.name.clone()).or(comments.name).unwrap_or_else(|| {
        let file_name = path.file_name().unwrap_or_default().to_string_lossy();
        let stem = file_name.strip_suffix(".ply").unwrap_or(&file_name);
        folder_name.unwrap_or(stem.strip_suffix(".compressed").unwrap_or(stem)).to_owned()
    });
    let unit = BaseUnit {
        name,
        file: Some(path.to_path_buf()),
        first: 0,
        palette,
        opacity: entry.map(|e| e.opacity).or(comments.opacity).unwrap_or(1.0),
        transform: entry.map(|e| e.transform).or(comments.transform).unwrap_or(DMat4::IDENTITY),
        convention,
        shading: shading.unwrap_or_default(),
        // iVR-GS trains normals against the depth seen from each camera, so they point outwards.
        oriented_normals: gaussians.shading.is_some()
            && entry.and_then(|e| e.oriented_normals).or(comments.oriented_normals).unwrap_or(is_ivrgs),
        transfer_function: entry.and_then(|e| e.transfer_function.clone()),
        gaussians,
    };
    Ok(LoadedUnit { unit, format, bounds: comments.bounds })
}

/// The palette of `palette_colors_chkpnt.pth`, or of the `.pth` with the PLY's own name, beside a PLY.
fn palette_beside(ply: &Path) -> Result<Option<Vec3>, LoadError> {
    let Some(path) = palette_file(ply) else { return Ok(None) };
    let read = |source| LoadError::Read { path: path.clone(), source };
    let content = |problem| LoadError::Content { path: path.clone(), problem };
    let mut bytes = Vec::new();
    let file = std::fs::File::open(&path).map_err(read)?;
    file.take(palette::MAX_FILE + 1).read_to_end(&mut bytes).map_err(read)?;
    if bytes.len() as u64 > palette::MAX_FILE {
        let what = format!("longer than {} bytes", palette::MAX_FILE);
        return Err(content(Problem::new("file", what, "a palette checkpoint is small: give --palette r,g,b")));
    }
    palette::read(&bytes).map(Some).map_err(content)
}

/// The file beside a PLY that holds its palette, where it does not hold it itself.
pub(crate) fn palette_file(ply: &Path) -> Option<PathBuf> {
    [ply.with_file_name(palette::FILE_NAME), ply.with_extension("pth")].into_iter().find(|p| p.is_file())
}
