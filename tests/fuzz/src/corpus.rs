//! The inputs of a target that are kept: one archive of a small set that reaches everything reached so far, and a folder of
//! inputs that once failed.

use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Most inputs of an archive. The shortest ones stay.
const MAX_INPUTS: usize = 300;

/// A corpus that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CorpusError {
    /// The system refused.
    #[error("{}: {source}", .path.display())]
    Io {
        /// File or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The archive is damaged.
    #[error("{}: {source}; pack it again with `ops/fuzz --merge`", .path.display())]
    Archive {
        /// The file.
        path: PathBuf,
        /// The error.
        source: zip::result::ZipError,
    },
}

/// An input with its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Name within the corpus.
    pub name: String,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// Folder of this package.
fn package() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The archive of a target.
#[must_use]
pub fn archive(target: &str) -> PathBuf {
    package().join("corpus").join(format!("{target}.zip"))
}

/// The kept inputs of a target: those of its archive, then those that once failed.
///
/// # Errors
/// [`CorpusError`].
pub fn inputs(target: &str) -> Result<Vec<Input>, CorpusError> {
    let mut inputs = packed(&archive(target))?;
    let failed = package().join("found").join(target);
    if failed.is_dir() {
        inputs.extend(loose(&failed)?);
    }
    Ok(inputs)
}

fn packed(path: &Path) -> Result<Vec<Input>, CorpusError> {
    let damaged = |source| CorpusError::Archive { path: path.to_owned(), source };
    let io = |source| CorpusError::Io { path: path.to_owned(), source };
    let bytes = fs::read(path).map_err(io)?;
    let mut zip = ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
    let mut inputs = Vec::with_capacity(zip.len());
    for at in 0..zip.len() {
        let mut entry = zip.by_index(at).map_err(damaged)?;
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(io)?;
        let name = entry.name().map_err(damaged)?.into_owned();
        inputs.push(Input { name, bytes });
    }
    Ok(inputs)
}

fn loose(folder: &Path) -> Result<Vec<Input>, CorpusError> {
    let io = |path: &Path, source| CorpusError::Io { path: path.to_owned(), source };
    let mut inputs = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| io(folder, e))? {
        let entry = entry.map_err(|e| io(folder, e))?;
        let bytes = fs::read(entry.path()).map_err(|e| io(&entry.path(), e))?;
        inputs.push(Input { name: entry.file_name().to_string_lossy().into_owned(), bytes });
    }
    inputs.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(inputs)
}

/// Writes the kept inputs of a target into a folder, for the engine.
///
/// # Errors
/// [`CorpusError`].
pub fn unpack(target: &str, folder: &Path) -> Result<usize, CorpusError> {
    let io = |path: &Path, source| CorpusError::Io { path: path.to_owned(), source };
    fs::create_dir_all(folder).map_err(|e| io(folder, e))?;
    let inputs = inputs(target)?;
    for input in &inputs {
        let path = folder.join(&input.name);
        fs::write(&path, &input.bytes).map_err(|e| io(&path, e))?;
    }
    Ok(inputs.len())
}

/// Packs the inputs of a folder as a target's archive. The same inputs make the same bytes.
///
/// # Errors
/// [`CorpusError`].
pub fn pack(target: &str, folder: &Path) -> Result<usize, CorpusError> {
    let path = archive(target);
    let damaged = |source| CorpusError::Archive { path: path.clone(), source };
    let io = |source| CorpusError::Io { path: path.clone(), source };
    let mut inputs = loose(folder)?;
    // Named by content, so that the order does not depend on who found them.
    for input in &mut inputs {
        input.name = blake3::hash(&input.bytes).to_hex().chars().take(16).collect();
    }
    inputs.sort_by_key(|input| (input.bytes.len(), input.name.clone()));
    inputs.dedup();
    inputs.truncate(MAX_INPUTS);
    inputs.sort_by(|a, b| a.name.cmp(&b.name));
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::default());
    for input in &inputs {
        zip.start_file(input.name.as_str(), options).map_err(damaged)?;
        zip.write_all(&input.bytes).map_err(io)?;
    }
    let bytes = zip.finish().map_err(damaged)?.into_inner();
    fs::create_dir_all(package().join("corpus")).map_err(io)?;
    fs::write(&path, bytes).map_err(io)?;
    Ok(inputs.len())
}
