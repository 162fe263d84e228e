//! The command line of a service's process (`sg_runtime::process::ServeArgs`).

use std::path::Path;
use std::time::Duration;

use sg_runtime::bus::Link;

/// Arguments of a service's process.
#[derive(Debug)]
pub(crate) struct ServeArguments<'a> {
    pub(crate) session: &'a str,
    pub(crate) role: &'a str,
    pub(crate) instance: &'a str,
    pub(crate) link: &'a Link,
    pub(crate) run_dir: &'a Path,
    /// File with a JSON object.
    pub(crate) params_file: &'a Path,
    pub(crate) epoch: u64,
    pub(crate) standby: bool,
    /// Time between SIGTERM and SIGKILL.
    pub(crate) stop: Duration,
}

impl ServeArguments<'_> {
    /// The arguments. The process dies with this one.
    pub(crate) fn arguments(&self) -> Vec<String> {
        let run_dir = self.run_dir.display().to_string();
        let params_file = self.params_file.display().to_string();
        let supervisor = std::process::id().to_string();
        let epoch = self.epoch.to_string();
        // Leave a fifth of the time for the exit itself.
        let grace = self.stop.mul_f64(0.8).as_millis().to_string();
        let mut arguments = vec!["serve".to_owned()];
        for (name, value) in [
            ("--session", self.session),
            ("--role", self.role),
            ("--instance", self.instance),
            ("--connect", self.link.endpoint.as_str()),
            ("--run-dir", &run_dir),
            ("--params-file", &params_file),
            ("--supervisor-pid", &supervisor),
            ("--epoch", &epoch),
            ("--grace-ms", &grace),
        ] {
            arguments.extend([name.to_owned(), value.to_owned()]);
        }
        if let Some(files) = &self.link.certificates {
            for (name, path) in
                [("--authority", &files.authority), ("--certificate", &files.certificate), ("--key", &files.key)]
            {
                arguments.extend([name.to_owned(), path.display().to_string()]);
            }
        }
        arguments.extend(self.standby.then(|| "--standby".to_owned()));
        arguments
    }
}
