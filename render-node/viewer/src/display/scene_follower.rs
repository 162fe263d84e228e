//! Where the Gaussians of a display's scene are: followed beside the loop that draws.

use std::sync::Arc;

use sg_edit::{EditState, PlacedScene};
use sg_scene::model::Scene;
use sg_selection::brush::Brush;

use super::latest_worker::LatestWorker;

/// A scene with Gaussians where a state has them.
pub struct FollowedScene {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The brush over it; `None` while a hand still moves them, and the former one has to do.
    pub brush: Option<Arc<Brush>>,
}

struct Job {
    state: Arc<EditState>,
    is_draft: bool,
}

/// Computes the scene of the newest state wherever edits have moved or duplicated Gaussians. Without such edits it does nothing.
pub struct SceneFollower {
    worker: LatestWorker<Job, (Arc<EditState>, FollowedScene)>,
    /// The state that was asked for last, and whether a hand was still at it.
    asked: (Arc<EditState>, bool),
    /// The newest state with the Gaussians of the scene that is known.
    shown: Arc<EditState>,
}

impl SceneFollower {
    /// Follows the scene of `file` from a first state on. Returns the scene as that state has it; `wake` is called after each
    /// later one.
    ///
    /// # Errors
    /// The system's error if it cannot start a thread.
    pub fn new(
        file: Arc<Scene>,
        first: Arc<EditState>,
        wake: impl Fn() + Send + 'static,
    ) -> std::io::Result<(Self, Arc<Scene>)> {
        let placed = PlacedScene::new(file);
        let scene = placed.of(&first);
        let mut kept: Option<(Arc<Scene>, Arc<Brush>)> = None;
        let work = move |Job { state, is_draft }: Job| {
            let scene = placed.of(&state);
            if is_draft {
                return (state, FollowedScene { scene, brush: None });
            }
            let brush = match kept.take().filter(|(of, _)| Arc::ptr_eq(of, &scene)) {
                Some((_, brush)) => brush,
                None => Arc::new(Brush::of_scene(&scene)),
            };
            kept = Some((Arc::clone(&scene), Arc::clone(&brush)));
            (state, FollowedScene { scene, brush: Some(brush) })
        };
        let worker = LatestWorker::new("follows", work, wake)?;
        Ok((Self { worker, asked: (Arc::clone(&first), false), shown: first }, scene))
    }

    /// Asks for the scene of `state` where it has other Gaussians, or has them elsewhere. `is_draft` says that a hand still moves
    /// them. Returns the newest scene that is known, once, and does not wait.
    pub fn follow(&mut self, state: &Arc<EditState>, is_draft: bool) -> Option<FollowedScene> {
        let (asked, was_draft) = &self.asked;
        let is_same = asked.has_scene_of(state);
        if !is_same || (*was_draft && !is_draft) {
            self.worker.submit(Job { state: Arc::clone(state), is_draft });
            self.asked = (Arc::clone(state), is_draft);
        }
        let (state, followed) = self.worker.take()?;
        self.shown = state;
        Some(followed)
    }

    /// `state`, if the scene that [`Self::follow`] returned last has its Gaussians; else the last state before it of which that holds.
    /// So a display shows the former state until the scene of duplicates is known.
    #[must_use]
    pub fn shown(&mut self, state: &Arc<EditState>) -> Arc<EditState> {
        if self.shown.has_gaussians_of(state) {
            self.shown = Arc::clone(state);
        }
        Arc::clone(&self.shown)
    }

    /// Whether nothing is computed or waits.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.worker.is_idle()
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use sg_proto::scene::command::Action;
    use sg_proto::scene::{DuplicateGaussians, Target, TransformGaussians, Vector};
    use sg_scene::synthetic::test_scene;

    use super::*;

    fn awaited(follower: &mut SceneFollower, state: &Arc<EditState>, is_draft: bool) -> FollowedScene {
        let begun = Instant::now();
        loop {
            if let Some(found) = follower.follow(state, is_draft) {
                return found;
            }
            assert!(begun.elapsed() < Duration::from_secs(10), "the worker does not answer");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn a_display_follows_moves_and_has_a_brush_once_the_hand_rests() {
        let file = Arc::new(test_scene(&[("bone", 30)]));
        let opened = Arc::new(EditState::of_scene(&file, "", ""));
        let (mut follower, first) = SceneFollower::new(Arc::clone(&file), Arc::clone(&opened), || ()).unwrap();
        assert!(Arc::ptr_eq(&first, &file) && follower.follow(&opened, true).is_none() && follower.is_idle());
        let shift = Some(Vector { x: 1.0, y: 0.0, z: 0.0 });
        let target = Some(Target { everything: true, ..Target::default() });
        let action = Action::TransformGaussians(TransformGaussians { target, shift, ..TransformGaussians::default() });
        let moved = Arc::new(opened.after(&file, action).unwrap());
        let drafted = awaited(&mut follower, &moved, true);
        assert!(drafted.brush.is_none());
        assert!((drafted.scene.position(3).unwrap() - file.position(3).unwrap()).x > 0.9);
        let rests = awaited(&mut follower, &moved, false);
        assert!(Arc::ptr_eq(&rests.scene, &drafted.scene));
        let at = rests.scene.position(3).unwrap();
        assert_eq!(rests.brush.unwrap().nearest(&[at]), Some(3));
        assert!(Arc::ptr_eq(&awaited(&mut follower, &opened, false).scene, &file), "undone: the file's own again");
    }

    #[test]
    fn a_display_shows_the_state_before_a_duplicate_until_its_scene_is_there() {
        let file = Arc::new(test_scene(&[("bone", 30)]));
        let opened = Arc::new(EditState::of_scene(&file, "", ""));
        let (mut follower, _) = SceneFollower::new(Arc::clone(&file), Arc::clone(&opened), || ()).unwrap();
        let target = Some(Target { everything: true, ..Target::default() });
        let duplicate = DuplicateGaussians { target, ..DuplicateGaussians::default() };
        let duplicated = Arc::new(opened.after(&file, Action::DuplicateGaussians(duplicate)).unwrap());
        assert!(Arc::ptr_eq(&follower.shown(&duplicated), &opened), "its scene is not known");
        let followed = awaited(&mut follower, &duplicated, false);
        assert_eq!(followed.scene.len(), 60);
        assert!(Arc::ptr_eq(&follower.shown(&duplicated), &duplicated));
        assert!(Arc::ptr_eq(&follower.shown(&opened), &duplicated), "undone, but the scene is that of both still");
        assert_eq!(awaited(&mut follower, &opened, false).scene.len(), 30);
        assert!(Arc::ptr_eq(&follower.shown(&opened), &opened));
    }
}
