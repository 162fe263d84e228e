//! Sessions that are opened from this one: each is the command `open` that a person could have typed, and goes on when this
//! one ends.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex};

use sg_proto::keys;
use sg_proto::launch::{OpenFailed, OpenReply, OpenRequest};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::session::SessionDir;

use super::Supervisor;
use crate::children;
use crate::console::{self, ServiceLog};
use crate::demo::has_display;
use crate::demo::input::Input;
use crate::logs::{self, LogFile};
use crate::open::session_of;

/// Most sessions opened from one that run at a time.
pub(super) const MOST: usize = 4;

impl Supervisor {
    /// Has a scene or volume opened; if that comes to nothing, an event tells.
    pub(super) fn open_beside(&self, request: &OpenRequest) -> Result<OpenReply, Fault> {
        let path = Path::new(&request.path);
        if self.mind.is_stopping() {
            return Err(Fault::precondition("the stack is stopping"));
        }
        if !path.is_absolute() {
            return Err(Fault::invalid(format!("`{}` must be an absolute path", request.path)));
        }
        let input = Input::of(Some(path)).map_err(|f| Fault::not_found(f.text()))?;
        // Opening a pipe would wait for who writes to it.
        let readable = std::fs::metadata(path).and_then(|is| match (is.is_file(), is.is_dir()) {
            (true, _) => File::open(path).map(drop),
            (_, true) => Ok(()),
            _ => Err(io::Error::other("neither a file nor a folder")),
        });
        readable.map_err(|e| Fault::precondition(format!("{}: {e}", path.display())))?;
        if !has_display() {
            return Err(Fault::precondition(format!(
                "DISPLAY is not set where this stack was started; where there is a display, `supergaussian open {}` opens it",
                path.display()
            )));
        }
        let refuse = |e: &dyn std::fmt::Display| Fault::precondition(format!("{}: {e}", path.display()));
        let session = session_of(path).map_err(|f| Fault::not_found(f.text()))?;
        if SessionDir::named(&session).map_err(|e| refuse(&e))?.is_running() {
            return Err(refuse(&format!("it is open already, in session `{session}`")));
        }
        let place = Arc::clone(&self.places).try_acquire_owned().map_err(|_| {
            Fault::exhausted(format!(
                "{MOST} sessions that were opened from this one run; close the window of one first"
            ))
        })?;
        let mut command = children::on_its_own();
        command.args(["open", "--session", &session]).arg(path);
        let log = ServiceLog {
            service: session.clone(),
            width: self.width,
            ink: console::ink_of(self.logs.len()),
            file: Arc::new(Mutex::new(LogFile::begin(logs::path_of(&self.stack.session.logs(), &session)))),
            console: self.console.clone(),
        };
        let (_, ended) = children::run(command, log).map_err(|e| refuse(&format!("it cannot be opened: {e}")))?;
        let (bus, failed) = (
            self.bus.clone(),
            OpenFailed { path: request.path.clone(), session: session.clone(), ..OpenFailed::default() },
        );
        tokio::spawn(async move {
            let exit = ended.await;
            drop(place);
            if exit.status != Some(0) {
                // What the command itself has said last, where it has said something.
                let reason = exit.reason.split_once("error: ").map_or(exit.reason.as_str(), |(_, said)| said);
                // Nobody need listen; it stands in the log too.
                let _ = bus
                    .publish(&keys::OPEN_FAILED, &OpenFailed { reason: reason.to_owned(), ..failed }, &Context::root())
                    .await;
            }
        });
        Ok(OpenReply { session, volume: matches!(input, Input::Volume(_)) })
    }
}
