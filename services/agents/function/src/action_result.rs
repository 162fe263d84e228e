//! Results of steps that did not run, or that ran before.

use sg_language::report;
use sg_proto::language::ActionResult;
use sg_proto::scene::{Command, CommandResult, Event};

/// A step that failed, with the reason.
pub(crate) fn failure(text: String) -> ActionResult {
    ActionResult { ok: false, text, ..ActionResult::default() }
}

/// The result of a command that an earlier try of the plan applied.
pub(crate) fn stored_result(id: &str, event: &Event) -> ActionResult {
    let result = CommandResult {
        id: id.to_owned(),
        revision: event.revision,
        summary: event.summary.clone(),
        repeated: true,
        ..CommandResult::default()
    };
    let command = Command { id: id.to_owned(), ..Command::default() };
    ActionResult {
        ok: true,
        text: report::sentence(&event.summary),
        command: Some(command),
        result: Some(result),
        ..ActionResult::default()
    }
}
