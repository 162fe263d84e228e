//! Reading a scene of any format.

use std::io::Read;
use std::path::{Path, PathBuf};

use glam::{DMat4, Vec3};

pub use crate::splat::LoadError;
use crate::splat::decode::decode_unit;
use crate::splat::format::{Decoded, FolderContent, Listing, START_LENGTH, Source, UnitSource};
use crate::splat::{Format, Problem, Warning, WarningCode, palette};
use crate::validation::NonFiniteCounts;
use sg_scene::model::{BaseUnit, Convention, Scene, SceneBox, ShadingModel};

/// Properties that override those of the files.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LoadOptions {
    /// Activation of the shading columns of every file.
    pub convention: Option<Convention>,
    /// Shading model of every unit.
    pub shading: Option<ShadingModel>,
    /// Palette colour of every unit with shading columns.
    pub palette: Option<Vec3>,
}

/// A scene, and the warnings of its reader.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Guesses, narrowed values, ignored parts and non-finite numbers.
    pub warnings: Vec<Warning>,
    /// The format of the scene.
    pub format: Format,
    /// The format of each unit, in scene order.
    pub unit_formats: Vec<Format>,
}

/// Reads a scene of any format in [`crate::splat`].
///
/// NaN and infinite values are kept and counted in the warnings. Units follow one another in the order of the scene file,
/// or of the folders' names. The box is the stored one, else that of the finite centres without unit transforms.
///
/// # Errors
/// [`LoadError`]: one line that names the file, the place in it and the remedy. Memory stays within a small multiple of the
/// files' sizes, even if a header announces more.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let source = open_source(path)?;
    let container =
        Format::detect(&source).map_err(|problem| LoadError::Content { path: path.to_path_buf(), problem })?;
    let listing = if source.is_ply() { Listing::of_file(path) } else { container.0.list(path)? };
    let mut warnings = Vec::new();
    let (mut units, mut unit_formats, mut bounds): (Vec<BaseUnit>, _, _) = (Vec::new(), Vec::new(), None);
    for file in listing.units {
        let mut loaded = load_unit(&file, options, &mut warnings)?;
        if let Some(folder_name) = file.name.filter(|_| units.iter().any(|u| u.name == loaded.unit.name)) {
            loaded.unit.name = folder_name;
        }
        bounds = bounds.or(loaded.bounds);
        unit_formats.push(loaded.format);
        units.push(loaded.unit);
    }
    let (format, bounds) =
        listing.scene.unwrap_or_else(|| (unit_formats.first().copied().unwrap_or(container), bounds));
    let scene = Scene::compose(units, bounds);
    if scene.is_empty() {
        warnings.push(Warning::new(WarningCode::Empty, "the scene holds no Gaussian"));
    }
    Ok(Loaded { scene, warnings, format, unit_formats })
}

/// The evidence of a path: its kind, its name, and the first bytes of a file.
fn open_source(path: &Path) -> Result<Source, LoadError> {
    let read = |source| LoadError::Read { path: path.to_path_buf(), source };
    let folder = std::fs::metadata(path)
        .map_err(read)?
        .is_dir()
        .then(|| FolderContent { has_scene_file: path.join("scene.toml").is_file() });
    let mut start = Vec::new();
    if folder.is_none() {
        std::fs::File::open(path).map_err(read)?.take(START_LENGTH).read_to_end(&mut start).map_err(read)?;
    }
    Ok(Source { name: lower_name(path), folder, start })
}

fn lower_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().to_lowercase()
}

struct LoadedUnit {
    unit: BaseUnit,
    format: Format,
    bounds: Option<SceneBox>,
}

/// Reads one unit's file. The scene file's statements take precedence over the file's own.
fn load_unit(file: &UnitSource, options: &LoadOptions, warnings: &mut Vec<Warning>) -> Result<LoadedUnit, LoadError> {
    let UnitSource { path, entry, name: folder_name } = file;
    let entry = entry.as_ref();
    let content = |problem| LoadError::Content { path: path.clone(), problem };
    let bytes = std::fs::read(path).map_err(|source| LoadError::Read { path: path.to_path_buf(), source })?;
    let forced = options.convention.or(entry.and_then(|e| e.convention));
    let mut found = Vec::new();
    let start = bytes.iter().copied().take(START_LENGTH as usize).collect();
    let source = Source { name: lower_name(path), folder: None, start };
    let Decoded { gaussians, format, convention, comments } =
        decode_unit(&source, bytes, forced, &mut found).map_err(content)?;
    let is_ivrgs = format.0.is_ivrgs();
    let palette = match options.palette.or(entry.and_then(|e| e.palette)).or(comments.palette) {
        _ if gaussians.shading.is_none() => Vec3::ZERO,
        Some(palette) => palette,
        None => match palette_beside(path)? {
            Some(palette) => palette,
            None => {
                let message = "no palette file lies beside it, so middle grey is used; --palette r,g,b overrides it";
                found.push(Warning::new(WarningCode::Palette, message));
                Vec3::splat(0.5)
            }
        },
    };
    let shading = options.shading.or(entry.and_then(|e| e.shading)).or(comments.shading);
    if is_ivrgs && shading.is_none() {
        let message = "it is drawn with one-sided shading; iVR-GS trains two-sided: --shading ivrgs-train draws that";
        found.push(Warning::new(WarningCode::Shading, message));
    }
    found.extend(NonFiniteCounts::of(&gaussians).warnings());
    warnings.extend(found.into_iter().map(|w| Warning { file: Some(path.to_path_buf()), ..w }));
    let name = entry.map(|e| e.name.clone()).or(comments.name).unwrap_or_else(|| {
        let file_name = path.file_name().unwrap_or_default().to_string_lossy();
        let stem = format.extensions().iter().find_map(|e| file_name.strip_suffix(e)).unwrap_or(&file_name);
        let stem = stem.strip_suffix(".compressed").unwrap_or(stem);
        folder_name.clone().unwrap_or_else(|| stem.to_owned())
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

/// The file beside a PLY that holds its palette, if the PLY does not hold it itself.
pub(crate) fn palette_file(ply: &Path) -> Option<PathBuf> {
    [ply.with_file_name(palette::FILE_NAME), ply.with_extension("pth")].into_iter().find(|p| p.is_file())
}
