//! The files of a folder, by their series.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sg_input::file;
use sg_input::number_format::grouped;

use super::super::error::ReadError;
use super::super::source::Source;
use super::elements::{self, Attributes, Fault, Head};
use super::{MAX_SLICES, error_of};

/// Most entries of a folder.
const MAX_ENTRIES: usize = 50_000;
/// Bytes of a file that are read first for its attributes.
const FIRST_BYTES: u64 = 64 << 10;
/// Series that a note names.
const NAMED: usize = 8;

/// A file with voxels.
pub(super) struct SeriesFile {
    pub(super) path: PathBuf,
    /// Bytes of the file.
    pub(super) length: u64,
    pub(super) head: Head,
    pub(super) attributes: Attributes,
}

impl SeriesFile {
    /// The source of its errors.
    pub(super) fn source<'a>(&'a self, of: Source<'a>) -> Source<'a> {
        Source { path: &self.path, ..of }
    }

    /// The name of the file, for a person.
    pub(super) fn name(&self) -> String {
        self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }
}

/// What a look at the files has found.
pub(super) struct Found {
    /// The series, the one with most voxels first.
    series: Vec<Vec<SeriesFile>>,
    /// Place of the series of the file that was named.
    named: Option<usize>,
    /// Files of other formats.
    others: usize,
    /// DICOM files without voxels.
    without_voxels: usize,
}

impl Found {
    /// Looks at all files of a folder, or at those beside a file.
    pub(super) fn scan(source: Source<'_>) -> Result<Self, ReadError> {
        let is_folder = source.path.is_dir();
        let mut found: BTreeMap<Vec<u8>, Vec<SeriesFile>> = BTreeMap::new();
        let (mut others, mut without_voxels, mut slices) = (0, 0, 0);
        let mut named = None;
        if !is_folder {
            let file = read_attributes(source)?.ok_or_else(|| {
                let what = "a DICOM file without voxels";
                source.format("pixel data", what, "give the folder with the slices")
            })?;
            named = Some(file.attributes.series.clone());
            // Frames of one file need no other.
            let is_whole = file.attributes.frames() > 1;
            found.entry(file.attributes.series.clone()).or_default().push(file);
            if is_whole && source.series.is_none() {
                return Ok(Self::of(found, named.as_deref(), 0, 0));
            }
        }
        for path in files_of(source)? {
            let own = Source { path: &path, ..source };
            if !is_folder && same(&path, source.path) {
                continue;
            }
            if !is_dicom_file(&path) || !is_inside(source, &path) {
                others += 1;
                continue;
            }
            let Some(file) = read_attributes(own)? else {
                without_voxels += 1;
                continue;
            };
            slices += file.attributes.frames();
            if slices > MAX_SLICES {
                let what = format!("more than {MAX_SLICES} slices");
                return Err(source.format("folder", what, "give a folder with one series"));
            }
            found.entry(file.attributes.series.clone()).or_default().push(file);
        }
        Ok(Self::of(found, named.as_deref(), others, without_voxels))
    }

    fn of(
        found: BTreeMap<Vec<u8>, Vec<SeriesFile>>,
        named: Option<&[u8]>,
        others: usize,
        without_voxels: usize,
    ) -> Self {
        let mut series: Vec<(Vec<u8>, Vec<SeriesFile>)> = found.into_iter().collect();
        for (_, files) in &mut series {
            files.sort_by(|a, b| a.path.cmp(&b.path));
        }
        let first = |files: &[SeriesFile]| files.first().map(|file| file.path.clone());
        series.sort_by(|(_, a), (_, b)| voxels(b).cmp(&voxels(a)).then_with(|| first(a).cmp(&first(b))));
        let named = named.and_then(|named| series.iter().position(|(of, _)| of == named));
        Self { series: series.into_iter().map(|(_, files)| files).collect(), named, others, without_voxels }
    }

    /// The wanted series, that of the named file, or the largest one; and notes for a person.
    pub(super) fn chosen(mut self, source: Source<'_>) -> Result<(Vec<SeriesFile>, Vec<String>), ReadError> {
        let count = self.series.len();
        if count == 0 {
            let what = "no DICOM file with voxels";
            return Err(source.format("folder", what, "give the folder that holds the slices"));
        }
        let index = match source.series {
            None => self.named.unwrap_or(0),
            Some(number) => number.checked_sub(1).filter(|index| *index < count).ok_or_else(|| {
                let what = format!("no series {number}; there {}", self.listed(None));
                source.format("--series", what, format!("give a number from 1 to {count}"))
            })?,
        };
        let mut notes = Vec::new();
        if count > 1 {
            let size = self.series.get(index).map(|files| size(files)).unwrap_or_default();
            let others = self.listed(Some(index));
            notes.push(format!(
                "series {} of {count} was read, {size}; others {others}; --series N reads another",
                index + 1
            ));
        }
        for (number, why) in [(self.others, "no DICOM"), (self.without_voxels, "no voxels")] {
            // Beside a single file anything may lie.
            if number > 0 && source.path.is_dir() {
                let files = if number == 1 { "file was" } else { "files were" };
                notes.push(format!("{} {files} left out: {why}", grouped(number as u64)));
            }
        }
        Ok((self.series.swap_remove(index), notes))
    }

    /// The series but one, by number and size.
    fn listed(&self, but: Option<usize>) -> String {
        let rest = self.series.iter().enumerate().filter(|(index, _)| Some(*index) != but);
        let mut listed: Vec<String> =
            rest.take(NAMED).map(|(index, files)| format!("{} ({})", index + 1, size(files))).collect();
        if self.series.len() > NAMED + usize::from(but.is_some()) {
            listed.push("more".to_owned());
        }
        format!("are {}", listed.join(", "))
    }
}

/// Slices, columns and rows of a series.
fn size(files: &[SeriesFile]) -> String {
    let slices: usize = files.iter().map(|file| file.attributes.frames()).sum();
    let (columns, rows) = files.first().map_or((0, 0), |file| (file.attributes.columns, file.attributes.rows));
    let word = if slices == 1 { "slice" } else { "slices" };
    format!("{slices} {word} of {columns} x {rows}")
}

fn voxels(files: &[SeriesFile]) -> usize {
    files.iter().map(|file| file.attributes.frames() * file.attributes.rows * file.attributes.columns).sum()
}

fn same(one: &Path, other: &Path) -> bool {
    one.file_name() == other.file_name()
}

/// Whether a file may be read: with [`Limits::own_folder`](super::super::Limits), no link that leads out of the folder.
fn is_inside(source: Source<'_>, path: &Path) -> bool {
    if !source.limits.own_folder {
        return true;
    }
    let folder = path.parent().map(std::fs::canonicalize);
    match (std::fs::canonicalize(path), folder) {
        (Ok(file), Some(Ok(folder))) => file.starts_with(folder),
        _ => false,
    }
}

/// The entries of the folder in the order of their names, without folders and the list of files that a disk comes with.
fn files_of(source: Source<'_>) -> Result<Vec<PathBuf>, ReadError> {
    let folder = if source.path.is_dir() {
        source.path
    } else {
        source.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
    };
    let fail = |error| ReadError::Io { path: folder.to_owned(), source: error };
    let mut files = Vec::new();
    for (number, entry) in std::fs::read_dir(folder).map_err(fail)?.enumerate() {
        if number >= MAX_ENTRIES {
            let what = format!("more than {MAX_ENTRIES} files");
            return Err(source.format("folder", what, "give a folder with one series"));
        }
        let path = entry.map_err(fail)?.path();
        let is_list = path.file_name().is_some_and(|name| name.eq_ignore_ascii_case("DICOMDIR"));
        if !is_list && !path.is_dir() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Whether a regular file starts as DICOM files do.
pub(super) fn is_dicom_file(path: &Path) -> bool {
    let (before, magic) = elements::MAGIC;
    file::read_start(path, (before + magic.len()) as u64).is_ok_and(|start| elements::has_magic(&start))
}

/// Reads the start of a file up to its voxels; `None` for one without.
fn read_attributes(source: Source<'_>) -> Result<Option<SeriesFile>, ReadError> {
    let opened = file::open(source.path).map_err(|e| source.io(e))?;
    let most = most_bytes(source);
    let mut bytes = Vec::new();
    let mut until = FIRST_BYTES;
    loop {
        opened.read_until(&mut bytes, until, most).map_err(|e| source.io(e))?;
        let is_whole = bytes.len() as u64 >= opened.length || (bytes.len() as u64) < until;
        if !elements::has_magic(&bytes) {
            let what = "no DICM behind the first 128 bytes";
            return Err(source.format("byte 128", what, "give a file of DICOM part 10"));
        }
        match attributes_of(&bytes) {
            Ok((_, attributes)) if attributes.pixels.is_none() && !is_whole => {}
            Err(Fault::Cut) if !is_whole => {}
            Ok((head, _)) if head.is_directory => return Ok(None),
            Ok((_, attributes)) if attributes.pixels.is_none() && !attributes.has_float_pixels => return Ok(None),
            Ok((head, attributes)) => {
                let (path, length) = (source.path.to_owned(), opened.length);
                return Ok(Some(SeriesFile { path, length, head, attributes }));
            }
            Err(wrong) => return Err(error_of(source, wrong)),
        }
        until = until.saturating_mul(4);
    }
}

fn attributes_of(bytes: &[u8]) -> Result<(Head, Attributes), Fault> {
    let head = elements::head(bytes)?;
    let mut unpacked = Vec::new();
    let data = elements::data_set(&head, bytes, &mut unpacked)?;
    Ok((head, elements::attributes(&head, data)?))
}

/// Most bytes of one file: never more than twice its values and a head.
pub(super) fn most_bytes(source: Source<'_>) -> u64 {
    source.limits.voxel_bytes.saturating_mul(2).saturating_add(1 << 20)
}
