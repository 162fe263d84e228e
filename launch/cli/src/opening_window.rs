//! The small window with the progress of a long `open`. Without it the work goes on all the same.

use std::ffi::OsStr;
use std::io::Write as _;
use std::path::Path;
use std::process::{Child, ChildStdin, Stdio};
use std::time::Duration;

use sg_input::printable;
use sg_proto::keys;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_stack::spawn::tied_to_parent;

use crate::subcommands::{self, LOOK};

/// Exit status of the window's process after a person has cancelled.
const CANCELLED: i32 = 3;

/// Share of the work that is done before the services start.
pub(crate) const PREPARED: f32 = 0.7;

/// Longest wait for the scene's own window.
const LONGEST_START: Duration = Duration::from_secs(900);

/// The window, gone when dropped.
pub(crate) struct OpeningWindow {
    child: Option<Child>,
    news: Option<ChildStdin>,
}

impl OpeningWindow {
    /// Opens the window for a file. Where that fails, there is no window.
    pub(crate) fn open(file: &Path) -> Self {
        let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
        let child = subcommands::executable_of("render").ok().and_then(|executable| {
            let mut command = tied_to_parent(&executable);
            command.args([OsStr::new("progress"), OsStr::new("--"), OsStr::new(&*printable(&name))]);
            command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
            command.spawn().ok()
        });
        let mut child = child;
        let news = child.as_mut().and_then(|child| child.stdin.take());
        Self { child, news }
    }

    /// Tells the share that is done, 0 to 1, and what is being done.
    pub(crate) fn tell(&mut self, share: f32, step: &str) {
        if let Some(news) = &mut self.news
            && writeln!(news, "{share} {step}").is_err()
        {
            self.news = None;
        }
    }

    /// Whether a person has cancelled.
    pub(crate) fn is_cancelled(&mut self) -> bool {
        let ended = self.child.as_mut().and_then(|child| child.try_wait().ok().flatten());
        ended.is_some_and(|status| status.code() == Some(CANCELLED))
    }

    /// Stays until the scene's own window shows a picture. Returns whether a person has cancelled before that.
    pub(crate) async fn until_shown(mut self, bus: &Bus) -> bool {
        self.tell(PREPARED, "starting the services");
        let begun = std::time::Instant::now();
        while begun.elapsed() < LONGEST_START {
            if self.is_cancelled() {
                return true;
            }
            let context = Context::root().deadline_in(LOOK);
            let state = bus.newest(&keys::VIEW_STATE, &context).await;
            if state.is_ok_and(|state| state.frames > 0) {
                return false;
            }
            tokio::time::sleep(LOOK).await;
        }
        false
    }
}

impl Drop for OpeningWindow {
    fn drop(&mut self) {
        // The end of its input closes it.
        self.news = None;
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
