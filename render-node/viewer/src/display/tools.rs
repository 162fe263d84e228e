//! Settings of one display, made by a person's hands and panels; the scene holds none of them.

use glam::Vec3;

use super::parameter_drag::WalkParameter;
use sg_raster::attributes::Attribute;
use sg_raster::foveation::Foveation;
use sg_raster::render::{Projection, Quality};

/// Brush mode: the effect of a stroke.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BrushMode {
    /// Seeds a random walk over the cluster graph.
    #[default]
    Walk,
    /// Changes whole Super-Gaussians.
    Cluster,
    /// Changes single Gaussians.
    Point,
}

impl BrushMode {
    /// All, in the order of a cycling button.
    pub const ALL: [Self; 3] = [Self::Walk, Self::Cluster, Self::Point];

    /// Name on panels and in the legend.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Walk => "Region",
            Self::Cluster => "Patch",
            Self::Point => "Single",
        }
    }

    /// One line on the effect of a stroke.
    #[must_use]
    pub fn hint(self) -> &'static str {
        match self {
            Self::Walk => "Brush grows to the whole structure.",
            Self::Cluster => "Brush changes whole Super-Gaussians.",
            Self::Point => "Brush changes single Gaussians.",
        }
    }

    /// The next one.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::Walk => Self::Cluster,
            Self::Cluster => Self::Point,
            Self::Point => Self::Walk,
        }
    }
}

/// Turn style of a stick pushed aside in a room.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TurnStyle {
    /// By 30° at once, as if the person turned.
    #[default]
    Snap,
    /// Evenly about the scene's middle.
    Smooth,
    /// Not at all.
    Off,
}

impl TurnStyle {
    /// All, in the order of the panel.
    pub const ALL: [Self; 3] = [Self::Snap, Self::Smooth, Self::Off];

    /// Name on the panel.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Snap => "at once",
            Self::Smooth => "evenly",
            Self::Off => "not at all",
        }
    }
}

/// Effect of the stick of the hand that takes away, in a room.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Locomotion {
    /// A wider or narrower brush, and the choice between a walk's parameters.
    #[default]
    Off,
    /// The person flies where the hand points.
    Fly,
    /// The person jumps to where an arc from the hand meets the floor.
    Teleport,
}

impl Locomotion {
    /// All, in the order of the panel.
    pub const ALL: [Self; 3] = [Self::Off, Self::Fly, Self::Teleport];

    /// Name on the panel.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "sizes the brush",
            Self::Fly => "flies",
            Self::Teleport => "teleports",
        }
    }
}

/// Colouring of this display.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum DisplayMode {
    /// The edited scene.
    #[default]
    Scene,
    /// Super-Gaussians in colours of their own.
    Clusters,
    /// Super-Gaussians by where they lie along the first principal axis.
    FirstComponent,
    /// The scene with the outlines of Super-Gaussians.
    Outlines,
    /// An attribute of each Gaussian as its colour.
    Attribute(Attribute),
}

/// The settings of one display.
#[derive(Debug, Clone, PartialEq)]
pub struct Tools {
    /// Brush mode.
    pub mode: BrushMode,
    /// The brush's radius as a fraction of the longest edge of the scene's box.
    pub radius: f64,
    /// Whether strokes, lassos and rectangles over a surface have a depth limit behind it.
    pub front_only: bool,
    /// Whether hidden Gaussians may become selected.
    pub include_hidden: bool,
    /// That limit for a brush, as a share of its radius, 0 to 1.
    pub brush_depth: f64,
    /// That limit for lassos and rectangles, as a fraction of the longest edge of the scene's box.
    pub lasso_depth: f64,
    /// Parameter of the last walk that the stick, keys and the wheel change.
    pub walk_parameter: WalkParameter,
    /// Whether the trigger's pressure narrows the brush.
    pub pressure: bool,
    /// Colour of the highlighted selection.
    pub highlight: Vec3,
    /// Share of that colour, 0 to 1.
    pub highlight_mix: f32,
    /// Factor on the opacity of the selection.
    pub highlight_opacity: f32,
    /// Display mode.
    pub display_mode: DisplayMode,
    /// The best quality drawn; a display goes below to keep its pace.
    pub quality: Quality,
    /// Projection and order of Gaussians.
    pub projection: Projection,
    /// Half resolution far from the optical axis of each eye of a headset.
    pub foveation: Option<Foveation>,
    /// Whether a window's background is a gradient about the scene's colour.
    pub gradient: bool,
    /// Whether pictures have ambient occlusion.
    pub occlusion: bool,
    /// Whether a window shows the ground grid and the box of what is visible.
    pub grid: bool,
    /// Whether the eye of a window goes to another view within a moment, rather than at once.
    pub smooth_views: bool,
    /// Whether panels are light rather than dark.
    pub light_panels: bool,
    /// Size of everything in panels, 1 for the usual.
    pub scale: f32,
    /// Whether the left hand is the dominant one.
    pub left_handed: bool,
    /// Whether the eyes' height is that of a seated person.
    pub seated: bool,
    /// Turn style of a stick.
    pub turn_style: TurnStyle,
    /// Effect of the other stick.
    pub locomotion: Locomotion,
    /// Whether hands turn the scene about the vertical only.
    pub upright: bool,
    /// Whether the floor is drawn.
    pub floor: bool,
    /// Metres of the room from an eye of a headset within which Gaussians fade.
    pub room_near: f64,
    /// Whether a headset shows the surroundings, where it can.
    pub surroundings: bool,
    /// Whether the controls' functions always hang beside the controllers.
    pub callouts: bool,
}

impl Tools {
    /// The narrowest and the widest brush, fractions of the box's longest edge.
    pub const RADII: (f64, f64) = (0.001, 0.25);

    /// The least and the greatest [`Self::lasso_depth`].
    pub const LASSO_DEPTHS: (f64, f64) = (0.002, 0.5);

    /// The least and the greatest [`Self::room_near`].
    pub const ROOM_NEARS: (f64, f64) = (0.01, 0.5);

    /// Multiplies the brush's radius, within [`Self::RADII`].
    pub fn widen(&mut self, factor: f64) {
        self.radius = (self.radius * factor).clamp(Self::RADII.0, Self::RADII.1);
    }
}

impl Default for Tools {
    fn default() -> Self {
        Self {
            mode: BrushMode::default(),
            radius: 0.02,
            front_only: true,
            include_hidden: false,
            brush_depth: 0.3,
            lasso_depth: 0.05,
            walk_parameter: WalkParameter::default(),
            pressure: false,
            // Okabe and Ito's sky blue: distinct from most palettes with every kind of colour vision.
            highlight: Vec3::new(0.337, 0.706, 0.914),
            highlight_mix: 0.6,
            highlight_opacity: 1.0,
            display_mode: DisplayMode::default(),
            quality: Quality::Standard,
            projection: Projection::default(),
            foveation: None,
            gradient: true,
            occlusion: false,
            grid: false,
            smooth_views: true,
            light_panels: false,
            scale: 1.0,
            left_handed: false,
            seated: false,
            turn_style: TurnStyle::default(),
            locomotion: Locomotion::default(),
            upright: false,
            floor: true,
            room_near: 0.05,
            surroundings: false,
            callouts: false,
        }
    }
}
