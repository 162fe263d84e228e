//! The table of commands. Parser, help, suggestions, JSON schema and execution use it.

use sg_proto::language::{Act, Clause};
use sg_proto::render::Frame;
use sg_proto::scene::State;

use super::command::{Command, Context, Effect, Field};
use super::help::{help_text, with_names};
use super::{
    answers, background, best_view, color, delete, duplicate, files, frame, help as help_command, history, kept_views,
    light, lock, merge, movement, naming, opacity, orbit, question, selection, shading, tone, tour, transfer_function,
    viewpoint, visibility, zoom,
};
use crate::resolution::{Refusal, Step};

/// All commands in the order of the help. The first of two equally good readings wins.
pub(crate) const TABLE: &[Command] = &[
    color::SET_COLOR,
    opacity::SET_OPACITY,
    // Before "only …": "only this part" is about the strokes.
    answers::TAKE_ANSWER,
    // Before targets: "everything above 200" is no unit.
    transfer_function::VALUES,
    // Before targets: "the bookmark entry" is no unit. Before names: "call this view entry" keeps the view.
    kept_views::KEEP_VIEW,
    kept_views::GO_TO_VIEW,
    kept_views::FORGET_VIEW,
    kept_views::LIST_VIEWS,
    visibility::SHOW_ONLY,
    visibility::SHOW,
    visibility::HIDE,
    light::SET_LIGHT,
    tone::SET_TONE,
    transfer_function::WINDOW,
    transfer_function::SCALE,
    transfer_function::RESET_TRANSFER_FUNCTION,
    background::SET_BACKGROUND,
    best_view::BEST_VIEW,
    viewpoint::VIEWPOINT,
    frame::FRAME,
    movement::TRANSFORM,
    orbit::ORBIT,
    zoom::ZOOM,
    shading::SET_TERM,
    tour::TOUR,
    selection::SELECT,
    selection::CLEAR_SELECTION,
    naming::LABEL,
    naming::RENAME,
    merge::MERGE,
    duplicate::DUPLICATE,
    delete::DELETE_GAUSSIANS,
    delete::RESTORE_GAUSSIANS,
    delete::REMOVE_NAME,
    lock::LOCK,
    lock::UNLOCK,
    files::SAVE_PICTURE,
    files::SAVE_COPY,
    files::EXPORT,
    files::OPEN,
    question::LIST,
    question::QUERY_SELECTION,
    question::DESCRIBE,
    history::UNDO,
    history::REDO,
    history::RESET,
    help_command::HELP,
];

/// The first command with this act.
fn command(act: Act) -> Option<&'static Command> {
    TABLE.iter().find(|command| command.act == act)
}

/// The fields of a clause besides `act` and `words`.
pub(crate) fn fields(act: Act) -> Option<&'static [Field]> {
    command(act).map(|command| command.fields)
}

/// The effect of a clause on the image.
pub(crate) fn effect(clause: &Clause) -> Effect {
    command(clause.act()).map_or(Effect::None, |command| command.effect)
}

/// Turns a clause into a scene command or an answer. `frame` is the last frame; it is used only if it shows the same
/// revision as `state`.
///
/// # Errors
/// [`Refusal`]: the clause does not fit the scene.
pub fn resolve(clause: &Clause, state: &State, frame: Option<&Frame>) -> Result<Step, Refusal> {
    let frame = frame.filter(|f| f.revision == state.revision);
    let command = command(clause.act()).ok_or_else(|| Refusal::invalid("The clause has no act."))?;
    (command.resolve)(clause, &Context { state, frame, table: TABLE })
}

/// All examples of the table, with names of the scene's units.
#[must_use]
pub fn examples(names: &[&str]) -> Vec<String> {
    TABLE.iter().flat_map(|command| command.examples).map(|example| with_names(example, names)).collect()
}

/// The help: one line per command, with names of the scene's units in the examples.
#[must_use]
pub fn help(names: &[&str]) -> String {
    help_text(TABLE, names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_with_one_act_have_equal_fields_and_effects() {
        for row in TABLE {
            let first = command(row.act).unwrap();
            assert_eq!((row.fields, row.effect), (first.fields, first.effect), "{}", row.title);
        }
    }
}
