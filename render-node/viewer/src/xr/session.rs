//! One session from its runtime's first answer to its last.

use openxr as xr;

use super::actions::Actions;
use super::device::{self, VulkanDevice};
use super::error::XrError;
use super::hand_tracking::HandTrackers;
use super::options::Options;
use super::quad::PanelId;
use super::session_state::{StateMachine, Transition};
use super::space::{self, STEREO, Views};
use super::surroundings::{Passthrough, Surroundings};
use super::swapchain::{Format, SwapchainTarget};
use super::visibility_mask::VisibilityMask;
use super::watchdog::Watchdog;
use crate::hands::{BareHand, HandInput, Joints, Origin, Side, Stance};

/// Session events since the last poll.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SessionEvent {
    Nothing,
    Left,
    Lost,
}

/// A session with all its parts. Fields are dropped in this order: dependent objects first.
pub(super) struct XrSession {
    pub(super) panels: Vec<Option<SwapchainTarget>>,
    pub(super) eyes: SwapchainTarget,
    /// Their depths, where the runtime takes them, and the format of those.
    pub(super) depths: Option<(SwapchainTarget, Format)>,
    pub(super) actions: Actions,
    fingers: Option<HandTrackers>,
    /// The cameras, while their layer is shown.
    pub(super) passthrough: Option<Passthrough>,
    bare: [BareHand; 2],
    pub(super) room: xr::Space,
    pub(super) head: xr::Space,
    pub(super) waiter: xr::FrameWaiter,
    pub(super) stream: xr::FrameStream<xr::Vulkan>,
    pub(super) session: xr::Session<xr::Vulkan>,
    pub(super) shared: VulkanDevice,
    instance: xr::Instance,
    pub(super) state_machine: StateMachine,
    pub(super) surroundings: Surroundings,
    pub(super) format: Format,
    pub(super) origin: Origin,
    room_kind: xr::ReferenceSpaceType,
    pub(super) recentred: bool,
    pub(super) most_layers: usize,
    pub(super) runtime: String,
    pub(super) system: String,
    has_rates: bool,
    pub(super) watchdog: Watchdog,
    /// Pixels that the lenses hide; empty without a visibility mask.
    pub(super) mask: VisibilityMask,
}

impl Drop for XrSession {
    fn drop(&mut self) {
        // Images may still be drawn to. Whether that ends well no longer matters.
        let _ = self.shared.gpu.wait();
    }
}

impl XrSession {
    pub(super) fn open(options: &Options, watchdog: &Watchdog) -> Result<Self, XrError> {
        let entry = device::loader()?;
        let offered = entry.enumerate_extensions().map_err(|code| XrError::NoRuntime { code })?;
        let extensions = extensions(&offered);
        let application = xr::ApplicationInfo {
            application_name: "Super-Gaussian",
            application_version: 1,
            engine_name: "supergaussian",
            engine_version: 1,
            api_version: xr::Version::new(1, 0, 0),
        };
        let instance =
            entry.create_instance(&application, &extensions, &[], &()).map_err(|code| XrError::NoRuntime { code })?;
        let properties = instance.properties().map_err(|e| XrError::call("runtime's name", e))?;
        let runtime = format!("{} {}", properties.runtime_name, properties.runtime_version);
        let system = instance
            .system(xr::FormFactor::HEAD_MOUNTED_DISPLAY)
            .map_err(|code| XrError::NoHeadset { runtime: runtime.clone(), code })?;
        let lacks = |what| XrError::Lacks { runtime: runtime.clone(), what };
        if !extensions.khr_vulkan_enable2 {
            return Err(lacks("XR_KHR_vulkan_enable2"));
        }
        let about = instance.system_properties(system).map_err(|e| XrError::call("headset's name", e))?;
        let shared = VulkanDevice::open(&instance, system)?;
        let (session, waiter, stream) = shared.session(&instance, system)?;
        let actions = Actions::attach(&instance, &session)?;
        let fingers =
            if extensions.ext_hand_tracking { HandTrackers::follow(&instance, system, &session) } else { None };
        let spaces = session.enumerate_reference_spaces().map_err(|e| XrError::call("spaces", e))?;
        let (room_kind, origin) = match options.stance {
            Stance::Standing if spaces.contains(&xr::ReferenceSpaceType::STAGE) => {
                (xr::ReferenceSpaceType::STAGE, Origin::Floor)
            }
            _ => (xr::ReferenceSpaceType::LOCAL, Origin::Eyes),
        };
        let at_origin = |kind| {
            session.create_reference_space(kind, xr::Posef::IDENTITY).map_err(|e| XrError::call("reference space", e))
        };
        let (room, head) = (at_origin(room_kind)?, at_origin(xr::ReferenceSpaceType::VIEW)?);
        let modes =
            instance.enumerate_environment_blend_modes(system, STEREO).map_err(|e| XrError::call("blend modes", e))?;
        let has_layer = extensions.fb_passthrough && device::supports_passthrough(&instance, system);
        let surroundings = Surroundings::choose(options.blend_mode, &modes, has_layer);
        if surroundings.mode() != options.blend_mode {
            let (wanted, chosen) = (options.blend_mode, surroundings.mode());
            tracing::warn!(?wanted, ?chosen, "the headset does not offer this blend mode");
        }
        match surroundings.source() {
            Some(source) => tracing::info!(?source, "the headset can show the surroundings"),
            None => tracing::info!(
                "surroundings are not switched: {runtime} offers no XR_FB_passthrough and one blend mode"
            ),
        }
        let [format, depth_format] = Format::of(&session).map_err(|e| XrError::call("formats", e))?;
        let format = format.ok_or_else(|| lacks("images in sRGB"))?;
        let depth_format = depth_format.filter(|_| extensions.khr_composition_layer_depth);
        let size = size(&instance, system, options.resolution)?;
        let mut mask = VisibilityMask::default();
        if extensions.khr_visibility_mask {
            (0..2).for_each(|eye| mask.query(&session, eye));
        }
        let eyes = SwapchainTarget::new(&shared.gpu, &session, format, size, 2, watchdog)?;
        let depths = depth_format.and_then(|format| {
            let target = SwapchainTarget::new(&shared.gpu, &session, format, size, 2, watchdog);
            let target = target.inspect_err(|e| tracing::warn!("the headset gets no depths: {e}"));
            target.ok().map(|target| (target, format))
        });
        let xr_session = Self {
            panels: Vec::new(),
            eyes,
            depths,
            actions,
            fingers,
            passthrough: None,
            bare: Default::default(),
            room,
            head,
            waiter,
            stream,
            session,
            shared,
            instance,
            state_machine: StateMachine::new(),
            surroundings,
            format,
            origin,
            room_kind,
            recentred: false,
            most_layers: (about.graphics_properties.max_layer_count as usize).max(1),
            runtime,
            system: about.system_name,
            has_rates: extensions.fb_display_refresh_rate,
            watchdog: watchdog.clone(),
            mask,
        };
        xr_session.ask_for_rate(options.refresh_rate);
        let [width, height] = size;
        tracing::info!(runtime = xr_session.runtime, headset = xr_session.system, width, height, "headset opened");
        Ok(xr_session)
    }

    /// Refresh rates to choose from; none if the runtime offers no choice.
    pub(super) fn rates(&self) -> Vec<f32> {
        if self.has_rates { self.session.enumerate_display_refresh_rates().unwrap_or_default() } else { Vec::new() }
    }

    /// Requests the offered rate nearest to the wanted one.
    pub(super) fn ask_for_rate(&self, wanted: Option<f32>) {
        let Some(wanted) = wanted.filter(|r| r.is_finite()) else { return };
        let rates = self.rates();
        let nearest = rates.iter().copied().min_by(|a, b| (a - wanted).abs().total_cmp(&(b - wanted).abs()));
        match nearest.map(|rate| (rate, self.session.request_display_refresh_rate(rate))) {
            Some((_, Ok(()))) => {}
            Some((rate, Err(error))) => tracing::info!(rate, %error, "the refresh rate stays"),
            None => tracing::info!(wanted, "the runtime lets nobody choose the refresh rate"),
        }
    }

    pub(super) fn controllers(&self) -> [Option<String>; 2] {
        self.actions.controllers(&self.instance, &self.session)
    }

    /// Makes images for a panel.
    pub(super) fn panel(&mut self, size: [u32; 2], session: u64) -> Result<PanelId, XrError> {
        let Self { shared, session: xr, format, watchdog, .. } = &*self;
        let target = watchdog
            .watch("images for a panel", || SwapchainTarget::new(&shared.gpu, xr, *format, size, 1, watchdog))?;
        let at = self.panels.iter().position(Option::is_none).unwrap_or(self.panels.len());
        match self.panels.get_mut(at) {
            Some(slot) => *slot = Some(target),
            None => self.panels.push(Some(target)),
        }
        Ok(PanelId { at, session })
    }

    /// Processes all events.
    pub(super) fn events(&mut self) -> Result<SessionEvent, XrError> {
        let mut buffer = xr::EventDataBuffer::new();
        while let Some(event) = self.instance.poll_event(&mut buffer).map_err(|e| XrError::call("events", e))? {
            match event {
                xr::Event::SessionStateChanged(change) => {
                    let asked = self.state_machine.enter(change.state());
                    tracing::debug!(state = ?self.state_machine.state(), "headset session");
                    match asked {
                        Transition::Begin => {
                            self.session.begin(STEREO).map_err(|e| XrError::call("begin", e))?;
                        }
                        Transition::End => {
                            self.session.end().map_err(|e| XrError::call("end", e))?;
                        }
                        Transition::Leave => return Ok(SessionEvent::Left),
                        Transition::Lose => return Ok(SessionEvent::Lost),
                        Transition::Nothing => {}
                    }
                }
                xr::Event::InstanceLossPending(_) => return Ok(SessionEvent::Lost),
                xr::Event::ReferenceSpaceChangePending(change) if change.reference_space_type() == self.room_kind => {
                    self.recentred = true;
                }
                xr::Event::VisibilityMaskChangedKHR(change) if change.view_configuration_type() == STEREO => {
                    self.mask.query(&self.session, change.view_index() as usize);
                }
                xr::Event::InteractionProfileChanged(_) => {
                    let [left, right] = self.controllers();
                    tracing::info!(?left, ?right, "controllers");
                }
                xr::Event::DisplayRefreshRateChangedFB(change) => {
                    tracing::info!(rate = change.to_display_refresh_rate(), "refresh rate");
                }
                xr::Event::PassthroughStateChangedFB(change) => {
                    let flags = change.flags();
                    tracing::info!(?flags, "surroundings");
                    if flags.contains(xr::PassthroughStateChangedFlagsFB::NON_RECOVERABLE_ERROR) {
                        self.surroundings.give_up();
                    }
                    if flags.contains(xr::PassthroughStateChangedFlagsFB::REINIT_REQUIRED) {
                        // The next frame starts them anew.
                        self.passthrough = None;
                    }
                }
                xr::Event::EventsLost(lost) => {
                    tracing::warn!(count = lost.lost_event_count(), "the runtime dropped events");
                }
                _ => {}
            }
        }
        Ok(SessionEvent::Nothing)
    }

    /// Shows or hides the surroundings, and starts or ends the cameras for them.
    pub(super) fn show_surroundings(&mut self, is_on: bool) {
        self.surroundings.switch(is_on);
        let Self { surroundings, passthrough, session, watchdog, .. } = self;
        match (surroundings.has_layer(), &passthrough) {
            (false, Some(_)) => watchdog.watch("the cameras' end", || *passthrough = None),
            (true, None) => match watchdog.watch("the cameras' begin", || Passthrough::start(session)) {
                Ok(started) => *passthrough = Some(started),
                Err(error) => {
                    tracing::warn!(%error, "the surroundings cannot be shown");
                    surroundings.give_up();
                }
            },
            _ => {}
        }
    }

    /// Input of both hands at `time`: from a controller, or else from the runtime's hand tracking, with the joints of such a
    /// hand.
    pub(super) fn hands(&mut self, time: xr::Time) -> xr::Result<[(HandInput, Option<Joints>); 2]> {
        let focused = self.state_machine.is_focused();
        let mut hands = self.actions.read(&self.session, &self.room, time, focused)?.map(|hand| (hand, None));
        let Some(fingers) = &self.fingers else { return Ok(hands) };
        for side in Side::BOTH {
            let k = side.index();
            let controlled = hands[k].0.grip.is_some() || hands[k].0.aim.is_some();
            let joints = if focused && !controlled { fingers.joints(&self.room, k, time)? } else { None };
            let bare = self.bare[k].read(joints.as_ref());
            if !controlled {
                hands[k] = (bare, joints);
            }
        }
        Ok(hands)
    }

    /// Both eyes and the head at `time`; `None` while the runtime does not know where they are.
    pub(super) fn look(&self, time: xr::Time) -> xr::Result<Option<Views>> {
        let (flags, views) = self.session.locate_views(STEREO, time, &self.room)?;
        let known = xr::ViewStateFlags::ORIENTATION_VALID | xr::ViewStateFlags::POSITION_VALID;
        let [Some(left), Some(right)] = [0, 1].map(|k| views.get(k).and_then(space::eye)) else { return Ok(None) };
        if !flags.contains(known) {
            return Ok(None);
        }
        let head = space::pose(&self.head.locate(&self.room, time)?);
        // The runtime gets the exact poses back that the picture was drawn for.
        let raw = [0, 1].map(|k| views.get(k).map_or((xr::Posef::IDENTITY, xr::Fovf::default()), |v| (v.pose, v.fov)));
        Ok(Some(Views { eyes: [left, right], head: head.unwrap_or(left.pose), raw }))
    }
}

/// The used extensions among the offered ones.
fn extensions(offered: &xr::ExtensionSet) -> xr::ExtensionSet {
    let mut wanted = xr::ExtensionSet::default();
    wanted.khr_vulkan_enable2 = offered.khr_vulkan_enable2;
    wanted.fb_passthrough = offered.fb_passthrough;
    wanted.fb_display_refresh_rate = offered.fb_display_refresh_rate;
    wanted.khr_visibility_mask = offered.khr_visibility_mask;
    wanted.khr_composition_layer_depth = offered.khr_composition_layer_depth;
    wanted.ext_hand_tracking = offered.ext_hand_tracking;
    wanted.ext_hand_interaction = offered.ext_hand_interaction;
    wanted.meta_touch_controller_plus = offered.meta_touch_controller_plus;
    wanted
}

/// The picture's size for each eye: the runtime's recommendation times `resolution`, within its limits.
fn size(instance: &xr::Instance, system: xr::SystemId, resolution: f64) -> Result<[u32; 2], XrError> {
    let views =
        instance.enumerate_view_configuration_views(system, STEREO).map_err(|e| XrError::call("picture size", e))?;
    let factor = if resolution.is_finite() { resolution.clamp(0.1, 4.0) } else { 1.0 };
    let scaled = |recommended: u32, most: u32| ((f64::from(recommended) * factor).round() as u32).clamp(1, most.max(1));
    let largest = |side: fn(&xr::ViewConfigurationView) -> (u32, u32)| {
        views
            .iter()
            .map(|v| {
                let (a, b) = side(v);
                scaled(a, b)
            })
            .max()
            .unwrap_or(1)
    };
    Ok([
        largest(|v| (v.recommended_image_rect_width, v.max_image_rect_width)),
        largest(|v| (v.recommended_image_rect_height, v.max_image_rect_height)),
    ])
}
