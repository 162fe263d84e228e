//! The headset as the loop sees it: there, away, or back.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, TryRecvError};
use std::time::{Duration, Instant};

use openxr as xr;

use super::error::XrError;
use super::frame::Frame;
use super::options::{Options, SurroundingsSource};
use super::quad::PanelId;
use super::session::{SessionEvent, XrSession};
use super::watchdog::Watchdog;
use crate::hands::Origin;
use sg_gpu::Gpu;

/// Pause of the loop before the next call, if [`Headset::frame`] had no frame to wait for.
pub const PAUSE: Duration = Duration::from_millis(10);

/// Outcome of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameOutcome {
    /// The frame was drawn and submitted.
    Shown,
    /// Not visible: submitted without drawing.
    Hidden,
    /// The session is not running; the call did not wait, see [`PAUSE`].
    Idle,
    /// The runtime and its device are gone: drop all objects made with the device. This call did not wait.
    Away,
    /// The runtime is back, with another device and no panels.
    Back,
    /// The session has ended, by [`Headset::leave`] or by the person. No more frames follow.
    Ended,
}

/// How frames keep up.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FrameTiming {
    /// Frames drawn and submitted.
    pub shown: u64,
    /// Frames of the display without a new picture in time.
    pub missed: u64,
    /// Seconds from one frame to the next, as the runtime has it.
    pub period: f64,
    /// Seconds from the end of the newest wait to the frame's submission; the budget is one period.
    pub work: f64,
}

enum State {
    Open(Box<XrSession>),
    Away { since: XrError, next: Instant, pending: Option<PendingSession> },
    Ended,
}

/// A pending session request, on a thread of its own. A stopped runtime does not answer, and the blocked thread cannot be
/// recovered. Until the answer, no second request is made, since a process has one session.
struct PendingSession {
    answer: Receiver<Result<Box<XrSession>, XrError>>,
    /// Deadline for the answer; after it, the runtime counts as hung.
    until: Instant,
}

impl PendingSession {
    fn begin(options: Options, watchdog: &Watchdog) -> Result<Self, XrError> {
        let (says, answer) = mpsc::sync_channel(1);
        // The loop does not wait here: no call blocks it.
        let watchdog = watchdog.clone();
        let ask = move || {
            // After a timeout the receiver is gone and the session ends here.
            let _ = says.send(XrSession::open(&options, &watchdog).map(Box::new));
        };
        let thread = std::thread::Builder::new().name("headset".to_owned()).spawn(ask);
        thread.map_err(|e| XrError::Silent { reason: format!("no thread to ask on: {e}") })?;
        Ok(Self { answer, until: Instant::now() + options.timeout })
    }

    /// Waits for the answer until the runtime counts as hung.
    fn wait(&self, timeout: Duration) -> Result<Box<XrSession>, XrError> {
        match self.answer.recv_timeout(self.until.saturating_duration_since(Instant::now())) {
            Ok(answer) => answer,
            Err(RecvTimeoutError::Timeout) => Err(silent(timeout)),
            Err(RecvTimeoutError::Disconnected) => Err(broken()),
        }
    }
}

fn silent(timeout: Duration) -> XrError {
    XrError::Silent { reason: format!("for {:.0} s", timeout.as_secs_f64()) }
}

fn broken() -> XrError {
    XrError::Silent { reason: "asking it failed".to_owned() }
}

/// A headset.
///
/// All of its frames, and all work for its device, belong to one thread. After [`FrameOutcome::Away`], the caller drops all
/// objects made with [`Self::gpu`]. After [`FrameOutcome::Back`], it makes them anew.
pub struct Headset {
    state: State,
    options: Options,
    /// How often the runtime was looked for since a frame was last shown.
    tries: u32,
    session: u64,
    timing: FrameTiming,
    last_shown: Option<xr::Time>,
    watchdog: Watchdog,
}

impl Headset {
    /// Finds runtime and headset and begins a session.
    ///
    /// # Errors
    /// [`XrError`]: the cause and a remedy.
    pub fn open(options: Options) -> Result<Self, XrError> {
        let watchdog = Watchdog::default();
        let xr_session = PendingSession::begin(options, &watchdog)?.wait(options.timeout)?;
        Ok(Self {
            state: State::Open(xr_session),
            options,
            tries: 0,
            session: 0,
            timing: FrameTiming::default(),
            last_shown: None,
            watchdog,
        })
    }

    /// The watchdog of the loop, for another thread.
    #[must_use]
    pub fn watchdog(&self) -> Watchdog {
        self.watchdog.clone()
    }

    fn xr_session(&self) -> Option<&XrSession> {
        match &self.state {
            State::Open(xr_session) => Some(xr_session),
            State::Away { .. } | State::Ended => None,
        }
    }

    /// The device; `None` while the runtime is away.
    #[must_use]
    pub fn gpu(&self) -> Option<&Gpu> {
        self.xr_session().map(|l| &l.shared.gpu)
    }

    /// Whether the surroundings are wanted at first.
    #[must_use]
    pub fn wants_surroundings(&self) -> bool {
        self.options.blend_mode.shows_surroundings()
    }

    /// Source of the device. A window can present on the headset's device if this instance made its surface, and if the
    /// surface suits this adapter. `None` while the runtime is away.
    #[must_use]
    pub fn instance_and_adapter(&self) -> Option<(&wgpu::Instance, &wgpu::Adapter)> {
        self.xr_session().map(|l| (&l.shared.instance_and_adapter.0, &l.shared.instance_and_adapter.1))
    }

    /// Format of the targets for eyes and panels, stored by the sRGB curve. [`sg_gpu::Present`] and egui's renderer are
    /// made for it. `None` while the runtime is away.
    #[must_use]
    pub fn format(&self) -> Option<wgpu::TextureFormat> {
        self.xr_session().map(|l| l.format.wgpu)
    }

    /// Width and height of each eye's picture; `None` while the runtime is away.
    #[must_use]
    pub fn size(&self) -> Option<[u32; 2]> {
        self.xr_session().map(|l| l.eyes.size)
    }

    /// Format of the images for both eyes' depths, as [`Frame::depth_format`]; `None` also while the runtime is away.
    #[must_use]
    pub fn depth_format(&self) -> Option<wgpu::TextureFormat> {
        self.xr_session().and_then(|l| l.depths.as_ref()).map(|(_, format)| format.wgpu)
    }

    /// The origin of the room frame, at y = 0.
    #[must_use]
    pub fn origin(&self) -> Origin {
        self.xr_session().map_or(Origin::Floor, |l| l.origin)
    }

    /// The runtime and the headset, for people to read; `None` while it is away.
    #[must_use]
    pub fn names(&self) -> Option<[&str; 2]> {
        self.xr_session().map(|l| [l.runtime.as_str(), l.system.as_str()])
    }

    /// The controllers in use, left and right, as paths of OpenXR's interaction profiles.
    #[must_use]
    pub fn controllers(&self) -> [Option<String>; 2] {
        self.xr_session().map(XrSession::controllers).unwrap_or_default()
    }

    /// Controllers that would be understood but that the runtime does not know.
    #[must_use]
    pub fn unknown_controllers(&self) -> &[&'static str] {
        self.xr_session().map_or(&[], |l| &l.actions.unknown)
    }

    /// Whether the person's hands are given to this session and not to the runtime's own menu.
    #[must_use]
    pub fn is_focused(&self) -> bool {
        self.xr_session().is_some_and(|l| l.state_machine.is_focused())
    }

    /// What can show the surroundings; `None` where they cannot be switched, and while the runtime is away.
    #[must_use]
    pub fn surroundings(&self) -> Option<SurroundingsSource> {
        self.xr_session().and_then(|l| l.surroundings.source())
    }

    /// Refresh rates that can be chosen; empty where the runtime chooses.
    #[must_use]
    pub fn refresh_rates(&self) -> Vec<f32> {
        self.xr_session().map(XrSession::rates).unwrap_or_default()
    }

    /// Requests the nearest offered refresh rate, now and after each return of the runtime.
    pub fn set_refresh_rate(&mut self, rate: f32) {
        self.options.refresh_rate = Some(rate);
        if let Some(xr_session) = self.xr_session() {
            xr_session.ask_for_rate(Some(rate));
        }
    }

    /// How frames keep up.
    #[must_use]
    pub fn timing(&self) -> FrameTiming {
        self.timing
    }

    /// Why the runtime is away, while it is.
    #[must_use]
    pub fn away(&self) -> Option<&XrError> {
        match &self.state {
            State::Away { since, .. } => Some(since),
            State::Open(_) | State::Ended => None,
        }
    }

    /// Makes images for a panel of this many pixels.
    ///
    /// # Errors
    /// [`XrError::NoPanel`] while the runtime is away, [`XrError::Call`] when it fails.
    pub fn panel(&mut self, size: [u32; 2]) -> Result<PanelId, XrError> {
        let State::Open(xr_session) = &mut self.state else { return Err(XrError::NoPanel) };
        xr_session.panel(size, self.session)
    }

    /// Frees a panel's images; an unknown panel has no effect.
    pub fn drop_panel(&mut self, panel: PanelId) {
        let session = self.session;
        if let State::Open(xr_session) = &mut self.state
            && panel.session == session
            && let Some(slot) = xr_session.panels.get_mut(panel.at)
        {
            let _ = xr_session.shared.gpu.wait();
            self.watchdog.watch("a panel's end", || *slot = None);
        }
    }

    /// Asks the runtime to end the session: [`FrameOutcome::Ended`] comes when it has. While it is away the session ends at once.
    pub fn leave(&mut self) {
        if let State::Open(xr_session) = &self.state
            && xr_session.state_machine.is_running()
            && self.watchdog.watch("the session's end", || xr_session.session.request_exit()).is_ok()
        {
            return;
        }
        self.put(State::Ended);
    }

    /// Gives runtime and device up and looks for them anew at once, as after the device's loss
    /// ([`sg_gpu::GpuError::Lost`]). Frames report [`FrameOutcome::Away`] until [`FrameOutcome::Back`]. While the runtime
    /// is away or the session has ended, nothing changes.
    pub fn restart(&mut self, reason: String) {
        if self.xr_session().is_some() {
            let lost = XrError::Device { reason };
            tracing::warn!(reason = %lost, "the headset is opened anew");
            self.put(State::Away { since: lost, next: Instant::now(), pending: None });
        }
    }

    /// Makes one frame: takes in the runtime's events, waits for the frame's time, draws it and submits it.
    ///
    /// After the wait, `draw` is called if there is something to see. A runtime that goes away meanwhile is no error but
    /// [`FrameOutcome::Away`], independent of the result of `draw`.
    ///
    /// # Errors
    /// The error of `draw`; [`XrError::Gone`] after [`Options::tries`] attempts to find the runtime again.
    pub fn frame<E: From<XrError>>(
        &mut self,
        draw: impl FnOnce(&mut Frame<'_>) -> Result<(), E>,
    ) -> Result<FrameOutcome, E> {
        let xr_session = match &mut self.state {
            State::Open(xr_session) => xr_session,
            State::Away { .. } => return Ok(self.look_again()?),
            State::Ended => return Ok(FrameOutcome::Ended),
        };
        match run_frame(xr_session, self.session, &mut self.timing, &mut self.last_shown, draw) {
            Ok((step, drawn)) => {
                match step {
                    FrameOutcome::Shown => self.tries = 0,
                    FrameOutcome::Ended => self.put(State::Ended),
                    FrameOutcome::Hidden | FrameOutcome::Idle | FrameOutcome::Away | FrameOutcome::Back => {}
                }
                drawn.map(|()| step)
            }
            Err(lost) => {
                tracing::warn!(reason = %lost, "the headset's runtime is gone; it is looked for again");
                self.away_for(lost);
                Ok(FrameOutcome::Away)
            }
        }
    }

    /// Changes to another state; an existing session ends here.
    fn put(&mut self, state: State) {
        if !matches!(state, State::Open(_)) {
            self.last_shown = None;
        }
        let before = std::mem::replace(&mut self.state, state);
        self.watchdog.watch("the session's end", || drop(before));
    }

    fn away_for(&mut self, since: XrError) {
        self.put(State::Away { since, next: Instant::now() + self.options.retry_pause, pending: None });
    }

    /// Looks for the runtime, as often as it may be looked for, without waiting for its answer.
    fn look_again(&mut self) -> Result<FrameOutcome, XrError> {
        let (options, now) = (self.options, Instant::now());
        let State::Away { since, next, pending } = &mut self.state else { return Ok(FrameOutcome::Away) };
        let reason =
            match pending.as_ref().map(|pending_session| (pending_session.until, pending_session.answer.try_recv())) {
                None if now < *next => return Ok(FrameOutcome::Away),
                None => {
                    self.tries += 1;
                    match PendingSession::begin(options, &self.watchdog) {
                        Ok(pending_session) => {
                            *pending = Some(pending_session);
                            return Ok(FrameOutcome::Away);
                        }
                        Err(reason) => reason,
                    }
                }
                Some((_, Ok(Ok(xr_session)))) => {
                    tracing::info!(tries = self.tries, "the headset is back");
                    self.put(State::Open(xr_session));
                    self.session += 1;
                    return Ok(FrameOutcome::Back);
                }
                Some((_, Ok(Err(reason)))) => reason,
                Some((_, Err(TryRecvError::Disconnected))) => broken(),
                Some((until, Err(TryRecvError::Empty))) if now < until => return Ok(FrameOutcome::Away),
                Some((_, Err(TryRecvError::Empty))) => {
                    // The request is pending, and only its answer helps; the wait still counts as a try.
                    self.tries += 1;
                    if self.tries < options.tries {
                        *since = silent(options.timeout);
                        if let Some(pending_session) = pending {
                            pending_session.until = now + options.timeout;
                        }
                        return Ok(FrameOutcome::Away);
                    }
                    silent(options.timeout)
                }
            };
        if self.tries >= options.tries {
            self.put(State::Ended);
            return Err(XrError::Gone { tries: self.tries, reason: Box::new(reason) });
        }
        self.away_for(reason);
        Ok(FrameOutcome::Away)
    }
}

/// A frame of a running session: its outcome and the result of `draw`, or the runtime's loss.
fn run_frame<E>(
    xr_session: &mut XrSession,
    session: u64,
    timing: &mut FrameTiming,
    last_shown: &mut Option<xr::Time>,
    draw: impl FnOnce(&mut Frame<'_>) -> Result<(), E>,
) -> Result<(FrameOutcome, Result<(), E>), XrError> {
    let watchdog = xr_session.watchdog.clone();
    match watchdog.watch("what happened", || xr_session.events())? {
        SessionEvent::Nothing => {}
        SessionEvent::Left => return Ok((FrameOutcome::Ended, Ok(()))),
        SessionEvent::Lost => return Err(XrError::call("session", xr::sys::Result::ERROR_SESSION_LOST)),
    }
    if !xr_session.state_machine.is_running() {
        *last_shown = None;
        return Ok((FrameOutcome::Idle, Ok(())));
    }
    let call = |e| XrError::call("frame", e);
    let waited = watchdog.watch("a frame's time", || xr_session.waiter.wait()).map_err(call)?;
    let begun = Instant::now();
    watchdog.watch("a frame's begin", || xr_session.stream.begin()).map_err(call)?;
    // Collects the device's errors of earlier frames, above all its loss, without a wait.
    let _ = xr_session.shared.gpu.device().poll(wgpu::PollType::Poll);
    let time = waited.predicted_display_time;
    let period = waited.predicted_display_period;
    let seen = waited.should_render && xr_session.state_machine.is_visible();
    let eye_views = if seen { watchdog.watch("where eyes are", || xr_session.look(time)).map_err(call)? } else { None };
    let hands = watchdog.watch("what hands do", || xr_session.hands(time)).map_err(call)?;
    let Some(eye_views) = eye_views else {
        *last_shown = None;
        watchdog
            .watch("taking a frame", || xr_session.stream.end(time, xr_session.surroundings.raw_mode(), &[]))
            .map_err(call)?;
        return Ok((FrameOutcome::Hidden, Ok(())));
    };
    let mut frame = Frame::new(xr_session, eye_views, hands, (session, time, period));
    let drawn = draw(&mut frame);
    frame.end(time)?;
    timing.shown += 1;
    timing.period = period.as_nanos() as f64 * 1e-9;
    timing.work = begun.elapsed().as_secs_f64();
    if let Some(last) = last_shown.replace(time) {
        let periods = (time.as_nanos() - last.as_nanos()) as f64 / (period.as_nanos().max(1)) as f64;
        timing.missed += (periods.round() as u64).saturating_sub(1);
    }
    Ok((FrameOutcome::Shown, drawn))
}
