//! The command that gives the Gaussians of a volume another transfer function.

use sg_proto::scene::{SetTransferFunction, Target};

use super::command_number::malformed;
use super::error::EditError;
use super::transaction::Transaction;
use super::transformation::significant;
use super::wire::decode_transfer_function;

impl Transaction<'_> {
    pub(super) fn set_transfer_function(&mut self, command: &SetTransferFunction) -> Result<String, EditError> {
        let everything = self.state.resolve(Some(&Target { everything: true, ..Target::default() }))?;
        self.refuse_locked(&everything)?;
        let Some(message) = &command.function else {
            self.state.transfer_function = None;
            return Ok("put the transfer function of the file back".to_owned());
        };
        let function = decode_transfer_function(message).map_err(|e| malformed(&e))?;
        sg_reclassify::check_scene(self.scene.file(), &function)?;
        let values = function.points.iter().map(|point| point.value);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let count = function.points.len();
        self.state.transfer_function = Some(function);
        let points = if count == 1 { "one point".to_owned() } else { format!("{count} points") };
        Ok(format!("transfer function of {points}, {} to {}", significant(low), significant(high)))
    }
}
