//! Volumes and transfer functions: readers, gradients, the made vessel tree.
//!
//! A [`Volume`] is what a file holds: values in their own type on a [`Grid`] in physical space. Its [`Field`] is what
//! sampling, gradients and ray marching work on. A [`TransferFunction`] says what values look like; bound to a volume's
//! range it becomes a [`Classifier`].

pub mod dvr;
pub mod field;
pub mod grid;
pub mod histogram;
pub mod phantom;
pub mod read;
pub mod scalars;
pub mod transfer;
pub mod volume;

pub use field::Field;
pub use grid::{Bounds, Grid};
pub use histogram::automatic;
pub use read::{
    ENDINGS, Limits, ReadError, WriteError, formats_help, raw_file_name, read_volume, read_volume_within, write_raw,
    write_volume,
};
pub use scalars::{ScalarType, Scalars, ValueRange};
pub use transfer::{Classifier, TransferFunction};
pub use volume::Volume;
