//! One frame while it is made.

use std::time::Duration;

use glam::DVec2;
use openxr as xr;

use super::error::XrError;
use super::options::{BlendMode, SurroundingsSource};
use super::quad::{PanelId, Quad};
use super::session::XrSession;
use super::space::Views;
use super::surroundings::{from_back_to_front, passthrough_layer};
use super::swapchain::SwapchainTarget;
use super::visibility_mask::Triangle;
use super::{device, space};
use crate::hands::{Eye, HandInput, Joints, Pose, Side};
use sg_gpu::{DEPTH_FAR, DEPTH_NEAR, Gpu};

/// One frame: predicted eyes and hands, and the targets to draw to.
pub struct Frame<'a> {
    /// Left and right.
    pub eyes: [Eye; 2],
    /// Between them.
    pub head: Pose,
    /// Left and right.
    pub hands: [HandInput; 2],
    /// Joints of each hand without a controller that the runtime sees.
    pub joints: [Option<Joints>; 2],
    /// When it will be shown, in seconds on the runtime's clock.
    pub seconds: f64,
    /// Seconds from one frame to the next.
    pub period: f64,
    /// Whether the person has recentred the room since the last frame: all of it may have moved.
    pub recentred: bool,
    pub(super) xr_session: &'a mut XrSession,
    pub(super) session: u64,
    pub(super) raw: [(xr::Posef, xr::Fovf); 2],
    pub(super) quads: Vec<Quad>,
    /// Width and height of the drawn part of each eye's picture.
    pub(super) part: [u32; 2],
    pub(super) eyes_drawn: bool,
    pub(super) depths_drawn: bool,
    /// The failed call: a lost runtime is not the error of `draw`.
    pub(super) failed: Option<XrError>,
}

impl<'a> Frame<'a> {
    pub(super) fn new(
        xr_session: &'a mut XrSession,
        eye_views: Views,
        hands: [(HandInput, Option<Joints>); 2],
        (session, time, period): (u64, xr::Time, xr::Duration),
    ) -> Self {
        let seconds = |nanoseconds: i64| nanoseconds as f64 * 1e-9;
        Self {
            eyes: eye_views.eyes,
            head: eye_views.head,
            hands: hands.map(|(hand, _)| hand),
            joints: hands.map(|(_, joints)| joints),
            seconds: seconds(time.as_nanos()),
            period: seconds(period.as_nanos()),
            recentred: std::mem::take(&mut xr_session.recentred),
            part: xr_session.eyes.size,
            xr_session,
            session,
            raw: eye_views.raw,
            quads: Vec::new(),
            eyes_drawn: false,
            depths_drawn: false,
            failed: None,
        }
    }

    /// The device that everything is drawn with.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.xr_session.shared.gpu
    }

    /// Width and height of each eye's picture, pixels.
    #[must_use]
    pub fn size(&self) -> [u32; 2] {
        self.xr_session.eyes.size
    }

    /// Whether the person's hands are given to this session and not to the runtime's own menu.
    #[must_use]
    pub fn is_focused(&self) -> bool {
        self.xr_session.state_machine.is_focused()
    }

    /// How pictures are put before the person's surroundings.
    #[must_use]
    pub fn blend_mode(&self) -> BlendMode {
        self.xr_session.surroundings.mode()
    }

    /// What can show the surroundings; `None` where they cannot be switched.
    #[must_use]
    pub fn surroundings(&self) -> Option<SurroundingsSource> {
        self.xr_session.surroundings.source()
    }

    /// Shows or hides the person's surroundings from this frame on. Draw afterwards: [`Self::blend_mode`] says how. Nothing changes
    /// where they cannot be switched.
    pub fn show_surroundings(&mut self, is_on: bool) {
        self.xr_session.show_surroundings(is_on);
    }

    /// Texture format of eyes and panels, as [`super::Headset::format`].
    #[must_use]
    pub fn format(&self) -> wgpu::TextureFormat {
        self.xr_session.format.wgpu
    }

    /// Format of the images for both eyes' depths: a depth format, with the size of their pictures. `None` if the runtime
    /// takes none.
    #[must_use]
    pub fn depth_format(&self) -> Option<wgpu::TextureFormat> {
        self.xr_session.depths.as_ref().map(|(_, format)| format.wgpu)
    }

    /// The areas of the left and the right eye's picture hidden by the lenses, and their version. Pixels there are never
    /// seen. Empty if the runtime does not report them.
    #[must_use]
    pub fn hidden(&self) -> (u64, &[Vec<Triangle>; 2]) {
        (self.xr_session.mask.version, &self.xr_session.mask.eyes)
    }

    /// Makes images for a panel of this many pixels, as [`super::Headset::panel`] does between frames.
    ///
    /// # Errors
    /// [`XrError::Call`] when the runtime fails.
    pub fn panel(&mut self, size: [u32; 2]) -> Result<PanelId, XrError> {
        let made = self.xr_session.panel(size, self.session);
        self.keep(made)
    }

    /// Draws both eyes' pictures. `draw` gets the left and right targets, in the format of [`super::Headset::format`]. It
    /// must submit its work before it returns. Without a call in a frame, no picture is shown.
    ///
    /// # Errors
    /// [`XrError::Call`] when the runtime fails.
    pub fn draw_eyes<T>(&mut self, draw: impl FnOnce(&[wgpu::TextureView]) -> T) -> Result<T, XrError> {
        let done = self.xr_session.eyes.draw(draw);
        self.part = self.xr_session.eyes.size;
        self.eyes_drawn |= done.is_ok();
        self.keep(done)
    }

    /// As [`Self::draw_eyes`], with the pictures' depths. `draw` also gets the depth images, in the format of
    /// [`Self::depth_format`]. It stores depths as [`sg_gpu::DepthLayer`] does. It gets no depth images if the runtime
    /// takes none.
    ///
    /// `part` is the drawn width and height, at most [`Self::size`], from the upper left of each target. The runtime shows
    /// that part alone, over the whole field of view: a picture of a lower resolution is resampled by the runtime only.
    ///
    /// # Errors
    /// [`XrError::Call`] when the runtime fails.
    pub fn draw_eyes_and_depths<T>(
        &mut self,
        part: [u32; 2],
        draw: impl FnOnce(&[wgpu::TextureView], &[wgpu::TextureView]) -> T,
    ) -> Result<T, XrError> {
        let XrSession { eyes, depths, .. } = &mut *self.xr_session;
        let done = match depths {
            Some((depths, _)) => depths.draw(|depths| eyes.draw(|eyes| draw(eyes, depths))).flatten(),
            None => eyes.draw(|eyes| draw(eyes, &[])),
        };
        self.part = part;
        self.eyes_drawn |= done.is_ok();
        self.depths_drawn |= done.is_ok() && self.xr_session.depths.is_some();
        self.keep(done)
    }

    /// Width and height of the part of each eye's target that this frame shows.
    #[must_use]
    pub fn part(&self) -> [u32; 2] {
        self.part
    }

    /// Whether this frame submits depths with its pictures.
    #[must_use]
    pub fn has_depths(&self) -> bool {
        self.depths_drawn && self.eyes_drawn
    }

    /// Draws a panel; its picture stays until the next call. `draw` is as for [`Self::draw_eyes`]. Colours have
    /// premultiplied alpha, as egui's.
    ///
    /// # Errors
    /// [`XrError::NoPanel`], [`XrError::Call`].
    pub fn draw_panel<T>(&mut self, panel: PanelId, draw: impl FnOnce(&wgpu::TextureView) -> T) -> Result<T, XrError> {
        let target = find(&mut self.xr_session.panels, self.session, panel)?;
        let done = target.draw(|layers| layers.first().map(draw));
        self.keep(done)?.ok_or(XrError::NoPanel)
    }

    /// Shows a panel in this frame, in front of the eyes' pictures or behind them. Of several the nearer covers the farther.
    /// One that was never drawn is not shown.
    pub fn show(&mut self, quad: Quad) {
        self.quads.push(quad);
    }

    /// Lets a hand feel something, of strength 0 to 1; a length of zero is the shortest that can be felt.
    ///
    /// # Errors
    /// [`XrError::Call`] when the runtime fails.
    pub fn pulse(&mut self, side: Side, strength: f32, length: Duration) -> Result<(), XrError> {
        let XrSession { actions, session, watchdog, .. } = &*self.xr_session;
        let done = watchdog.watch("a pulse", || actions.pulse(session, side, strength, length));
        self.keep(done.map_err(|e| XrError::call("pulse", e)))
    }

    fn keep<T>(&mut self, outcome: Result<T, XrError>) -> Result<T, XrError> {
        outcome.inspect_err(|error| {
            if let XrError::Call { what, code } = error {
                self.failed = Some(XrError::call(what, *code));
            }
        })
    }

    /// Hands the frame in: from back to front the panels behind the eyes' pictures, those pictures, and the panels in front of
    /// them, each from far to near.
    pub(super) fn end(mut self, time: xr::Time) -> Result<(), XrError> {
        if let Some(failed) = self.failed.take() {
            return Err(failed);
        }
        let head = self.head.position;
        self.quads.sort_by(|a, b| {
            let far = |q: &Quad| q.place.pose.position.distance_squared(head);
            far(b).total_cmp(&far(a))
        });
        let xr_session = &mut *self.xr_session;
        let depths = xr_session.depths.as_ref().filter(|_| self.depths_drawn);
        let depths = depths
            .map(|(target, _)| [0, 1].map(|k| device::depth_of(target.part(k, self.part), [DEPTH_NEAR, DEPTH_FAR])));
        let views = [0, 1].map(|k| {
            let (pose, fov) = self.raw[k];
            let view = xr::CompositionLayerProjectionView::new().pose(pose).fov(fov);
            let view = view.sub_image(xr_session.eyes.part(k as u32, self.part));
            match &depths {
                Some(depths) => device::with_depth(view, &depths[k]),
                None => view,
            }
        });
        let projection = xr::CompositionLayerProjection::new()
            .space(&xr_session.room)
            .layer_flags(xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA)
            .views(&views);
        let surroundings = xr_session.passthrough.as_ref().filter(|_| xr_session.surroundings.has_layer());
        let surroundings = surroundings.map(|passthrough| (passthrough_layer(passthrough.handle()), passthrough));
        let taken = usize::from(self.eyes_drawn) + usize::from(surroundings.is_some());
        let room_for = xr_session.most_layers.saturating_sub(taken);
        let hung: Vec<(&SwapchainTarget, &Quad)> = self
            .quads
            .iter()
            .filter_map(|quad| {
                let target = xr_session.panels.get(quad.panel.at).and_then(Option::as_ref);
                target.filter(|t| t.drawn && quad.panel.session == self.session).map(|t| (t, quad))
            })
            .collect();
        // The farthest give way.
        let hung = hung.get(hung.len().saturating_sub(room_for)..).unwrap_or_default();
        let quads: Vec<xr::CompositionLayerQuad<'_, xr::Vulkan>> = hung
            .iter()
            .map(|(target, quad)| {
                let DVec2 { x, y } = quad.place.size;
                xr::CompositionLayerQuad::new()
                    .space(&xr_session.room)
                    .eye_visibility(xr::EyeVisibility::BOTH)
                    .layer_flags(xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA)
                    .sub_image(target.sub_image(0))
                    .pose(space::raw(&quad.place.pose))
                    .size(xr::Extent2Df { width: x as f32, height: y as f32 })
            })
            .collect();
        let of = |in_front: bool| {
            let quads = quads.iter().zip(hung).filter(move |(_, (_, quad))| quad.in_front == in_front);
            quads.map(|(quad, _)| -> &xr::CompositionLayerBase<'_, xr::Vulkan> { quad })
        };
        let pictures: Option<&xr::CompositionLayerBase<'_, xr::Vulkan>> =
            if self.eyes_drawn { Some(&projection) } else { None };
        let surroundings = surroundings.as_ref().map(|(layer, owner)| device::as_layer(layer, owner));
        let layers: Vec<_> = from_back_to_front(surroundings, of(false), pictures, of(true)).collect();
        let (stream, blend) = (&mut xr_session.stream, xr_session.surroundings.raw_mode());
        xr_session
            .watchdog
            .watch("taking a frame", || stream.end(time, blend, &layers))
            .map_err(|e| XrError::call("frame", e))
    }
}

/// The panel of that name, if it was made in this session.
pub(super) fn find(
    panels: &mut [Option<SwapchainTarget>],
    session: u64,
    panel: PanelId,
) -> Result<&mut SwapchainTarget, XrError> {
    if panel.session != session {
        return Err(XrError::NoPanel);
    }
    panels.get_mut(panel.at).and_then(Option::as_mut).ok_or(XrError::NoPanel)
}
