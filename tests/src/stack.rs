//! A whole running stack on the small scene, in a run folder of its own.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use sg_runtime::bus::{Bus, BusError, endpoint_of};

use crate::hosts::Host;
use crate::{Missing, command, said, small_scene};

/// Name of its session.
pub const SESSION: &str = "tried";

/// Number of services of the headless and of the desktop launch file.
pub const SERVICES: usize = 9;

/// How long the stack may take until every service is ready.
const READY: Duration = Duration::from_secs(90);

/// A running stack; killed with all its services when dropped.
#[derive(Debug)]
pub struct Stack {
    /// Name of its launch file.
    file: String,
    folder: tempfile::TempDir,
    supervisor: Child,
}

impl Stack {
    /// Starts every service of the headless launch file and waits until each is ready.
    ///
    /// # Errors
    /// A line that names the part that is missing or did not get ready.
    pub fn up() -> Result<Self, String> {
        Self::up_with(&[])
    }

    /// As [`Stack::up`], with `--set` of each setting.
    ///
    /// # Errors
    /// As [`Stack::up`].
    pub fn up_with(settings: &[String]) -> Result<Self, String> {
        Self::up_in(settings, &[])
    }

    /// As [`Stack::up_with`], with these environment variables.
    ///
    /// # Errors
    /// As [`Stack::up`].
    pub fn up_in(settings: &[String], env: &[(&str, &str)]) -> Result<Self, String> {
        Self::up_of("headless.toml", settings, env)
    }

    /// As [`Stack::up_in`], of one of the launch files that come with the project.
    ///
    /// # Errors
    /// As [`Stack::up`].
    pub fn up_of(file: &str, settings: &[String], env: &[(&str, &str)]) -> Result<Self, String> {
        let mut stack = Self::begin_of(file, settings, env, None)?;
        let begun = Instant::now();
        loop {
            let services = stack.ps();
            if are_ready(&services) {
                return Ok(stack);
            }
            if let Some(status) = stack.ended(Duration::ZERO) {
                return Err(format!("it ended with {status:?}\n{}", stack.log()));
            }
            if begun.elapsed() > READY {
                return Err(stack.not_ready(&services));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Begins to start every service of the headless launch file, on a host if one is given.
    ///
    /// # Errors
    /// A line that names the missing part.
    pub fn begin(settings: &[String], env: &[(&str, &str)], host: Option<&Host>) -> Result<Self, String> {
        Self::begin_of("headless.toml", settings, env, host)
    }

    fn begin_of(file: &str, settings: &[String], env: &[(&str, &str)], host: Option<&Host>) -> Result<Self, String> {
        let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
        small_scene::write(folder.path()).map_err(|e| e.to_string())?;
        let mut up = command(&folder.path().join("run")).map_err(|e| e.to_string())?;
        if let Some(host) = host {
            up = host.on(&up, &[]);
        }
        up.args(Self::arguments(file, folder.path(), settings));
        up.envs(env.iter().copied());
        let log = std::fs::File::create(folder.path().join("up.log")).map_err(|e| e.to_string())?;
        let supervisor =
            up.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log).spawn().map_err(|e| e.to_string())?;
        Ok(Self { file: file.to_owned(), folder, supervisor })
    }

    fn arguments(file: &str, folder: &Path, settings: &[String]) -> Vec<String> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch").join(file).display().to_string();
        let scene = format!("service.scene.params.scene={}", small_scene::path(folder).display());
        let mut arguments: Vec<String> = ["up", "--session", SESSION].map(str::to_owned).to_vec();
        arguments.push(file);
        for setting in [&scene].into_iter().chain(settings) {
            arguments.extend(["--set".to_owned(), setting.clone()]);
        }
        arguments
    }

    /// Reloads the launch file with other settings and waits until the stack agrees with it. Returns exit status, standard
    /// output, and all output for a failing test.
    ///
    /// # Errors
    /// As [`Stack::command`].
    pub fn up_again(&self, settings: &[String]) -> Result<(Option<i32>, String, String), Missing> {
        let arguments = Self::arguments(&self.file, self.folder.path(), settings);
        self.run(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// Waits until every service is ready.
    ///
    /// # Errors
    /// A line that names the part that did not get ready.
    pub fn wait(&self) -> Result<(), String> {
        let begun = Instant::now();
        loop {
            let services = self.ps();
            if are_ready(&services) {
                return Ok(());
            }
            if begun.elapsed() > READY {
                return Err(self.not_ready(&services));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The supervisor's output so far.
    #[must_use]
    pub fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("up.log")).unwrap_or_default()
    }

    /// Exit status of the supervisor, if it ends within `patience`.
    pub fn ended(&mut self, patience: Duration) -> Option<Option<i32>> {
        let begun = Instant::now();
        loop {
            if let Ok(Some(status)) = self.supervisor.try_wait() {
                return Some(status.code());
            }
            if begun.elapsed() >= patience {
                return None;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn not_ready(&self, services: &[Value]) -> String {
        format!("not ready within {} s: {services:?}\n{}", READY.as_secs(), self.log())
    }

    /// The folder that holds all of it.
    #[must_use]
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The command `supergaussian`. It finds this stack.
    ///
    /// # Errors
    /// [`Missing::Command`] if it was not built.
    pub fn command(&self) -> Result<Command, Missing> {
        command(&self.run_root())
    }

    /// Runs the command to its end: exit status, standard output, and all output for a failing test.
    ///
    /// # Errors
    /// As [`Stack::command`].
    pub fn run(&self, arguments: &[&str]) -> Result<(Option<i32>, String, String), Missing> {
        let output = self.command()?.args(arguments).output()?;
        Ok((output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned(), said(&output)))
    }

    /// How the services are; nothing before the supervisor answers.
    #[must_use]
    pub fn ps(&self) -> Vec<Value> {
        let Ok((Some(0), text, _)) = self.run(&["ps", "--json"]) else { return Vec::new() };
        let ps: Value = serde_json::from_str(&text).unwrap_or_default();
        ps["services"].as_array().cloned().unwrap_or_default()
    }

    /// Joins the bus in the name of a role.
    ///
    /// # Errors
    /// [`BusError::Open`].
    pub async fn join(&self, role: &str) -> Result<Bus, BusError> {
        Bus::connect(SESSION, role, &endpoint_of(&self.run_root().join(SESSION).join("bus.sock"))).await
    }

    /// Process id of the supervisor.
    #[must_use]
    pub fn supervisor(&self) -> u32 {
        self.supervisor.id()
    }

    /// The folder of the session.
    #[must_use]
    pub fn session_folder(&self) -> PathBuf {
        self.run_root().join(SESSION)
    }

    /// The folder of all sessions: its own, and those that were opened from it.
    #[must_use]
    pub fn run_root(&self) -> PathBuf {
        self.folder.path().join("run")
    }
}

fn are_ready(services: &[Value]) -> bool {
    !services.is_empty() && services.iter().all(|s| s["state"] == "READY")
}

impl Drop for Stack {
    fn drop(&mut self) {
        // The services die with their supervisor.
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
    }
}
