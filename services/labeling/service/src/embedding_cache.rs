//! Embeddings of pictures on disk, each under a hash of what it was made of. So a restart draws nothing again.

use std::io;
use std::path::{Path, PathBuf};

use sg_encoders::Embedding;
use sg_formats::staged_file;
use sg_formats::stored_entries::keep_newest;
use sg_input::file;

/// First bytes of an entry: format and version.
const MAGIC: &[u8; 8] = b"SGEMBED1";
/// Most entries of a folder: 13 MB for embeddings of 768 numbers. The oldest are removed first.
const MAX_ENTRIES: usize = 4096;
/// Most numbers of an embedding.
const MAX_DIMENSION: usize = 16_384;
/// Ending of an entry's name.
const EXTENSION: &str = "embedding";

/// A folder of embeddings.
#[derive(Debug, Clone)]
pub struct EmbeddingCache {
    folder: PathBuf,
}

/// Embedding of some pictures, with their number.
pub type Stored = (Embedding, usize);

impl EmbeddingCache {
    /// The cache in a folder. The first [`EmbeddingCache::store`] creates the folder.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_path_buf() }
    }

    fn path(&self, key: &blake3::Hash) -> PathBuf {
        self.folder.join(format!("{}.{EXTENSION}", key.to_hex()))
    }

    /// The entry of a key. A damaged entry is none, after a line in the log.
    #[must_use]
    pub fn load(&self, key: &blake3::Hash) -> Option<Stored> {
        let path = self.path(key);
        let bytes = match file::read(&path, 64 + 4 * MAX_DIMENSION as u64) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => {
                tracing::warn!(path = %path.display(), %error, "a stored embedding could not be read");
                return None;
            }
        };
        let entry = decode(&bytes);
        if entry.is_none() {
            tracing::warn!(path = %path.display(), "a stored embedding is damaged; it is made again");
        }
        entry
    }

    /// Stores an embedding of `views` pictures.
    ///
    /// # Errors
    /// The system's error, such as a full disk. No partial entry remains.
    pub fn store(&self, key: &blake3::Hash, (embedding, views): &Stored) -> io::Result<()> {
        std::fs::create_dir_all(&self.folder)?;
        staged_file::replace(&self.path(key), &encode(embedding, *views))?;
        keep_newest(&self.folder, EXTENSION, MAX_ENTRIES)
    }
}

fn encode(embedding: &Embedding, views: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(48 + 4 * embedding.dimension());
    out.extend_from_slice(MAGIC);
    out.extend_from_slice(&(views as u32).to_le_bytes());
    embedding.raw().iter().for_each(|value| out.extend_from_slice(&value.to_le_bytes()));
    let checksum = blake3::hash(&out);
    out.extend_from_slice(checksum.as_bytes());
    out
}

/// The content of an entry. `None` for a damaged one.
#[must_use]
pub fn decode(bytes: &[u8]) -> Option<Stored> {
    let (content, checksum) = bytes.split_last_chunk::<32>()?;
    if blake3::hash(content) != blake3::Hash::from_bytes(*checksum) {
        return None;
    }
    let (magic, rest) = content.split_first_chunk::<8>()?;
    let (views, rest) = rest.split_first_chunk::<4>()?;
    let (values, []) = rest.as_chunks::<4>() else { return None };
    let raw: Vec<f32> = values.iter().map(|value| f32::from_le_bytes(*value)).collect();
    let embedding = Embedding::new(&raw).ok().filter(|_| magic == MAGIC)?;
    Some((embedding, u32::from_le_bytes(*views) as usize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_back_and_damaged_ones_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let cache = EmbeddingCache::new(&folder.path().join("embeddings"));
        let (key, other) = (blake3::hash(b"a region"), blake3::hash(b"another one"));
        let entry = (Embedding::new(&[0.5, -2.0, 0.25]).unwrap(), 5);
        assert_eq!(cache.load(&key), None);
        cache.store(&key, &entry).unwrap();
        let (found, views) = cache.load(&key).unwrap();
        assert!(found.cosine(&entry.0).unwrap() > 1.0 - 1e-6 && (found.norm() / entry.0.norm() - 1.0).abs() < 1e-6);
        assert_eq!((views, cache.load(&other)), (5, None));
        let whole = std::fs::read(cache.path(&key)).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x10;
            std::fs::write(cache.path(&key), &bytes).unwrap();
            assert_eq!(cache.load(&key), None, "byte {at}");
            std::fs::write(cache.path(&key), &whole[..at]).unwrap();
            assert_eq!(cache.load(&key), None, "cut at {at}");
        }
        // The damaged entry is replaced.
        cache.store(&key, &entry).unwrap();
        assert!(cache.load(&key).is_some());
    }
}
