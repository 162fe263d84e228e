//! The pending selection, shown before it is durable.

use std::sync::Arc;

use sg_edit::Replica;
use sg_proto::keys::{self, role};
use sg_proto::selection::{Answers, Preview};
use sg_runtime::bus::{Bus, BusError};
use sg_scene::mask::Mask;
use tokio::sync::watch;

/// Most waiting previews; only the newest is drawn.
const WAITING: usize = 4;

/// The newest preview, while the bus exists.
pub(super) async fn follow(bus: &Bus) -> Result<watch::Receiver<Option<Preview>>, BusError> {
    let mut told = bus.subscribe(&keys::SELECTION_PREVIEW, role::SELECTION, WAITING).await?;
    let (newest, previews) = watch::channel(None);
    tokio::spawn(async move {
        while let Some((preview, _)) = told.next().await {
            newest.send_replace(Some(preview));
        }
    });
    Ok(previews)
}

/// Whether a preview was made over the current selection, and that did not go and come back since, as by undo.
fn holds(replica: &Replica, preview: &Preview) -> bool {
    preview.selection_hash == replica.state().selection().hash() && preview.revision >= replica.selected_at()
}

/// Answers of a preview that is shown.
pub(super) fn answers(replica: &Replica, preview: Option<&Preview>) -> Option<Arc<Answers>> {
    preview.filter(|p| holds(replica, p))?.answers.clone().map(Arc::new)
}

/// Highlighted mask of a view: the preview if it was made over the current selection, else that selection. A preview is
/// stale once its selection went and came back, as by undo.
pub(super) fn highlighted(replica: &Replica, preview: Option<&Preview>) -> Arc<Mask> {
    let committed = replica.state().selection();
    match preview.filter(|p| holds(replica, p) && !p.changed.is_empty()) {
        Some(preview) => Arc::new(changed(committed.mask(), &preview.changed)),
        None => Arc::clone(committed.mask()),
    }
}

/// A mask with the Gaussians of `runs` turned over: how many are passed over, how many differ, and so on.
pub(super) fn changed(mask: &Mask, runs: &[u32]) -> Mask {
    let mut mask = mask.clone();
    let mut at = 0_usize;
    for run in runs.chunks(2) {
        if let &[passed, differ] = run {
            let first = at.saturating_add(passed as usize).min(mask.len());
            at = first.saturating_add(differ as usize).min(mask.len());
            for i in first..at {
                mask.set(i, !mask.get(i));
            }
        }
    }
    mask
}

#[cfg(test)]
mod tests {
    use sg_edit::EditState;
    use sg_edit::wire::encode_mask;
    use sg_proto::replica::Replica as _;
    use sg_proto::scene::{Change, Event, Selection, change};
    use sg_scene::synthetic::test_scene;

    use super::*;

    fn commit(revision: u64, selected: &[usize]) -> Event {
        let mask = Mask::from_fn(8, |i| selected.contains(&i));
        let selection = Selection {
            count: mask.count() as u64,
            hash: sg_edit::mask_hash(&mask),
            mask: Some(encode_mask(&mask)),
            ..Selection::default()
        };
        let changes = vec![Change { item: Some(change::Item::Selection(selection)) }];
        Event { revision, changes, ..Event::default() }
    }

    #[test]
    fn a_preview_shows_until_another_selection_is_committed_and_not_again_when_that_is_taken_back() {
        let mut replica = Replica::new(EditState::of_scene(&test_scene(&[("all", 8)]), "scene.ply", "hash"));
        let over = replica.state().selection().hash().to_owned();
        let preview = Preview {
            selected: 2,
            changed: vec![3, 2],
            selection_hash: over,
            revision: replica.revision(),
            answers: Some(Answers::default()),
        };
        let shown = |replica: &Replica| highlighted(replica, Some(&preview)).ones().collect::<Vec<_>>();
        assert_eq!(shown(&replica), [3, 4]);
        assert!(answers(&replica, Some(&preview)).is_some());
        // A change of something else leaves it.
        let other = Event { revision: 1, ..Event::default() };
        replica.apply(&other).unwrap();
        assert_eq!(shown(&replica), [3, 4]);
        replica.apply(&commit(2, &[3, 4, 5])).unwrap();
        assert_eq!(shown(&replica), [3, 4, 5]);
        // Undone: the preview's base selection is current again.
        replica.apply(&commit(3, &[])).unwrap();
        assert!(answers(&replica, Some(&preview)).is_none());
        assert_eq!(shown(&replica), [0; 0]);
    }

    #[test]
    fn runs_turn_over_what_differs() {
        let mask = Mask::from_fn(20, |i| i < 5);
        let got = changed(&mask, &[3, 4, 9, 2]);
        assert_eq!(got.ones().collect::<Vec<_>>(), [0, 1, 2, 5, 6, 16, 17]);
        assert_eq!(changed(&mask, &[]), mask);
        // Runs past the end or without length are ignored.
        assert_eq!(changed(&mask, &[18, 40, 3]).ones().count(), 7);
        assert_eq!(changed(&mask, &[u32::MAX, u32::MAX]), mask);
    }
}
