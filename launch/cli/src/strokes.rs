//! Stroke files that scripts name.

use std::collections::HashSet;
use std::path::Path;

use sg_input::limits::{SMALL_TEXT_BYTES, TEXT_BYTES};
use sg_proto::scene::SelectionStep;
use sg_proto::stroke_file::{self, Limits};

use crate::shipped::DENSEST;
use crate::terminal::{CommandResult, Failure};
use crate::text_file::read_text;
use supergaussian::script::{self, Step};

/// Reads a script and all stroke files that it names, so that mistakes show before slow work.
pub(crate) fn read_script(path: &Path) -> Result<Vec<Step>, Failure> {
    let text = read_text(path, SMALL_TEXT_BYTES)?;
    let steps = script::read(path, &text).map_err(|problems| Failure::Mistakes(problems.lines().collect()))?;
    check_strokes(&steps)?;
    Ok(steps)
}

fn check_strokes(steps: &[Step]) -> CommandResult {
    let mut checked = HashSet::new();
    for step in steps {
        if let Step::Strokes { file, .. } = step
            && !file.ends_with(DENSEST)
            && checked.insert(file)
        {
            read_strokes(file)?;
        }
    }
    Ok(())
}

/// Reads a file of strokes.
///
/// # Errors
/// The file cannot be read or has a mistake.
pub(crate) fn read_strokes(file: &Path) -> Result<Vec<SelectionStep>, Failure> {
    let text = read_text(file, TEXT_BYTES)?;
    stroke_file::parse(&text, &Limits::BUS).map_err(|e| Failure::Input(format!("{}: {e}", file.display())))
}
