//! The scene of a file as the edits of a state place its Gaussians.

use std::sync::{Arc, Mutex, PoisonError};

use sg_scene::model::Scene;

use super::placement::{Placement, placed, same};
use super::state::EditState;

impl EditState {
    /// Gaussians that are not where the file has them, by their maps. No Gaussian is in two parts.
    #[must_use]
    pub fn placements(&self) -> &Arc<[Placement]> {
        &self.placements
    }

    /// Whether Gaussians are at the same places in both states of a scene.
    #[must_use]
    pub fn is_placed_as(&self, other: &Self) -> bool {
        same(&self.placements, &other.placements)
    }

    /// Number of Gaussians that are not where the file has them.
    #[must_use]
    pub fn moved_count(&self) -> usize {
        self.placements.iter().map(|part| part.members.count()).sum()
    }
}

/// Memory of the newest scene and its placements.
type Newest = Mutex<Option<(Arc<[Placement]>, Arc<Scene>)>>;

/// The Gaussians of a file where edits put them. A clone shares the memory of the newest scene.
#[derive(Debug, Clone)]
pub struct PlacedScene {
    file: Arc<Scene>,
    newest: Arc<Newest>,
}

impl PlacedScene {
    /// The scene of a file.
    #[must_use]
    pub fn new(file: Arc<Scene>) -> Self {
        Self { file, newest: Arc::default() }
    }

    /// A scene that is already where the edits of `state` put it, for states with the same placements.
    pub(crate) fn shown(scene: Arc<Scene>, state: &EditState) -> Self {
        let newest = Some((Arc::clone(state.placements()), Arc::clone(&scene)));
        Self { file: scene, newest: Arc::new(Mutex::new(newest)) }
    }

    /// The scene as its file has it.
    #[must_use]
    pub fn file(&self) -> &Arc<Scene> {
        &self.file
    }

    /// The scene as `state` has it. Where nothing was moved it is the file's own, without a copy. Else it is a copy of all
    /// columns, made once for each change of the placements: it takes milliseconds for 100,000 Gaussians.
    #[must_use]
    pub fn of(&self, state: &EditState) -> Arc<Scene> {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        if state.placements.is_empty() {
            *newest = None;
            return Arc::clone(&self.file);
        }
        if let Some((_, scene)) = newest.as_ref().filter(|(of, _)| same(of, &state.placements)) {
            return Arc::clone(scene);
        }
        // The former copy goes first: two would take its memory twice.
        *newest = None;
        let scene = Arc::new(placed(&self.file, &state.placements));
        *newest = Some((Arc::clone(&state.placements), Arc::clone(&scene)));
        scene
    }
}
