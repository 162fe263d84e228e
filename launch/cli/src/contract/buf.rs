//! The helper program buf: lints the schema and compares it with a released one.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use sg_stack::file::ExecutableSearch;
use tokio::process::Command;

/// Longest run. buf reads a few local files.
const DEADLINE: Duration = Duration::from_secs(60);

/// Environment variable that makes a missing buf a failure.
const REQUIRE_TOOLS: &str = "SUPERGAUSSIAN_REQUIRE_TOOLS";

/// buf, run in the folder of a schema.
#[derive(Debug)]
pub(super) struct Buf<'a> {
    program: PathBuf,
    proto: &'a Path,
}

impl<'a> Buf<'a> {
    /// Finds buf on `PATH`.
    pub(super) fn find(proto: &'a Path) -> Option<Self> {
        let program = ExecutableSearch::here_then_path().find("buf", Path::new("")).ok()?;
        Some(Self { program, proto })
    }

    /// Violations of buf's rules for style and comments.
    pub(super) async fn lint(&self) -> Vec<String> {
        self.problems(&["lint"]).await
    }

    /// Violations of buf's layout.
    pub(super) async fn format(&self) -> Vec<String> {
        self.problems(&["format", "--diff", "--exit-code"]).await
    }

    /// Changes that break users of a released image, by the rules of `buf.yaml`.
    pub(super) async fn breaking(&self, against: &Path) -> Vec<String> {
        let against = against.display().to_string();
        self.problems(&["breaking", "--against", &against]).await
    }

    /// The output lines of a failed run; empty after success.
    async fn problems(&self, arguments: &[&str]) -> Vec<String> {
        let mut command = Command::new(&self.program);
        command.args(arguments).current_dir(self.proto).stdin(Stdio::null()).kill_on_drop(true);
        let output = match tokio::time::timeout(DEADLINE, command.output()).await {
            Err(_) => return vec![format!("buf {}: no end within {} s", arguments.join(" "), DEADLINE.as_secs())],
            Ok(Err(error)) => return vec![format!("{} cannot be started: {error}", self.program.display())],
            Ok(Ok(output)) => output,
        };
        if output.status.success() {
            return Vec::new();
        }
        let text = [output.stdout, output.stderr].concat();
        let lines: Vec<_> = String::from_utf8_lossy(&text).lines().map(str::to_owned).collect();
        if lines.is_empty() { vec![format!("buf {}: {}", arguments.join(" "), output.status)] } else { lines }
    }
}

/// Whether a missing buf is a failure.
pub(super) fn is_required() -> bool {
    std::env::var(REQUIRE_TOOLS).is_ok_and(|v| v == "1")
}
