//! The commands with which a supervisor opens dropped scenes and volumes.

use std::io::ErrorKind;
use std::path::Path;

use sg_input::file;
use sg_runtime::fault::Fault;
use sg_stack::spawn;
use sg_stack::supervisor::{OpenCommand, SessionOpener};

use crate::display::has_display;
use crate::input::Input;
use crate::session_name::session_of;

/// Opens files with `supergaussian open`.
#[derive(Debug)]
pub(crate) struct CommandOpener;

impl SessionOpener for CommandOpener {
    fn command(&self, path: &Path, spacing: Option<[f64; 3]>) -> Result<OpenCommand, Fault> {
        // A path that is not there is a fault of its own.
        file::check_file_or_folder(path)
            .or_else(|e| if e.kind() == ErrorKind::NotFound { Ok(()) } else { Err(e) })
            .map_err(|e| Fault::precondition(format!("{}: {e}", path.display())))?;
        let refuse = if path.exists() { Fault::precondition } else { Fault::not_found };
        let input = Input::of(Some(path)).map_err(|f| refuse(f.text()))?;
        let readable = if path.is_dir() { Ok(()) } else { file::open(path).map(drop) };
        readable.map_err(|e| Fault::precondition(format!("{}: {e}", path.display())))?;
        if !has_display() {
            return Err(Fault::precondition(format!(
                "DISPLAY is not set where this stack was started; where there is a display, `supergaussian open {}` opens it",
                path.display()
            )));
        }
        let session = session_of(path).map_err(|f| Fault::not_found(f.text()))?;
        let mut command = spawn::detached();
        command.args(["open", "--session", &session]).arg(path);
        if let Some([x, y, z]) = spacing {
            command.arg(format!("--spacing={x},{y},{z}"));
        }
        Ok(OpenCommand { session, volume: matches!(input, Input::Volume(_)), command })
    }
}
