//! ONNX Runtime, a library that the user brings: loaded once, from a file, into this process.
//!
//! Its safe binding `ort` is built for the interface of version 1.17, so all libraries since then load.

use std::error::Error as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use ort::environment::Environment;
use ort::logging::LogLevel;
use ort::{LoadDynamicError, MINOR_VERSION};
use sg_input::file;

use crate::error::EncoderError;

/// Where a library comes from.
const REMEDY: &str = "`pip download onnxruntime` gets a wheel with onnxruntime/capi/libonnxruntime.so.*, and Debian has packages libonnxruntime*";

/// Bytes at the start of a library that have the names of its symbols.
const SYMBOLS: u64 = 1 << 20;

/// The library, loaded.
#[derive(Clone, Debug)]
pub struct OnnxRuntime {
    environment: Environment,
    version: Arc<str>,
}

/// The library of this process. It stays until the process ends, as code of it may run in threads of its own.
struct Loaded {
    path: PathBuf,
    /// Device and inode.
    identity: (u64, u64),
    /// `None` if the library was loaded but gave no environment.
    runtime: Option<OnnxRuntime>,
}

static LOADED: Mutex<Option<Loaded>> = Mutex::new(None);

impl OnnxRuntime {
    /// Loads the library of a file such as `libonnxruntime.so`, or gives the one that is loaded if it is the same file. Loading
    /// runs code of the file: name one that you trust. The library logs nothing and sends nothing.
    ///
    /// # Errors
    /// [`EncoderError`] with the file, the problem and the remedy: the file is absent, no library, another library or too old,
    /// or another library of ONNX Runtime is loaded already.
    pub fn load(path: &Path) -> Result<Self, EncoderError> {
        let wrong = |problem: String| EncoderError::file(path, problem);
        let identity = file::open(path).map_err(|error| wrong(format!("{error}; {REMEDY}")))?.identity;
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        match &mut *loaded {
            Some(other) if other.identity != identity => {
                let other = other.path.display();
                Err(wrong(format!(
                    "{other} is loaded already, and a process has one ONNX Runtime; name the same file everywhere"
                )))
            }
            Some(Loaded { runtime: Some(runtime), .. }) => Ok(runtime.clone()),
            loaded => {
                // The binding looks for relative paths beside the program.
                let absolute = std::path::absolute(path).map_err(|error| wrong(error.to_string()))?;
                let start = file::read_start(path, SYMBOLS).map_err(|error| wrong(error.to_string()))?;
                let builder = ort::init_from(&absolute).map_err(|error| wrong(load_problem(&error)))?;
                let own = loaded.insert(Loaded { path: absolute, identity, runtime: None });
                // Errors come back as values. Without a logger the library writes to standard error too.
                let builder =
                    builder.with_name("supergaussian").with_telemetry(false).with_logger(Arc::new(|_, _, _, _, _| {}));
                let environment = builder.build().map_err(|error| wrong(message(&error)))?;
                environment.set_log_level(LogLevel::Fatal);
                let runtime = Self { environment, version: version(&start, &own.path, ort::info()).into() };
                Ok(own.runtime.insert(runtime).clone())
            }
        }
    }

    /// The library's version, such as `1.32.0`. Of a build without one, what it says of itself.
    #[must_use]
    pub fn version(&self) -> &str {
        &self.version
    }

    pub(crate) fn environment(&self) -> &Environment {
        &self.environment
    }
}

/// The binding's message in one line.
pub(crate) fn message<R>(error: &ort::Error<R>) -> String {
    in_one_line(error.message())
}

fn in_one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn load_problem(error: &LoadDynamicError) -> String {
    match error {
        LoadDynamicError::Dlopen { error, .. } => {
            let reason = error.source().map_or_else(|| error.to_string(), ToString::to_string);
            format!("not a library that this machine can load: {}; {REMEDY}", in_one_line(&reason))
        }
        LoadDynamicError::MissingApi { .. } => {
            format!("a library, but not ONNX Runtime: it has no `OrtGetApiBase`; {REMEDY}")
        }
        LoadDynamicError::InvalidVersionString => format!("ONNX Runtime without a readable version; {REMEDY}"),
        LoadDynamicError::BadVersion { version_str, .. } => {
            format!("ONNX Runtime {version_str} is too old; version 1.{MINOR_VERSION} or newer is needed: {REMEDY}")
        }
    }
}

/// The version by the name of the library's symbols in the first bytes of its file, such as `VERS_1.32.0`. Without one, the name of
/// the file has it, or the text in which the library describes itself.
fn version(start: &[u8], path: &Path, info: &str) -> String {
    let mark = b"VERS_";
    let of_symbols = start.windows(mark.len()).position(|part| part == mark).map(|at| {
        let digits = start[at + mark.len()..].iter().take_while(|byte| byte.is_ascii_digit() || **byte == b'.');
        digits.map(|byte| char::from(*byte)).collect::<String>()
    });
    let file = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let of_file = || name.split_once(".so.").map(|(_, version)| version.to_owned());
    of_symbols.filter(|version| !version.is_empty()).or_else(of_file).unwrap_or_else(|| info.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_come_from_the_symbols_or_the_file() {
        let (named, plain) = (Path::new("/lib/libonnxruntime.so.1.21"), Path::new("/lib/libonnxruntime.so"));
        assert_eq!(version(b"\x7fELF\0VERS_1.32.0\0libm", named, "ORT Build Info"), "1.32.0");
        assert_eq!(version(b"\x7fELF\0VERS_\0", named, "ORT Build Info"), "1.21");
        assert_eq!(version(b"", plain, "ORT Build Info: git-branch=HEAD"), "ORT Build Info: git-branch=HEAD");
    }
}
