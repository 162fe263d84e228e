//! Samples of a running stack, as they are taken and as a table of numbers.

use std::fmt::Write as _;
use std::path::PathBuf;

use sg_proto::keys;
use sg_proto::launch::{PsRequest, ServiceState};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;

use super::pace::Pace;
use super::usage::{DiskUse, ProcessUse, descendants};
use crate::until::PATIENCE;

/// Name of the process that plays all users.
pub const USERS: &str = "users";
/// Name of the supervisor.
pub const SUPERVISOR: &str = "supervisor";

/// Groups of files that a stack keeps.
pub const DISKS: [&str; 5] = ["project", "logs", PICTURES, "session", "temporary"];
/// The group of pictures that processes have stored.
pub const PICTURES: &str = "pictures";

/// What a stack uses at a time.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Since the begin of the session.
    pub seconds: f64,
    /// Commands done so far.
    pub commands: u64,
    /// Pictures so far.
    pub captures: u64,
    /// Restarts so far.
    pub restarts: u64,
    /// The processes in the order of [`Sampler::names`]; `None` for one that is not ready.
    pub processes: Vec<Option<ProcessUse>>,
    /// Processes below the supervisor.
    pub below: u64,
    /// Those of them that have ended without being waited for.
    pub zombies: u64,
    /// Instances with a folder of pictures.
    pub picture_folders: u64,
    /// Files by group.
    pub disks: [DiskUse; DISKS.len()],
}

/// Folders of a stack.
#[derive(Debug, Clone)]
pub struct Folders {
    /// Of the session.
    pub session: PathBuf,
    /// Of projects.
    pub data: PathBuf,
    /// Of temporary files.
    pub temporary: PathBuf,
}

/// Takes samples.
#[derive(Debug)]
pub struct Sampler {
    bus: Bus,
    supervisor: u32,
    folders: Folders,
    /// This process, the supervisor, and the services in the order of the launch file.
    pub names: Vec<String>,
}

impl Sampler {
    /// A sampler of a stack whose services are known.
    #[must_use]
    pub fn new(bus: Bus, supervisor: u32, services: &[String], folders: Folders) -> Self {
        let names = [USERS, SUPERVISOR].map(str::to_owned).into_iter().chain(services.iter().cloned()).collect();
        Self { bus, supervisor, folders, names }
    }

    /// One sample; `None` if the supervisor does not answer.
    pub async fn take(&self, pace: &Pace) -> Option<Sample> {
        let ps = self.bus.ask(&keys::PS, &PsRequest {}, &Context::root().deadline_in(PATIENCE)).await.ok()?;
        let pid_of = |name: &String| match name.as_str() {
            USERS => Some(std::process::id()),
            SUPERVISOR => Some(self.supervisor),
            // A process that still loads uses less than it will.
            _ => ps.services.iter().find(|s| s.name == *name && s.state() == ServiceState::Ready).map(|s| s.pid),
        };
        let Folders { session, data, temporary } = &self.folders;
        let (logs, pictures) = (session.join("logs"), session.join("blobs"));
        let (below, zombies) = descendants(self.supervisor);
        Some(Sample {
            seconds: pace.elapsed().as_secs_f64(),
            commands: pace.commands.done(),
            captures: pace.captures.done(),
            restarts: pace.restarts.done(),
            processes: self.names.iter().map(|name| pid_of(name).and_then(ProcessUse::of)).collect(),
            below,
            zombies,
            picture_folders: std::fs::read_dir(&pictures).into_iter().flatten().count() as u64,
            disks: [
                DiskUse::of(data, &[]),
                DiskUse::of(&logs, &[]),
                DiskUse::of(&pictures, &[]),
                DiskUse::of(session, &[&logs, &pictures]),
                DiskUse::of(temporary, &[]),
            ],
        })
    }

    /// First line of the table of samples.
    #[must_use]
    pub fn header(&self) -> String {
        let mut line = "seconds,commands,captures,restarts,processes,zombies,picture_folders".to_owned();
        for disk in DISKS {
            // Writing to a string cannot fail.
            let _ = write!(line, ",{disk}.bytes,{disk}.entries");
        }
        for name in &self.names {
            for column in ["pid", "anonymous_kib", "descriptors", "sockets", "threads", "maps", "processor_ms"] {
                let _ = write!(line, ",{name}.{column}");
            }
        }
        line
    }
}

impl Sample {
    /// Its line in the table of samples.
    #[must_use]
    pub fn line(&self) -> String {
        let Self { seconds, commands, captures, restarts, below, zombies, picture_folders, .. } = self;
        let mut line = format!("{seconds:.2},{commands},{captures},{restarts},{below},{zombies},{picture_folders}");
        for disk in &self.disks {
            let _ = write!(line, ",{},{}", disk.bytes, disk.entries);
        }
        for process in &self.processes {
            match process {
                Some(u) => {
                    let ProcessUse { pid, anonymous_kib, descriptors, sockets, threads, maps, processor_ms } = u;
                    let _ =
                        write!(line, ",{pid},{anonymous_kib},{descriptors},{sockets},{threads},{maps},{processor_ms}");
                }
                None => line.push_str(",,,,,,,"),
            }
        }
        line
    }
}
