//! A real OpenXR runtime for tests: Monado with scripted head and controllers, in a room of its own.
//!
//! A program can only talk to it from within the folder that `ops/monado.sh` made, with its libraries. So a test runs itself anew
//! in there.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// Set for a test that runs within Monado's folder.
const INSIDE: &str = "SUPERGAUSSIAN_TEST_INSIDE_MONADO";

/// Longest wait for a service to start.
const PATIENCE: Duration = Duration::from_secs(30);

/// The folder with the runtime. Without one: `None` and a message, unless it is required.
pub(crate) fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("SUPERGAUSSIAN_MONADO").map(PathBuf::from);
    let there = folder.filter(|f| f.join("run").exists());
    if there.is_none() {
        assert!(
            std::env::var_os("SUPERGAUSSIAN_REQUIRE_XR").is_none_or(|v| v != "1"),
            "SUPERGAUSSIAN_MONADO must name the folder that ops/monado.sh makes"
        );
        println!("SKIPPED under an OpenXR runtime: set SUPERGAUSSIAN_MONADO to the folder that ops/monado.sh makes");
    }
    there
}

/// Runs the ignored test `name` of this program within Monado's folder. One at a time on this machine: the runtime's
/// scripted devices listen on a port.
pub(crate) fn run_inside(name: &str) {
    run_inside_beside(name, None);
}

/// As [`run_inside`], with a screen that the test can open windows on.
pub(crate) fn run_inside_beside(name: &str, screen: Option<&Screen>) {
    let Some(folder) = folder() else { return };
    let _alone = alone();
    let room = room();
    let status = Command::new(folder.join("run"))
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", name, "--ignored", "--nocapture"])
        .env(INSIDE, "1")
        .env("XDG_RUNTIME_DIR", room.path())
        .env("DISPLAY", screen.map_or_else(String::new, |s| format!(":{}", s.number)))
        .stdin(Stdio::null())
        .status()
        .unwrap();
    assert!(status.success(), "{name}: {status}");
}

/// Waits until no other test of this machine has a runtime with scripted devices: they listen on a port.
pub(crate) fn alone() -> File {
    let lock = File::create(std::env::temp_dir().join("supergaussian-monado.lock"));
    // A file of another user can be locked all the same.
    let lock = lock.or_else(|_| File::open(std::env::temp_dir().join("supergaussian-monado.lock"))).unwrap();
    lock.lock().unwrap();
    lock
}

/// A folder that a runtime and its programs share.
pub(crate) fn room() -> tempfile::TempDir {
    let room = tempfile::tempdir().unwrap();
    std::fs::set_permissions(room.path(), std::fs::Permissions::from_mode(0o700)).unwrap();
    room
}

/// Whether this is such a run. A run of ignored tests by hand prints the instructions.
pub(crate) fn is_inside() -> bool {
    let inside = std::env::var_os(INSIDE).is_some();
    if !inside {
        println!("SKIPPED: the test of the same name without `inside` runs this");
    }
    inside
}

/// A program of the test, ended with it.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The kind of display.
pub(crate) enum Display<'a> {
    /// None: pictures are taken and thrown away, 20 in a second.
    None,
    /// An X server.
    X(&'a Screen),
}

/// The runtime's service.
pub(crate) struct Runtime {
    service: Running,
}

impl Runtime {
    /// Starts the service for programs of this one's folder and waits until it takes clients.
    pub(crate) fn start(display: &Display<'_>) -> Self {
        Self::start_in(display, &PathBuf::from(std::env::var_os("XDG_RUNTIME_DIR").unwrap()))
    }

    /// As [`Self::start`], for programs whose `XDG_RUNTIME_DIR` is this.
    pub(crate) fn start_in(display: &Display<'_>, room: &Path) -> Self {
        // Files that a killed service leaves behind.
        for left in ["monado_comp_ipc", "monado.pid"] {
            let _ = std::fs::remove_file(room.join(left));
        }
        let mut command = Command::new(folder().unwrap().join("run"));
        command
            .arg("monado-service")
            .env("XRT_NO_STDIN", "1")
            .env("P_OVERRIDE_ACTIVE_CONFIG", "remote")
            .env("XRT_LOG", "info")
            .env("XDG_RUNTIME_DIR", room)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        match display {
            Display::None => command.env("XRT_COMPOSITOR_NULL", "1"),
            Display::X(screen) => command
                .env("XRT_COMPOSITOR_NULL", "0")
                .env("XRT_COMPOSITOR_FORCE_XCB", "1")
                .env("DISPLAY", format!(":{}", screen.number)),
        };
        let mut service = command.spawn().unwrap();
        let log = service.stderr.take().unwrap();
        let service = Running(service);
        let (says, heard) = mpsc::channel();
        thread::spawn(move || {
            for line in BufReader::new(log).lines().map_while(Result::ok) {
                let _ = says.send(line);
            }
        });
        let begun = Instant::now();
        let mut log = Vec::new();
        loop {
            match heard.recv_timeout(PATIENCE.saturating_sub(begun.elapsed())) {
                Ok(line) if line.contains("The Monado service has started") => break,
                Ok(line) => log.push(line),
                Err(_) => panic!("monado-service did not start:\n{}", log.join("\n")),
            }
        }
        Self { service }
    }

    /// Its process.
    #[allow(dead_code, reason = "only whoever shares this file from outside stops it")]
    pub(crate) fn pid(&self) -> u32 {
        self.service.0.id()
    }

    /// Ends it as a crash would.
    pub(crate) fn kill(mut self) {
        self.service.0.kill().unwrap();
        self.service.0.wait().unwrap();
    }
}

/// An X server without a screen. Its picture is a file.
pub(crate) struct Screen {
    _server: Running,
    number: u32,
    folder: tempfile::TempDir,
}

impl Screen {
    /// Starts one of this size.
    pub(crate) fn start([width, height]: [u32; 2]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-nolisten", "tcp", "-screen", "0", &format!("{width}x{height}x24")])
            .arg("-fbdir")
            .arg(folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb must be installed (ops/setup-debian.sh)");
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Self { _server: Running(server), number: number.trim().parse().unwrap(), folder }
    }

    /// The picture on it: width, height, and RGB row by row.
    pub(crate) fn picture(&self) -> (u32, u32, Vec<u8>) {
        xwd(&self.folder.path().join("Xvfb_screen0"))
    }
}

/// Whether there is a runtime to test with. Prints a message if there is none.
pub(crate) fn is_there() -> bool {
    folder().is_some()
}

/// Reads an X window dump of 32-bit pixels, blue first.
fn xwd(path: &Path) -> (u32, u32, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let word = |k: usize| u32::from_be_bytes(bytes[4 * k..4 * k + 4].try_into().unwrap());
    let (header, width, height, bits, row, colors) = (word(0), word(4), word(5), word(11), word(12), word(19));
    assert_eq!(bits, 32);
    let pixels = &bytes[header as usize + 12 * colors as usize..];
    let rows = pixels.chunks_exact(row as usize).take(height as usize);
    let rgb = rows.flat_map(|r| r[..4 * width as usize].chunks_exact(4).flat_map(|p| [p[2], p[1], p[0]])).collect();
    (width, height, rgb)
}

/// One scripted controller.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Controller {
    pub(crate) position: [f32; 3],
    /// x, y, z, w.
    pub(crate) orientation: [f32; 4],
    pub(crate) trigger: f32,
    pub(crate) squeeze: f32,
    pub(crate) stick: [f32; 2],
    pub(crate) a: bool,
    pub(crate) b: bool,
    pub(crate) stick_click: bool,
    /// Whether it is held at all.
    pub(crate) active: bool,
    /// The bend of all fingers, 0 to 1; `None` where the runtime does not see them.
    pub(crate) curl: Option<f32>,
}

impl Controller {
    pub(crate) fn at(position: [f32; 3]) -> Self {
        let orientation = [0.0, 0.0, 0.0, 1.0];
        Self {
            position,
            orientation,
            trigger: 0.0,
            squeeze: 0.0,
            stick: [0.0; 2],
            a: false,
            b: false,
            stick_click: false,
            active: true,
            curl: Some(0.0),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let squeeze = self.squeeze;
        let mut numbers = Vec::new();
        numbers.extend(self.orientation);
        numbers.extend(self.position);
        // Velocities; fingers.
        numbers.extend([0.0; 6]);
        numbers.extend([self.curl.unwrap_or(0.0); 5]);
        numbers.extend([self.trigger, squeeze, squeeze]);
        numbers.extend(self.stick);
        // Trackpad.
        numbers.extend([0.0; 3]);
        let mut bytes: Vec<u8> = numbers.iter().flat_map(|n: &f32| n.to_le_bytes()).collect();
        let tilted = self.stick != [0.0; 2];
        let pressed = [
            self.curl.is_some(),
            self.active,
            false,
            false,
            self.a,
            self.a,
            self.b,
            self.b,
            self.trigger > 0.9,
            self.trigger > 0.0,
            self.stick_click,
            tilted,
            false,
            false,
            false,
            false,
        ];
        bytes.extend(pressed.map(u8::from));
        assert_eq!(bytes.len(), 120);
        bytes
    }
}

/// Head and hands as a test moves them, sent to the runtime's `remote` driver (`struct r_remote_data` of Monado 25).
pub(crate) struct Puppet {
    wire: TcpStream,
    pub(crate) head: [f32; 3],
    pub(crate) left: Controller,
    pub(crate) right: Controller,
}

impl Puppet {
    /// Takes the runtime's devices in hand.
    pub(crate) fn connect() -> Self {
        let begun = Instant::now();
        let mut wire = loop {
            match TcpStream::connect(("127.0.0.1", 4242)) {
                Ok(wire) => break wire,
                Err(error) => assert!(begun.elapsed() < PATIENCE, "no scripted devices: {error}"),
            }
            thread::sleep(Duration::from_millis(50));
        };
        wire.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut first = [0; 376];
        wire.read_exact(&mut first).unwrap();
        let mut puppet = Self {
            wire,
            head: [0.0, 1.6, 0.0],
            left: Controller::at([-0.2, 1.2, -0.4]),
            right: Controller::at([0.2, 1.2, -0.4]),
        };
        puppet.send();
        puppet
    }

    /// Lets the runtime know.
    pub(crate) fn send(&mut self) {
        let mut packet = b"mndrmt3\0".to_vec();
        packet.extend([0; 96]);
        packet.extend([0.0, 0.0, 0.0, 1.0_f32].iter().chain(&self.head).flat_map(|n| n.to_le_bytes()));
        packet.extend([0; 4]);
        packet.extend(self.left.bytes());
        packet.extend(self.right.bytes());
        assert_eq!(packet.len(), 376);
        self.wire.write_all(&packet).unwrap();
    }
}
