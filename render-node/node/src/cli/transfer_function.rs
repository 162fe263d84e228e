//! The transfer function of the command line.

use std::path::Path;

use sg_input::print;
use sg_volume::TransferFunction;

use super::failure::Failure;

/// The transfer function of a file; prints its unknown keys.
pub(super) fn read_transfer_function(path: &Path) -> Result<TransferFunction, Failure> {
    let loaded = TransferFunction::load(path).map_err(Failure::input)?;
    loaded.notes(path).for_each(|note| print::status(&note));
    Ok(loaded.function)
}
