//! How many steps of the scene's history a call made.

use sg_proto::language::Reply;
use sg_proto::scene::Event;
use sg_proto::scene::change::Item;
use sg_proto::scene::command::Action;

/// The newest steps of the history, made by one call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Change {
    /// Number of steps, at least 1.
    pub(super) steps: u32,
    /// Revision after them.
    pub(super) revision: u64,
}

/// What `undo` and `redo` take without a number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct History {
    done: Option<Change>,
    undone: Option<Change>,
}

impl History {
    /// Notes what a call changed.
    pub(super) fn note_done(&mut self, change: Option<Change>) {
        if change.is_some() {
            *self = Self { done: change, undone: None };
        }
    }

    /// Notes what `undo` took back.
    pub(super) fn note_undone(&mut self, change: Change) {
        *self = Self { done: None, undone: Some(change) };
    }

    /// Steps of `undo` at a revision.
    pub(super) fn undo(&self, revision: u64) -> u32 {
        steps_at(self.done, revision)
    }

    /// Steps of `redo` at a revision.
    pub(super) fn redo(&self, revision: u64) -> u32 {
        steps_at(self.undone, revision)
    }
}

/// Steps of a change if it is the newest one, else one step.
fn steps_at(change: Option<Change>, revision: u64) -> u32 {
    change.filter(|change| change.revision == revision).map_or(1, |change| change.steps)
}

/// Revisions that the actions of a reply made, in order. Empty if an action was itself one on the history.
pub(super) fn revisions(reply: &Reply) -> Vec<u64> {
    let done = || reply.actions.iter().filter(|action| action.ok);
    let mut commands = done().filter_map(|action| action.command.as_ref());
    if commands.any(|command| matches!(command.action, Some(Action::Undo(_) | Action::Redo(_)))) {
        return Vec::new();
    }
    done().filter_map(|action| action.result.as_ref()).map(|result| result.revision).collect()
}

/// The last revision that a reply tells of.
pub(super) fn last_revision(reply: &Reply) -> u64 {
    let results = reply.actions.iter().filter_map(|action| action.result.as_ref());
    results.map(|result| result.revision).fold(reply.revision, u64::max)
}

/// The steps of the history that revisions are, from the events since before the first of them. `None`: they are none,
/// or something else changed the scene between them.
pub(super) fn change(revisions: &[u64], events: &[Event]) -> Option<Change> {
    let (first, last) = (*revisions.first()?, *revisions.last()?);
    let mut steps = 0;
    for event in events.iter().filter(|event| (first..=last).contains(&event.revision)) {
        // A command that only names its target makes no step.
        let items = || event.changes.iter().filter_map(|change| change.item.as_ref());
        if items().all(|item| matches!(item, Item::Focus(_))) {
            continue;
        }
        if !revisions.contains(&event.revision) {
            return None;
        }
        steps += 1;
    }
    (steps > 0).then_some(Change { steps, revision: last })
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::language::ActionResult;
    use sg_proto::scene::{BaseUnit, Change as Part, Command, CommandResult, Focus, SetVisibility, Undo};

    fn event(revision: u64, items: Vec<Item>) -> Event {
        let changes = items.into_iter().map(|item| Part { item: Some(item) }).collect();
        Event { revision, changes, ..Event::default() }
    }

    fn unit() -> Item {
        Item::BaseUnit(BaseUnit::default())
    }

    fn focus() -> Item {
        Item::Focus(Focus::default())
    }

    #[test]
    fn each_change_is_a_step() {
        let events = [event(5, vec![unit(), focus()]), event(6, vec![focus()]), event(7, vec![unit()])];
        assert_eq!(change(&[5, 6, 7], &events), Some(Change { steps: 2, revision: 7 }));
        assert_eq!(change(&[5, 7], &events), Some(Change { steps: 2, revision: 7 }));
        assert_eq!(change(&[5], &events), Some(Change { steps: 1, revision: 5 }));
        assert_eq!(change(&[6], &events), None, "only named");
        assert_eq!(change(&[], &events), None);
        assert_eq!(change(&[5], &[]), None, "the events are gone");
        let foreign = [event(5, vec![unit()]), event(6, vec![unit()]), event(7, vec![unit()])];
        assert_eq!(change(&[5, 7], &foreign), None, "a person changed the scene in between");
    }

    #[test]
    fn revisions_come_from_actions_that_are_no_undo() {
        let action = |ok, action: Action, revision| ActionResult {
            ok,
            command: Some(Command { action: Some(action), ..Command::default() }),
            result: Some(CommandResult { revision, ..CommandResult::default() }),
            ..ActionResult::default()
        };
        let hide = || Action::SetVisibility(SetVisibility::default());
        let reply = |actions| Reply { revision: 4, actions, ..Reply::default() };
        let two = reply(vec![action(true, hide(), 4), action(true, hide(), 5), action(false, hide(), 0)]);
        assert_eq!((revisions(&two), last_revision(&two)), (vec![4, 5], 5));
        let undone = reply(vec![action(true, hide(), 4), action(true, Action::Undo(Undo { steps: 1 }), 5)]);
        assert_eq!((revisions(&undone), last_revision(&undone)), (vec![], 5));
    }

    #[test]
    fn the_last_call_is_taken_back_whole_while_it_is_the_newest() {
        let mut history = History::default();
        assert_eq!((history.undo(0), history.redo(0)), (1, 1));
        history.note_done(Some(Change { steps: 3, revision: 9 }));
        history.note_done(None);
        assert_eq!((history.undo(9), history.undo(10), history.redo(9)), (3, 1, 1));
        history.note_undone(Change { steps: 3, revision: 10 });
        assert_eq!((history.undo(10), history.redo(10), history.redo(11)), (1, 3, 1));
        history.note_done(Some(Change { steps: 3, revision: 11 }));
        assert_eq!((history.undo(11), history.redo(11)), (3, 1));
    }
}
