//! The service manager that started this process, such as systemd: it learns when the stack is ready and whether the
//! supervisor's loop makes progress (the protocol of `sd_notify`).
//!
//! A thread sends the messages, so that a slow service manager never delays the loop. Only the loop's turns make messages. So a
//! loop that stands still sends no sign of life, and the service manager starts the stack again.

use std::process::Command;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use sd_notify::NotifyState;

/// Environment variables of the service manager. They are for this process alone.
const VARIABLES: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_PID", "WATCHDOG_USEC"];
/// Most messages that wait at a time. Further ones are sent with a later turn.
const CAPACITY: usize = 16;
/// Signs of life within the time that the service manager waits for one.
const SIGNS: u32 = 3;

/// Keeps the service manager's variables from a child, which must not speak for this process.
pub(crate) fn hide_from(command: &mut Command) {
    for name in VARIABLES {
        command.env_remove(name);
    }
}

/// The state of a stack, as a service manager sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct StackState {
    /// Whether every service that the stack cannot do without is ready.
    pub(crate) ready: bool,
    /// Whether the stack is stopping.
    pub(crate) stopping: bool,
    /// One line for people.
    pub(crate) status: String,
}

/// The connection to the service manager. Without one it does nothing.
#[derive(Debug)]
pub(crate) struct ServiceManager {
    sender: Option<SyncSender<Note>>,
    /// Time between two signs of life.
    period: Option<Duration>,
    last_sign: Option<Instant>,
    told: Option<StackState>,
    was_ready: bool,
}

/// A message.
#[derive(Debug, PartialEq, Eq)]
enum Note {
    Ready,
    Reloading,
    Stopping,
    SignOfLife,
    Status(String),
}

impl ServiceManager {
    /// Connects to the service manager that the environment names.
    pub(crate) fn of_environment() -> Self {
        let named = std::env::var_os("NOTIFY_SOCKET").is_some_and(|socket| !socket.is_empty());
        let started = |(sender, waiting)| {
            let thread = std::thread::Builder::new().name("service-manager".into());
            thread.spawn(move || send(&waiting)).ok().map(|_| sender)
        };
        let sender = if named { started(sync_channel(CAPACITY)) } else { None };
        let period = sd_notify::watchdog_enabled().map(|time| time / SIGNS);
        Self::new(sender, period)
    }

    fn new(sender: Option<SyncSender<Note>>, period: Option<Duration>) -> Self {
        Self { sender, period, last_sign: None, told: None, was_ready: false }
    }

    /// Whether there is one.
    pub(crate) fn is_there(&self) -> bool {
        self.sender.is_some()
    }

    /// Tells of a reload. The next turn with all services ready ends it.
    pub(crate) fn reloading(&mut self) {
        if self.was_ready && self.tell(Note::Reloading) {
            self.was_ready = false;
            self.told = None;
        }
    }

    /// Tells of a turn of the loop, and of what has changed since the last one.
    pub(crate) fn turn(&mut self, now: Instant, state: StackState) {
        let due = |last: Instant, period| now.saturating_duration_since(last) >= period;
        if let Some(period) = self.period
            && self.last_sign.is_none_or(|last| due(last, period))
            && self.tell(Note::SignOfLife)
        {
            self.last_sign = Some(now);
        }
        if self.told.as_ref() == Some(&state) {
            return;
        }
        let stops = state.stopping && self.told.as_ref().is_none_or(|told| !told.stopping);
        let mut sent = !stops || self.tell(Note::Stopping);
        // Once the stack is ready, a service that is started again changes the status only.
        if state.ready && !state.stopping && !self.was_ready {
            self.was_ready = self.tell(Note::Ready);
            sent &= self.was_ready;
        }
        sent &= self.tell(Note::Status(state.status.clone()));
        if sent {
            self.told = Some(state);
        }
    }

    /// Passes a message to the thread. Returns whether it had room.
    fn tell(&self, note: Note) -> bool {
        self.sender.as_ref().is_some_and(|sender| sender.try_send(note).is_ok())
    }
}

/// Sends messages until the supervisor ends.
fn send(waiting: &Receiver<Note>) {
    for note in waiting {
        let state = match &note {
            Note::Ready => NotifyState::Ready,
            Note::Reloading => NotifyState::Reloading,
            Note::Stopping => NotifyState::Stopping,
            Note::SignOfLife => NotifyState::Watchdog,
            Note::Status(status) => NotifyState::Status(status),
        };
        // A service manager that does not listen acts on the missing signs of life.
        let _ = match note {
            Note::Reloading => NotifyState::monotonic_usec_now().and_then(|now| sd_notify::notify(&[state, now])),
            _ => sd_notify::notify(&[state]),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(ready: bool, stopping: bool, status: &str) -> StackState {
        StackState { ready, stopping, status: status.to_owned() }
    }

    fn status(text: &str) -> Note {
        Note::Status(text.to_owned())
    }

    #[test]
    fn changes_are_told_once_and_signs_of_life_in_their_period() {
        let (sender, notes) = sync_channel(CAPACITY);
        let mut manager = ServiceManager::new(Some(sender), Some(Duration::from_secs(1)));
        let began = Instant::now();
        let mut turn = |seconds: f64, state: StackState| {
            manager.turn(began + Duration::from_secs_f64(seconds), state);
            notes.try_iter().collect::<Vec<_>>()
        };
        assert_eq!(turn(0.0, state(false, false, "0 of 2")), [Note::SignOfLife, status("0 of 2")]);
        assert_eq!(turn(0.5, state(false, false, "0 of 2")), []);
        assert_eq!(turn(1.0, state(true, false, "2 of 2")), [Note::SignOfLife, Note::Ready, status("2 of 2")]);
        // A service is started again.
        assert_eq!(turn(1.1, state(false, false, "1 of 2")), [status("1 of 2")]);
        assert_eq!(turn(1.2, state(true, false, "2 of 2")), [status("2 of 2")]);
        assert_eq!(turn(2.0, state(true, true, "stopping")), [Note::SignOfLife, Note::Stopping, status("stopping")]);
        assert_eq!(turn(2.1, state(false, true, "stopping")), [status("stopping")]);
    }

    #[test]
    fn a_reload_ends_with_readiness_and_what_finds_no_room_is_told_later() {
        let (sender, notes) = sync_channel(2);
        let mut manager = ServiceManager::new(Some(sender), None);
        let now = Instant::now();
        manager.reloading();
        assert_eq!(notes.try_iter().count(), 0, "it is not ready yet");
        manager.turn(now, state(true, false, "2 of 2"));
        assert_eq!(notes.try_iter().collect::<Vec<_>>(), [Note::Ready, status("2 of 2")]);
        manager.reloading();
        manager.turn(now, state(true, false, "3 of 3"));
        assert_eq!(notes.try_iter().collect::<Vec<_>>(), [Note::Reloading, Note::Ready]);
        manager.turn(now, state(true, false, "3 of 3"));
        assert_eq!(notes.try_iter().collect::<Vec<_>>(), [status("3 of 3")]);
    }
}
