//! Opens scenes and volumes in sessions of their own, as the command `open` does. They go on when this session ends.

use std::sync::{Arc, Mutex};

use sg_proto::keys;
use sg_proto::launch::{OpenFailed, OpenReply, OpenRequest};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::session::SessionDir;

use super::event_loop::Supervisor;
use super::file_places::FilePlaces;
use super::opener::{MAX_OPEN, OpenCommand};
use crate::console::{self, ServiceLog};
use crate::log_file::{self, LogFile};
use crate::spawn;

impl Supervisor {
    /// Opens a scene or volume. Publishes [`OpenFailed`] if its command fails later.
    pub(super) fn open_session(&self, request: &OpenRequest) -> Result<OpenReply, Fault> {
        if self.reconciler.is_stopping() {
            return Err(Fault::precondition("the stack is stopping"));
        }
        let path = &FilePlaces::of(&self.stack.file.services).absolute(&request.path)?;
        let spacing = match request.spacing[..] {
            [] => None,
            [x, y, z] if [x, y, z].iter().all(|v| v.is_finite() && *v > 0.0) => Some([x, y, z]),
            _ => return Err(Fault::invalid("the spacing of voxels is three lengths above 0")),
        };
        let OpenCommand { session, volume, command } = self.stack.opener.command(path, spacing)?;
        let refuse = |e: &dyn std::fmt::Display| Fault::precondition(format!("{}: {e}", path.display()));
        if SessionDir::named(&session).map_err(|e| refuse(&e))?.is_running() {
            return Err(refuse(&format!("it is open already, in session `{session}`")));
        }
        let place = Arc::clone(&self.open_slots).try_acquire_owned().map_err(|_| {
            Fault::exhausted(format!("{MAX_OPEN} sessions opened from this one run; close the window of one first"))
        })?;
        let log = ServiceLog {
            service: session.clone(),
            width: self.width,
            color: console::color_of(self.logs.len()),
            file: Arc::new(Mutex::new(LogFile::create(log_file::path_of(&self.stack.session.logs(), &session)))),
            console: self.console.clone(),
        };
        let (_, ended) = spawn::run(command, log).map_err(|e| refuse(&format!("it cannot be opened: {e}")))?;
        let (bus, failed) = (
            self.bus.clone(),
            OpenFailed { path: path.display().to_string(), session: session.clone(), ..OpenFailed::default() },
        );
        tokio::spawn(async move {
            let exit = ended.await;
            drop(place);
            if exit.status != Some(0) {
                // Prefer the command's own last error line.
                let reason = exit.reason.split_once("error: ").map_or(exit.reason.as_str(), |(_, said)| said);
                // The log has the line too.
                let _ = bus
                    .publish(&keys::OPEN_FAILED, &OpenFailed { reason: reason.to_owned(), ..failed }, &Context::root())
                    .await;
            }
        });
        Ok(OpenReply { session, volume })
    }
}
