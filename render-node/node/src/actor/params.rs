//! Launch parameters of a render process.

use std::path::PathBuf;

use serde::Deserialize;
use sg_gpu::Rasterizer;
use sg_gpu::backend::Backend;
use sg_proto::limits;
use sg_raster::render::{Projection, Quality};
use sg_viewer::display::{Locomotion, Tools};
use sg_viewer::xr::BlendMode;

/// Fastest steady pace of the view.
const MAX_FRAMES_PER_SECOND: f64 = 240.0;

/// Parameters in the launch file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Width of the view's pictures, pixels.
    pub(super) width: u32,
    /// Height of the view's pictures, pixels.
    pub(super) height: u32,
    /// Output besides the view's pictures: `none`, a `window` on this machine, or a `headset`. Without a headset, a window
    /// opens.
    pub(super) display: Display,
    /// Factor on the resolution that a headset recommends.
    pub(super) resolution: f64,
    /// Whether a person in a headset sits.
    pub(super) seated: bool,
    /// Whether the hands swap roles: left takes the tasks of right.
    pub(super) left_handed: bool,
    /// A person's surroundings in a headset: `opaque` hides them, `alpha-blend` and `additive` show them behind the scene where
    /// the runtime can.
    pub(super) blend_mode: BlendMode,
    /// The stick of the hand that takes away: `off` sizes the brush, `fly` and `teleport` move the person.
    pub(super) locomotion: Locomotion,
    /// Whether hands turn the scene about the vertical only.
    pub(super) upright: bool,
    /// Whether a headset shows a floor.
    pub(super) floor: bool,
    /// Whether the functions of the controls always hang beside the controllers.
    pub(super) callouts: bool,
    /// Whether a window mirrors the left eye of a headset.
    pub(super) mirror: bool,
    /// Seconds that a headset's runtime may hold the loop, 1 to 3600, before the process ends and is started again.
    pub(super) patience: f64,
    /// Folder for pictures that a person keeps in a display; by default the user's own for pictures.
    pub(super) pictures: Option<PathBuf>,
    /// Folder for recordings of a headset's frame times; nothing is recorded without it.
    pub(super) frame_traces: Option<PathBuf>,
    /// Quality of the view's pictures: `exact`, `standard` (without this) or `fast`.
    pub(super) quality: Option<Quality>,
    /// Projection of the view and its display: `affine` as in 3DGS, or `per-ray`. `per-ray` stays the same when a head
    /// turns and costs more.
    pub(super) projection: Projection,
    /// Rendering backend: `auto`, `cpu`, or `gpu`. `auto` prefers a graphics card and falls back to the cores.
    pub(super) backend: Backend,
    /// Blending method on a graphics device: `tiles`, `quads` or `bands`. By default a trial at the start picks the
    /// fastest.
    pub(super) rasterizer: Option<Rasterizer>,
    /// Degrees from the optical axis of an eye beyond which tiles in a headset have half the resolution, 1 to 89; 0 (without this) for
    /// the whole resolution everywhere.
    pub(super) foveation: u8,
    /// Whether a window's pictures are copied from the device that draws them. By default only pictures of a software
    /// device are copied.
    pub(super) copies: Option<bool>,
    /// Frames per second that the view draws without a change, for recorders and mirrors; 0 draws only changes.
    pub(super) frames_per_second: f64,
    /// Distance from the eye, in the scene's unit, within which Gaussians fade in published pictures and for picks, without a
    /// display; by default a two-hundredth of the scene's longest edge. At most a tenth of the way to the target of a view. In a
    /// headset metres of the room, 0.01 to 0.5; by default the person's own setting.
    pub(super) near: Option<f64>,
    /// Colour of a highlighted selection.
    pub(super) highlight_color: [f32; 3],
    /// Share of that colour, 0 to 1. By default 0.25 in a window, where a contour shows the selection too, and 0.6 elsewhere.
    pub(super) highlight_mix: Option<f32>,
    /// The file that a person has opened, absolute. Its window has it among its recent files, and suggests its folder.
    pub(super) file: Option<PathBuf>,
    /// What a window's title names; by default the name of the opened file, else the last two parts of the scene's path.
    pub(super) title: Option<String>,
}

/// Output of a view.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Display {
    /// None besides the published pictures.
    #[default]
    None,
    /// In a window.
    Window,
    /// In a headset; without one, in a window.
    Headset,
}

impl Display {
    /// Name in the launch file.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Window => "window",
            Self::Headset => "headset",
        }
    }
}

impl Default for Params {
    fn default() -> Self {
        Self {
            width: 640,
            height: 640,
            display: Display::None,
            resolution: 1.0,
            seated: false,
            left_handed: false,
            blend_mode: BlendMode::Opaque,
            locomotion: Locomotion::Off,
            upright: false,
            floor: true,
            callouts: false,
            mirror: false,
            patience: 30.0,
            pictures: None,
            frame_traces: None,
            quality: None,
            projection: Projection::Affine,
            backend: Backend::Auto,
            rasterizer: None,
            foveation: 0,
            copies: None,
            frames_per_second: 0.0,
            near: None,
            // Okabe and Ito's sky blue: distinct from most palettes with every kind of colour vision.
            highlight_color: [0.337, 0.706, 0.914],
            highlight_mix: None,
            file: None,
            title: None,
        }
    }
}

impl Params {
    /// The first invalid parameter, as text.
    pub(super) fn check(&self) -> Result<(), String> {
        let side = 1..=limits::MAX_PICTURE_PIXELS;
        if !side.contains(&self.width) || !side.contains(&self.height) {
            return Err(format!("a picture of {} x {} pixels; 1 to {} each", self.width, self.height, side.end()));
        }
        if !(0.0..=MAX_FRAMES_PER_SECOND).contains(&self.frames_per_second) {
            return Err(format!(
                "frames_per_second = {}; 0 for pictures of changes alone, else up to {MAX_FRAMES_PER_SECOND}",
                self.frames_per_second
            ));
        }
        if !(0.1..=4.0).contains(&self.resolution) {
            return Err(format!("resolution = {}; a factor from 0.1 to 4", self.resolution));
        }
        if self.foveation > 89 {
            return Err(format!("foveation = {}; degrees from 1 to 89, or 0 for none", self.foveation));
        }
        if !(1.0..=3600.0).contains(&self.patience) {
            return Err(format!("patience = {}; seconds from 1 to 3600", self.patience));
        }
        self.check_near()?;
        if !self.highlight_mix.is_none_or(|mix| (0.0..=1.0).contains(&mix))
            || !self.highlight_color.iter().all(|c| (0.0..=1.0).contains(c))
        {
            return Err("highlight_color and highlight_mix are numbers from 0 to 1".to_owned());
        }
        Ok(())
    }

    /// A near distance is a length of the scene, or of the room in a headset.
    fn check_near(&self) -> Result<(), String> {
        let Some(near) = self.near else { return Ok(()) };
        let (least, most) = Tools::ROOM_NEARS;
        if self.display == Display::Headset && !(least..=most).contains(&near) {
            return Err(format!("near = {near}; in a headset metres of the room from {least} to {most}"));
        }
        if !(near >= 0.0 && near.is_finite()) {
            return Err(format!("near = {near}; a finite length of at least 0"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_distance_is_of_the_room_in_a_headset_and_of_the_scene_elsewhere() {
        let check = |display, near| Params { display, near: Some(near), ..Params::default() }.check();
        for near in [0.01, 0.05, 0.5] {
            assert_eq!(check(Display::Headset, near), Ok(()));
        }
        for near in [0.0, 0.009, 0.51, -0.05, f64::INFINITY, f64::NAN] {
            let said = check(Display::Headset, near).unwrap_err();
            assert_eq!(said, format!("near = {near}; in a headset metres of the room from 0.01 to 0.5"));
        }
        for display in [Display::None, Display::Window] {
            assert_eq!((check(display, 0.0), check(display, 120.0)), (Ok(()), Ok(())));
            assert!(check(display, -1.0).is_err() && check(display, f64::NAN).is_err());
        }
        let unset = Params { display: Display::Headset, ..Params::default() };
        assert_eq!(unset.check(), Ok(()));
    }
}
