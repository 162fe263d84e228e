//! Reading a scene of any format.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat4, Vec3};

pub use crate::splat::LoadError;
use crate::splat::decode::{self, decode_unit};
use crate::splat::format::{Decoded, FolderContent, Listing, START_LENGTH, Source, UnitSource};
use crate::splat::{Format, Problem, Warning, WarningCode, palette};
use crate::validation::NonFiniteCounts;
use sg_input::{file, limits, unreadable};
use sg_scene::model::{BaseUnit, Convention, Scene, SceneBox, ShadingModel};
use sg_scene::orientation::Orientation;

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
/// Files of trained splats say nothing of their directions as a rule; then −y is up.
///
/// NaN and infinite values are kept and counted in the warnings. Units follow one another in the order of the scene file,
/// or of the folders' names. The box is the stored one, else that of the finite centres without unit transforms.
///
/// # Errors
/// [`LoadError`]: one line that names the file, the place in it and the remedy. Memory stays within a small multiple of the
/// files' sizes, even if a header announces more. A file that several units name is read once.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let source = open_source(path)?;
    let content = |problem| LoadError::Content { path: path.to_path_buf(), problem };
    // Any folder without a scene file could be one of iVR-GS.
    if source.folder.is_some_and(|folder| !folder.has_scene_file)
        && let Some(problem) = unreadable_problem(path)
    {
        return Err(content(problem));
    }
    let container = Format::detect(&source).map_err(|problem| content(unreadable_problem(path).unwrap_or(problem)))?;
    let listing = if source.is_ply() { Listing::of_file(path) } else { container.0.list(path)? };
    let mut reader = UnitReader::of(path, &listing.units, options)?;
    let (mut units, mut unit_formats, mut bounds): (Vec<BaseUnit>, _, _) = (Vec::new(), Vec::new(), None);
    let mut orientation = listing.orientation;
    for file in listing.units {
        let mut loaded = reader.load(&file)?;
        if let Some(folder_name) = file.name.filter(|_| units.iter().any(|u| u.name == loaded.unit.name)) {
            loaded.unit.name = folder_name;
        }
        bounds = bounds.or(loaded.bounds);
        if orientation == Orientation::default() {
            orientation = loaded.orientation;
        }
        unit_formats.push(loaded.format);
        units.push(loaded.unit);
    }
    let (format, bounds) =
        listing.scene.unwrap_or_else(|| (unit_formats.first().copied().unwrap_or(container), bounds));
    if orientation.patient.is_none() && !units.is_empty() && units.iter().all(BaseUnit::is_trained) {
        orientation = orientation.with_up(orientation.up.or(Orientation::OF_TRAINED.up));
    }
    let scene = Scene { orientation, ..Scene::compose(units, bounds) };
    let mut warnings = reader.warnings;
    if scene.is_empty() {
        warnings.push(Warning::new(WarningCode::Empty, "the scene holds no Gaussian"));
    }
    Ok(Loaded { scene, warnings, format, unit_formats })
}

/// The problem of a well-known format that has no reader.
fn unreadable_problem(path: &Path) -> Option<Problem> {
    unreadable::recognise(path).map(|found| Problem::new(found.place, found.what(), found.format.remedy))
}

/// The evidence of a path: its kind, its name, and the first bytes of a file.
fn open_source(path: &Path) -> Result<Source, LoadError> {
    let read = |source| LoadError::Read { path: path.to_path_buf(), source };
    let folder = std::fs::metadata(path)
        .map_err(read)?
        .is_dir()
        .then(|| FolderContent { has_scene_file: path.join("scene.toml").exists() });
    let mut start = Vec::new();
    if folder.is_none() {
        start = file::read_start(path, START_LENGTH).map_err(read)?;
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
    orientation: Orientation,
}

/// Device and inode of a file, and the convention that it is read with.
type Key = ((u64, u64), Option<Convention>);

/// Reads the units of a scene, one after another.
struct UnitReader<'a> {
    options: &'a LoadOptions,
    /// Units that are still to come, for each file.
    uses: HashMap<Key, usize>,
    /// Files that are named again.
    decoded: HashMap<Key, Decoded>,
    /// Palettes beside the files of units.
    palettes: HashMap<PathBuf, Option<Vec3>>,
    warnings: Vec<Warning>,
}

impl<'a> UnitReader<'a> {
    /// Counts the uses of each file. The scene at `path` may name a file again and again, but not without end.
    fn of(path: &Path, units: &[UnitSource], options: &'a LoadOptions) -> Result<Self, LoadError> {
        let mut reader =
            Self { options, uses: HashMap::new(), decoded: HashMap::new(), palettes: HashMap::new(), warnings: vec![] };
        let (mut once, mut all) = (0_u64, 0_u64);
        for unit in units.iter().filter(|_| units.len() > 1) {
            // A file that is not there is an error at its own turn.
            let Ok(metadata) = std::fs::metadata(&unit.path) else { continue };
            let uses = reader.uses.entry(reader.key(unit, file::identity_of(&metadata))).or_default();
            if *uses == 0 {
                once = once.saturating_add(metadata.len());
            }
            *uses += 1;
            all = all.saturating_add(metadata.len());
        }
        if all > limits::expanded(once) {
            let what = format!("they name files of {once} bytes again and again, {all} bytes in all");
            let problem = Problem::new("units", what, limits::remedy(all));
            return Err(LoadError::Content { path: path.to_path_buf(), problem });
        }
        Ok(reader)
    }

    fn key(&self, unit: &UnitSource, identity: (u64, u64)) -> Key {
        (identity, self.options.convention.or(unit.entry.as_ref().and_then(|e| e.convention)))
    }

    /// The Gaussians of a unit's file. Warnings about a file are given once.
    fn decode(&mut self, unit: &UnitSource, found: &mut Vec<Warning>) -> Result<Decoded, LoadError> {
        let path = &unit.path;
        let read = |source| LoadError::Read { path: path.clone(), source };
        let content = |problem| LoadError::Content { path: path.clone(), problem };
        let opened = file::open(path).map_err(read)?;
        let key = self.key(unit, opened.identity);
        let left = self.uses.get_mut(&key).map_or(0, |uses| {
            *uses = uses.saturating_sub(1);
            *uses
        });
        let shared = if left > 0 { self.decoded.get(&key).cloned() } else { self.decoded.remove(&key) };
        if let Some(decoded) = shared {
            return Ok(decoded);
        }
        let mut bytes = Vec::new();
        opened.read_until(&mut bytes, decode::HEAD_LENGTH, limits::DATA_BYTES).map_err(read)?;
        let start = bytes.iter().copied().take(START_LENGTH as usize).collect();
        let source = Source { name: lower_name(path), folder: None, start };
        let needed = decode::needed(&source, &bytes, opened.length).map_err(content)?;
        opened.read_until(&mut bytes, needed, limits::DATA_BYTES).map_err(read)?;
        let decoded = decode_unit(&source, (bytes, opened.length), key.1, found).map_err(content)?;
        found.extend(NonFiniteCounts::of(&decoded.gaussians).warnings());
        if left > 0 {
            self.decoded.insert(key, decoded.clone());
        }
        Ok(decoded)
    }

    /// The palette beside a PLY file, read once for each file.
    fn palette_beside(&mut self, ply: &Path) -> Result<Option<Vec3>, LoadError> {
        let Some(path) = palette_file(ply) else { return Ok(None) };
        if let Some(known) = self.palettes.get(&path) {
            return Ok(*known);
        }
        let palette = read_palette(&path)?;
        self.palettes.insert(path, palette);
        Ok(palette)
    }

    /// Reads one unit. The scene file's statements take precedence over the file's own.
    fn load(&mut self, unit: &UnitSource) -> Result<LoadedUnit, LoadError> {
        let mut found = Vec::new();
        let Decoded { gaussians, format, convention, comments } = self.decode(unit, &mut found)?;
        let UnitSource { path, entry, name: folder_name } = unit;
        let (entry, options) = (entry.as_ref(), self.options);
        let is_ivrgs = format.0.is_ivrgs();
        let palette = match options.palette.or(entry.and_then(|e| e.palette)).or(comments.palette) {
            _ if gaussians.shading.is_none() => Vec3::ZERO,
            Some(palette) => palette,
            None => match self.palette_beside(path)? {
                Some(palette) => palette,
                None => {
                    let message =
                        "no palette file lies beside it, so middle grey is used; --palette r,g,b overrides it";
                    found.push(Warning::new(WarningCode::Palette, message));
                    Vec3::splat(0.5)
                }
            },
        };
        let shading = options.shading.or(entry.and_then(|e| e.shading)).or(comments.shading);
        if is_ivrgs && shading.is_none() {
            let message =
                "it is drawn with one-sided shading; iVR-GS trains two-sided: --shading ivrgs-train draws that";
            found.push(Warning::new(WarningCode::Shading, message));
        }
        for warning in found {
            let warning = Warning { file: Some(path.to_path_buf()), ..warning };
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
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
            values: entry.and_then(|e| e.values),
            gaussians,
        };
        let orientation = comments.orientation.unwrap_or_default();
        Ok(LoadedUnit { unit, format, bounds: comments.bounds, orientation })
    }
}

fn read_palette(path: &Path) -> Result<Option<Vec3>, LoadError> {
    let bytes =
        file::read(path, palette::MAX_FILE).map_err(|source| LoadError::Read { path: path.to_path_buf(), source })?;
    palette::read(&bytes).map(Some).map_err(|problem| LoadError::Content { path: path.to_path_buf(), problem })
}

/// The palette of `palette_colors_chkpnt.pth`, or of the `.pth` with the PLY's own name, beside a PLY that does not hold it
/// itself.
pub(crate) fn palette_file(ply: &Path) -> Option<PathBuf> {
    [ply.with_file_name(palette::FILE_NAME), ply.with_extension("pth")].into_iter().find(|p| p.exists())
}
