//! The commands that give the Gaussians of a volume another transfer function.

use std::sync::Arc;

use sg_input::number_format::{significant, values_between};
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::{AdjustTransferFunction, SetTransferFunction, Target, ValueColor, ValueRange, ValueWindow};
use sg_reclassify::ReclassifyError;
use sg_volume::TransferFunction;
use sg_volume::transfer::Scale;

use super::command_number::{self, malformed};
use super::error::EditError;
use super::transaction::Transaction;
use super::wire::{decode_scale, decode_transfer_function, encode_transfer_function};

impl Transaction<'_> {
    pub(super) fn set_transfer_function(&mut self, command: &SetTransferFunction) -> Result<String, EditError> {
        self.refuse_locked_values()?;
        let Some(message) = &command.function else {
            self.state.transfer_function = None;
            return Ok("put the transfer function of the file back".to_owned());
        };
        let function = decode_transfer_function(message).map_err(|e| malformed(&e))?;
        let values = function.points.iter().map(|point| point.value);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let count = function.points.len();
        self.take(function)?;
        let points = if count == 1 { "one point".to_owned() } else { format!("{count} points") };
        Ok(format!("transfer function of {points}, {} to {}", significant(low), significant(high)))
    }

    pub(super) fn adjust_transfer_function(&mut self, command: &AdjustTransferFunction) -> Result<String, EditError> {
        self.refuse_locked_values()?;
        let present = self.present_function()?;
        let missing = |field| EditError::Malformed { field, reason: "it is missing".to_owned() };
        let change = command.change.as_ref().ok_or_else(|| missing("change"))?;
        let (function, summary) = match change {
            Change::Window(window) => windowed(&present, window)?,
            Change::ShowOnly(range) => {
                let [low, high] = ends(range);
                (present.showing_only(low, high)?, format!("show only {}", values_between(range.low, range.high)))
            }
            Change::Hide(range) => {
                let [low, high] = ends(range);
                (present.hiding(low, high)?, format!("hide {}", values_between(range.low, range.high)))
            }
            Change::Color(ValueColor { range, color }) => {
                let range = range.as_ref().ok_or_else(|| missing("range"))?;
                let color = command_number::color(color.as_ref().ok_or_else(|| missing("color"))?, "color")?;
                let [low, high] = ends(range);
                (
                    present.colored(low, high, color.to_array())?,
                    format!("colour {}", values_between(range.low, range.high)),
                )
            }
            Change::Scale(scale) => {
                let scale = decode_scale(*scale).map_err(|e| malformed(&e))?;
                let name = match scale {
                    Scale::Linear => "linear",
                    Scale::Log10 => "logarithmic",
                    Scale::Symlog => "symmetric logarithmic",
                };
                (present.scaled(scale)?, format!("{name} scale of values"))
            }
        };
        // Checked as one from outside: a range may add points beyond the limit.
        let checked = decode_transfer_function(&encode_transfer_function(&function));
        self.take(checked.map_err(|e| malformed(&e))?)?;
        Ok(summary)
    }

    /// The transfer function that the Gaussians have.
    fn present_function(&self) -> Result<Arc<TransferFunction>, EditError> {
        let volume = self.state.geometry.volume.as_ref();
        let of_file = volume.and_then(|volume| volume.function.as_ref());
        if let Some(function) = self.state.transfer_function.as_ref().or(of_file) {
            return Ok(Arc::clone(function));
        }
        match self.scene.file().units.first() {
            Some(unit) if volume.is_none() => Err(ReclassifyError::NoValues(unit.name.clone()).into()),
            _ => Err(EditError::NoFunction),
        }
    }

    fn take(&mut self, function: Arc<TransferFunction>) -> Result<(), EditError> {
        sg_reclassify::check_scene(self.scene.file(), &function)?;
        self.state.transfer_function = Some(function);
        Ok(())
    }

    fn refuse_locked_values(&self) -> Result<(), EditError> {
        let everything = self.state.resolve(Some(&Target { everything: true, ..Target::default() }))?;
        self.refuse_locked(&everything)
    }
}

/// The function of a window, and its summary.
fn windowed(present: &TransferFunction, change: &ValueWindow) -> Result<(TransferFunction, String), EditError> {
    let (level, window) = present.level_and_window();
    let factor = change.window_factor.unwrap_or(1.0);
    if !(factor.is_finite() && factor > 0.0) {
        return Err(EditError::OutOfRange { field: "window_factor", found: factor, want: "a finite number above 0" });
    }
    let level = change.level.unwrap_or(level) + change.level_change + change.level_shift * window;
    let window = (change.window.unwrap_or(window) * factor + change.window_change).max(0.0);
    let function = present.windowed(level, window)?;
    let (level, window) = function.level_and_window();
    Ok((function, format!("level {}, window {}", significant(level), significant(window))))
}

fn ends(range: &ValueRange) -> [f64; 2] {
    [range.low.unwrap_or(f64::NEG_INFINITY), range.high.unwrap_or(f64::INFINITY)]
}
