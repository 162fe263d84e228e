//! A recording of a headset's frames: the times that quality is controlled by, as a table in a text file.
//!
//! # Format
//!
//! The first line is [`HEAD`], the second one [`COLUMNS`]. Each further line is a row of values between commas; lines that begin
//! with `#` are remarks. A shown frame has a row. Other states have one row, at their begin.
//!
//! | column | unit | |
//! | --- | --- | --- |
//! | `time` | s | since the begin of the recording, by a clock that only goes forward |
//! | `state` | | [`SessionVisibility::name`] |
//! | `period` | ms | from one frame of the display to the next, as the runtime predicts it |
//! | `missed` | | frames of the display without a new picture since the row before |
//! | `level` | | [`super::quality_control`]'s level of the picture of the scene; empty without a picture |
//! | `device` | ms | what the device took for that picture; empty where it was not measured |
//! | `pixels` | ms | the part of it that grows with pixels; empty on a device without timestamps |
//! | `delay` | ms | from the row's time until the measurement was known |
//!
//! A file has at most [`MAX_BYTES`] bytes: ten minutes at 90 frames in a second take 3 MiB.

use std::fmt::{self, Write as _};
use std::io;
use std::path::Path;

use sg_input::{file, limits};

use super::quality_control::LEVELS;

/// First line of a recording.
pub const HEAD: &str = "# supergaussian frame trace 1";

/// Names of the columns.
pub const COLUMNS: &str = "time,state,period,missed,level,device,pixels,delay";

/// Most bytes of a recording.
pub const MAX_BYTES: u64 = limits::TEXT_BYTES;

/// What a person sees of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionVisibility {
    /// Its pictures; the hands are its own.
    Focused,
    /// Its pictures, beside the runtime's own menu, which has the hands.
    Visible,
    /// Nothing of it: another program is shown, or the headset is off.
    Hidden,
    /// It does not run.
    Idle,
    /// The runtime is away.
    Away,
}

impl SessionVisibility {
    /// All, in the order of a falling session.
    pub const ALL: [Self; 5] = [Self::Focused, Self::Visible, Self::Hidden, Self::Idle, Self::Away];

    /// Name in a recording.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Focused => "focused",
            Self::Visible => "visible",
            Self::Hidden => "hidden",
            Self::Idle => "idle",
            Self::Away => "away",
        }
    }

    /// Whether the session's pictures are seen.
    #[must_use]
    pub fn is_shown(self) -> bool {
        matches!(self, Self::Focused | Self::Visible)
    }
}

/// Measured cost of a recorded picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedCost {
    /// Device seconds.
    pub seconds: f64,
    /// Those of them that grow with pixels, where the device measures passes.
    pub pixel_seconds: Option<f64>,
    /// Seconds from the frame until the measurement was known.
    pub delay: f64,
}

/// A row of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceRow {
    /// Seconds since the begin.
    pub time: f64,
    /// What the person saw from then on.
    pub state: SessionVisibility,
    /// Seconds from one frame of the display to the next; 0 before the runtime has said it.
    pub period: f64,
    /// Frames of the display without a new picture since the row before.
    pub missed: u64,
    /// Level of the picture.
    pub level: Option<usize>,
    /// Its cost, where it was measured.
    pub cost: Option<RecordedCost>,
}

/// A recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameTrace {
    /// Rows in their order.
    pub rows: Vec<TraceRow>,
}

/// Errors of a recording.
#[derive(Debug, thiserror::Error)]
pub enum FrameTraceError {
    /// The file cannot be read.
    #[error("{path}: {error}")]
    Read {
        /// The file.
        path: String,
        /// The system's error.
        error: io::Error,
    },
    /// A line that is not of the format.
    #[error("line {line}: {reason}")]
    Line {
        /// Its number, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
}

impl FrameTrace {
    /// Reads a recording.
    ///
    /// # Errors
    /// [`FrameTraceError`], also for a file of more than [`MAX_BYTES`].
    pub fn read(path: &Path) -> Result<Self, FrameTraceError> {
        let text = file::read_text(path, MAX_BYTES);
        Self::parse(&text.map_err(|error| FrameTraceError::Read { path: path.display().to_string(), error })?)
    }

    /// Parses the text of a recording.
    ///
    /// # Errors
    /// [`FrameTraceError::Line`] for another format, numbers that are not finite or below 0, unknown states and levels, and times
    /// that go back.
    pub fn parse(text: &str) -> Result<Self, FrameTraceError> {
        let mut lines = text.lines().zip(1..);
        for expected in [HEAD, COLUMNS] {
            let (found, line) = lines.next().unwrap_or(("", 1));
            if found != expected {
                return Err(FrameTraceError::Line { line, reason: format!("{expected:?} expected") });
            }
        }
        let mut rows: Vec<TraceRow> = Vec::new();
        for (text, line) in lines.filter(|(text, _)| !text.starts_with('#')) {
            let row = row(text).map_err(|reason| FrameTraceError::Line { line, reason })?;
            if rows.last().is_some_and(|before| before.time > row.time) {
                return Err(FrameTraceError::Line { line, reason: "the time goes back".to_owned() });
            }
            rows.push(row);
        }
        Ok(Self { rows })
    }
}

/// A row of its text.
fn row(text: &str) -> Result<TraceRow, String> {
    let values: Vec<&str> = text.split(',').collect();
    let [time, state, period, missed, level, device, pixels, delay] = values[..] else {
        return Err(format!("{} values, not 8", values.len()));
    };
    let state = SessionVisibility::ALL.into_iter().find(|s| s.name() == state);
    let state = state.ok_or_else(|| "an unknown state".to_owned())?;
    let level = optional(level, |text| text.parse().ok().filter(|level| *level < LEVELS), "level")?;
    let milliseconds = |text: &str| number(text).map(|ms| 1e-3 * ms);
    let cost = match optional(device, milliseconds, "device time")? {
        None => None,
        Some(seconds) => Some(RecordedCost {
            seconds,
            pixel_seconds: optional(pixels, milliseconds, "time of pixels")?,
            delay: milliseconds(delay).ok_or("no delay")?,
        }),
    };
    Ok(TraceRow {
        time: number(time).ok_or("no time")?,
        state,
        period: milliseconds(period).ok_or("no period")?,
        missed: missed.parse().map_err(|_| "no number of missed frames")?,
        level,
        cost,
    })
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|n: &f64| n.is_finite() && *n >= 0.0)
}

fn optional<T>(text: &str, read: impl FnOnce(&str) -> Option<T>, what: &str) -> Result<Option<T>, String> {
    match text {
        "" => Ok(None),
        text => read(text).map(Some).ok_or_else(|| format!("{text:?} is no {what}")),
    }
}

impl fmt::Display for TraceRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { time, state, period, missed, level, cost } = self;
        write!(f, "{time:.4},{},{:.3},{missed},", state.name(), 1e3 * period)?;
        if let Some(level) = level {
            write!(f, "{level}")?;
        }
        f.write_char(',')?;
        let Some(RecordedCost { seconds, pixel_seconds, delay }) = cost else { return f.write_str(",,") };
        write!(f, "{:.3},", 1e3 * seconds)?;
        if let Some(pixels) = pixel_seconds {
            write!(f, "{:.3}", 1e3 * pixels)?;
        }
        write!(f, ",{:.1}", 1e3 * delay)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(time: f64, cost: Option<RecordedCost>) -> TraceRow {
        TraceRow { time, state: SessionVisibility::Focused, period: 0.0111, missed: 1, level: Some(3), cost }
    }

    #[test]
    fn rows_are_read_as_they_were_written() {
        let cost = RecordedCost { seconds: 0.0042, pixel_seconds: Some(0.003), delay: 0.0223 };
        let rows = [
            shown(0.0, Some(cost)),
            shown(0.0111, Some(RecordedCost { pixel_seconds: None, ..cost })),
            shown(0.0222, None),
            TraceRow { time: 7.0, state: SessionVisibility::Hidden, level: None, ..shown(0.0, None) },
        ];
        let text: Vec<String> = rows.iter().map(ToString::to_string).collect();
        assert_eq!(text[0], "0.0000,focused,11.100,1,3,4.200,3.000,22.3");
        assert_eq!(text[3], "7.0000,hidden,11.100,1,,,,");
        let file = format!("{HEAD}\n{COLUMNS}\n{}\n# a remark\n", text.join("\n"));
        let read = FrameTrace::parse(&file).unwrap();
        let again: Vec<String> = read.rows.iter().map(ToString::to_string).collect();
        assert_eq!(again, text);
        let off = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(off(read.rows[0].cost.unwrap().delay, 0.0223) && off(read.rows[0].period, 0.0111));
    }

    #[test]
    fn other_texts_are_refused_with_their_line() {
        let file = |rows: &str| format!("{HEAD}\n{COLUMNS}\n{rows}");
        for (text, says) in [
            (String::new(), "line 1: \"# supergaussian frame trace 1\" expected"),
            (format!("{HEAD}\ntime\n"), "line 2"),
            (file("0,focused,11"), "line 3: 3 values"),
            (file("0,asleep,11,0,,,,"), "unknown state"),
            (file("NaN,focused,11,0,,,,"), "no time"),
            (file("0,focused,-1,0,,,,"), "no period"),
            (file("0,focused,11,0,17,,,"), "\"17\" is no level"),
            (file("0,focused,11,0,3,x,,1"), "\"x\" is no device time"),
            (file("0,focused,11,0,3,1,,"), "no delay"),
            (file("2,focused,11,0,,,,\n1,focused,11,0,,,,"), "line 4: the time goes back"),
        ] {
            let error = FrameTrace::parse(&text).unwrap_err().to_string();
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }
}
