//! The scene of a file as the edits of a state place and colour its Gaussians.

use std::sync::{Arc, Mutex, PoisonError};

use sg_scene::model::{BaseUnit, Scene};

use super::duplicates;
use super::placement::{self, Placement};
use super::state::EditState;

impl EditState {
    /// Gaussians that are not where the file has them, by their maps. No Gaussian is in two parts.
    #[must_use]
    pub fn placements(&self) -> &Arc<[Placement]> {
        &self.placements
    }

    /// Whether both states have the same scene: Gaussians at the same places, under one transfer function.
    #[must_use]
    pub fn has_scene_of(&self, other: &Self) -> bool {
        self.has_gaussians_of(other)
            && placement::same(&self.placements, &other.placements)
            && self.has_function_of(other)
    }

    /// Whether both states of a scene have the same Gaussians: the file's and the same copies.
    #[must_use]
    pub fn has_gaussians_of(&self, other: &Self) -> bool {
        duplicates::same(&self.duplicates, &other.duplicates)
    }

    /// Whether the scene of this state is that of its file.
    pub(crate) fn is_as_in_file(&self) -> bool {
        self.duplicates.is_empty() && self.placements.is_empty() && self.transfer_function.is_none()
    }

    /// Number of Gaussians that are not where the file has them.
    #[must_use]
    pub fn moved_count(&self) -> usize {
        self.placements.iter().map(|part| part.members.count()).sum()
    }
}

/// The newest scene, and a state that has it.
#[derive(Debug)]
struct Newest {
    state: EditState,
    scene: Arc<Scene>,
}

impl Newest {
    fn of(state: &EditState, scene: &Arc<Scene>) -> Self {
        Self { state: state.clone(), scene: Arc::clone(scene) }
    }
}

/// The Gaussians of a file where edits put them, with the copies that edits added. A clone shares the memory of the newest scene.
#[derive(Debug, Clone)]
pub struct PlacedScene {
    file: Arc<Scene>,
    newest: Arc<Mutex<Option<Newest>>>,
}

impl PlacedScene {
    /// The scene of a file.
    #[must_use]
    pub fn new(file: Arc<Scene>) -> Self {
        Self { file, newest: Arc::default() }
    }

    /// A scene that is already where the edits of `state` put it, for states with the same Gaussians at the same places.
    pub(crate) fn shown(scene: Arc<Scene>, state: &EditState) -> Self {
        let newest = Some(Newest::of(state, &scene));
        Self { file: scene, newest: Arc::new(Mutex::new(newest)) }
    }

    /// The scene as its file has it.
    #[must_use]
    pub fn file(&self) -> &Arc<Scene> {
        &self.file
    }

    /// The scene as `state` has it. Where nothing was moved or copied, under the transfer function of the file, it is the file's own.
    /// Else all columns are copied, once for each change of places, copies and function: that takes milliseconds for 100,000
    /// Gaussians.
    #[must_use]
    pub fn of(&self, state: &EditState) -> Arc<Scene> {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        if state.is_as_in_file() {
            *newest = None;
            return Arc::clone(&self.file);
        }
        if let Some(Newest { scene, .. }) = newest.as_ref().filter(|known| known.state.has_scene_of(state)) {
            return Arc::clone(scene);
        }
        // The former copy goes first: two would take its memory twice.
        *newest = None;
        let scene = Arc::new(placed(&self.file, state));
        *newest = Some(Newest::of(state, &scene));
        scene
    }
}

/// The scene of a file with the copies of `state` and all Gaussians where it has them, under its transfer function.
#[must_use]
pub(crate) fn placed(scene: &Scene, state: &EditState) -> Scene {
    let mut placed = scene.clone();
    if let Some(function) = state.transfer_function() {
        // The command was refused unless the scene can have it.
        let _ = sg_reclassify::reclassify_scene(&mut placed, function);
    }
    for (duplicate, base) in state.duplicates().iter().zip(state.base_units().iter().skip(scene.units.len())) {
        let first = duplicate.originals().ones().next();
        let Some((source, _)) = first.and_then(|first| placed.locate(first)) else { continue };
        let rows: Vec<usize> = duplicate.originals().ones().map(|i| i - source.first).collect();
        let (gaussians, transfer_function) = (source.gaussians.rows(&rows), source.transfer_function.clone());
        let name = base.name.clone();
        let copies = BaseUnit { name, file: None, gaussians, first: base.first, transfer_function, ..*source };
        placed.units.push(copies);
    }
    for unit in &mut placed.units {
        let (to_local, from_local) = (unit.transform.inverse(), unit.transform);
        for part in state.placements().iter() {
            let rows: Vec<usize> = unit.range().filter(|i| part.members.get(*i)).map(|i| i - unit.first).collect();
            if !rows.is_empty() {
                // A unit that its file stretches keeps view-dependent colours that are turned only, as an export of it does.
                unit.gaussians.transform(&rows, &(to_local * part.map.matrix() * from_local));
            }
        }
    }
    placed
}
