//! The state of panels from frame to frame.

use std::collections::BTreeMap;
use std::sync::Arc;

use sg_edit::UnitRef;
use sg_proto::scene::command::Action;
use sg_raster::attributes;
use sg_volume::TransferFunction;

use super::label_questions::LabelQuestions;
use super::last_turn::LastTurn;
use super::output::{DisplayAction, PanelHost};
use super::text_input::TextInput;
use super::volume_values::{FunctionState, VolumeValues};
use crate::display::ParameterDrag;

/// State of the panels from frame to frame.
#[derive(Debug, Default)]
pub struct Panels {
    /// Their host: decides which controls need a trigger, a ray or a mouse.
    pub host: PanelHost,
    /// Actions that the display supports; others are not drawn.
    pub supported_actions: Vec<DisplayAction>,
    /// Whether the display can show and hide the surroundings.
    pub switches_surroundings: bool,
    /// Legend of the current colours, if they stand for a number.
    pub numbers: Option<attributes::Legend>,
    /// Transfer function of each base unit of the file.
    pub(super) functions: Vec<Option<TransferFunction>>,
    /// The volume behind the scene, if Gaussians keep its values.
    pub(super) volume: Option<Arc<VolumeValues>>,
    pub(super) function: FunctionState,
    pub(super) chosen: Option<UnitRef>,
    /// Further units that a merge takes, in the order in which they were pressed.
    pub(super) joined: Vec<UnitRef>,
    pub(super) held: Option<ActiveEdit>,
    pub(super) text_input: TextInput,
    /// Name of the panel that is being drawn.
    pub(super) drawing: &'static str,
    /// The drawn version of `text_input`, by the name of the panel.
    pub(super) drawn: BTreeMap<&'static str, u64>,
    pub(super) shift: bool,
    pub(super) renaming: Option<UnitRef>,
    pub(super) select: SelectState,
    pub(super) labels: LabelQuestions,
    /// Whether the button that is held to talk was down.
    pub(super) is_talking: bool,
    /// The newest turn of the conversation as it was shown last.
    pub(super) last_turn: Option<LastTurn>,
    /// Revision of the scene that was shown last.
    pub(super) revision: u64,
    pub(super) shown_notices: NoticeTimes,
}

/// A change under a hand.
#[derive(Debug)]
pub(super) struct ActiveEdit {
    /// Name of the panel under the hand.
    pub(super) panel: &'static str,
    /// The change.
    pub(super) action: Action,
    /// Whether the display knows of it.
    pub(super) said: bool,
}

/// State of the Select panel.
#[derive(Debug)]
pub(super) struct SelectState {
    /// Distance to grow or shrink the selection, a fraction of the box's longest edge.
    pub(super) distance: f64,
    /// Gaussians of the largest hole to fill.
    pub(super) hole: f64,
    /// Largest feature distance of similar Gaussians from the selection's mean, in units of its spread.
    pub(super) likeness: f64,
    /// The unit to replace, while a confirmation is pending.
    pub(super) replaces: Option<String>,
    /// The last walk under the hand.
    pub(super) drag: ParameterDrag,
    /// Name of the panel with the slider of that walk under the hand.
    pub(super) dragged_in: &'static str,
}

impl Default for SelectState {
    fn default() -> Self {
        Self {
            distance: 0.005,
            hole: 100.0,
            likeness: 2.0,
            replaces: None,
            drag: ParameterDrag::default(),
            dragged_in: "",
        }
    }
}

/// When each line was first seen, seconds of the context's clock.
#[derive(Debug, Default)]
pub(super) struct NoticeTimes(pub(super) BTreeMap<u64, f64>);
