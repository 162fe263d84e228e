//! A room that a person stands in with the scene: a headset, two hands, panels around them.
//!
//! The loop waits for the headset's next frame and for nothing else. Hands hold, scale and turn the scene
//! ([`crate::hands::Handling`]) and brush it ([`Acts`]); panels hang around the person and are pointed at.

mod acts;
mod boards;
mod eyes;
mod marks;
mod mirror;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sg_scene::model::{Scene, SceneBox};

use crate::display::{Drafts, Dressing, Pace, Request, Seat, Shown, Tools};
use crate::hands::{Bookmarks, Comfort, Origin, Placement, Rectangle, Stance};
use crate::panels::{Output, Panel, Panels, Place, Wish};
use crate::xr::{Counts, Frame, Headset, PAUSE, Step, XrError};
use sg_gpu::GpuError;

pub use acts::{Acts, Did, SeenTip, Taken};
pub use boards::first_place;

use boards::Boards;
use eyes::Eyes;
use marks::Marks;
use mirror::Mirror;

/// Seconds of one frame before the headset has said how long one is.
const FIRST_PERIOD: f64 = 1.0 / 90.0;

/// What a person steps into.
pub struct Setup {
    /// The geometry.
    pub scene: Arc<Scene>,
    /// Where the newest comes from and requests go.
    pub seat: Seat,
    /// The settings of hands and panels.
    pub tools: Tools,
    /// What the scene was opened from: transfer functions are found beside it.
    pub opened: PathBuf,
    /// Whether a window on the desk shows what the left eye sees, while [`Room::serve`] serves it.
    pub mirror: bool,
}

/// A room.
pub struct Room {
    scene: Arc<Scene>,
    seat: Seat,
    tools: Tools,
    drafts: Drafts,
    dressing: Dressing,
    acts: Acts,
    panels: Panels,
    boards: Boards,
    marks: Marks,
    bookmarks: Bookmarks,
    comfort: Comfort,
    /// Whether the scene was put elsewhere at once since the last frame.
    jumped: bool,
    /// Why the device is to be opened anew.
    lost: Option<String>,
    eyes: Option<Eyes>,
    /// What the device would not do, told once.
    trouble: Option<String>,
    frames: u64,
    /// What is at y = 0 of the room.
    origin: Origin,
    /// Whether the scene stands where it does for somebody who sits.
    seated: bool,
    /// Revision of the scene that the newest frame shows.
    revision: u64,
    /// Whether a window on the desk is to be opened.
    mirrors: bool,
}

impl Room {
    /// A room around a headset that is there.
    #[must_use]
    pub fn new(setup: Setup, headset: &Headset) -> Self {
        let Setup { scene, mut seat, tools, opened, mirror } = setup;
        let home = home(&scene, &mut seat, &tools, headset.origin());
        let mut panels = Panels::new(Place::Headset);
        for problem in panels.behind(&scene, Path::new(&opened)) {
            tracing::warn!("no curve is shown: {problem}");
        }
        let seated = tools.seated;
        Self {
            acts: Acts::new(&scene, home),
            boards: Boards::new(stance(&tools), headset.origin()),
            marks: Marks::default(),
            scene,
            seat,
            tools,
            drafts: Drafts::default(),
            dressing: Dressing::default(),
            panels,
            bookmarks: Bookmarks::default(),
            comfort: Comfort::default(),
            jumped: false,
            lost: None,
            eyes: None,
            trouble: None,
            frames: 0,
            origin: headset.origin(),
            seated,
            revision: 0,
            mirrors: mirror,
        }
    }

    /// Where the scene stands.
    #[must_use]
    pub fn placement(&self) -> Placement {
        self.acts.placement()
    }

    /// What hands and panels have set.
    #[must_use]
    pub fn tools(&self) -> &Tools {
        &self.tools
    }

    /// Where a panel hangs, unless it is hidden.
    #[must_use]
    pub fn panel(&self, panel: Panel) -> Option<Rectangle> {
        self.boards.place(panel)
    }

    /// What a panel has cost so far.
    #[must_use]
    pub fn counts(&self, panel: Panel) -> Option<Counts> {
        self.boards.counts(panel)
    }

    /// Where places for a next stroke were marked last, and which of them stands out.
    #[must_use]
    pub fn marks(&self) -> Vec<(Rectangle, bool)> {
        self.marks.places()
    }

    /// Serves a headset on this thread until its session or its seat is over.
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
            if self.seat.is_over() {
                headset.leave();
            }
            let step = headset.frame(|frame| self.frame(frame))?;
            match step {
                Step::Shown | Step::Hidden | Step::Back => {}
                Step::Idle => std::thread::sleep(PAUSE),
                Step::Away => {
                    // What was made with the device that has gone.
                    self.eyes = None;
                    mirror.iter_mut().for_each(Mirror::put_away);
                    std::thread::sleep(PAUSE);
                }
                Step::Ended => return Ok(()),
            }
            if step == Step::Shown {
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

    /// Shows what the left eye sees on the desk as well, for as long as that can be shown there.
    fn show_in(&self, mirror: &mut Option<Mirror>, headset: &Headset) {
        let picture = self.eyes.as_ref().and_then(Eyes::left);
        if let Some((there, picture)) = mirror.as_mut().zip(picture)
            && let Err(why) = there.show(headset, picture)
        {
            tracing::warn!("the headset is no longer mirrored: {why}");
            *mirror = None;
        }
    }

    /// One frame that somebody sees.
    ///
    /// # Errors
    /// [`XrError::Call`] when the runtime fails.
    pub fn frame(&mut self, frame: &mut Frame<'_>) -> Result<(), XrError> {
        let newest = self.seat.newest();
        if self.tools.seated != self.seated {
            self.seated = self.tools.seated;
            let home = home(&self.scene, &mut self.seat, &self.tools, self.origin);
            let SceneBox { min, max } = self.scene.bounds;
            self.acts.refit(home, 0.5 * (min + max));
            self.jumped = true;
        }
        let drafted = self.drafts.over(&self.scene, &newest.scene);
        let shown = Shown { scene: drafted, ..Shown::clone(&newest) };
        let hands = frame.hands;
        let taken = self.boards.step((&hands, &frame.head), &self.panels, &self.tools, &shown);
        let Did { mut requests, felt, panels, jumped } =
            self.acts.step(&hands, taken, (frame.head.position, frame.period), &mut self.tools, &shown);
        self.jumped |= jumped || frame.recentred;
        for (side, strength) in felt {
            frame.pulse(side, strength, std::time::Duration::ZERO)?;
        }
        if panels {
            self.take(Output { wishes: vec![Wish::Panels], ..Output::default() }, &shown, &mut requests);
        }
        let highlighted = self.acts.highlighted(&shown, &self.tools);
        let Self { scene, dressing, tools, .. } = self;
        let look = dressing.look(scene, &shown.scene, &highlighted, shown.clusters.as_ref(), tools);
        self.draw(frame, &look)?;
        self.panels.numbers = self.dressing.legend();
        self.panels.fulfils = vec![Wish::Fit, Wish::Bookmark, Wish::Panels];
        let kept = self.bookmarks.all().len().min(usize::from(u8::MAX)) as u8;
        self.panels.fulfils.extend((1..=kept).map(Wish::Place));
        self.panels.fulfils.extend((0_u8..).zip(shown.proposals()).map(|(k, _)| Wish::Proposal(k)));
        let tips = self.acts.tips(&self.tools);
        let asked = self.boards.show(frame, &mut self.panels, &shown, &mut self.tools, tips)?;
        let (bounds, placement) = (self.scene.bounds, self.acts.placement());
        self.marks.show(frame, &shown, |k| shown.proposal_at(bounds, k).map(|at| placement.to_room(at)))?;
        self.take(asked, &shown, &mut requests);
        for request in requests {
            self.seat.ask(request);
        }
        self.frames += 1;
        self.revision = shown.scene.revision();
        Ok(())
    }

    fn draw(&mut self, frame: &mut Frame<'_>, look: &sg_scene::appearance::Appearance) -> Result<(), XrError> {
        let placement = self.acts.placement();
        let darkened = self.comfort.step(&placement, &frame.head, std::mem::take(&mut self.jumped), frame.period);
        let drawn = match &mut self.eyes {
            Some(eyes) => eyes.draw(frame, &placement, look, (&self.tools, darkened))?,
            none => {
                let period = if frame.period > 0.0 { frame.period } else { FIRST_PERIOD };
                match Eyes::new(frame, &self.scene, period) {
                    Ok(eyes) => {
                        *none = Some(eyes);
                        Ok(())
                    }
                    Err(error) => Err(error),
                }
            }
        };
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

    /// Takes in what was asked for on panels.
    fn take(&mut self, mut asked: Output, shown: &Shown, requests: &mut Vec<Request>) {
        asked.show_draft(&mut self.drafts, shown);
        requests.extend(asked.requests);
        for wish in asked.wishes {
            match wish {
                Wish::Fit => {
                    self.jumped = true;
                    self.acts.go(None);
                }
                Wish::Bookmark => {
                    let name = format!("place {}", self.bookmarks.all().len() + 1);
                    self.bookmarks.keep(&name, self.acts.placement());
                }
                Wish::Place(number) => {
                    if let Some(place) = self.bookmarks.find(&format!("place {number}")) {
                        self.jumped = true;
                        self.acts.go(Some(place));
                    }
                }
                Wish::Panels => {
                    let left = self.boards.turn_over(&mut self.panels);
                    self.take(left, shown, requests);
                }
                Wish::Proposal(number) => self.marks.light_up(number.into(), shown),
                // Not among what is fulfilled.
                Wish::Screenshot => (),
            }
        }
    }

    fn tell(&self, headset: &Headset) {
        let paced = headset.paced();
        let engine = |eyes: &Eyes| {
            let scale = 100.0 * eyes.level.scale;
            headset.gpu().map_or_else(String::new, |gpu| format!("{}, {scale:.0} % of the edge", gpu.name()))
        };
        self.seat.tell(Pace {
            frames: self.frames,
            pictures: self.eyes.as_ref().map_or(0, |e| e.pictures),
            late: paced.missed + self.eyes.as_ref().map_or(0, Eyes::late),
            seconds: paced.work,
            engine: self.eyes.as_ref().map(engine).unwrap_or_default(),
            revision: self.revision,
        });
    }
}

fn stance(tools: &Tools) -> Stance {
    if tools.seated { Stance::Seated } else { Stance::Standing }
}

/// Where a scene stands at first, turned as it is seen: for somebody who stands or sits.
fn home(scene: &Scene, seat: &mut Seat, tools: &Tools, origin: Origin) -> Placement {
    let view = seat.newest().scene.view();
    Placement::fit(scene.bounds, view.up, view.target - view.eye, stance(tools), origin)
}
