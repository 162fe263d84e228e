//! Commands to the scene of a running stack.

use std::ops::Range;

use sg_edit::wire::encode_mask;
use sg_proto::keys;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Command, CommandResult, CommitSelection};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_scene::mask::Mask;

/// Applies an action to the scene. The id of the context is that of the command.
///
/// # Errors
/// The fault of the scene service: it refuses the action, or is away.
pub async fn apply(bus: &Bus, action: Action, context: &Context) -> Result<CommandResult, Fault> {
    let command = Command { id: context.id.clone(), action: Some(action), ..Command::default() };
    bus.ask(&keys::SCENE_APPLY, &command, context).await
}

/// The action that selects a range of the Gaussians of a scene that has `count`.
#[must_use]
pub fn select_range(count: usize, range: Range<usize>) -> Action {
    let mut mask = Mask::empty(count);
    mask.select_range(range);
    Action::CommitSelection(CommitSelection { mask: Some(encode_mask(&mask)), ..CommitSelection::default() })
}
