//! Panics end their process. A worker that is gone would leave its requests unanswered for ever.

use std::io::Write as _;
use std::panic::PanicHookInfo;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::watch;

/// The first panic of this process, one line.
static FIRST: OnceLock<watch::Sender<Option<String>>> = OnceLock::new();
/// Whether a panic of the main thread is printed.
static PRINTS_MAIN: AtomicBool = AtomicBool::new(false);

/// Takes note of every panic of this process, on any thread or task, instead of printing it. The receiver gets the first
/// one as one line. Its owner ends the process as failed. A panic of the main thread ends it at once, and is printed.
///
/// With `RUST_BACKTRACE` in the environment, every panic and its backtrace are printed as well.
#[must_use]
pub fn report_panics() -> watch::Receiver<Option<String>> {
    PRINTS_MAIN.store(true, Ordering::Relaxed);
    report()
}

/// As [`report_panics`]. The caller catches panics of the main thread.
pub(super) fn report() -> watch::Receiver<Option<String>> {
    let first = FIRST.get_or_init(|| {
        let print = std::panic::take_hook();
        let wanted = std::env::var_os("RUST_BACKTRACE").is_some_and(|v| v != "0");
        std::panic::set_hook(Box::new(move |info| {
            if wanted {
                print(info);
            } else if PRINTS_MAIN.load(Ordering::Relaxed) && std::thread::current().name() == Some("main") {
                // Standard error may be closed.
                let _ = writeln!(std::io::stderr(), "error: {}", line(info));
            }
            if let Some(first) = FIRST.get() {
                first.send_if_modified(|known| known.is_none() && known.replace(line(info)).is_none());
            }
        }));
        watch::channel(None).0
    });
    first.subscribe()
}

/// The first panic so far.
pub(super) fn first() -> Option<String> {
    FIRST.get().and_then(|first| first.borrow().clone())
}

fn line(info: &PanicHookInfo<'_>) -> String {
    let said = info.payload_as_str().unwrap_or("no reason given").split_whitespace().collect::<Vec<_>>().join(" ");
    let place = info.location().map_or_else(String::new, |l| format!(" at {}:{}", l.file(), l.line()));
    let thread = std::thread::current();
    format!("panicked{place} (thread `{}`): {said}", thread.name().unwrap_or("unnamed"))
}
