//! A room around a person and the scene: a headset, two hands, panels around them.
//!
//! The loop waits only for the headset's next frame, and between frames for the trial at its start. Hands hold, scale and turn the scene ([`crate::hands::Grab`]) and
//! brush it ([`Interaction`]). Panels hang around the person and are pointed at. Meshes show hands, lasers, brushes and the
//! floor.

mod callouts;
mod eye_renderer;
mod hand_meshes;
mod interaction;
mod laser;
mod meshes;
mod mirror;
mod motion;
mod occlusion;
mod overlay;
mod panel_layers;
mod push_to_talk;
mod room_meshes;
mod saved_settings;
mod screenshots;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sg_edit::EditState;
use sg_scene::appearance::Appearance;
use sg_scene::model::{Scene, SceneBox};

use crate::display::frame_trace::SessionVisibility;
use crate::display::number_format::percent;
use crate::display::{
    AppearanceBuilder, Drafts, FollowedScene, FrameStats, RecordedFrame, Request, SceneFollower, Tools, TraceRecorder,
    ViewPort, ViewState,
};
use crate::hands::{Bookmarks, ComfortVignette, HandInput, Origin, Placement, Rectangle, Side, Stance};
use crate::panels::{DisplayAction, Output, Panel, PanelHost, Panels};
use crate::xr::{Counts, Frame, FrameOutcome, Headset, PAUSE, XrError};
use sg_gpu::{GpuError, Rasterizer};

pub use interaction::{BrushMarker, Interaction, InteractionOutput, PanelCapture};
pub use panel_layers::first_place;

use eye_renderer::{Around, EyeRenderer, Sight};
use laser::SceneHits;
use mirror::Mirror;
use motion::Motion;
use occlusion::Occlusion;
use overlay::MarkerOverlay;
use panel_layers::PanelLayers;
use room_meshes::{Floor, Hole, Met, Room, SeenHand};
use saved_settings::SavedSettings;
use screenshots::Screenshots;

/// Seconds of one frame before the headset has said how long one is.
const FIRST_PERIOD: f64 = 1.0 / 90.0;

/// Configuration of a headset view.
pub struct Setup {
    /// The geometry.
    pub scene: Arc<Scene>,
    /// Source of the newest state, and sink of requests.
    pub view_port: ViewPort,
    /// The initial settings of hands and panels; those that `settings` has override them.
    pub tools: Tools,
    /// Metres of the room within which Gaussians fade, if given for this run; it overrides the saved one.
    pub near: Option<f64>,
    /// Path of the settings that the headset shares with the window: ambient occlusion and the near distance of the room. `None`:
    /// not saved.
    pub settings: Option<PathBuf>,
    /// Path of the opened scene; transfer functions are read from its folder.
    pub opened: PathBuf,
    /// Whether a desktop window mirrors the left eye, while [`VrView::serve`] serves it.
    pub mirror: bool,
    /// How splats are blended; without it a trial of what the person sees picks the fastest way.
    pub rasterizer: Option<Rasterizer>,
    /// Folder for pictures that the person keeps.
    pub pictures: PathBuf,
    /// Folder for a recording of the frames' times, see [`crate::display::frame_trace`].
    pub frame_traces: Option<PathBuf>,
}

/// A room.
pub struct VrView {
    /// The scene with Gaussians where edits put them, and what finds it; `None` if the system gives no thread for it.
    scene: Arc<Scene>,
    follower: Option<SceneFollower>,
    view_port: ViewPort,
    tools: Tools,
    drafts: Drafts,
    appearance_builder: AppearanceBuilder,
    occlusion: Occlusion,
    saved_settings: SavedSettings,
    interaction: Interaction,
    panels: Panels,
    panel_layers: PanelLayers,
    markers: MarkerOverlay,
    bookmarks: Bookmarks,
    comfort: ComfortVignette,
    motion: Motion,
    /// Whether the scene jumped since the last frame.
    jumped: bool,
    /// Reason for reopening the device.
    lost: Option<String>,
    eyes: Option<EyeRenderer>,
    /// Whether the next frame may draw the scene.
    is_prepared: bool,
    rasterizer: Option<Rasterizer>,
    /// Level of quality that is held.
    held: Option<usize>,
    /// What the person saw in the newest frame.
    sight: Option<Sight>,
    /// The last device error; each is logged once.
    trouble: Option<String>,
    frames: u64,
    /// The origin of the room frame, at y = 0.
    origin: Origin,
    /// Whether the scene's placement is that of a seated person.
    seated: bool,
    /// Revision of the scene that the newest frame shows.
    revision: u64,
    /// Whether to open the mirror window.
    mirrors: bool,
    hits: SceneHits,
    /// What the hands' lasers met in the newest frame.
    met: [Option<Met>; 2],
    screenshots: Screenshots,
    recorder: Option<TraceRecorder>,
}

impl VrView {
    /// A room around an open headset.
    #[must_use]
    pub fn new(setup: Setup, headset: &Headset) -> Self {
        let Setup {
            scene,
            mut view_port,
            mut tools,
            near,
            settings,
            opened,
            mirror,
            rasterizer,
            pictures,
            frame_traces,
        } = setup;
        let saved_settings = SavedSettings::read(settings, near, &mut tools);
        let home = home(&scene, &mut view_port, &tools, headset.origin());
        let mut panels = Panels::new(PanelHost::Headset);
        for problem in panels.behind(&scene, Path::new(&opened)) {
            tracing::warn!("no curve is shown: {problem}");
        }
        tools.surroundings = headset.wants_surroundings();
        let followed = SceneFollower::new(Arc::clone(&scene), Arc::clone(&view_port.newest().scene), || ());
        let followed = followed.inspect_err(|e| tracing::warn!("moved Gaussians stay: no thread to follow them: {e}"));
        let (follower, scene) = followed.map_or((None, scene), |(follower, placed)| (Some(follower), placed));
        let recorder = frame_traces.and_then(|folder| {
            let begun = TraceRecorder::begin(&folder);
            begun.inspect_err(|e| tracing::warn!("{}: {e}; frames are not recorded", folder.display())).ok()
        });
        let seated = tools.seated;
        let interaction = Interaction::new(&scene, home);
        Self {
            hits: SceneHits::new(Arc::clone(&scene), interaction.search_tree()),
            met: [None; 2],
            screenshots: Screenshots::new(Arc::clone(&scene), pictures),
            recorder,
            interaction,
            panel_layers: PanelLayers::new(stance(&tools), headset.origin()),
            markers: MarkerOverlay::default(),
            scene,
            follower,
            view_port,
            tools,
            drafts: Drafts::default(),
            appearance_builder: AppearanceBuilder::default(),
            occlusion: Occlusion::default(),
            saved_settings,
            panels,
            bookmarks: Bookmarks::default(),
            comfort: ComfortVignette::default(),
            motion: Motion::default(),
            jumped: false,
            lost: None,
            eyes: None,
            is_prepared: false,
            rasterizer,
            held: None,
            sight: None,
            trouble: None,
            frames: 0,
            origin: headset.origin(),
            seated,
            revision: 0,
            mirrors: mirror,
        }
    }

    /// Placement of the scene.
    #[must_use]
    pub fn placement(&self) -> Placement {
        self.interaction.placement()
    }

    /// The present settings of hands and panels.
    #[must_use]
    pub fn tools(&self) -> &Tools {
        &self.tools
    }

    /// Placement of a panel, unless it is hidden.
    #[must_use]
    pub fn panel(&self, panel: Panel) -> Option<Rectangle> {
        self.panel_layers.place(panel)
    }

    /// Layout and draw counts of a panel.
    #[must_use]
    pub fn counts(&self, panel: Panel) -> Option<Counts> {
        self.panel_layers.counts(panel)
    }

    /// Positions of the last proposal marks, and the emphasized one.
    #[must_use]
    pub fn markers(&self) -> Vec<(Rectangle, bool)> {
        self.markers.places()
    }

    /// Where a hand's laser meets a panel or the scene, in the room.
    #[must_use]
    pub fn laser_end(&self, side: Side) -> Option<glam::DVec3> {
        match self.met[side.index()]? {
            Met::Nothing => None,
            Met::Panel(at) | Met::Scene(at) => Some(at),
        }
    }

    /// Where the labels of a hand's controls hang, while they are shown.
    #[must_use]
    pub fn callouts(&self, side: Side) -> Option<Rectangle> {
        self.panel_layers.callouts(side)
    }

    /// Serves a headset on this thread until its session ends or its view port closes, and saves the person's settings then.
    ///
    /// # Errors
    /// [`XrError::Gone`] for a runtime that went away and did not come back.
    pub fn serve(mut self, headset: &mut Headset) -> Result<(), XrError> {
        let served = self.serve_frames(headset);
        self.saved_settings.save(&self.tools);
        served
    }

    /// The frames until the end.
    fn serve_frames(&mut self, headset: &mut Headset) -> Result<(), XrError> {
        let mirror = self.mirrors.then(Mirror::open).transpose();
        let mut mirror = mirror.unwrap_or_else(|why| {
            tracing::warn!("the headset is not mirrored: {why}");
            None
        });
        loop {
            if self.view_port.is_closed() {
                headset.leave();
            }
            let step = self.step(headset)?;
            match step {
                FrameOutcome::Shown | FrameOutcome::Hidden | FrameOutcome::Back => {}
                FrameOutcome::Idle => std::thread::sleep(PAUSE),
                FrameOutcome::Away => {
                    mirror.iter_mut().for_each(Mirror::put_away);
                    std::thread::sleep(PAUSE);
                }
                FrameOutcome::Ended => return Ok(()),
            }
            if step == FrameOutcome::Shown {
                self.show_in(&mut mirror, headset);
            }
            if mirror.as_mut().is_some_and(|m| !m.attend()) {
                tracing::info!("the mirror was closed");
                mirror = None;
            }
            if let Some(reason) = self.lost.take() {
                self.eyes = None;
                mirror.iter_mut().for_each(Mirror::put_away);
                headset.restart(reason);
            }
            self.tell(headset);
        }
    }

    /// Prepares the headset's next frame, waits for it, draws and records it. After [`FrameOutcome::Away`] the caller drops what it
    /// made with the device, as this view does.
    ///
    /// # Errors
    /// As [`Headset::frame`].
    pub fn step(&mut self, headset: &mut Headset) -> Result<FrameOutcome, XrError> {
        self.prepare(headset);
        let pictures = self.pictures();
        let step = headset.frame(|frame| self.frame(frame))?;
        match step {
            FrameOutcome::Hidden | FrameOutcome::Idle => self.interrupt(),
            // These objects belong to the lost device.
            FrameOutcome::Away => self.eyes = None,
            FrameOutcome::Shown | FrameOutcome::Back | FrameOutcome::Ended => {}
        }
        // Hands give no input where nothing is shown, so a button that is held there is never released.
        if step != FrameOutcome::Shown
            && let Some(request) = self.interaction.stop_talking()
        {
            self.view_port.send(request);
        }
        let is_drawn = self.pictures() > pictures;
        self.record(step, headset, is_drawn);
        Ok(step)
    }

    /// Number of pictures of the scene on this device.
    fn pictures(&self) -> u64 {
        self.eyes.as_ref().map_or(0, |eyes| eyes.pictures)
    }

    /// Records a frame, with a picture of the scene or without, and the measurements that it learnt.
    fn record(&mut self, step: FrameOutcome, headset: &Headset, is_drawn: bool) {
        let Some(recorder) = &mut self.recorder else { return };
        let state = match step {
            FrameOutcome::Shown if headset.is_focused() => SessionVisibility::Focused,
            FrameOutcome::Shown => SessionVisibility::Visible,
            FrameOutcome::Hidden => SessionVisibility::Hidden,
            FrameOutcome::Idle => SessionVisibility::Idle,
            FrameOutcome::Away => SessionVisibility::Away,
            FrameOutcome::Back | FrameOutcome::Ended => return,
        };
        let timing = headset.timing();
        let picture = self.eyes.as_ref().filter(|_| is_drawn).map(EyeRenderer::newest);
        recorder.frame(RecordedFrame { state, period: timing.period, missed: timing.missed, picture });
        for (picture, seconds, pixel_seconds) in self.eyes.iter_mut().flat_map(EyeRenderer::new_costs) {
            recorder.measured(picture, seconds, pixel_seconds);
        }
    }

    /// Prepares the renderer of both eyes, between two frames. The first call after a frame uploads the scene, the next ones each
    /// make one step of the trial that picks the rasterizer, and all further ones make what the next pictures need. Without
    /// effect while the runtime is away.
    pub fn prepare(&mut self, headset: &Headset) {
        self.occlusion.prepare(&self.tools);
        let Some(sight) = self.sight else { return };
        let prepared = match &mut self.eyes {
            Some(eyes) => eyes.prepare(&sight, &self.tools, || {
                let newest = Arc::clone(&self.view_port.newest().scene);
                self.follower.as_mut().map_or(Arc::clone(&newest), |follower| follower.shown(&newest)).appearance()
            }),
            none => EyeRenderer::new(headset, &self.scene, self.rasterizer).map(|made| *none = made),
        };
        self.is_prepared = prepared.is_ok();
        if prepared.is_err() {
            self.trouble_with(prepared);
        }
    }

    /// The session showed nothing.
    fn interrupt(&mut self) {
        if let Some(eyes) = &mut self.eyes {
            eyes.interrupt();
        }
    }

    /// Holds a level of [`crate::display::quality_control`] instead of controlling the quality, such as for a picture; `None`
    /// gives it back to the control.
    pub fn hold_level(&mut self, level: Option<usize>) {
        self.held = level;
    }

    /// Number of the present level of quality, from 0 for the best; `None` before the first picture.
    #[must_use]
    pub fn level(&self) -> Option<usize> {
        self.eyes.as_ref().filter(|eyes| eyes.pictures > 0).map(EyeRenderer::level_number)
    }

    /// Whether the newest picture has ambient occlusion.
    #[must_use]
    pub fn is_occluded(&self) -> bool {
        self.eyes.as_ref().is_some_and(|eyes| eyes.is_occluded)
    }

    /// The appearance with the newest ambient occlusion, where the settings say so and frames create nothing for it.
    fn occluded(&mut self, appearance: Appearance) -> Appearance {
        let can_occlude = self.eyes.as_ref().is_some_and(EyeRenderer::can_occlude);
        let factors = self.occlusion.factors(&self.scene, &appearance, &self.tools);
        Appearance { occlusion: factors.filter(|_| can_occlude), ..appearance }
    }

    /// Also mirrors the left eye on the desk, for as long as that works.
    fn show_in(&self, mirror: &mut Option<Mirror>, headset: &Headset) {
        let picture = self.eyes.as_ref().and_then(EyeRenderer::left);
        if let Some((there, (picture, part))) = mirror.as_mut().zip(picture)
            && let Err(why) = there.show(headset, (picture, part))
        {
            tracing::warn!("the headset is no longer mirrored: {why}");
            *mirror = None;
        }
    }

    /// One visible frame.
    ///
    /// # Errors
    /// [`XrError::Call`] when the runtime fails.
    pub fn frame(&mut self, frame: &mut Frame<'_>) -> Result<(), XrError> {
        let newest = self.view_port.newest();
        frame.show_surroundings(self.tools.surroundings);
        self.panels.switches_surroundings = frame.surroundings().is_some();
        if self.tools.seated != self.seated {
            self.seated = self.tools.seated;
            let home = home(&self.scene, &mut self.view_port, &self.tools, self.origin);
            let SceneBox { min, max } = self.scene.bounds;
            self.interaction.refit(home, 0.5 * (min + max));
            self.jumped = true;
        }
        let drafted = self.drafts.over(&self.scene, &newest.scene);
        self.follow(&drafted);
        let notices = self.screenshots.with_notices(&newest.notices);
        let state = ViewState { notices, ..newest.with_scene(self.shown(&drafted)) };
        let hands = frame.hands;
        let captured = self.panel_layers.step((&hands, &frame.head), &self.panels, &self.tools, &state);
        self.interaction.floor = floor_height(&self.tools, self.origin);
        let InteractionOutput { mut requests, felt, panels, jumped, screenshot } =
            self.interaction.step(&hands, captured, (frame.head.position, frame.period), &mut self.tools, &state);
        self.jumped |= jumped || frame.recentred;
        for (side, strength) in felt {
            frame.pulse(side, strength, std::time::Duration::ZERO)?;
        }
        let pressed = [(panels, DisplayAction::Panels), (screenshot, DisplayAction::Screenshot)];
        let actions: Vec<DisplayAction> = pressed.into_iter().filter(|(on, _)| *on).map(|(_, action)| action).collect();
        if !actions.is_empty() {
            self.take(Output { actions, ..Output::default() }, &state, &mut requests);
        }
        let highlighted = self.interaction.highlighted(&state, &self.tools);
        let Self { scene, appearance_builder, tools, .. } = self;
        let appearance = appearance_builder.build(scene, &state.scene, &highlighted, state.clusters.as_deref(), tools);
        let busy = Side::BOTH.map(|side| self.interaction.is_busy(side));
        let leaders = self.panel_layers.hang_callouts((&hands, &frame.head), busy, (&self.tools, &state), frame.period);
        let (bounds, placement) = (self.scene.bounds, self.interaction.placement());
        let marks = self
            .markers
            .hang(frame.head.position, &state, |k| state.proposal_at(bounds, k).map(|at| placement.to_room(at)));
        let mut holes = self.panel_layers.holes(&self.panels, &state);
        holes.extend(marks);
        self.aim(&appearance, &hands, busy);
        let appearance = self.occluded(appearance);
        let has_holes = self.draw(frame, &appearance, &holes, &leaders)?;
        self.panels.numbers = self.appearance_builder.legend();
        self.panels.supported_actions =
            vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Panels, DisplayAction::Screenshot];
        let kept = self.bookmarks.all().len().min(usize::from(u8::MAX)) as u8;
        self.panels.supported_actions.extend((1..=kept).map(DisplayAction::Place));
        self.panels.supported_actions.extend((0_u8..).zip(state.proposals()).map(|(k, _)| DisplayAction::Proposal(k)));
        let output = self.panel_layers.show(frame, &mut self.panels, &state, &mut self.tools, has_holes)?;
        self.markers.show(frame, has_holes)?;
        self.take(output, &state, &mut requests);
        for request in requests {
            self.view_port.send(request);
        }
        self.frames += 1;
        self.revision = state.scene.revision();
        Ok(())
    }

    /// Shows Gaussians where a state has them, once their places are known.
    fn follow(&mut self, state: &Arc<EditState>) {
        let followed = self.follower.as_mut().and_then(|follower| follower.follow(state, false));
        let Some(FollowedScene { scene, brush: Some(brush) }) = followed else { return };
        self.interaction.set_brush(&brush);
        self.hits.show_scene(Arc::clone(&scene), brush);
        self.screenshots.show_scene(Arc::clone(&scene));
        self.scene = scene;
        // Without a renderer, and where its device fails, the next one is made of the new places.
        match self.eyes.as_mut().map(|eyes| eyes.show(&self.scene)) {
            Some(Ok(true)) | None => (),
            Some(Ok(false)) => self.eyes = None,
            Some(Err(error)) => {
                tracing::warn!("the scene is uploaded again: {error}");
                self.eyes = None;
            }
        }
    }

    /// The state that fits the scene.
    fn shown(&mut self, state: &Arc<EditState>) -> Arc<EditState> {
        self.follower.as_mut().map_or_else(|| Arc::clone(state), |follower| follower.shown(state))
    }

    /// Finds what the hands' lasers meet: a panel, else the scene's front. A hand that draws or holds has no laser.
    fn aim(&mut self, appearance: &Appearance, hands: &[HandInput; 2], busy: [bool; 2]) {
        let placement = self.interaction.placement();
        let on_panel = Side::BOTH.map(|side| self.panel_layers.pointed_by(side));
        let throws = Interaction::adds(&self.tools).other();
        let aims = Side::BOTH.map(|side| {
            let k = side.index();
            let throws = side == throws && self.interaction.aimed().is_some();
            hands[k].aim.filter(|_| !busy[k] && !throws)
        });
        let ray = |k: usize| {
            let aim = aims[k].filter(|_| on_panel[k].is_none())?;
            let along = placement.rotation.inverse() * (laser::LENGTH * aim.forward()) / placement.scale;
            Some((placement.to_scene(aim.position), along))
        };
        let hits = self.hits.step(appearance, [ray(0), ray(1)]);
        self.met = [0, 1].map(|k| {
            aims[k]?;
            let scene = hits[k].map(|at| Met::Scene(placement.to_room(at)));
            Some(on_panel[k].map(Met::Panel).or(scene).unwrap_or(Met::Nothing))
        });
    }

    /// Draws the scene and what is in the room beside it. Returns whether the eyes' pictures have holes for panels: without a
    /// picture there are none.
    fn draw(
        &mut self,
        frame: &mut Frame<'_>,
        appearance: &Appearance,
        holes: &[Hole],
        leaders: &[[glam::DVec3; 2]],
    ) -> Result<bool, XrError> {
        let placement = self.interaction.placement();
        let darkened = self.comfort.step(&placement, &frame.head, std::mem::take(&mut self.jumped), frame.period);
        let period = if frame.period > 0.0 { frame.period } else { FIRST_PERIOD };
        let in_motion = self.motion.step(&frame.head, &placement, period);
        self.sight = Some(Sight { eyes: frame.eyes, head: frame.head, placement, period });
        // Without a renderer this frame shows the panels alone: see `prepare`.
        let Some(eyes) = self.eyes.as_mut().filter(|eyes| self.is_prepared && eyes.is_ready()) else {
            return Ok(false);
        };
        let brushes = self.interaction.brush_markers(&self.tools);
        let hands = frame.hands;
        let hand = |side: Side| {
            let k = side.index();
            let sign = Interaction::sign(side, &self.tools);
            let joints = frame.joints[k].as_ref();
            SeenHand { side, input: &hands[k], joints, sign, brush: brushes[k], laser: self.met[k] }
        };
        let is_on_dark = appearance.background.dot(glam::Vec3::new(0.299, 0.587, 0.114)) < 0.5;
        let floor = Floor { height: self.interaction.floor, is_on_dark };
        let room = Room {
            hands: [hand(Side::Left), hand(Side::Right)],
            head: frame.head.position,
            floor: (self.tools.floor && !frame.blend_mode().shows_surroundings()).then_some(floor),
            arc: self.interaction.aimed(),
            holes,
            leaders,
        };
        let meshes = room.meshes();
        let SceneBox { min, max } = self.scene.bounds;
        let around = Around { meshes: &meshes, middle: placement.to_room(0.5 * (min + max)) };
        let drawn = eyes.draw(frame, &placement, appearance, (&self.tools, darkened, in_motion), around, self.held)?;
        let is_drawn = drawn.is_ok();
        self.trouble_with(drawn);
        Ok(is_drawn)
    }

    fn trouble_with(&mut self, drawn: Result<(), GpuError>) {
        if let Err(GpuError::Lost { reason, .. }) = &drawn {
            self.lost = Some(reason.clone());
        }
        let trouble = drawn.err().map(|e| e.to_string());
        if trouble.is_some() && trouble != self.trouble {
            tracing::error!("the scene is not drawn: {}", trouble.as_deref().unwrap_or_default());
        }
        self.trouble = trouble;
    }

    /// Handles the output of panels.
    fn take(&mut self, mut output: Output, state: &ViewState, requests: &mut Vec<Request>) {
        output.show_draft(&mut self.drafts, state);
        requests.extend(output.requests);
        for wish in output.actions {
            match wish {
                DisplayAction::Fit => {
                    self.jumped = true;
                    self.interaction.go(None);
                }
                DisplayAction::Bookmark => {
                    let name = format!("place {}", self.bookmarks.all().len() + 1);
                    self.bookmarks.keep(&name, self.interaction.placement());
                }
                DisplayAction::Place(number) => {
                    if let Some(place) = self.bookmarks.find(&format!("place {number}")) {
                        self.jumped = true;
                        self.interaction.go(Some(place));
                    }
                }
                DisplayAction::Panels => {
                    let left = self.panel_layers.turn_over(&mut self.panels);
                    self.take(left, state, requests);
                }
                DisplayAction::Proposal(number) => self.markers.light_up(number.into(), state),
                DisplayAction::Screenshot => self.take_screenshot(state),
            }
        }
    }

    /// Keeps a picture of what the person sees, without the preview of a stroke.
    fn take_screenshot(&mut self, state: &ViewState) {
        let Some(Sight { head, placement, .. }) = self.sight else { return };
        let Self { scene, appearance_builder, tools, .. } = self;
        let appearance =
            appearance_builder.build(scene, &state.scene, &state.selected, state.clusters.as_deref(), tools);
        let appearance = self.occluded(appearance);
        self.screenshots.take(&head, &placement, self.tools.room_near, appearance);
    }

    fn tell(&self, headset: &Headset) {
        let timing = headset.timing();
        let engine = |eyes: &EyeRenderer| {
            let scale = percent(eyes.level.scale);
            headset.gpu().map_or_else(String::new, |gpu| format!("{}, {scale} of the edge", gpu.name()))
        };
        self.view_port.report(FrameStats {
            frames: self.frames,
            pictures: self.eyes.as_ref().map_or(0, |e| e.pictures),
            late: timing.missed + self.eyes.as_ref().map_or(0, EyeRenderer::late),
            seconds: timing.work,
            engine: self.eyes.as_ref().map(engine).unwrap_or_default(),
            revision: self.revision,
            size: [0, 0],
        });
    }
}

/// Height of the floor in the room, metres: that of a standing or a seated person's eyes below them, without a stage.
fn floor_height(tools: &Tools, origin: Origin) -> f64 {
    stance(tools).height(origin) - stance(tools).height(Origin::Floor)
}

fn stance(tools: &Tools) -> Stance {
    if tools.seated { Stance::Seated } else { Stance::Standing }
}

/// Initial placement of a scene in its current orientation: for a standing or a seated person.
fn home(scene: &Scene, view_port: &mut ViewPort, tools: &Tools, origin: Origin) -> Placement {
    let view = view_port.newest().scene.view();
    Placement::fit(scene.bounds, view.up, view.target - view.eye, stance(tools), origin)
}
