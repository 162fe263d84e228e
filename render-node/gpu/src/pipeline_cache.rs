//! Compiled pipelines, kept on disk from one start to the next.
//!
//! A driver compiles shaders to programs of the device, for seconds in all. It gives these programs as bytes that only the same
//! driver on the same kind of device reads. A file holds a BLAKE3 hash of the bytes, then the bytes. Drivers trust their own
//! bytes, so a damaged file is ignored.

use std::fs::{self, DirBuilder, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use blake3::Hash;
use sg_input::file;

use crate::trusted;

/// Folder of the files of all devices that this process opens.
static FOLDER: OnceLock<PathBuf> = OnceLock::new();

/// Limit of a file, bytes. A larger one is made anew.
const LIMIT: u64 = 256 << 20;

/// Bytes of the hash at the begin of a file.
const HASH_BYTES: usize = blake3::OUT_LEN;

/// Keeps the compiled pipelines of all devices that this process opens from now on in a folder of the user's cache. Only the
/// first call counts.
pub fn keep_pipelines_in(folder: PathBuf) {
    let _ = FOLDER.set(folder);
}

/// The folder of this process, if it has one.
pub(super) fn folder() -> Option<&'static Path> {
    FOLDER.get().map(PathBuf::as_path)
}

/// A device's compiled pipelines with their file.
#[derive(Debug)]
pub(super) struct KeptPipelines {
    pub(super) cache: wgpu::PipelineCache,
    path: PathBuf,
    /// Whether an earlier start has left a sound file.
    pub(super) is_loaded: bool,
    /// Number of pipelines made so far.
    made: AtomicU64,
    stored: Mutex<Stored>,
}

/// Content of the file.
#[derive(Debug)]
struct Stored {
    hash: Option<Hash>,
    /// Number of pipelines made when it was last looked at.
    made: u64,
}

impl KeptPipelines {
    /// Loads the file of a device from a folder. `None` for a device whose driver keeps no pipelines.
    pub(super) fn load(device: &wgpu::Device, info: &wgpu::AdapterInfo, folder: &Path) -> Option<Self> {
        if !device.features().contains(wgpu::Features::PIPELINE_CACHE) {
            return None;
        }
        let path = folder.join(wgpu::util::pipeline_cache_key(info)?);
        let stored = read(&path).unwrap_or_else(|error| {
            tracing::warn!("{}: {error}, so pipelines are compiled anew", path.display());
            None
        });
        let (bytes, hash) = stored.map_or((None, None), |(bytes, hash)| (Some(bytes), Some(hash)));
        let cache = trusted::pipeline_cache(device, bytes.as_deref());
        let stored = Mutex::new(Stored { hash, made: 0 });
        Some(Self { cache, path, is_loaded: hash.is_some(), made: AtomicU64::new(0), stored })
    }

    /// Counts a pipeline.
    pub(super) fn count(&self) {
        self.made.fetch_add(1, Ordering::Relaxed);
    }

    /// Writes the file if pipelines were made since the last call, and their bytes differ. Returns whether it did.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn save(&self) -> io::Result<bool> {
        let mut stored = self.stored.lock().unwrap_or_else(PoisonError::into_inner);
        let made = self.made.load(Ordering::Relaxed);
        if made == stored.made {
            return Ok(false);
        }
        stored.made = made;
        let Some(bytes) = self.cache.get_data().filter(|bytes| (bytes.len() as u64) < LIMIT - HASH_BYTES as u64) else {
            return Ok(false);
        };
        let hash = blake3::hash(&bytes);
        if stored.hash == Some(hash) {
            return Ok(false);
        }
        write(&self.path, &bytes, hash)
            .map_err(|e| io::Error::new(e.kind(), format!("{}: {e}", self.path.display())))?;
        stored.hash = Some(hash);
        Ok(true)
    }
}

/// The bytes of a file and their hash; `None` without a file.
fn read(path: &Path) -> io::Result<Option<(Vec<u8>, Hash)>> {
    let whole = match file::read(path, LIMIT) {
        Ok(whole) => whole,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let damaged = || io::Error::other("the file is damaged");
    let (hash, bytes) = whole.split_first_chunk::<HASH_BYTES>().ok_or_else(damaged)?;
    let hash = Hash::from_bytes(*hash);
    if blake3::hash(bytes) != hash {
        return Err(damaged());
    }
    Ok(Some((bytes.to_vec(), hash)))
}

/// Writes a file of this user alone, whole or not at all.
fn write(path: &Path, bytes: &[u8], hash: Hash) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    let unfinished = path.with_extension(format!("{}.unfinished", std::process::id()));
    let written = (|| {
        let mut to = OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&unfinished)?;
        to.write_all(hash.as_bytes())?;
        to.write_all(bytes)?;
        fs::rename(&unfinished, path)
    })();
    if written.is_err() {
        let _ = fs::remove_file(&unfinished);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::pipeline::Kernel;
    use crate::shader::Shader;

    /// A device whose pipelines are kept in a folder, with one pipeline of its own. Returns whether it loaded a file, and
    /// whether it wrote one.
    fn start(folder: &Path, number: u32) -> Option<(bool, bool)> {
        let gpu = test_device()?;
        // Some drivers keep none.
        let is_loaded = gpu.keep_pipelines(folder)?;
        let text = format!(
            "@group(0) @binding(0) var<storage, read_write> made: array<u32>;
             @compute @workgroup_size(1) fn fill() {{ made[0] = {number}u; }}"
        );
        Kernel::new(&gpu, &Shader::new(&gpu, "test", &[&text]), "fill", &[]);
        gpu.check().unwrap();
        let is_saved = gpu.save_pipelines().unwrap();
        // Nothing was made since.
        assert!(!gpu.save_pipelines().unwrap());
        Some((is_loaded, is_saved))
    }

    #[test]
    fn a_second_start_loads_what_the_first_one_compiled() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("pipelines");
        let Some(first) = start(&inside, 1) else { return };
        assert_eq!(first, (false, true));
        let entries: Vec<_> = fs::read_dir(&inside).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(entries.len(), 1, "{entries:?}");
        assert!(start(&inside, 1).unwrap().0, "the second start did not load it");
        // A damaged, a short and a foreign file are ignored, and replaced.
        let whole = fs::read(&entries[0]).unwrap();
        let mut damaged = whole.clone();
        *damaged.last_mut().unwrap() ^= 1;
        for broken in [damaged, whole[..40].to_vec(), Vec::new(), vec![7; 4096]] {
            fs::write(&entries[0], broken).unwrap();
            assert_eq!(start(&inside, 1), Some((false, true)));
            assert!(start(&inside, 1).unwrap().0);
        }
        // A folder that cannot be made is an error with its path.
        let gpu = test_device().unwrap();
        gpu.keep_pipelines(&entries[0].join("below")).unwrap();
        Kernel::new(&gpu, &Shader::new(&gpu, "test", &["@compute @workgroup_size(1) fn none() {}"]), "none", &[]);
        let error = gpu.save_pipelines().unwrap_err().to_string();
        assert!(error.contains("below"), "{error}");
    }
}
