//! Content-addressed files of a session: named by their BLAKE3 hash, bounded in size, sent to other machines in parts.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use sg_input::file;
use sg_proto::bus::{ContentReply, ContentRequest};
use sg_proto::keys::{Identity, Request};

use crate::bus::Bus;
use crate::context::Context;
use crate::fault::Fault;
use crate::progress;

/// Most bytes that one process keeps. Beyond that it removes its oldest files.
const MAX_BYTES: u64 = 1 << 30;
/// Most files that one process keeps. Without this bound, the index of millions of small pictures would fill the memory.
const MAX_FILES: usize = 4096;
/// Largest file that is stored or fetched, bytes. A file stays while the next one is stored, so both parts of a picture can be fetched.
pub const MAX_FILE_BYTES: u64 = MAX_BYTES / 2;
/// Size of one part of a transfer, bytes.
const PART_BYTES: u64 = 1 << 20;
/// Smallest part of a transfer, except for the last one. It bounds the number of requests.
const MIN_PART_BYTES: usize = 64 << 10;

/// A folder of content-addressed files. Each process removes only its own files.
#[derive(Debug, Clone)]
pub struct Blobs {
    folder: PathBuf,
    index: Arc<Mutex<Index>>,
}

#[derive(Debug, Default)]
struct Index {
    /// Written by this process, oldest first.
    files: VecDeque<(PathBuf, u64)>,
    bytes: u64,
    /// Paths of the files that other processes may read, by hash.
    offered: HashMap<String, PathBuf>,
}

/// A file that a process has stored: where, under which hash, and who says so.
#[derive(Debug, Clone, Copy)]
pub struct StoredFile<'a> {
    /// Path on the machine of the sender.
    pub path: &'a str,
    /// BLAKE3 of its content, hexadecimal.
    pub hash: &'a str,
    /// Sender of the message with the path; `None` for a process of the supervisor's machine.
    pub sender: Option<&'a Identity>,
}

/// A file could not be stored or read.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {source}; is the disk full?")]
pub struct BlobError {
    /// The file or folder.
    pub path: PathBuf,
    /// Error of the system.
    pub source: io::Error,
}

impl From<BlobError> for Fault {
    fn from(error: BlobError) -> Self {
        Self::exhausted(error.to_string())
    }
}

impl Blobs {
    /// Opens a folder, and creates it if it does not exist.
    ///
    /// # Errors
    /// [`BlobError`] if the folder cannot be created.
    pub fn open(folder: &Path) -> Result<Self, BlobError> {
        std::fs::create_dir_all(folder).map_err(|source| BlobError { path: folder.to_owned(), source })?;
        Ok(Self { folder: folder.to_owned(), index: Arc::default() })
    }

    /// The folder. It holds the files of this process alone, and goes some time after the end of the process.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Stores bytes under their hash, with an extension such as `npy`, and offers them. Equal bytes are stored once.
    ///
    /// Returns the hash (hexadecimal) and the path.
    ///
    /// # Errors
    /// [`BlobError`], also for more than [`MAX_FILE_BYTES`]. No partial file remains.
    pub fn put(&self, bytes: &[u8], extension: &str) -> Result<(String, PathBuf), BlobError> {
        let hash = blake3::hash(bytes).to_hex().to_string();
        let path = self.path_of(&hash, extension);
        if bytes.len() as u64 > MAX_FILE_BYTES {
            let what = format!("{} bytes are more than the {MAX_FILE_BYTES} of one file", bytes.len());
            return Err(BlobError { path, source: io::Error::new(io::ErrorKind::FileTooLarge, what) });
        }
        let fresh = !path.exists();
        if fresh {
            self.write(&path, |file| file.write_all(bytes))?;
        }
        let mut index = self.lock();
        index.offered.insert(hash.clone(), path.clone());
        if fresh {
            index.record(&path, bytes.len() as u64);
        } else {
            index.renew(&path);
        }
        Ok((hash, path))
    }

    /// Offers a file outside the folder. Returns its hash (hexadecimal) and its size in bytes.
    ///
    /// The file must not change while it is offered: receivers would refuse it.
    ///
    /// # Errors
    /// [`BlobError`] if it cannot be read.
    pub fn offer(&self, path: &Path) -> Result<(String, u64), BlobError> {
        let fail = |source| BlobError { path: path.to_owned(), source };
        let mut hasher = blake3::Hasher::new();
        let bytes = hasher.update_reader(file::open(path).map_err(fail)?.file).map_err(fail)?.count();
        let hash = hasher.finalize().to_hex().to_string();
        self.lock().offered.insert(hash.clone(), path.to_owned());
        Ok((hash, bytes))
    }

    /// Reads a part of an offered file.
    ///
    /// # Errors
    /// `NotFound` for a hash that is not offered; `Internal` for a file that cannot be read.
    pub fn part(&self, request: &ContentRequest) -> Result<ContentReply, Fault> {
        let path = self.lock().offered.get(&request.hash).cloned();
        let gone = || Fault::not_found(format!("no file of hash {} is offered here", request.hash));
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

    /// Returns a local path of a file that a process has stored, with the content that its hash promises.
    ///
    /// A path is opened only if its sender runs on the same machine. From another machine the file is fetched in parts.
    ///
    /// # Errors
    /// The fault of the role; `InvalidArgument` for a malformed hash; `DataLoss` for other content; `ResourceExhausted` for a
    /// file that is too large or cannot be stored.
    pub async fn fetch(
        &self,
        bus: &Bus,
        row: &Request<ContentRequest, ContentReply>,
        stored: StoredFile<'_>,
        context: &Context,
    ) -> Result<PathBuf, Fault> {
        let StoredFile { path, hash, sender } = stored;
        check_hash(hash)?;
        let path = Path::new(path);
        let is_local = sender.map(|s| s.node.as_str()) == bus.node();
        if is_local && path.is_file() {
            tokio::task::block_in_place(|| check_content(path, hash, row.role))?;
            return Ok(path.to_owned());
        }
        let local = self.path_of(hash, extension_of(path));
        if local.is_file() && tokio::task::block_in_place(|| check_content(&local, hash, row.role)).is_ok() {
            return Ok(local);
        }
        let bytes = fetch_to(bus, row, (hash, MAX_FILE_BYTES), &local, context).await?;
        self.lock().record(&local, bytes);
        Ok(local)
    }

    fn path_of(&self, hash: &str, extension: &str) -> PathBuf {
        self.folder.join(format!("{hash}.{extension}"))
    }

    fn write(&self, path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), BlobError> {
        let part = part_of(path);
        let written =
            File::create(&part).and_then(|mut file| fill(&mut file)).and_then(|()| std::fs::rename(&part, path));
        written.map_err(|source| {
            // The part file may not exist. The first error counts.
            let _ = std::fs::remove_file(&part);
            BlobError { path: path.to_owned(), source }
        })
    }

    /// Ignores poisoning: each change of the index is complete, even if its thread panics.
    fn lock(&self) -> std::sync::MutexGuard<'_, Index> {
        self.index.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Index {
    /// A file that is stored again is the newest.
    fn renew(&mut self, path: &Path) {
        if let Some(at) = self.files.iter().position(|(stored, _)| stored == path) {
            let file = self.files.remove(at);
            self.files.extend(file);
        }
    }

    fn record(&mut self, path: &Path, bytes: u64) {
        self.files.push_back((path.to_owned(), bytes));
        self.bytes += bytes;
        while (self.bytes > MAX_BYTES && self.files.len() > 1) || self.files.len() > MAX_FILES {
            if let Some((old, size)) = self.files.pop_front() {
                self.bytes -= size;
                // Files are named by their hashes.
                let hash = old.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
                if self.offered.get(hash) == Some(&old) {
                    self.offered.remove(hash);
                }
                // Another process may have removed it already.
                let _ = std::fs::remove_file(old);
            }
        }
    }
}

/// Temporary path of a file that is being written.
fn part_of(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}", std::process::id()))
}

/// Checks that a hash has the form of a BLAKE3 hash, since it becomes a file name.
fn check_hash(hash: &str) -> Result<(), Fault> {
    let is_hash = hash.len() == 64 && hash.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    if is_hash { Ok(()) } else { Err(Fault::invalid(format!("`{}` is no BLAKE3 hash", hash.escape_debug()))) }
}

/// Checks a file against its hash.
fn check_content(path: &Path, hash: &str, role: &str) -> Result<(), Fault> {
    let fail = |source| BlobError { path: path.to_owned(), source };
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path).map_err(fail)?).map_err(fail)?;
    if hasher.finalize().to_hex().as_str() == hash { Ok(()) } else { Err(other_content(role, hash)) }
}

fn other_content(role: &str, hash: &str) -> Fault {
    let text = format!("`{role}` sent other content under hash {hash}; has the file changed?");
    Fault::new(sg_proto::bus::Code::DataLoss, text)
}

/// Extension of a path from another machine, if it is safe in a file name.
fn extension_of(path: &Path) -> &str {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let is_plain = (1..=8).contains(&extension.len()) && extension.bytes().all(|b| b.is_ascii_alphanumeric());
    if is_plain { extension } else { "bin" }
}

/// Fetches a file of at most `limit` bytes by its hash. It exists at `path` only when it is whole. Returns its size. Each
/// part has the context's deadline anew.
///
/// # Errors
/// As [`Blobs::fetch`].
pub(crate) async fn fetch_to(
    bus: &Bus,
    row: &Request<ContentRequest, ContentReply>,
    (hash, limit): (&str, u64),
    path: &Path,
    context: &Context,
) -> Result<u64, Fault> {
    check_hash(hash)?;
    let part = part_of(path);
    let outcome = fetch_parts(bus, row, (hash, limit), &part, context).await;
    let outcome = outcome.and_then(|bytes| {
        std::fs::rename(&part, path).map_err(|source| BlobError { path: path.to_owned(), source })?;
        Ok(bytes)
    });
    if outcome.is_err() {
        // A partial file is useless.
        let _ = std::fs::remove_file(&part);
    }
    outcome
}

async fn fetch_parts(
    bus: &Bus,
    row: &Request<ContentRequest, ContentReply>,
    (hash, limit): (&str, u64),
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
        if reply.total > limit {
            return Err(Fault::exhausted(format!(
                "a file of {} bytes is over the limit of {limit} bytes",
                reply.total
            )));
        }
        let is_last = offset + reply.data.len() as u64 >= reply.total;
        if reply.data.len() < MIN_PART_BYTES && !is_last {
            return Err(Fault::invalid(format!("`{}` sent a part of only {} bytes", row.role, reply.data.len())));
        }
        hasher.update(&reply.data);
        file.write_all(&reply.data).map_err(fail)?;
        offset += reply.data.len() as u64;
        progress::current().step();
        if offset > limit {
            return Err(Fault::exhausted(format!("`{}` sent more than {limit} bytes", row.role)));
        }
        if is_last {
            break;
        }
    }
    if hasher.finalize().to_hex().as_str() != hash {
        return Err(other_content(row.role, hash));
    }
    file.sync_all().map_err(fail)?;
    Ok(offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_bytes_are_stored_once() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(folder.path()).unwrap();
        let (hash, path) = blobs.put(b"gaussian", "bin").unwrap();
        assert_eq!(hash, blake3::hash(b"gaussian").to_hex().to_string());
        assert_eq!(blobs.put(b"gaussian", "bin").unwrap().1, path);
        assert_eq!(std::fs::read(&path).unwrap(), b"gaussian");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn names_from_messages_stay_in_the_folder() {
        assert!(check_hash(&blake3::hash(b"gaussian").to_hex()).is_ok());
        for bad in ["", "abc", "../../etc/passwd", &"A".repeat(64), &"g".repeat(64), &format!("{}/..", "a".repeat(61))]
        {
            assert!(check_hash(bad).is_err(), "{bad}");
        }
        let extension = |path| extension_of(Path::new(path));
        assert_eq!((extension("/a/b.npy"), extension("/a/b"), extension("b.n\u{1b}y")), ("npy", "bin", "bin"));
    }

    #[test]
    fn other_content_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(folder.path()).unwrap();
        let (hash, path) = blobs.put(b"gaussian", "bin").unwrap();
        assert!(check_content(&path, &hash, "scene").is_ok());
        std::fs::write(&path, b"laplacian").unwrap();
        assert_eq!(check_content(&path, &hash, "scene").unwrap_err().code, sg_proto::bus::Code::DataLoss);
    }

    #[test]
    fn a_file_stays_while_its_partner_is_stored() {
        let mut index = Index::default();
        let [old, npy, png] = ["old", "npy", "png"].map(PathBuf::from);
        index.record(&npy, MAX_FILE_BYTES);
        index.record(&old, MAX_FILE_BYTES);
        index.renew(&npy);
        index.record(&png, MAX_FILE_BYTES);
        let left: Vec<_> = index.files.iter().map(|(path, _)| path.clone()).collect();
        assert_eq!((left, index.bytes), (vec![npy, png], MAX_BYTES));
    }

    #[test]
    fn the_number_of_small_files_is_bounded() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::open(folder.path()).unwrap();
        for i in 0..MAX_FILES as u32 + 100 {
            blobs.put(&i.to_le_bytes(), "bin").unwrap();
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), MAX_FILES);
        let index = blobs.lock();
        assert_eq!((index.files.len(), index.offered.len(), index.bytes), (MAX_FILES, MAX_FILES, 4 * MAX_FILES as u64));
        assert!(index.offered.contains_key(&blake3::hash(&(MAX_FILES as u32 + 99).to_le_bytes()).to_hex().to_string()));
    }

    #[test]
    fn only_offered_files_are_read_in_parts() {
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
