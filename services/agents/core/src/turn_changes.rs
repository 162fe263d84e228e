//! Which steps of the scene's history take a turn of the conversation back.

use sg_proto::language::{Act, Intent, PlanResult};
use sg_proto::scene::change::Item;
use sg_proto::scene::{Event, State};

/// What the commands of a turn changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TurnChanges {
    /// Revisions that they made, in order.
    revisions: Vec<u64>,
}

/// Steps of the history, the newest ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Steps {
    /// Steps that take the turn back.
    pub(crate) all: u32,
    /// Those of them that changed the viewpoint after the turn.
    pub(crate) later_views: u32,
}

impl TurnChanges {
    /// The changes of an executed plan. `None`: nothing that an undo could reach.
    pub(crate) fn of(intent: &Intent, outcome: &PlanResult) -> Option<Self> {
        let mut revisions = Vec::new();
        for action in outcome.actions.iter().filter(|action| action.ok) {
            let Some(result) = &action.result else { continue };
            let clause = usize::try_from(action.clause).ok().and_then(|at| intent.clauses.get(at));
            if clause.is_some_and(|clause| matches!(clause.act(), Act::Undo | Act::Redo)) {
                // What came before it is no longer the newest part of the history.
                revisions.clear();
            } else {
                revisions.push(result.revision);
            }
        }
        (!revisions.is_empty()).then_some(Self { revisions })
    }

    /// The revision before the first change.
    pub(crate) fn start(&self) -> u64 {
        self.revisions.first().map_or(0, |first| first.saturating_sub(1))
    }

    /// The steps that take the turn back, from the events since [`TurnChanges::start`]. A window shares its viewpoint before an
    /// utterance, so changes of the viewpoint may follow the turn. After any other change there are none.
    pub(crate) fn steps(&self, events: &[Event], scene: &State) -> Steps {
        let mut labels: Vec<&String> = Vec::new();
        let mut later_views = 0;
        for event in events {
            // A command that only names its target makes no step.
            let items = event.changes.iter().filter_map(|change| change.item.as_ref());
            let mut items = items.filter(|item| !matches!(item, Item::Focus(_))).peekable();
            if items.peek().is_none() {
                continue;
            }
            if !self.revisions.contains(&event.revision) {
                if !items.all(|item| matches!(item, Item::View(_))) {
                    return Steps::default();
                }
                later_views += 1;
            }
            labels.push(&event.summary);
        }
        // An undo since then has events too, and `scene` may be older than the last event. The history tells.
        let is_newest = labels.len() <= scene.undo.len() && labels.iter().rev().zip(&scene.undo).all(|(a, b)| *a == b);
        match u32::try_from(labels.len()) {
            Ok(all) if is_newest && all > later_views => Steps { all, later_views },
            _ => Steps::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::language::{ActionResult, Clause};
    use sg_proto::scene::{BaseUnit, Change, CommandResult, Focus, View};

    fn event(revision: u64, summary: &str, items: Vec<Item>) -> Event {
        let changes = items.into_iter().map(|item| Change { item: Some(item) }).collect();
        Event { revision, summary: summary.to_owned(), changes, ..Event::default() }
    }

    fn unit() -> Item {
        Item::BaseUnit(BaseUnit::default())
    }

    fn focus() -> Item {
        Item::Focus(Focus::default())
    }

    fn view() -> Item {
        Item::View(View::default())
    }

    fn scene(revision: u64, undo: &[&str]) -> State {
        State { revision, undo: undo.iter().map(|label| (*label).to_owned()).collect(), ..State::default() }
    }

    fn steps(revisions: &[u64], events: &[Event], scene: &State) -> (u32, u32) {
        let steps = TurnChanges { revisions: revisions.to_vec() }.steps(events, scene);
        (steps.all, steps.later_views)
    }

    #[test]
    fn only_results_after_the_last_undo_count() {
        let acts = [Act::SetColor, Act::Undo, Act::SetColor, Act::Hide, Act::Describe, Act::Show];
        let clauses = acts.map(|act| Clause { act: act.into(), ..Clause::default() }).to_vec();
        let intent = Intent { clauses, ..Intent::default() };
        let action = |clause: u32, ok, revision: Option<u64>| ActionResult {
            clause,
            ok,
            result: revision.map(|revision| CommandResult { revision, ..CommandResult::default() }),
            ..ActionResult::default()
        };
        let result = |actions| PlanResult { actions, ..PlanResult::default() };
        let all = vec![
            action(0, true, Some(4)),
            action(1, true, Some(5)),
            action(2, true, Some(6)),
            action(3, true, Some(7)),
            action(4, true, None),
            action(5, false, None),
        ];
        let changes = TurnChanges::of(&intent, &result(all)).unwrap();
        assert_eq!((changes.revisions.as_slice(), changes.start()), ([6, 7].as_slice(), 5));
        let undone = vec![action(0, true, Some(4)), action(1, true, Some(5))];
        assert_eq!(TurnChanges::of(&intent, &result(undone)), None);
        assert_eq!(TurnChanges::of(&intent, &PlanResult::default()), None);
    }

    #[test]
    fn each_change_of_the_turn_is_a_step() {
        let red = event(5, "red", vec![unit(), focus()]);
        let hidden = event(6, "hidden", vec![unit()]);
        // The unit looked so already.
        let same = event(6, "blue", vec![focus()]);
        let before = ["hidden", "red", "before"];
        assert_eq!(steps(&[5, 6], &[red.clone(), hidden], &scene(6, &before)), (2, 0));
        assert_eq!(steps(&[5, 6], &[red, same.clone()], &scene(6, &["red", "before"])), (1, 0));
        assert_eq!(steps(&[6], &[same], &scene(6, &["before"])), (0, 0));
        assert_eq!(steps(&[5], &[], &scene(5, &["before"])), (0, 0));
    }

    #[test]
    fn later_views_are_steps_and_other_later_changes_end_it() {
        let red = event(5, "red", vec![unit()]);
        let looked = event(6, "looked", vec![view()]);
        let both = [red.clone(), looked.clone()];
        assert_eq!(steps(&[5], &both, &scene(6, &["looked", "red", "before"])), (2, 1));
        let by_hand = event(6, "opacity", vec![unit()]);
        assert_eq!(steps(&[5], &[red.clone(), by_hand], &scene(6, &["opacity", "red"])), (0, 0));
        // The view was taken back by hand, and that is no step.
        let taken_back = event(7, "undid: looked", vec![view()]);
        assert_eq!(steps(&[5], &[red.clone(), looked, taken_back], &scene(7, &["red", "before"])), (0, 0));
        // The change itself was taken back and another one made.
        assert_eq!(steps(&[5], &[red], &scene(5, &["before"])), (0, 0));
    }
}
