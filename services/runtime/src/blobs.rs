//! Bulk data of a session by content: files known by their BLAKE3 hash, bounded in number and size, offered to other
//! machines in parts and fetched from them.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use sg_proto::bus::{ContentReply, ContentRequest};
use sg_proto::keys::Ask;

use crate::bus::Bus;
use crate::context::Context;
use crate::fault::Fault;

/// Most bytes one process keeps in the session's folder before it removes its oldest files.
const MAX_BYTES: u64 = 1 << 30;
/// Bytes of one part on the way between machines.
const PART_BYTES: u64 = 1 << 20;
/// Largest file that is fetched.
const MAX_FETCHED: u64 = 64 << 30;

/// A folder of content-addressed files. Each process removes only what it wrote itself.
#[derive(Debug, Clone)]
pub struct Blobs {
    folder: PathBuf,
    held: Arc<Mutex<Held>>,
}

#[derive(Debug, Default)]
struct Held {
    /// Written by this process, oldest first.
    files: VecDeque<(PathBuf, u64)>,
    bytes: u64,
    /// Where what others may read lies, by hash.
    offered: HashMap<String, PathBuf>,
}

/// A file that could not be kept or read.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}; is the disk full?")]
pub struct BlobError {
    /// The file or folder.
    pub path: PathBuf,
    /// What the system said.
    pub source: io::Error,
}

impl From<BlobError> for Fault {
    fn from(error: BlobError) -> Self {
        Self::exhausted(error.to_string())
    }
}

impl Blobs {
    /// Opens, making it if need be, a folder of blobs.
    ///
    /// # Errors
    /// [`BlobError`] if the folder cannot be made.
    pub fn open(folder: &Path) -> Result<Self, BlobError> {
        std::fs::create_dir_all(folder).map_err(|source| BlobError { path: folder.to_owned(), source })?;
        Ok(Self { folder: folder.to_owned(), held: Arc::default() })
    }

    /// Keeps bytes under their hash (hexadecimal) with an extension such as `npy`, and offers them; the same bytes are kept
    /// once.
    ///
    /// # Errors
    /// [`BlobError`]; no half file stays behind.
    pub fn put(&self, bytes: &[u8], extension: &str) -> Result<(String, PathBuf), BlobError> {
        let hash = blake3::hash(bytes).to_hex().to_string();
        let path = self.path_of(&hash, extension);
        let fresh = !path.exists();
        if fresh {
            self.write(&path, |file| file.write_all(bytes))?;
        }
        let mut held = self.lock();
        held.offered.insert(hash.clone(), path.clone());
        if fresh {
            held.remember(&path, bytes.len() as u64);
        }
        Ok((hash, path))
    }

    /// Offers a file that lies elsewhere; its hash, hexadecimal, and its bytes. It must not change while it is offered:
    /// who fetches it would refuse it.
    ///
    /// # Errors
    /// [`BlobError`] if it cannot be read.
    pub fn offer(&self, path: &Path) -> Result<(String, u64), BlobError> {
        let fail = |source| BlobError { path: path.to_owned(), source };
        let mut hasher = blake3::Hasher::new();
        let bytes = hasher.update_reader(File::open(path).map_err(fail)?).map_err(fail)?.count();
        let hash = hasher.finalize().to_hex().to_string();
        self.lock().offered.insert(hash.clone(), path.to_owned());
        Ok((hash, bytes))
    }

    /// A part of something that is offered.
    ///
    /// # Errors
    /// `NotFound` for what is not offered, or no more; what the system said of a file that cannot be read.
    pub fn part(&self, request: &ContentRequest) -> Result<ContentReply, Fault> {
        let path = self.lock().offered.get(&request.hash).cloned();
        let gone = || Fault::not_found(format!("nothing of hash {} is kept here", request.hash));
        let path = path.ok_or_else(gone)?;
        let read = || -> io::Result<ContentReply> {
            let file = File::open(&path)?;
            let total = file.metadata()?.len();
            let length = total.saturating_sub(request.offset).min(PART_BYTES);
            let mut data = vec![0; usize::try_from(length).map_err(io::Error::other)?];
            file.read_exact_at(&mut data, request.offset)?;
            Ok(ContentReply { data, total })
        };
        read().map_err(|e| match e.kind() {
            io::ErrorKind::NotFound => gone(),
            _ => Fault::internal(format!("{}: {e}", path.display())),
        })
    }

    /// Where something can be read on this machine that a role has kept under `path` on its own: there, if this is the same
    /// machine, else in this folder, fetched part by part and checked against its hash.
    ///
    /// # Errors
    /// The role's refusal; `DataLoss` for content of another hash; what the system said of a file that cannot be kept.
    pub async fn fetch(
        &self,
        bus: &Bus,
        row: &Ask<ContentRequest, ContentReply>,
        (path, hash): (&str, &str),
        context: &Context,
    ) -> Result<PathBuf, Fault> {
        let path = Path::new(path);
        if path.is_file() {
            return Ok(path.to_owned());
        }
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let kept = self.path_of(hash, &extension);
        if !kept.is_file() {
            let bytes = fetch_to(bus, row, hash, &kept, context).await?;
            self.lock().remember(&kept, bytes);
        }
        Ok(kept)
    }

    fn path_of(&self, hash: &str, extension: &str) -> PathBuf {
        self.folder.join(format!("{hash}.{extension}"))
    }

    fn write(&self, path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), BlobError> {
        let part = part_of(path);
        let written =
            File::create(&part).and_then(|mut file| fill(&mut file)).and_then(|()| std::fs::rename(&part, path));
        written.map_err(|source| {
            // The part file may not exist; what matters is the error that led here.
            let _ = std::fs::remove_file(&part);
            BlobError { path: path.to_owned(), source }
        })
    }

    /// Every change leaves the list whole, a panic in between included.
    fn lock(&self) -> std::sync::MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Held {
    fn remember(&mut self, path: &Path, bytes: u64) {
        self.files.push_back((path.to_owned(), bytes));
        self.bytes += bytes;
        while self.bytes > MAX_BYTES && self.files.len() > 1 {
            if let Some((old, size)) = self.files.pop_front() {
                self.bytes -= size;
                self.offered.retain(|_, path| *path != old);
                // Somebody may have removed it already; the aim is that it is gone.
                let _ = std::fs::remove_file(old);
            }
        }
    }
}

/// Where a file is written before it is whole.
fn part_of(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}", std::process::id()))
}

/// Fetches something by its hash into a file, which is there only when it is whole; its bytes. Each part has the context's
/// deadline anew.
///
/// # Errors
/// As [`Blobs::fetch`].
pub(crate) async fn fetch_to(
    bus: &Bus,
    row: &Ask<ContentRequest, ContentReply>,
    hash: &str,
    path: &Path,
    context: &Context,
) -> Result<u64, Fault> {
    let part = part_of(path);
    let outcome = fetch_parts(bus, row, hash, &part, context).await;
    let outcome = outcome.and_then(|bytes| {
        std::fs::rename(&part, path).map_err(|source| BlobError { path: path.to_owned(), source })?;
        Ok(bytes)
    });
    if outcome.is_err() {
        // What was fetched so far is of no use to anybody.
        let _ = std::fs::remove_file(&part);
    }
    outcome
}

async fn fetch_parts(
    bus: &Bus,
    row: &Ask<ContentRequest, ContentReply>,
    hash: &str,
    part: &Path,
    context: &Context,
) -> Result<u64, Fault> {
    let fail = |source| BlobError { path: part.to_owned(), source };
    let mut file = File::create(part).map_err(fail)?;
    let (mut hasher, mut offset) = (blake3::Hasher::new(), 0);
    let time = context.remaining();
    loop {
        let request = ContentRequest { hash: hash.to_owned(), offset };
        let reply = bus.ask(row, &request, &context.next().deadline_in(time)).await?;
        if reply.total > MAX_FETCHED {
            return Err(Fault::exhausted(format!(
                "a file of {} bytes is larger than any that is fetched",
                reply.total
            )));
        }
        hasher.update(&reply.data);
        file.write_all(&reply.data).map_err(fail)?;
        offset += reply.data.len() as u64;
        if offset >= reply.total || reply.data.is_empty() {
            break;
        }
    }
    if hasher.finalize().to_hex().as_str() != hash {
        return Err(Fault::new(
            sg_proto::bus::Code::DataLoss,
            format!("what `{}` sent under hash {hash} is something else; did the file change?", row.role),
        ));
    }
    file.sync_all().map_err(fail)?;
    Ok(offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_bytes_are_kept_once_under_their_hash() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(folder.path()).unwrap();
        let (hash, path) = blobs.put(b"gaussian", "bin").unwrap();
        assert_eq!(hash, blake3::hash(b"gaussian").to_hex().to_string());
        assert_eq!(blobs.put(b"gaussian", "bin").unwrap().1, path);
        assert_eq!(std::fs::read(&path).unwrap(), b"gaussian");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_is_offered_is_read_in_parts_and_nothing_else_is() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(&folder.path().join("blobs")).unwrap();
        let bytes: Vec<u8> = (0..PART_BYTES + 10).map(|i| (i % 251) as u8).collect();
        let file = folder.path().join("scene.ply");
        std::fs::write(&file, &bytes).unwrap();
        let (hash, length) = blobs.offer(&file).unwrap();
        assert_eq!((hash.as_str(), length), (blake3::hash(&bytes).to_hex().as_str(), bytes.len() as u64));
        let part = |offset| blobs.part(&ContentRequest { hash: hash.clone(), offset }).unwrap();
        let whole = [part(0).data, part(PART_BYTES).data].concat();
        assert_eq!((whole, part(0).total), (bytes, length));
        assert!(part(length).data.is_empty() && part(u64::MAX).data.is_empty());
        let other = blobs.part(&ContentRequest { hash: "../scene.ply".into(), offset: 0 }).unwrap_err();
        assert_eq!(other.code, sg_proto::bus::Code::NotFound);
        std::fs::remove_file(&file).unwrap();
        assert!(blobs.part(&ContentRequest { hash, offset: 0 }).is_err());
    }
}
