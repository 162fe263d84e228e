//! A person's surroundings behind the pictures: by the runtime's blend modes, or by a layer of `XR_FB_passthrough`.

use openxr as xr;
use openxr::sys;
use openxr::sys::Handle as _;

use super::options::{BlendMode, SurroundingsSource};

/// How a session shows the surroundings, and whether it does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surroundings {
    /// Blend mode of frames without them.
    plain: xr::EnvironmentBlendMode,
    /// `None` where they can be neither shown nor hidden.
    source: Option<SurroundingsSource>,
    is_on: bool,
}

impl Surroundings {
    /// The surroundings of a runtime that offers these blend modes, and has the passthrough extension or not. The `wanted` mode
    /// decides whether they are shown at first. Its own way comes first; then as through cameras, by a layer, and as on glass.
    pub(super) fn choose(wanted: BlendMode, offered: &[xr::EnvironmentBlendMode], has_layer: bool) -> Self {
        let opaque = xr::EnvironmentBlendMode::OPAQUE;
        let offers = |mode: BlendMode| offered.contains(&raw_mode(mode));
        let plain = Some(opaque).filter(|mode| offered.contains(mode)).or_else(|| offered.first().copied());
        let plain = plain.unwrap_or(opaque);
        let by = |mode: BlendMode| (offers(mode) && raw_mode(mode) != plain).then_some(SurroundingsSource::Blend(mode));
        let wanted_one = Some(wanted).filter(|mode| mode.shows_surroundings()).and_then(by);
        let layer = (has_layer && plain == opaque).then_some(SurroundingsSource::Passthrough);
        let source = wanted_one.or_else(|| by(BlendMode::AlphaBlend)).or(layer).or_else(|| by(BlendMode::Additive));
        Self { plain, source, is_on: wanted.shows_surroundings() && source.is_some() }
    }

    pub(super) fn source(&self) -> Option<SurroundingsSource> {
        self.source
    }

    /// Shows or hides them, where that is possible.
    pub(super) fn switch(&mut self, is_on: bool) {
        self.is_on = is_on && self.source.is_some();
    }

    /// Gives them up after an error.
    pub(super) fn give_up(&mut self) {
        (self.source, self.is_on) = (None, false);
    }

    /// Whether frames have a passthrough layer.
    pub(super) fn has_layer(&self) -> bool {
        self.is_on && self.source == Some(SurroundingsSource::Passthrough)
    }

    /// Blend mode that frames are submitted with.
    pub(super) fn raw_mode(&self) -> xr::EnvironmentBlendMode {
        match self.source {
            Some(SurroundingsSource::Blend(mode)) if self.is_on => raw_mode(mode),
            _ => self.plain,
        }
    }

    /// How pictures are put before the surroundings. A layer shows them as cameras do.
    pub(super) fn mode(&self) -> BlendMode {
        match self.raw_mode() {
            _ if self.has_layer() => BlendMode::AlphaBlend,
            xr::EnvironmentBlendMode::ALPHA_BLEND => BlendMode::AlphaBlend,
            xr::EnvironmentBlendMode::ADDITIVE => BlendMode::Additive,
            _ => BlendMode::Opaque,
        }
    }
}

fn raw_mode(mode: BlendMode) -> xr::EnvironmentBlendMode {
    match mode {
        BlendMode::Opaque => xr::EnvironmentBlendMode::OPAQUE,
        BlendMode::AlphaBlend => xr::EnvironmentBlendMode::ALPHA_BLEND,
        BlendMode::Additive => xr::EnvironmentBlendMode::ADDITIVE,
    }
}

/// The running cameras of a headset, and the layer that shows them. Both end with this.
pub(super) struct Passthrough {
    // The layer goes first.
    layer: xr::PassthroughLayerFB,
    _cameras: xr::Passthrough,
}

impl Passthrough {
    /// Starts the cameras. The `start` of openxr 0.22 pauses them instead, so they run from their creation on.
    pub(super) fn start(session: &xr::Session<xr::Vulkan>) -> xr::Result<Self> {
        let running = xr::PassthroughFlagsFB::IS_RUNNING_AT_CREATION;
        let cameras = session.create_passthrough(running)?;
        let purpose = xr::PassthroughLayerPurposeFB::RECONSTRUCTION;
        let layer = session.create_passthrough_layer(&cameras, running, purpose)?;
        Ok(Self { layer, _cameras: cameras })
    }

    pub(super) fn handle(&self) -> sys::PassthroughLayerFB {
        self.layer.as_raw()
    }
}

/// The layer of a frame that shows the cameras' pictures. It belongs to no space, as the extension demands.
pub(super) fn passthrough_layer(handle: sys::PassthroughLayerFB) -> sys::CompositionLayerPassthroughFB {
    sys::CompositionLayerPassthroughFB {
        ty: sys::CompositionLayerPassthroughFB::TYPE,
        next: std::ptr::null(),
        flags: xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA,
        space: sys::Space::NULL,
        layer_handle: handle,
    }
}

/// The layers of a frame from back to front: the surroundings, panels behind the eyes' pictures, those pictures, panels in front.
pub(super) fn from_back_to_front<T>(
    surroundings: Option<T>,
    behind: impl IntoIterator<Item = T>,
    pictures: Option<T>,
    in_front: impl IntoIterator<Item = T>,
) -> impl Iterator<Item = T> {
    surroundings.into_iter().chain(behind).chain(pictures).chain(in_front)
}

#[cfg(test)]
mod tests {
    use super::*;

    use xr::EnvironmentBlendMode as Mode;

    #[test]
    fn a_wanted_blend_mode_is_taken_where_it_is_offered() {
        let all = [Mode::ADDITIVE, Mode::OPAQUE, Mode::ALPHA_BLEND];
        let shown = |wanted, offered: &[Mode], has_layer| {
            let chosen = Surroundings::choose(wanted, offered, has_layer);
            (chosen.raw_mode(), chosen.mode(), chosen.has_layer())
        };
        assert_eq!(shown(BlendMode::Opaque, &all, true), (Mode::OPAQUE, BlendMode::Opaque, false));
        assert_eq!(shown(BlendMode::AlphaBlend, &all, true), (Mode::ALPHA_BLEND, BlendMode::AlphaBlend, false));
        assert_eq!(shown(BlendMode::Additive, &all, true), (Mode::ADDITIVE, BlendMode::Additive, false));
        assert_eq!(shown(BlendMode::AlphaBlend, &all[..2], true), (Mode::OPAQUE, BlendMode::AlphaBlend, true));
        assert_eq!(shown(BlendMode::AlphaBlend, &all[..2], false), (Mode::ADDITIVE, BlendMode::Additive, false));
        assert_eq!(shown(BlendMode::AlphaBlend, &all[1..2], false), (Mode::OPAQUE, BlendMode::Opaque, false));
        assert_eq!(shown(BlendMode::Additive, &[], false), (Mode::OPAQUE, BlendMode::Opaque, false));
    }

    #[test]
    fn a_switch_shows_and_hides_them_where_something_can() {
        let mut layer = Surroundings::choose(BlendMode::Opaque, &[Mode::OPAQUE], true);
        assert_eq!((layer.source(), layer.has_layer()), (Some(SurroundingsSource::Passthrough), false));
        layer.switch(true);
        // The layer lies under opaque frames, and pictures have their own opacity.
        assert_eq!((layer.raw_mode(), layer.mode(), layer.has_layer()), (Mode::OPAQUE, BlendMode::AlphaBlend, true));
        layer.switch(false);
        assert_eq!((layer.mode(), layer.has_layer()), (BlendMode::Opaque, false));
        layer.switch(true);
        layer.give_up();
        layer.switch(true);
        assert_eq!((layer.source(), layer.mode(), layer.has_layer()), (None, BlendMode::Opaque, false));

        let mut nothing = Surroundings::choose(BlendMode::AlphaBlend, &[Mode::OPAQUE], false);
        nothing.switch(true);
        assert_eq!((nothing.source(), nothing.mode()), (None, BlendMode::Opaque));

        let mut cameras = Surroundings::choose(BlendMode::Opaque, &[Mode::OPAQUE, Mode::ALPHA_BLEND], true);
        cameras.switch(true);
        assert_eq!((cameras.mode(), cameras.has_layer()), (BlendMode::AlphaBlend, false), "the core's way comes first");

        // Glass always shows them.
        let mut glass = Surroundings::choose(BlendMode::Opaque, &[Mode::ADDITIVE], true);
        glass.switch(false);
        assert_eq!((glass.source(), glass.mode()), (None, BlendMode::Additive));
    }

    #[test]
    fn the_surroundings_are_the_last_layer() {
        let handle = sys::PassthroughLayerFB::from_raw(7);
        let layer = passthrough_layer(handle);
        assert_eq!(layer.ty, sys::StructureType::COMPOSITION_LAYER_PASSTHROUGH_FB);
        assert!(layer.next.is_null() && layer.space == sys::Space::NULL && layer.layer_handle == handle);
        assert!(layer.flags.contains(xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA));
        let order = |surroundings, pictures| {
            from_back_to_front(surroundings, ["board"], pictures, ["menu", "labels"]).collect::<Vec<_>>()
        };
        assert_eq!(order(Some("room"), Some("eyes")), ["room", "board", "eyes", "menu", "labels"]);
        assert_eq!(order(None, Some("eyes")), ["board", "eyes", "menu", "labels"]);
        assert_eq!(order(Some("room"), None), ["room", "board", "menu", "labels"]);
    }
}
