//! A screen without a viewer, and a mouse and a keyboard without a hand: Xvfb, openbox and xdotool.

use std::io::{BufRead as _, BufReader};
use std::ops::Range;
use std::os::unix::fs::FileExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::{dropping, minimizing, placement};

/// Width and height of the screen in pixels.
pub const SIZE: [usize; 2] = [1440, 900];

/// The window manager of a managed screen.
const MANAGER: &str = "openbox";

/// A screen; gone when dropped.
#[derive(Debug)]
pub struct Screen {
    server: Child,
    manager: Option<Child>,
    folder: tempfile::TempDir,
    display: String,
}

/// A picture of the screen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shot {
    /// Red, green, blue of each pixel, rows from the top.
    pub pixels: Vec<[u8; 3]>,
}

impl Screen {
    /// Opens a screen of its own. If Xvfb or xdotool is missing, prints a message and returns `None`, unless they are required.
    ///
    /// # Errors
    /// The reason why it did not open.
    pub fn open() -> Result<Option<Self>, String> {
        Self::open_with(&["Xvfb", "xdotool"])
    }

    /// As [`Screen::open`], with a window manager: windows have frames and lie where it puts them.
    ///
    /// # Errors
    /// As [`Screen::open`].
    pub fn open_managed() -> Result<Option<Self>, String> {
        let Some(mut screen) = Self::open_with(&["Xvfb", "xdotool", MANAGER])? else { return Ok(None) };
        let manager = Command::new(MANAGER)
            .args(["--sm-disable", "--config-file", "/dev/null"])
            .env("DISPLAY", &screen.display)
            .env("XDG_CONFIG_HOME", screen.folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        screen.manager = Some(manager.map_err(|e| format!("{MANAGER}: {e}"))?);
        // A window that is shown before the manager runs has no frame.
        let begun = Instant::now();
        while screen.act(&["get_num_desktops"]).is_err() {
            if begun.elapsed() > Duration::from_secs(20) {
                return Err(format!("{MANAGER} does not manage the screen"));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(Some(screen))
    }

    #[allow(clippy::print_stderr, reason = "a skipped test says so")]
    fn open_with(programs: &[&str]) -> Result<Option<Self>, String> {
        for program in programs {
            let there = Command::new(program).arg("--help").stdout(Stdio::null()).stderr(Stdio::null()).status();
            if there.is_err() {
                if std::env::var_os("SUPERGAUSSIAN_REQUIRE_XR").is_some_and(|v| v == "1") {
                    return Err(format!("{program} is required and not installed"));
                }
                eprintln!("SKIPPED on a screen: {program} is not installed");
                return Ok(None);
            }
        }
        let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
        let [width, height] = SIZE;
        let mut server = Command::new("Xvfb")
            .args([
                "-displayfd",
                "1",
                "-screen",
                "0",
                &format!("{width}x{height}x24"),
                "-nolisten",
                "tcp",
                "-noreset",
                "-fbdir",
            ])
            .arg(folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|e| e.to_string())?;
        // It writes its number when it is ready, and closes its end if it cannot start.
        let said = server.stdout.take().map(BufReader::new);
        let mut number = String::new();
        let read = said.map(|mut said| said.read_line(&mut number));
        let screen = Self { server, manager: None, folder, display: format!(":{}", number.trim()) };
        match read {
            Some(Ok(1..)) => Ok(Some(screen)),
            outcome => Err(format!("Xvfb did not open a screen: {outcome:?}")),
        }
    }

    /// The value for `DISPLAY`.
    #[must_use]
    pub fn display(&self) -> &str {
        &self.display
    }

    /// Has xdotool do something.
    ///
    /// # Errors
    /// Its output.
    pub fn act(&self, words: &[&str]) -> Result<String, String> {
        let output = Command::new("xdotool")
            .args(words)
            .env("DISPLAY", &self.display)
            .output()
            .map_err(|e| format!("xdotool: {e}"))?;
        if output.status.success() {
            return Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned());
        }
        Err(format!("xdotool {words:?}: {}", String::from_utf8_lossy(&output.stderr)))
    }

    /// The window with this at its top, once it is there and takes keys.
    ///
    /// # Errors
    /// There is none within `patience`.
    pub fn window(&self, title: &str, patience: Duration) -> Result<String, String> {
        let begun = Instant::now();
        loop {
            let found = self.act(&["search", "--onlyvisible", "--name", title]);
            if let Ok(windows) = &found
                && let Some(window) = windows.lines().next()
            {
                // No window manager gives it the keyboard.
                self.act(&["windowfocus", "--sync", window])?;
                return Ok(window.to_owned());
            }
            if begun.elapsed() > patience {
                return Err(format!("no window `{title}`: {found:?}"));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// A stroke with the left button through places, pixels of the screen.
    ///
    /// # Errors
    /// As [`Screen::act`].
    pub fn drag(&self, places: &[[i32; 2]]) -> Result<(), String> {
        let to = |[x, y]: [i32; 2]| self.act(&["mousemove", &x.to_string(), &y.to_string()]).map(drop);
        for (k, place) in places.iter().enumerate() {
            to(*place)?;
            if k == 0 {
                self.act(&["mousedown", "1"])?;
            }
            // A hand takes its time.
            std::thread::sleep(Duration::from_millis(30));
        }
        self.act(&["mouseup", "1"]).map(drop)
    }

    /// Drops a file on a window, given by its number.
    ///
    /// # Errors
    /// That the window does not take it within `patience`.
    pub fn drop_file(&self, window: &str, path: &Path, patience: Duration) -> Result<(), String> {
        let number = window.parse().map_err(|e| format!("window `{window}`: {e}"))?;
        dropping::drop_file(&self.display, number, path, patience)
    }

    /// Left, top, width and height of the content of a window, given by its number, on the screen in pixels.
    ///
    /// # Errors
    /// The display's message.
    pub fn place(&self, window: &str) -> Result<[i32; 4], String> {
        let number = window.parse().map_err(|e| format!("window `{window}`: {e}"))?;
        placement::place(&self.display, number).map_err(|e| format!("the place of {window}: {e}"))
    }

    /// Minimises a window, given by its number, as a window manager does it.
    ///
    /// # Errors
    /// The display's message.
    pub fn minimize(&self, window: &str) -> Result<(), String> {
        let number = window.parse().map_err(|e| format!("window `{window}`: {e}"))?;
        minimizing::minimize(&self.display, number).map_err(|e| format!("minimising {window}: {e}"))
    }

    /// Shows a minimised window again.
    ///
    /// # Errors
    /// The display's message.
    pub fn restore(&self, window: &str) -> Result<(), String> {
        let number = window.parse().map_err(|e| format!("window `{window}`: {e}"))?;
        minimizing::restore(&self.display, number).map_err(|e| format!("showing {window}: {e}"))
    }

    /// The contents of the screen.
    ///
    /// # Errors
    /// A frame buffer that cannot be read.
    pub fn shot(&self) -> Result<Shot, String> {
        let rows = self.rows(0..SIZE[1], 0..SIZE[0])?;
        Ok(Shot { pixels: rows.chunks_exact(4).map(|p| [p[2], p[1], p[0]]).collect() })
    }

    /// Part of the contents of the screen: blue, green, red and nothing of each pixel of these rows and columns. It reads no others,
    /// so that often looking costs little.
    ///
    /// # Errors
    /// As [`Screen::shot`].
    pub fn rows(&self, rows: impl Iterator<Item = usize>, columns: Range<usize>) -> Result<Vec<u8>, String> {
        let path = self.folder.path().join("Xvfb_screen0");
        let fail = |e: std::io::Error| format!("{}: {e}", path.display());
        let file = std::fs::File::open(&path).map_err(fail)?;
        // A window dump of X: a header of 25 numbers, a table of colours of 12 bytes each, rows of blue, green, red, nothing.
        let mut header = [0; 4 * 25];
        file.read_exact_at(&mut header, 0).map_err(fail)?;
        let number = |k: usize| u32::from_be_bytes([0, 1, 2, 3].map(|byte| header[4 * k + byte])) as usize;
        let (length, width, height, row, colors) = (number(0), number(4), number(5), number(12), number(19));
        if columns.end > width {
            return Err(format!("the screen is {width} × {height}"));
        }
        let mut bytes = Vec::new();
        for y in rows {
            let first = bytes.len();
            bytes.resize(first + 4 * columns.len(), 0);
            let at = length + 12 * colors + y * row + 4 * columns.start;
            file.read_exact_at(&mut bytes[first..], at as u64).map_err(fail)?;
        }
        Ok(bytes)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        for process in self.manager.iter_mut().chain([&mut self.server]) {
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}

impl Shot {
    /// Writes the picture as a PNG file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), String> {
        let fail = |reason: &dyn std::fmt::Display| format!("{}: {reason}", path.display());
        let file = std::fs::File::create(path).map_err(|e| fail(&e))?;
        let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), SIZE[0] as u32, SIZE[1] as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(|e| fail(&e))?;
        writer.write_image_data(self.pixels.as_flattened()).map_err(|e| fail(&e))?;
        writer.finish().map_err(|e| fail(&e))
    }

    /// Share of the pixels of a rectangle (left, top, width, height) with a given property.
    #[must_use]
    pub fn share(&self, [left, top, width, height]: [usize; 4], holds: impl Fn([u8; 3]) -> bool) -> f64 {
        let rows = (top..top + height).map(|y| y * SIZE[0] + left);
        let inside = rows.flat_map(|at| self.pixels.get(at..at + width).unwrap_or_default());
        let found = inside.filter(|p| holds(**p)).count();
        found as f64 / (width * height).max(1) as f64
    }
}
