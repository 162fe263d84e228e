//! The headset as the loop sees it: there, away, or back.

use std::time::{Duration, Instant};

use openxr as xr;

use super::XrError;
use super::frame::{Frame, PanelId};
use super::live::{Happened, Live};
use crate::gpu::Gpu;
use crate::hands::{Origin, Stance};

/// How long the loop may rest before it asks again when [`Headset::frame`] had nothing to wait for.
pub const PAUSE: Duration = Duration::from_millis(10);

/// How a headset is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Factor on the width and height that the runtime recommends, 0.1 to 4.
    pub resolution: f64,
    /// Frames in a second, where the runtime lets one choose; the nearest that it offers.
    pub refresh_rate: Option<f32>,
    /// Standing, the room's floor is at y = 0 where the runtime knows it; seated, the eyes are.
    pub stance: Stance,
    /// Pause before a runtime that went away is looked for again.
    pub retry_pause: Duration,
    /// How often it is looked for.
    pub tries: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            resolution: 1.0,
            refresh_rate: None,
            stance: Stance::Standing,
            retry_pause: Duration::from_secs(1),
            tries: 300,
        }
    }
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// It was drawn and handed in.
    Shown,
    /// Nobody would see it: handed in without being drawn.
    Hidden,
    /// The session is not running; nothing was waited for, see [`PAUSE`].
    Idle,
    /// The runtime is gone, and with it the device: what was made with it is to be dropped. Nothing was waited for.
    Away,
    /// The runtime is there again, with another device and no panels.
    Back,
    /// The session is over, as [`Headset::leave`] or the person asked. Nothing comes any more.
    Ended,
}

/// How frames keep up.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Paced {
    /// Frames drawn and handed in.
    pub shown: u64,
    /// Frames of the display for which nothing new was there in time.
    pub missed: u64,
    /// Seconds from one frame to the next, as the runtime has it.
    pub period: f64,
    /// Seconds from the end of the newest wait until the frame was handed in: what there is one period for.
    pub work: f64,
}

enum State {
    Open(Box<Live>),
    Away { since: XrError, next: Instant },
    Ended,
}

/// A headset.
///
/// All of its frames, and all work for its device, belong to one thread. When [`Step::Away`] is told, whoever drew drops
/// what was made with [`Self::gpu`]; when [`Step::Back`] is, it is made anew.
pub struct Headset {
    state: State,
    options: Options,
    /// How often the runtime was looked for since a frame was last shown.
    tries: u32,
    session: u64,
    paced: Paced,
    last_shown: Option<xr::Time>,
}

impl Headset {
    /// Finds runtime and headset and begins a session.
    ///
    /// # Errors
    /// [`XrError`]: what is missing, and what to do.
    pub fn open(options: Options) -> Result<Self, XrError> {
        let live = Live::open(&options)?;
        Ok(Self {
            state: State::Open(Box::new(live)),
            options,
            tries: 0,
            session: 0,
            paced: Paced::default(),
            last_shown: None,
        })
    }

    fn live(&self) -> Option<&Live> {
        match &self.state {
            State::Open(live) => Some(live),
            State::Away { .. } | State::Ended => None,
        }
    }

    /// The device; `None` while the runtime is away.
    #[must_use]
    pub fn gpu(&self) -> Option<&Gpu> {
        self.live().map(|l| &l.shared.gpu)
    }

    /// Where the device comes from: a window whose surface this instance made, and which suits this adapter, can show on the
    /// same device what the headset does. `None` while the runtime is away.
    #[must_use]
    pub fn made_of(&self) -> Option<(&wgpu::Instance, &wgpu::Adapter)> {
        self.live().map(|l| (&l.shared.made_of.0, &l.shared.made_of.1))
    }

    /// Format of what eyes and panels are drawn to, one that stores by the sRGB curve: what [`crate::gpu::Present`] and
    /// egui's renderer are made for. `None` while the runtime is away.
    #[must_use]
    pub fn format(&self) -> Option<wgpu::TextureFormat> {
        self.live().map(|l| l.format.wgpu)
    }

    /// Width and height of each eye's picture; `None` while the runtime is away.
    #[must_use]
    pub fn size(&self) -> Option<[u32; 2]> {
        self.live().map(|l| l.eyes.size)
    }

    /// What is at y = 0 of the room.
    #[must_use]
    pub fn origin(&self) -> Origin {
        self.live().map_or(Origin::Floor, |l| l.origin)
    }

    /// The runtime and the headset, for people to read; `None` while it is away.
    #[must_use]
    pub fn names(&self) -> Option<[&str; 2]> {
        self.live().map(|l| [l.runtime.as_str(), l.system.as_str()])
    }

    /// The controllers in use, left and right, as paths of OpenXR's interaction profiles.
    #[must_use]
    pub fn controllers(&self) -> [Option<String>; 2] {
        self.live().map(Live::controllers).unwrap_or_default()
    }

    /// Controllers that would be understood but that the runtime does not know.
    #[must_use]
    pub fn unknown_controllers(&self) -> &[&'static str] {
        self.live().map_or(&[], |l| &l.actions.unknown)
    }

    /// Whether the person's hands are given to this session and not to the runtime's own menu.
    #[must_use]
    pub fn is_focused(&self) -> bool {
        self.live().is_some_and(|l| l.life.is_focused())
    }

    /// Refresh rates that can be chosen; empty where the runtime chooses.
    #[must_use]
    pub fn refresh_rates(&self) -> Vec<f32> {
        self.live().map(Live::rates).unwrap_or_default()
    }

    /// Asks for the refresh rate nearest to this one, now and whenever the runtime comes back.
    pub fn set_refresh_rate(&mut self, rate: f32) {
        self.options.refresh_rate = Some(rate);
        if let Some(live) = self.live() {
            live.ask_for_rate(Some(rate));
        }
    }

    /// How frames keep up.
    #[must_use]
    pub fn paced(&self) -> Paced {
        self.paced
    }

    /// Why the runtime is away, while it is.
    #[must_use]
    pub fn away(&self) -> Option<&XrError> {
        match &self.state {
            State::Away { since, .. } => Some(since),
            State::Open(_) | State::Ended => None,
        }
    }

    /// Makes images for a panel of so many pixels.
    ///
    /// # Errors
    /// [`XrError::NoPanel`] while the runtime is away, [`XrError::Call`] when it fails.
    pub fn panel(&mut self, size: [u32; 2]) -> Result<PanelId, XrError> {
        let State::Open(live) = &mut self.state else { return Err(XrError::NoPanel) };
        live.panel(size, self.session)
    }

    /// Gives a panel's images back; one that is not there changes nothing.
    pub fn drop_panel(&mut self, panel: PanelId) {
        let session = self.session;
        if let State::Open(live) = &mut self.state
            && panel.session == session
            && let Some(slot) = live.panels.get_mut(panel.at)
        {
            let _ = live.shared.gpu.wait();
            *slot = None;
        }
    }

    /// Asks the runtime to end the session: [`Step::Ended`] comes when it has. While it is away the session ends at once.
    pub fn leave(&mut self) {
        if let State::Open(live) = &self.state
            && live.life.is_running()
            && live.session.request_exit().is_ok()
        {
            return;
        }
        self.state = State::Ended;
    }

    /// Gives runtime and device up and looks for them anew at once, as when the device was lost
    /// ([`crate::gpu::GpuError::Lost`]): [`Step::Away`] until [`Step::Back`]. While the runtime is away or the session has ended,
    /// nothing changes.
    pub fn restart(&mut self, reason: String) {
        if self.live().is_some() {
            let lost = XrError::Device { reason };
            tracing::warn!(reason = %lost, "the headset is opened anew");
            self.state = State::Away { since: lost, next: Instant::now() };
            self.last_shown = None;
        }
    }

    /// Makes one frame: takes in what the runtime tells, waits for the frame's time, has it drawn and hands it in.
    ///
    /// `draw` is called where there is something to see, after the wait. A runtime that goes away on the way is no error but
    /// [`Step::Away`], whatever `draw` returned.
    ///
    /// # Errors
    /// What `draw` returned; [`XrError::Gone`] when the runtime has been looked for as often as [`Options::tries`] says.
    pub fn frame<E: From<XrError>>(&mut self, draw: impl FnOnce(&mut Frame<'_>) -> Result<(), E>) -> Result<Step, E> {
        let live = match &mut self.state {
            State::Open(live) => live,
            State::Away { next, .. } if Instant::now() < *next => return Ok(Step::Away),
            State::Away { .. } => return Ok(self.look_again()?),
            State::Ended => return Ok(Step::Ended),
        };
        match made(live, self.session, &mut self.paced, &mut self.last_shown, draw) {
            Ok((step, drawn)) => {
                match step {
                    Step::Shown => self.tries = 0,
                    Step::Ended => self.state = State::Ended,
                    Step::Hidden | Step::Idle | Step::Away | Step::Back => {}
                }
                drawn.map(|()| step)
            }
            Err(lost) => {
                tracing::warn!(reason = %lost, "the headset's runtime is gone; it is looked for again");
                self.away_for(lost);
                Ok(Step::Away)
            }
        }
    }

    fn away_for(&mut self, since: XrError) {
        self.state = State::Away { since, next: Instant::now() + self.options.retry_pause };
        self.last_shown = None;
    }

    fn look_again(&mut self) -> Result<Step, XrError> {
        self.tries += 1;
        match Live::open(&self.options) {
            Ok(live) => {
                tracing::info!(tries = self.tries, "the headset is back");
                self.state = State::Open(Box::new(live));
                self.session += 1;
                Ok(Step::Back)
            }
            Err(reason) if self.tries >= self.options.tries => {
                self.state = State::Ended;
                Err(XrError::Gone { tries: self.tries, reason: Box::new(reason) })
            }
            Err(reason) => {
                self.away_for(reason);
                Ok(Step::Away)
            }
        }
    }
}

/// A frame of a session that is there: what became of it and what `draw` returned, or how the runtime was lost.
fn made<E>(
    live: &mut Live,
    session: u64,
    paced: &mut Paced,
    last_shown: &mut Option<xr::Time>,
    draw: impl FnOnce(&mut Frame<'_>) -> Result<(), E>,
) -> Result<(Step, Result<(), E>), XrError> {
    match live.events()? {
        Happened::Nothing => {}
        Happened::Left => return Ok((Step::Ended, Ok(()))),
        Happened::Lost => return Err(XrError::call("session", xr::sys::Result::ERROR_SESSION_LOST)),
    }
    if !live.life.is_running() {
        *last_shown = None;
        return Ok((Step::Idle, Ok(())));
    }
    let call = |e| XrError::call("frame", e);
    let waited = live.waiter.wait().map_err(call)?;
    let begun = Instant::now();
    live.stream.begin().map_err(call)?;
    // What the device has to say of earlier frames, its own loss above all; nothing is waited for.
    let _ = live.shared.gpu.device().poll(wgpu::PollType::Poll);
    let time = waited.predicted_display_time;
    let period = waited.predicted_display_period;
    let looking = if waited.should_render { live.look(time).map_err(call)? } else { None };
    let hands = live.actions.read(&live.session, &live.room, time, live.life.is_focused()).map_err(call)?;
    let Some(looking) = looking else {
        *last_shown = None;
        live.stream.end(time, live.blend, &[]).map_err(call)?;
        return Ok((Step::Hidden, Ok(())));
    };
    let mut frame = Frame::new(live, looking, hands, (session, time, period));
    let drawn = draw(&mut frame);
    frame.end(time)?;
    paced.shown += 1;
    paced.period = period.as_nanos() as f64 * 1e-9;
    paced.work = begun.elapsed().as_secs_f64();
    if let Some(last) = last_shown.replace(time) {
        let periods = (time.as_nanos() - last.as_nanos()) as f64 / (period.as_nanos().max(1)) as f64;
        paced.missed += (periods.round() as u64).saturating_sub(1);
    }
    Ok((Step::Shown, drawn))
}
