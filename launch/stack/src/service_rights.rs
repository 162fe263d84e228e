//! The rights of a service's process: what the kernel leaves to it ([`sg_confinement`]).
//!
//! A service may use the system's programs and libraries, its own executable, its files in the session's folder, the paths in
//! its parameters, and what its role needs. The launch file adds to that, or frees a service (`read`, `write`, `confined`).

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{self, Read as _};
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _};
use std::path::{Path, PathBuf};

use serde_json::Value;
use sg_confinement::Rights;
use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;
use sg_proto::keys::role;
use sg_runtime::bus::Link;

use crate::file::{Confinement, Service};

/// Folders of the system with programs, libraries and their data.
const SYSTEM: [&str; 15] = [
    "/bin",
    "/etc",
    "/gnu/store",
    "/lib",
    "/lib32",
    "/lib64",
    "/libx32",
    "/nix/store",
    "/opt",
    "/run/current-system",
    "/run/opengl-driver",
    "/sbin",
    "/snap",
    "/usr",
    "/var/cache/fontconfig",
];
/// What every program may read about the system. Landlock itself hides the memory and environment of other processes.
const STATE: [&str; 4] = ["/proc", "/run/systemd/resolve", "/run/udev", "/sys"];
/// Devices that every program may use.
const DEVICES: [&str; 6] = ["/dev/full", "/dev/null", "/dev/random", "/dev/tty", "/dev/urandom", "/dev/zero"];
/// Memory that processes share.
const SHARED_MEMORY: &str = "/dev/shm";
/// Devices of graphics cards, by the begin of their names in `/dev`.
const GRAPHICS_DEVICES: [&str; 7] = ["dri", "dxg", "kfd", "nvidia", "udmabuf", "dma_heap", "mali"];
/// Environment variables with lists of folders whose programs or libraries are used.
const SEARCHED: [&str; 4] = ["LD_LIBRARY_PATH", "PATH", "PYTHONPATH", "VIRTUAL_ENV"];
/// Environment variable with the interpreter of services in Python.
const PYTHON: &str = "SUPERGAUSSIAN_PYTHON";
/// The interpreter of the environment for Python services, below the user's cache.
const PYTHON_ENVIRONMENT: &str = "supergaussian/python/bin/python";
/// Environment variable with the folder of the schema, for services in Python.
const SCHEMA: &str = "SUPERGAUSSIAN_PROTO";
/// Environment variables with lists of description files of graphics drivers and headset runtimes.
const DRIVERS: [&str; 5] =
    ["VK_ADD_DRIVER_FILES", "VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_LAYER_PATH", "XR_RUNTIME_JSON"];
/// Files below the home folder that headset runtimes, graphics drivers and the display keep there.
const HOME_READ: [&str; 9] = [
    ".Xauthority",
    ".config/openvr",
    ".config/openxr",
    ".config/vulkan",
    ".local/share/Steam",
    ".local/share/openvr",
    ".local/share/openxr",
    ".local/share/vulkan",
    ".steam",
];
/// Caches below the home folder that graphics drivers write.
const HOME_CACHES: [&str; 4] = [".cache/mesa_shader_cache", ".cache/mesa_shader_cache_db", ".cache/nvidia", ".nv"];
/// Folder below the user's cache in which render processes keep compiled pipelines.
const PIPELINES: &str = "supergaussian/pipelines";
/// Folder of sound devices.
const SOUND_DEVICES: &str = "/dev/snd";
/// What sound servers keep in the user's runtime folder.
const SOUND_SOCKETS: [&str; 3] = ["pipewire-0", "pipewire-0.lock", "pulse"];
/// Settings of sound below the home folder.
const SOUND_SETTINGS: [&str; 4] = [".asoundrc", ".config/alsa", ".config/pipewire", ".config/pulse"];
/// Folder below the user's cache with models of speech and of sentences.
const MODELS: &str = "supergaussian/models";
/// Ports of addresses that name none.
const HTTP_PORT: u16 = 80;
const HTTPS_PORT: u16 = 443;
/// Port of an OpenTelemetry collector whose address names none.
const COLLECTOR_PORT: u16 = 4317;
/// First TCP port of X11 displays.
const X11_PORT: u16 = 6000;
/// Longest first line of a script, bytes.
const FIRST_LINE: u64 = 512;
/// Most values of parameters that are looked at.
const MAX_VALUES: usize = 10_000;

/// A process, with everything that its rights derive from.
#[derive(Debug)]
pub(crate) struct Process<'a> {
    pub(crate) role: &'a str,
    pub(crate) instance: &'a str,
    pub(crate) executable: &'a Path,
    pub(crate) params: &'a Value,
    pub(crate) params_file: &'a Path,
    pub(crate) env: &'a [(String, String)],
    pub(crate) run_dir: &'a Path,
    pub(crate) link: &'a Link,
    /// The session's scene on this machine, if there is one.
    pub(crate) scene: Option<&'a Path>,
    pub(crate) confinement: &'a Confinement,
}

/// Whether a parameter of the speech service names a sound device, as `device` or `device:NAME`.
fn is_sound_device(parameter: &str) -> bool {
    parameter == "device" || parameter.starts_with("device:")
}

/// Path of the session's scene: the parameter of the service that serves the role.
pub(crate) fn scene_of(services: &[Service]) -> Option<PathBuf> {
    let scene = services.iter().find(|s| s.role == role::SCENE && s.start.node.is_none())?;
    absolute(scene.start.params.get("scene")?.as_str()?)
}

impl Process<'_> {
    /// The rights of this process, `None` if its launch file frees it, and its folder for temporary files. Makes the folders
    /// that it may write.
    ///
    /// # Errors
    /// One line: a folder cannot be made.
    pub(crate) fn prepare(&self) -> Result<(Option<Rights>, PathBuf), String> {
        let scratch = self.run_dir.join("blobs").join(self.instance);
        let rights = make_folder(&scratch).and_then(|()| self.rights(&scratch));
        Ok((rights.map_err(|e| format!("a folder that it may write cannot be made: {e}"))?, scratch))
    }

    fn rights(&self, scratch: &Path) -> io::Result<Option<Rights>> {
        if !self.confinement.confined {
            return Ok(None);
        }
        let mut rights = Rights::none();
        rights.run.extend(SYSTEM.map(PathBuf::from));
        rights.read.extend(STATE.map(PathBuf::from));
        rights.devices.extend(DEVICES.map(PathBuf::from));
        self.programs(&mut rights);
        self.python(&mut rights)?;
        self.session(&mut rights, scratch)?;
        self.parameters(&mut rights)?;
        self.network(&mut rights);
        if [role::RENDER_VIEW, role::RENDER_CAPTURE].contains(&self.role) {
            self.graphics(&mut rights);
        }
        if self.role == role::RENDER_VIEW {
            self.display(&mut rights)?;
        }
        rights.run.extend(self.confinement.read.iter().cloned());
        rights.write.extend(self.confinement.write.iter().cloned());
        Ok(Some(rights))
    }

    /// The executable, its interpreter, this program, and the folders in which programs and libraries are searched.
    fn programs(&self, rights: &mut Rights) {
        rights.run.insert(self.executable.to_owned());
        // Scripts start programs that lie beside the launcher.
        let mut programs: Vec<PathBuf> = std::env::current_exe().into_iter().collect();
        programs.push(self.executable.to_owned());
        programs.extend(self.interpreter());
        programs.extend(self.variable(PYTHON).map(PathBuf::from).filter(|p| p.is_absolute()));
        let cached = self.user_folder("XDG_CACHE_HOME", ".cache").map(|cache| cache.join(PYTHON_ENVIRONMENT));
        programs.extend(cached.filter(|p| p.is_file()));
        for program in programs {
            let real = std::fs::canonicalize(&program).ok();
            let prefixes = [environment_of(&program), real.as_deref().and_then(python_of)];
            let paths = [Some(program), real].into_iter().flatten();
            for path in paths {
                rights.run.extend(path.parent().filter(|folder| !self.is_wide(folder)).map(Path::to_owned));
                rights.run.insert(path);
            }
            rights.run.extend(prefixes.into_iter().flatten().filter(|folder| !self.is_wide(folder)));
        }
        for name in SEARCHED {
            let value = self.variable(name).unwrap_or_default();
            let folders = std::env::split_paths(&value).filter(|f| f.is_absolute() && !self.is_wide(f));
            rights.run.extend(folders);
        }
    }

    /// What a service in Python needs besides its interpreter: the schema of the messages, and the code made from it. Python
    /// programs are scripts.
    fn python(&self, rights: &mut Rights) -> io::Result<()> {
        let Ok(real) = std::fs::canonicalize(self.executable) else { return Ok(()) };
        if self.interpreter().is_none() {
            return Ok(());
        }
        // The bus for Python keeps large messages in shared memory.
        rights.write.insert(SHARED_MEMORY.into());
        let schema = self.variable(SCHEMA).map(PathBuf::from);
        let above = || real.ancestors().map(|folder| folder.join("proto")).find(|p| p.join("supergaussian").is_dir());
        rights.read.extend(schema.or_else(above));
        if let Some(cache) = self.user_folder("XDG_CACHE_HOME", ".cache") {
            let messages = cache.join("supergaussian/python-messages");
            make_folder(&messages)?;
            rights.write.insert(messages);
        }
        Ok(())
    }

    /// The interpreter that the first line of a script names.
    fn interpreter(&self) -> Option<PathBuf> {
        let mut first = Vec::new();
        file::open(self.executable).ok()?.file.take(FIRST_LINE).read_to_end(&mut first).ok()?;
        let line = first.strip_prefix(b"#!")?.split(|b| *b == b'\n').next()?;
        let mut words = std::str::from_utf8(line).ok()?.split_whitespace();
        let interpreter = PathBuf::from(words.next()?);
        if !interpreter.ends_with("env") {
            return Some(interpreter);
        }
        let name = words.find(|word| !word.starts_with('-'))?;
        let path = self.variable("PATH")?;
        std::env::split_paths(&path).map(|folder| folder.join(name)).find(|p| p.is_file())
    }

    /// The files of the process in its session's folder.
    fn session(&self, rights: &mut Rights, scratch: &Path) -> io::Result<()> {
        rights.write.insert(scratch.to_owned());
        // Pictures of other processes, but not their parameters.
        rights.read.insert(self.run_dir.join("blobs"));
        rights.read.insert(self.params_file.to_owned());
        let clusters = self.run_dir.join("clusters");
        make_folder(&clusters)?;
        if self.role == role::SELECTION {
            rights.write.insert(clusters)
        } else {
            rights.read.insert(clusters)
        };
        if self.role == role::LABELING {
            let embeddings = self.run_dir.join("embeddings");
            make_folder(&embeddings)?;
            rights.write.insert(embeddings);
        }
        if let Some(certificates) = &self.link.certificates {
            rights
                .read
                .extend([&certificates.authority, &certificates.certificate, &certificates.key].map(Clone::clone));
            // A node's processes fetch the scene.
            let scenes = self.run_dir.join("scenes");
            make_folder(&scenes)?;
            rights.write.insert(scenes);
        }
        let is_agent = [role::AGENT_CORE, role::AGENT_FUNCTION, role::AGENT_INTENT].contains(&self.role);
        if let Some(scene) = self.scene.filter(|_| !is_agent) {
            rights.read.extend(self.scene_files(scene));
        }
        Ok(())
    }

    /// A scene with its files: those in the folder of a `scene.toml`, else the file itself.
    fn scene_files(&self, scene: &Path) -> Vec<PathBuf> {
        let folder = scene.parent().filter(|_| scene.extension().is_some_and(|e| e == "toml"));
        match folder {
            Some(folder) if self.is_wide(folder) => visible(folder),
            Some(folder) => vec![folder.to_owned()],
            None => vec![scene.to_owned()],
        }
    }

    /// Paths in the parameters: read, and those that the role writes.
    fn parameters(&self, rights: &mut Rights) -> io::Result<()> {
        let mut waiting = vec![self.params];
        for _ in 0..MAX_VALUES {
            let Some(value) = waiting.pop() else { break };
            match value {
                Value::String(text) => rights.read.extend(absolute(text).filter(|p| p.exists())),
                Value::Array(items) => waiting.extend(items),
                Value::Object(entries) => waiting.extend(entries.values()),
                _ => {}
            }
        }
        let path = |name: &str| absolute(self.params.get(name)?.as_str()?);
        match self.role {
            role::SCENE => match path("project") {
                // SQLite keeps its log beside the file.
                Some(project) => rights.write.extend(project.parent().map(Path::to_owned)),
                None => {
                    if let Some(data) = self.user_folder("XDG_DATA_HOME", ".local/share") {
                        let projects = data.join("supergaussian/projects");
                        make_folder(&projects)?;
                        rights.write.insert(projects);
                    }
                }
            },
            role::SELECTION | role::LABELING => {
                if let Some(cache) = path("cache") {
                    make_folder(&cache)?;
                    rights.write.insert(cache);
                }
                if self.role == role::LABELING {
                    rights.read.extend(self.models());
                }
            }
            role::SPEECH => {
                // A pipe is written itself, and a file beside its place.
                let output = path("output");
                let is_pipe = |p: &PathBuf| std::fs::metadata(p).is_ok_and(|m| m.file_type().is_fifo());
                rights
                    .write
                    .extend(output.and_then(|p| if is_pipe(&p) { Some(p) } else { p.parent().map(Path::to_owned) }));
                let device = |name: &str| self.params.get(name).and_then(Value::as_str).is_some_and(is_sound_device);
                if device("input") || device("output") {
                    self.sound(rights);
                }
                rights.read.extend(self.models());
            }
            _ => {}
        }
        Ok(())
    }

    /// The folder of the usual models, if it is there.
    fn models(&self) -> Option<PathBuf> {
        let cache = self.user_folder("XDG_CACHE_HOME", ".cache");
        cache.map(|cache| cache.join(MODELS)).filter(|models| models.is_dir())
    }

    /// Connections by TCP: agents reach language models, speech its servers, and everyone the collector of traces and a node's home.
    /// Programs of unknown roles may connect anywhere.
    fn network(&self, rights: &mut Rights) {
        const LOCAL: [&str; 6] =
            [role::SCENE, role::SELECTION, role::LABELING, role::SPEECH, role::RENDER_VIEW, role::RENDER_CAPTURE];
        if !LOCAL.contains(&self.role) {
            rights.connect = None;
            return;
        }
        let mut ports = BTreeSet::new();
        if let Some(collector) = self.variable("OTEL_EXPORTER_OTLP_ENDPOINT").filter(|c| !c.is_empty()) {
            ports.insert(port_of(&collector.to_string_lossy()).unwrap_or(COLLECTOR_PORT));
        }
        if self.link.is_remote() {
            ports.extend(port_of(&self.link.endpoint));
        }
        if self.role == role::SPEECH {
            ports.extend(["recognizer", "synthesizer"].into_iter().filter_map(|backend| self.speech_server(backend)));
        }
        if self.role == role::RENDER_VIEW
            && let Some(display) = self.variable("DISPLAY")
            && let Some((host, screen)) = display.to_string_lossy().rsplit_once(':')
            && !host.is_empty()
            && let Some(number) = screen.split('.').next().and_then(|n| n.parse::<u16>().ok())
        {
            ports.extend(X11_PORT.checked_add(number));
        }
        rights.connect = Some(ports);
    }

    /// The port of the server that hears or speaks, if there is one.
    fn speech_server(&self, backend: &str) -> Option<u16> {
        let kind = self.params.get(backend)?.as_str()?;
        let server = self.params.get(format!("{backend}_server"));
        let endpoint = server.and_then(|server| server.get("endpoint")?.as_str()).unwrap_or_default();
        if matches!(kind, "openai" | "grpc") { server_port(endpoint) } else { None }
    }

    /// Sound devices, with the settings and the sockets of the sound servers.
    fn sound(&self, rights: &mut Rights) {
        rights.devices.insert(SOUND_DEVICES.into());
        rights.write.insert(SHARED_MEMORY.into());
        let runtime = self.variable("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|folder| folder.is_absolute());
        rights.write.extend(runtime.into_iter().flat_map(|folder| SOUND_SOCKETS.map(|name| folder.join(name))));
        if let Some(home) = self.home() {
            rights.read.extend(SOUND_SETTINGS.map(|path| home.join(path)));
        }
    }

    /// Graphics devices with their drivers.
    fn graphics(&self, rights: &mut Rights) {
        let devices = std::fs::read_dir("/dev").into_iter().flatten().flatten().map(|entry| entry.path());
        let is_graphics = |path: &PathBuf| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            GRAPHICS_DEVICES.iter().any(|begin| name.starts_with(begin))
        };
        rights.devices.extend(devices.filter(is_graphics));
        rights.write.insert(SHARED_MEMORY.into());
        for name in DRIVERS {
            let value = self.variable(name).unwrap_or_default();
            for description in std::env::split_paths(&value).filter(|p| p.is_absolute()) {
                rights.run.extend(library_of(&description));
                rights.run.insert(description);
            }
        }
        if let Some(cache) = self.user_folder("XDG_CACHE_HOME", ".cache") {
            let pipelines = cache.join(PIPELINES);
            // Without it the process compiles at each start.
            if make_folder(&pipelines).is_ok() {
                rights.write.insert(pipelines);
            }
        }
        let Some(home) = self.home() else { return };
        rights.run.extend(HOME_READ.map(|path| home.join(path)));
        for (variable, usual) in [("XDG_CONFIG_HOME", ".config"), ("XDG_DATA_HOME", ".local/share")] {
            let Some(folder) = self.user_folder(variable, usual) else { continue };
            rights.run.extend(["openxr", "vulkan"].map(|name| folder.join(name)));
            rights.run.extend(library_of(&folder.join("openxr/1/active_runtime.json")));
        }
        rights.write.extend(HOME_CACHES.map(|path| home.join(path)));
    }

    /// The window or headset: its settings, the pictures that a person keeps, and files that are dropped on it.
    fn display(&self, rights: &mut Rights) -> io::Result<()> {
        // X11 prefers its abstract socket.
        rights.abstract_sockets = true;
        rights.read.extend(self.variable("XAUTHORITY").map(PathBuf::from));
        if self.params.get("display").is_none_or(|d| d == "none") {
            return Ok(());
        }
        if let Some(settings) = self.user_folder("XDG_CONFIG_HOME", ".config") {
            rights.read.insert(settings.join("user-dirs.dirs"));
            let settings = settings.join("supergaussian");
            make_folder(&settings)?;
            rights.write.insert(settings);
        }
        let given = |name: &str| self.params.get(name).and_then(Value::as_str).and_then(absolute);
        let pictures = given("pictures").or_else(|| self.pictures());
        for folder in pictures.into_iter().chain(given("frame_traces")) {
            make_folder(&folder)?;
            rights.write.insert(folder);
        }
        // A person's own files, but nothing hidden, such as keys and passwords.
        rights.read.extend(self.home().iter().flat_map(|home| visible(home)));
        Ok(())
    }

    /// The user's folder for pictures, as the desktop names it.
    fn pictures(&self) -> Option<PathBuf> {
        let set = self.variable("XDG_PICTURES_DIR").map(PathBuf::from).filter(|p| p.is_absolute());
        let home = self.home()?;
        set.or_else(|| {
            let dirs = self.user_folder("XDG_CONFIG_HOME", ".config")?.join("user-dirs.dirs");
            let text = file::read_text(&dirs, SMALL_TEXT_BYTES).ok()?;
            let value = text.lines().find_map(|line| line.trim().strip_prefix("XDG_PICTURES_DIR="))?.trim_matches('"');
            Some(value.strip_prefix("$HOME/").map_or_else(|| PathBuf::from(value), |rest| home.join(rest)))
        })
        .or_else(|| Some(home.join("Pictures")))
    }

    /// An environment variable of the process: of its launch file, else of this process.
    fn variable(&self, name: &str) -> Option<OsString> {
        let own = self.env.iter().rfind(|(n, _)| n == name).map(|(_, value)| OsString::from(value));
        own.or_else(|| std::env::var_os(name)).filter(|value| !value.is_empty())
    }

    fn home(&self) -> Option<PathBuf> {
        self.variable("HOME").map(PathBuf::from).filter(|home| home.is_absolute())
    }

    /// A folder of the user by the rules of XDG. The crate that knows them reads this process's environment only.
    fn user_folder(&self, variable: &str, usual: &str) -> Option<PathBuf> {
        let set = self.variable(variable).map(PathBuf::from).filter(|folder| folder.is_absolute());
        set.or_else(|| Some(self.home()?.join(usual)))
    }

    /// Whether a folder holds more than one subject: the home folder or one above it, or the system's for temporary files.
    fn is_wide(&self, folder: &Path) -> bool {
        self.home().is_some_and(|home| home.starts_with(folder))
            || [Path::new("/tmp"), Path::new("/var/tmp")].contains(&folder)
    }
}

/// The path of a parameter. Services share the working directory of this process.
fn absolute(text: &str) -> Option<PathBuf> {
    std::path::absolute(text).ok()
}

/// The environment of Python that has an interpreter: its libraries lie beside its `bin`.
fn environment_of(interpreter: &Path) -> Option<PathBuf> {
    let prefix = interpreter.parent().filter(|folder| folder.ends_with("bin"))?.parent()?;
    prefix.join("pyvenv.cfg").is_file().then(|| prefix.to_owned())
}

/// The installation of Python that has an interpreter, by its real path.
fn python_of(interpreter: &Path) -> Option<PathBuf> {
    let name = interpreter.file_name()?.to_string_lossy();
    let prefix = interpreter.parent().filter(|folder| folder.ends_with("bin"))?.parent()?;
    (name.starts_with("python") && prefix.join("lib").is_dir()).then(|| prefix.to_owned())
}

/// Entries of a folder that are not hidden.
fn visible(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(|e| !e.file_name().to_string_lossy().starts_with('.')).map(|e| e.path()).collect()
}

/// The folder of the library that the description of a driver or runtime names.
fn library_of(description: &Path) -> Option<PathBuf> {
    let text = file::read_text(description, SMALL_TEXT_BYTES).ok()?;
    let json: Value = serde_json::from_str(&text).ok()?;
    let library =
        ["ICD", "layer", "runtime"].into_iter().find_map(|kind| json.get(kind)?.get("library_path")?.as_str())?;
    // A bare name is searched by the loader in the system's folders.
    if !library.contains('/') {
        return None;
    }
    let path = description.parent().unwrap_or(Path::new("/")).join(library);
    std::fs::canonicalize(path).ok()?.parent().map(Path::to_owned)
}

/// The port of a server of speech; none for a socket. OpenAI's own endpoint is an empty text.
fn server_port(endpoint: &str) -> Option<u16> {
    let (scheme, rest) = endpoint.split_once("://").unwrap_or_default();
    let authority = rest.split('/').next().unwrap_or_default();
    let usual = if scheme.eq_ignore_ascii_case("http") { HTTP_PORT } else { HTTPS_PORT };
    (!endpoint.starts_with("unix:")).then(|| port_of(authority).unwrap_or(usual))
}

/// The port of an address such as `http://host:4317` or `tls/host:7447`.
fn port_of(address: &str) -> Option<u16> {
    let rest = address.split_once("://").map_or(address, |(_, rest)| rest);
    rest.trim_end_matches('/').rsplit_once(':')?.1.split(['/', '?', '#']).next()?.parse().ok()
}

/// Makes a folder for this user alone.
fn make_folder(folder: &Path) -> io::Result<()> {
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn servers_of_speech_have_ports() {
        for (endpoint, port) in [
            ("", Some(443)),
            ("https://api.example.com/v1", Some(443)),
            ("https://host/v1/model:8080", Some(443)),
            ("http://127.0.0.1:8000/v1", Some(8000)),
            ("HTTP://127.0.0.1", Some(80)),
            ("http://[::1]:9/v1", Some(9)),
            ("unix:/run/speech.sock", None),
            ("unix:///run/speech.sock", None),
        ] {
            assert_eq!(server_port(endpoint), port, "{endpoint}");
        }
    }
}
