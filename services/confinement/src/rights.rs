//! The rights that a confined process keeps.

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Rights of a confined process. It has no others.
///
/// A right on a folder holds for everything below it. Paths that do not exist at the time of [`confine`](crate::confine) are
/// left out. Links are followed.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rights {
    /// Files and folders to read.
    pub read: BTreeSet<PathBuf>,
    /// Files and folders to read, with programs that may be run.
    pub run: BTreeSet<PathBuf>,
    /// Files and folders to read and change. In a folder, files and folders can be made, renamed and removed.
    pub write: BTreeSet<PathBuf>,
    /// Folders in which empty folders can be removed.
    pub remove_folders: BTreeSet<PathBuf>,
    /// Devices to read, write and control.
    pub devices: BTreeSet<PathBuf>,
    /// TCP ports to connect to; `None` for all. No port can be listened on (Landlock 4).
    pub connect: Option<BTreeSet<u16>>,
    /// Whether sockets with abstract names of other processes can be used (Landlock 6). Those with paths always can.
    pub abstract_sockets: bool,
}

impl Rights {
    /// No right at all: no file, no connection.
    #[must_use]
    pub fn none() -> Self {
        Self { connect: Some(BTreeSet::new()), ..Self::default() }
    }
}
