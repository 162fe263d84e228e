//! Text files that are named on the command line.

use std::path::Path;

use sg_input::file;

use crate::terminal::Failure;

/// Reads a text file of at most `most` bytes.
pub(crate) fn read_text(path: &Path, most: u64) -> Result<String, Failure> {
    file::read_text(path, most).map_err(|e| Failure::Input(format!("{}: {e}", path.display())))
}
