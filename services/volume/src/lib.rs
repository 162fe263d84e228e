//! Scalar volumes, transfer functions and direct volume rendering.

pub mod classifier;
pub mod dvr;
pub mod field;
pub mod grid;
pub mod histogram;
pub mod opacity;
pub mod phantom;
pub mod read;
pub mod scalars;
pub mod transfer;
pub mod volume;

pub use classifier::{BaseUnitMatch, Classifier};
pub use field::Field;
pub use grid::{Bounds, Grid};
pub use histogram::automatic_transfer_function;
pub use read::{
    ENDINGS, Limits, ReadError, WriteError, formats_help, raw_file_name, read_volume, read_volume_within, write_raw,
    write_volume,
};
pub use scalars::{ScalarType, Scalars, ValueRange};
pub use transfer::TransferFunction;
pub use volume::Volume;
