//! Programs in Python that stand in a language model's place.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use sg_tests::python;

/// Longest wait for a program to say that it serves.
const PATIENCE: Duration = Duration::from_secs(60);

/// A program that serves until it is dropped.
pub(crate) struct Program {
    child: Child,
    /// Its address.
    pub(crate) endpoint: String,
}

impl Program {
    /// The Python backend that comes with the agents; none without Python.
    pub(crate) fn german(address: &str) -> Option<Self> {
        Self::start(&repository().join("services/agents/examples/python-backend/backend.py"), address, "serving ")
    }

    /// The Python recognizer and synthesizer that come with the speech service; none without Python.
    pub(crate) fn speech(address: &str) -> Option<Self> {
        Self::start(&repository().join("services/speech/examples/python-backend/backend.py"), address, "serving ")
    }

    /// A llama.cpp server with a model that knows nothing; none without Python.
    pub(crate) fn llama(folder: &Path) -> Option<Self> {
        Self::start(&repository().join("tests/llama/server.py"), &folder.to_string_lossy(), "")
    }

    fn start(script: &Path, argument: &str, before: &str) -> Option<Self> {
        let Some(python) = python().unwrap() else {
            println!("SKIPPED: {} needs the environment that ops/python.sh makes", script.display());
            return None;
        };
        let mut child = Command::new(python)
            .arg(script)
            .arg(argument)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let out = child.stdout.take().unwrap();
        let (tell, told) = mpsc::channel();
        std::thread::spawn(move || {
            let mut line = String::new();
            let _ = BufReader::new(out).read_line(&mut line);
            let _ = tell.send(line);
        });
        let line = told.recv_timeout(PATIENCE);
        let endpoint = line.as_deref().ok().and_then(|l| l.trim().strip_prefix(before)).filter(|l| !l.is_empty());
        let endpoint = endpoint.map(str::to_owned);
        let program = Self { child, endpoint: endpoint.clone().unwrap_or_default() };
        assert!(endpoint.is_some(), "{} says {line:?}", script.display());
        Some(program)
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}
