//! A room around a person and the scene: a headset, two hands, panels around them.
//!
//! The loop waits only for the headset's next frame, and between frames for the trial at its start. Hands hold, scale and turn the scene ([`crate::hands::Grab`]) and
//! brush it ([`Interaction`]). Panels hang around the person and are pointed at.

mod eye_renderer;
mod interaction;
mod mirror;
mod overlay;
mod panel_layers;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sg_scene::model::{Scene, SceneBox};

use crate::display::number_format::percent;
use crate::display::{AppearanceBuilder, Drafts, FrameStats, Request, Tools, ViewPort, ViewState};
use crate::hands::{Bookmarks, ComfortVignette, Origin, Placement, Rectangle, Stance};
use crate::panels::{DisplayAction, Output, Panel, PanelHost, Panels};
use crate::xr::{Counts, Frame, FrameOutcome, Headset, PAUSE, XrError};
use sg_gpu::{GpuError, Rasterizer};

pub use interaction::{BrushMarker, Interaction, InteractionOutput, PanelCapture};
pub use panel_layers::first_place;

use eye_renderer::{EyeRenderer, Sight};
use mirror::Mirror;
use overlay::MarkerOverlay;
use panel_layers::PanelLayers;

/// Seconds of one frame before the headset has said how long one is.
const FIRST_PERIOD: f64 = 1.0 / 90.0;

/// Configuration of a headset view.
pub struct Setup {
    /// The geometry.
    pub scene: Arc<Scene>,
    /// Source of the newest state, and sink of requests.
    pub view_port: ViewPort,
    /// The settings of hands and panels.
    pub tools: Tools,
    /// Path of the opened scene; transfer functions are read from its folder.
    pub opened: PathBuf,
    /// Whether a desktop window mirrors the left eye, while [`VrView::serve`] serves it.
    pub mirror: bool,
    /// How splats are blended; without it a trial of what the person sees picks the fastest way.
    pub rasterizer: Option<Rasterizer>,
}

/// A room.
pub struct VrView {
    scene: Arc<Scene>,
    view_port: ViewPort,
    tools: Tools,
    drafts: Drafts,
    appearance_builder: AppearanceBuilder,
    interaction: Interaction,
    panels: Panels,
    panel_layers: PanelLayers,
    markers: MarkerOverlay,
    bookmarks: Bookmarks,
    comfort: ComfortVignette,
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
}

impl VrView {
    /// A room around an open headset.
    #[must_use]
    pub fn new(setup: Setup, headset: &Headset) -> Self {
        let Setup { scene, mut view_port, tools, opened, mirror, rasterizer } = setup;
        let home = home(&scene, &mut view_port, &tools, headset.origin());
        let mut panels = Panels::new(PanelHost::Headset);
        for problem in panels.behind(&scene, Path::new(&opened)) {
            tracing::warn!("no curve is shown: {problem}");
        }
        let seated = tools.seated;
        Self {
            interaction: Interaction::new(&scene, home),
            panel_layers: PanelLayers::new(stance(&tools), headset.origin()),
            markers: MarkerOverlay::default(),
            scene,
            view_port,
            tools,
            drafts: Drafts::default(),
            appearance_builder: AppearanceBuilder::default(),
            panels,
            bookmarks: Bookmarks::default(),
            comfort: ComfortVignette::default(),
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

    /// Serves a headset on this thread until its session ends or its view port closes.
    ///
    /// # Errors
    /// [`XrError::Gone`] for a runtime that went away and did not come back.
    pub fn serve(mut self, headset: &mut Headset) -> Result<(), XrError> {
        let mirror = self.mirrors.then(Mirror::open).transpose();
        let mut mirror = mirror.unwrap_or_else(|why| {
            tracing::warn!("the headset is not mirrored: {why}");
            None
        });
        loop {
            if self.view_port.is_closed() {
                headset.leave();
            }
            self.prepare(headset);
            let step = headset.frame(|frame| self.frame(frame))?;
            match step {
                FrameOutcome::Shown | FrameOutcome::Back => {}
                FrameOutcome::Hidden => self.interrupt(),
                FrameOutcome::Idle => {
                    self.interrupt();
                    std::thread::sleep(PAUSE);
                }
                FrameOutcome::Away => {
                    // These objects belong to the lost device.
                    self.eyes = None;
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

    /// Prepares the renderer of both eyes, between two frames. The first call after a frame uploads the scene, the next ones each
    /// make one step of the trial that picks the rasterizer, and all further ones make what the next pictures need. Without
    /// effect while the runtime is away.
    pub fn prepare(&mut self, headset: &Headset) {
        let Some(sight) = self.sight else { return };
        let prepared = match &mut self.eyes {
            Some(eyes) => eyes.prepare(&sight, &self.tools, || self.view_port.newest().scene.appearance()),
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
        if self.tools.seated != self.seated {
            self.seated = self.tools.seated;
            let home = home(&self.scene, &mut self.view_port, &self.tools, self.origin);
            let SceneBox { min, max } = self.scene.bounds;
            self.interaction.refit(home, 0.5 * (min + max));
            self.jumped = true;
        }
        let drafted = self.drafts.over(&self.scene, &newest.scene);
        let state = ViewState { scene: drafted, ..ViewState::clone(&newest) };
        let hands = frame.hands;
        let captured = self.panel_layers.step((&hands, &frame.head), &self.panels, &self.tools, &state);
        let InteractionOutput { mut requests, felt, panels, jumped } =
            self.interaction.step(&hands, captured, (frame.head.position, frame.period), &mut self.tools, &state);
        self.jumped |= jumped || frame.recentred;
        for (side, strength) in felt {
            frame.pulse(side, strength, std::time::Duration::ZERO)?;
        }
        if panels {
            self.take(Output { actions: vec![DisplayAction::Panels], ..Output::default() }, &state, &mut requests);
        }
        let highlighted = self.interaction.highlighted(&state, &self.tools);
        let Self { scene, appearance_builder, tools, .. } = self;
        let appearance = appearance_builder.build(scene, &state.scene, &highlighted, state.clusters.as_deref(), tools);
        self.draw(frame, &appearance)?;
        self.panels.numbers = self.appearance_builder.legend();
        self.panels.supported_actions = vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Panels];
        let kept = self.bookmarks.all().len().min(usize::from(u8::MAX)) as u8;
        self.panels.supported_actions.extend((1..=kept).map(DisplayAction::Place));
        self.panels.supported_actions.extend((0_u8..).zip(state.proposals()).map(|(k, _)| DisplayAction::Proposal(k)));
        let brush_markers = self.interaction.brush_markers(&self.tools);
        let output = self.panel_layers.show(frame, &mut self.panels, &state, &mut self.tools, brush_markers)?;
        let (bounds, placement) = (self.scene.bounds, self.interaction.placement());
        self.markers.show(frame, &state, |k| state.proposal_at(bounds, k).map(|at| placement.to_room(at)))?;
        self.take(output, &state, &mut requests);
        for request in requests {
            self.view_port.send(request);
        }
        self.frames += 1;
        self.revision = state.scene.revision();
        Ok(())
    }

    fn draw(&mut self, frame: &mut Frame<'_>, appearance: &sg_scene::appearance::Appearance) -> Result<(), XrError> {
        let placement = self.interaction.placement();
        let darkened = self.comfort.step(&placement, &frame.head, std::mem::take(&mut self.jumped), frame.period);
        let period = if frame.period > 0.0 { frame.period } else { FIRST_PERIOD };
        self.sight = Some(Sight { eyes: frame.eyes, placement, period });
        // Without a renderer this frame shows the panels alone: see `prepare`.
        let Some(eyes) = self.eyes.as_mut().filter(|eyes| self.is_prepared && eyes.is_ready()) else { return Ok(()) };
        let drawn = eyes.draw(frame, &placement, appearance, (&self.tools, darkened), self.held)?;
        self.trouble_with(drawn);
        Ok(())
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
                // Not among the supported actions.
                DisplayAction::Screenshot => (),
            }
        }
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
        });
    }
}

fn stance(tools: &Tools) -> Stance {
    if tools.seated { Stance::Seated } else { Stance::Standing }
}

/// Initial placement of a scene in its current orientation: for a standing or a seated person.
fn home(scene: &Scene, view_port: &mut ViewPort, tools: &Tools, origin: Origin) -> Placement {
    let view = view_port.newest().scene.view();
    Placement::fit(scene.bounds, view.up, view.target - view.eye, stance(tools), origin)
}
