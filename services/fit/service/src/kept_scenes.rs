//! A folder of scenes that were made from volumes: each under a key of its volume, its options and the fit's revision.
//!
//! `KEY/NAME/scene.toml` is a scene. The key stands for the values, the grid, the transfer function and the options. So
//! the same volume under another file name is not fitted again. A scene comes to its place whole, by a rename.

use std::fs::DirBuilder;
use std::io::{self, ErrorKind};
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use sg_fit::Options;
use sg_fit::direct::REVISION;
use sg_fit::label_units::LabelUnits;
use sg_formats::LoadOptions;
use sg_formats::files::short_name;
use sg_formats::staged_file::sync_folder;
use sg_scene::orientation::{Axis, LengthUnit, Orientation, PatientFrame};
use sg_volume::{ScalarFieldRef, TransferFunction};
use tempfile::TempDir;

/// Letters of a key.
const KEY: usize = 16;
/// Prefix of folders in which a scene is being written.
const STAGED: &str = ".staged-";
/// Age from which such a folder is the rest of a killed process.
const STALE: Duration = Duration::from_secs(24 * 3600);

/// The folder.
pub(crate) struct KeptScenes {
    folder: PathBuf,
}

/// A scene of the folder.
pub(crate) struct KeptScene {
    /// Its `scene.toml`.
    pub(crate) path: PathBuf,
    /// Number of Gaussians.
    pub(crate) gaussians: usize,
}

impl KeptScenes {
    pub(crate) fn new(folder: &Path) -> io::Result<Self> {
        Ok(Self { folder: std::path::absolute(folder)? })
    }

    /// The scene of a key, if it is there and can be loaded.
    pub(crate) fn find(&self, key: &str) -> Option<KeptScene> {
        let scenes = std::fs::read_dir(self.folder.join(key)).ok()?.flatten();
        let mut paths = scenes.map(|entry| entry.path().join("scene.toml")).filter(|path| path.is_file());
        let path = paths.next()?;
        let loaded = sg_formats::load(&path, &LoadOptions::default()).ok()?;
        Some(KeptScene { path, gaussians: loaded.scene.len() })
    }

    /// A folder for a new scene of this volume, beside the kept ones.
    pub(crate) fn stage(&self, volume: &Path) -> io::Result<StagedScene> {
        DirBuilder::new().recursive(true).mode(0o700).create(&self.folder)?;
        self.remove_stale();
        let staged = tempfile::Builder::new().prefix(STAGED).tempdir_in(&self.folder)?;
        let name = Some(short_name(volume)).filter(|name| !name.is_empty()).unwrap_or_else(|| "volume".to_owned());
        let folder = staged.path().join(&name);
        std::fs::create_dir(&folder)?;
        Ok(StagedScene { staged, folder, name })
    }

    /// Puts a written scene under its key. If another process was faster, its scene stays: it has the same content.
    pub(crate) fn keep(&self, scene: StagedScene, key: &str) -> io::Result<PathBuf> {
        let StagedScene { staged, folder, name } = scene;
        sync_folder(&folder.join("scene.toml"))?;
        sync_folder(&folder)?;
        let place = self.folder.join(key);
        let path = place.join(&name).join("scene.toml");
        match std::fs::rename(staged.path(), &place) {
            Ok(()) => {
                // Its name is gone with the rename.
                let _ = staged.keep();
            }
            Err(error) if is_taken(&error) => match self.find(key) {
                Some(kept) => return Ok(kept.path),
                // The rest of a scene, or a damaged one.
                None => {
                    std::fs::remove_dir_all(&place)?;
                    std::fs::rename(staged.path(), &place)?;
                    let _ = staged.keep();
                }
            },
            Err(error) => return Err(error),
        }
        sync_folder(&place)?;
        Ok(path)
    }

    /// Removes what killed processes left.
    fn remove_stale(&self) {
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            let age = entry.metadata().and_then(|m| m.modified()).ok().and_then(|at| at.elapsed().ok());
            if entry.file_name().to_string_lossy().starts_with(STAGED) && age.is_some_and(|age| age > STALE) {
                // A rest only takes disk space.
                let _ = std::fs::remove_dir_all(entry.path());
            }
        }
    }
}

/// A scene that is being written; it vanishes unless it is kept.
pub(crate) struct StagedScene {
    staged: TempDir,
    /// The folder to write to.
    pub(crate) folder: PathBuf,
    name: String,
}

fn is_taken(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::AlreadyExists | ErrorKind::DirectoryNotEmpty)
}

/// The key of a fit: 16 letters of a hash.
pub(crate) fn key<'a>(
    field: impl Into<ScalarFieldRef<'a>>,
    orientation: Orientation,
    function: &TransferFunction,
    options: &Options,
) -> Result<String, serde_json::Error> {
    Ok(hash(field, orientation, function, options)?.to_hex().chars().take(KEY).collect())
}

/// The digest of a volume under a transfer function.
pub(crate) fn digest<'a>(
    field: impl Into<ScalarFieldRef<'a>>,
    orientation: Orientation,
    function: &TransferFunction,
) -> Result<[u8; 32], serde_json::Error> {
    Ok(*hash(field, orientation, function, &Options::default())?.as_bytes())
}

fn hash<'a>(
    field: impl Into<ScalarFieldRef<'a>>,
    orientation: Orientation,
    function: &TransferFunction,
    options: &Options,
) -> Result<blake3::Hash, serde_json::Error> {
    let mut hasher = blake3::Hasher::new_derive_key("supergaussian scene of volume 1");
    hasher.update(&REVISION.to_le_bytes());
    let mut add = |bytes: [u8; 8]| {
        hasher.update(&bytes);
    };
    let (offset, values) = match field.into() {
        ScalarFieldRef::Grid(field) => {
            let grid = field.grid();
            grid.dims().into_iter().for_each(|size| add((size as u64).to_le_bytes()));
            let geometry = [grid.spacing(), grid.origin()].into_iter().flat_map(|v| v.to_array());
            geometry.chain(grid.direction().to_cols_array()).for_each(|number| add(number.to_le_bytes()));
            (field.offset(), field.values())
        }
        ScalarFieldRef::Mesh(field) => {
            add((field.cells().len() as u64).to_le_bytes());
            let places = std::iter::once(field.middle()).chain(field.points().iter().copied());
            places.flat_map(|place| place.to_array()).for_each(|number| add(number.to_le_bytes()));
            field.cells().iter().flatten().for_each(|point| add(u64::from(*point).to_le_bytes()));
            (field.offset(), field.values())
        }
    };
    for number in [offset, options.flattening, options.interior, options.hidden] {
        add(number.to_le_bytes());
    }
    // A scene without directions and unit keeps the key that it had before scenes stored them.
    if orientation != Orientation::default() {
        let Orientation { patient, unit, up } = orientation;
        let words = [patient.map(PatientFrame::name), unit.map(LengthUnit::name), up.map(Axis::name)];
        for word in words {
            hasher.update(word.unwrap_or("-").as_bytes()).update(b" ");
        }
    }
    hasher.update(&(options.gaussians as u64).to_le_bytes()).update(&options.seed.to_le_bytes());
    let function = function.to_json()?;
    hasher.update(&(function.len() as u64).to_le_bytes()).update(function.as_bytes());
    let mut bytes = Vec::with_capacity(4 << 16);
    for values in values.chunks(1 << 16) {
        bytes.clear();
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        hasher.update(&bytes);
    }
    Ok(hasher.finalize())
}

/// The key of a fit whose base units are labels, from [`key`] of its volume.
pub(crate) fn key_of_labels(key: &str, labels: &LabelUnits) -> String {
    let mut hasher = blake3::Hasher::new_derive_key("supergaussian scene of labels 1");
    hasher.update(key.as_bytes());
    for unit in labels.units() {
        hasher.update(&unit.label.to_le_bytes()).update(&(unit.name.len() as u64).to_le_bytes());
        hasher.update(unit.name.as_bytes()).update(&[u8::from(unit.color.is_some())]);
        unit.color.iter().flat_map(glam::Vec3::to_array).for_each(|channel| {
            hasher.update(&channel.to_le_bytes());
        });
    }
    hasher.update(&[u8::from(labels.stands_alone())]).update(labels.of_voxels());
    hasher.finalize().to_hex().chars().take(KEY).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_fit::direct_start;
    use sg_fit::label_units::Background;
    use sg_formats::SaveOptions;
    use sg_volume::Field;
    use sg_volume::phantom::{VesselTree, transfer_function};

    fn field(seed: u64) -> Field {
        VesselTree::new().rasterize(16, seed).unwrap().volume().unwrap().to_field()
    }

    #[test]
    fn a_key_stands_for_values_function_and_options() {
        let (function, options) = (transfer_function(), Options::default());
        let none = Orientation::default();
        let one = key(&field(1), none, &function, &options).unwrap();
        assert_eq!((one.len(), &one), (KEY, &key(&field(1), none, &function, &options).unwrap()));
        let mut narrow = function.clone();
        narrow.domain[1] *= 0.5;
        let patient = Orientation { patient: Some(PatientFrame::Lps), ..none };
        let others = [
            key(&field(1), patient, &function, &options),
            key(&field(2), none, &function, &options),
            key(&field(1), none, &narrow, &options),
            key(&field(1), none, &function, &Options { gaussians: 7, ..options }),
            key(&field(1), none, &function, &Options { seed: 7, ..options }),
            key(&field(1), none, &function, &Options { flattening: 0.5, ..options }),
            key(&field(1), none, &function, &Options { interior: 0.5, ..options }),
            key(&field(1), none, &function, &Options { hidden: 0.5, ..options }),
        ];
        for other in others {
            assert_ne!(other.unwrap(), one);
        }
    }

    #[test]
    fn a_key_stands_for_labels_with_their_names_and_colours() {
        let labels = VesselTree::new().rasterize(16, 1).unwrap().labels().unwrap();
        let table = sg_volume::LabelTable::default();
        let units = |background| LabelUnits::new(&labels, &table, background).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let named = |text: &str| {
            std::fs::write(dir.path().join("names.txt"), text).unwrap();
            let table = sg_volume::LabelTable::load(&dir.path().join("names.txt")).unwrap();
            LabelUnits::new(&labels, &table, Background::LeftOut).unwrap()
        };
        let all = [
            units(Background::LeftOut),
            units(Background::Rest),
            LabelUnits::alone(&labels, &table).unwrap(),
            named("1 0 0 0 1 1 1 \"sac\""),
            named("1 0 0 1 1 1 1 \"sac\""),
        ];
        let mut keys: Vec<String> = all.iter().map(|units| key_of_labels("0123456789abcdef", units)).collect();
        assert_eq!((keys[0].len(), &keys[0]), (KEY, &key_of_labels("0123456789abcdef", &all[0])));
        assert_ne!(keys[0], key_of_labels("f123456789abcdef", &all[0]));
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), all.len());
    }

    #[test]
    fn a_scene_is_kept_whole_once_and_repaired() {
        let home = tempfile::tempdir().unwrap();
        let kept = KeptScenes::new(&home.path().join("data/scenes")).unwrap();
        assert!(kept.find("k").is_none() && !home.path().join("data").exists(), "a look makes no folder");
        let options = Options { gaussians: 50, ..Options::default() };
        let scene = direct_start(&field(1), &transfer_function(), &options, |_| ()).unwrap().scene;
        let write = || {
            let staged = kept.stage(Path::new("/data/a heart.nrrd")).unwrap();
            sg_formats::save(&staged.folder.join("scene.toml"), &scene, &SaveOptions::default()).unwrap();
            staged
        };
        let path = kept.keep(write(), "k").unwrap();
        assert!(path.ends_with("scenes/k/a-heart/scene.toml"), "{}", path.display());
        let found = kept.find("k").unwrap();
        assert_eq!((&found.path, found.gaussians), (&path, scene.len()));
        // A second process with the same volume.
        let other = write();
        assert_eq!(kept.keep(other, "k").unwrap(), path);
        // A damaged scene is replaced.
        std::fs::write(&path, "schema = 99").unwrap();
        assert!(kept.find("k").is_none());
        kept.keep(write(), "k").unwrap();
        assert!(kept.find("k").is_some());
        drop(write());
        let names: Vec<_> = std::fs::read_dir(&kept.folder).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(names, ["k"]);
    }
}
