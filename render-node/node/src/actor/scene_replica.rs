//! A render process's replica of the scene.

use std::sync::Arc;

use sg_edit::{EditState, Replica};
use sg_proto::selection::Preview;
use sg_runtime::context::Context;
use sg_runtime::scene_feed::{SceneFeed, Update};
use sg_scene::mask::Mask;
use tokio::sync::watch;

use super::preview;

/// The newest known state of the scene.
#[derive(Clone)]
pub(super) struct SceneReplica {
    /// Its state.
    pub(super) state: Arc<EditState>,
    /// No other selection than the present one has been committed since this revision.
    pub(super) selected_at: u64,
    /// Context of the newest change.
    pub(super) context: Context,
}

impl SceneReplica {
    /// Highlighted mask of a view: the preview if it was made over the current selection, else that selection. A preview is
    /// stale once its selection went and came back, as by undo.
    pub(super) fn highlighted(&self, preview: Option<&Preview>) -> Arc<Mask> {
        let committed = self.state.selection();
        let holds = |p: &&Preview| p.selection_hash == committed.hash() && p.revision >= self.selected_at;
        match preview.filter(|p| holds(p) && !p.changed.is_empty()) {
            Some(preview) => Arc::new(preview::changed(committed.mask(), &preview.changed)),
            None => Arc::clone(committed.mask()),
        }
    }
}

/// Follows the scene from a state on.
pub(super) fn follow(feed: SceneFeed, state: EditState) -> watch::Receiver<SceneReplica> {
    let replica = Replica::new(state);
    let first = SceneReplica {
        state: Arc::new(replica.state().clone()),
        selected_at: replica.selected_at(),
        context: Context::root(),
    };
    let (newest, state) = watch::channel(first);
    tokio::spawn(keep_up(feed, replica, newest));
    state
}

async fn keep_up(mut feed: SceneFeed, mut replica: Replica, newest: watch::Sender<SceneReplica>) {
    while let Some((update, context)) = feed.next().await {
        let taken = match &update {
            Update::Event(event) => replica.offer(event).map(drop).map_err(|e| e.to_string()),
            Update::Snapshot(state) => {
                EditState::from_snapshot(state).map(|s| replica = Replica::new(s)).map_err(|e| e.to_string())
            }
        };
        match taken {
            Ok(()) => {
                let (state, selected_at) = (Arc::new(replica.state().clone()), replica.selected_at());
                newest.send_replace(SceneReplica { state, selected_at, context });
            }
            Err(error) => tracing::error!("the scene cannot be followed: {error}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use sg_edit::wire::encode_mask;
    use sg_proto::scene::{Change, Event, Selection, change};
    use sg_scene::model::{BaseUnit, Scene};

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

    fn snapshot(replica: &Replica) -> SceneReplica {
        let state = Arc::new(replica.state().clone());
        SceneReplica { state, selected_at: replica.selected_at(), context: Context::root() }
    }

    fn scene() -> Scene {
        let gaussians = sg_scene::model::Gaussians {
            position: vec![glam::Vec3::ZERO; 8],
            log_scale: vec![glam::Vec3::ZERO; 8],
            rotation: vec![[1.0, 0.0, 0.0, 0.0]; 8],
            opacity_logit: vec![0.0; 8],
            ..Default::default()
        };
        let unit = BaseUnit {
            name: "all".to_owned(),
            file: None,
            gaussians,
            first: 0,
            palette: glam::Vec3::ONE,
            opacity: 1.0,
            transform: glam::DMat4::IDENTITY,
            convention: Default::default(),
            shading: Default::default(),
            oriented_normals: false,
            transfer_function: None,
        };
        Scene::compose(vec![unit], None)
    }

    #[test]
    fn a_preview_shows_until_another_selection_is_committed_and_not_again_when_that_is_taken_back() {
        let mut replica = Replica::new(EditState::of_scene(&scene(), "scene.ply", "hash"));
        let over = replica.state().selection().hash().to_owned();
        let preview = Preview { selected: 2, changed: vec![3, 2], selection_hash: over, revision: replica.revision() };
        let shown = |replica: &Replica| snapshot(replica).highlighted(Some(&preview)).ones().collect::<Vec<_>>();
        assert_eq!(shown(&replica), [3, 4]);
        // A change of something else leaves it.
        let other = Event { revision: 1, ..Event::default() };
        replica.offer(&other).unwrap();
        assert_eq!(shown(&replica), [3, 4]);
        replica.offer(&commit(2, &[3, 4, 5])).unwrap();
        assert_eq!(shown(&replica), [3, 4, 5]);
        // Undone: the preview's base selection is current again.
        replica.offer(&commit(3, &[])).unwrap();
        assert_eq!(shown(&replica), [0; 0]);
    }
}
