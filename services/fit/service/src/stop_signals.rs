//! The signals that end a training early: Ctrl-C (SIGINT) and SIGTERM.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nix::sys::signal::{SigSet, Signal, raise};

/// Tells whether a signal came during a training. A second one, and one at another time, ends the process at once.
#[derive(Debug, Default)]
pub(crate) struct StopSignals(Arc<Flags>);

#[derive(Debug, Default)]
struct Flags {
    is_training: AtomicBool,
    is_stopped: AtomicBool,
}

impl StopSignals {
    /// Watches the signals if there will be a training. Without one, they end the process as ever.
    pub(crate) fn for_training(is_wanted: bool) -> io::Result<Self> {
        if is_wanted { Self::watch() } else { Ok(Self::default()) }
    }

    /// Watches the signals from now on. Threads that run already would still end by them, so there must be none.
    fn watch() -> io::Result<Self> {
        let mut signals = SigSet::empty();
        signals.add(Signal::SIGINT);
        signals.add(Signal::SIGTERM);
        // Threads inherit this, so the signals wait for the one that takes them.
        signals.thread_block()?;
        let watched = Self::default();
        let flags = Arc::clone(&watched.0);
        let watch = move || {
            while let Ok(signal) = signals.wait() {
                let is_first = !flags.is_stopped.swap(true, Ordering::Relaxed);
                if !(is_first && flags.is_training.load(Ordering::Relaxed)) {
                    end(signals, signal);
                }
            }
        };
        std::thread::Builder::new().name("signals".to_owned()).spawn(watch)?;
        Ok(watched)
    }

    /// Says whether there is a training that is worth an orderly end.
    pub(crate) fn set_training(&self, is_training: bool) {
        self.0.is_training.store(is_training, Ordering::Relaxed);
    }

    /// Whether a signal came during a training.
    pub(crate) fn is_stopped(&self) -> bool {
        self.0.is_stopped.load(Ordering::Relaxed)
    }
}

/// Ends the process by the signal, as if it had not been watched.
fn end(signals: SigSet, signal: Signal) {
    // The process ends in any case.
    let _ = signals.thread_unblock();
    let _ = raise(signal);
    std::process::exit(128 + signal as i32);
}
