//! Saved settings of a window.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use directories::ProjectDirs;
use serde::{Deserialize, Serialize};
use sg_input::{file, limits};

use super::hints::Hint;
use super::mouse_tool::MouseTool;
use super::navigation::NavigationMode;
use crate::display::{BrushMode, Tools};
use sg_raster::render::Quality;

/// Most files that are remembered as opened.
pub(super) const RECENT_FILES: usize = 10;

/// The layout of a window and the settings of its tools. Missing or unknown entries keep their defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Width of the window in points.
    pub width: f64,
    /// Height of the window in points.
    pub height: f64,
    /// Whether it fills the screen's work area.
    pub maximized: bool,
    /// Whether panels are shown.
    pub panels: bool,
    /// Tool of the left button.
    #[serde(rename = "pointer")]
    pub mouse_tool: MouseTool,
    /// How the eye moves.
    #[serde(rename = "manner")]
    pub navigation_mode: NavigationMode,
    /// Brush mode.
    pub mode: BrushMode,
    /// Radius of the brush, a fraction of the box's longest edge.
    pub radius: f64,
    /// Whether strokes, lassos and rectangles have a depth limit behind the surface.
    pub front_only: bool,
    /// Best quality of pictures.
    pub quality: Quality,
    /// Whether panels are light.
    pub light_panels: bool,
    /// Size of everything, 1 for the usual.
    pub scale: f32,
    /// Whether the background is a gradient.
    pub gradient: bool,
    /// Whether ambient light is occluded.
    pub occlusion: bool,
    /// Hints that a person has dismissed, or has no need of any more.
    pub hints_done: Vec<Hint>,
    /// The files that were opened last, newest first.
    pub recent: Vec<PathBuf>,
    /// Whether the desktop's file dialogs are used where it has some.
    pub native_dialogs: bool,
    /// Whether the ground grid and the box of what is visible are shown.
    pub grid: bool,
    /// Whether the eye goes to another view within a moment.
    pub smooth_views: bool,
    /// Metres of the room from an eye of a headset within which Gaussians fade.
    pub room_near: f64,
}

impl Default for Settings {
    fn default() -> Self {
        let Tools {
            mode,
            radius,
            front_only,
            quality,
            light_panels,
            scale,
            gradient,
            occlusion,
            grid,
            smooth_views,
            room_near,
            ..
        } = Tools::default();
        Self {
            width: 1440.0,
            height: 900.0,
            maximized: false,
            panels: true,
            mouse_tool: MouseTool::default(),
            navigation_mode: NavigationMode::default(),
            mode,
            radius,
            front_only,
            quality,
            light_panels,
            scale,
            gradient,
            occlusion,
            hints_done: Vec::new(),
            recent: Vec::new(),
            native_dialogs: true,
            grid,
            smooth_views,
            room_near,
        }
    }
}

/// Settings that cannot be read or saved.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// The file cannot be read or written.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: std::io::Error,
    },
    /// The file is no valid TOML of settings.
    #[error("{}: {reason}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The place and the mistake.
        reason: Box<toml::de::Error>,
    },
    /// A value has no TOML form.
    #[error("{}: {reason}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// The value and the reason.
        reason: Box<toml::ser::Error>,
    },
}

impl SettingsError {
    fn file(path: &Path, reason: std::io::Error) -> Self {
        Self::File { path: path.to_owned(), reason }
    }
}

impl Settings {
    /// Path of the file: `supergaussian/window.toml` of the user's configuration; `None` for a user without a home.
    #[must_use]
    pub fn default_path() -> Option<PathBuf> {
        Some(ProjectDirs::from("", "", "supergaussian")?.config_dir().join("window.toml"))
    }

    /// The saved settings; `None` without a file.
    ///
    /// # Errors
    /// [`SettingsError`] for an unreadable or invalid file.
    pub fn load(path: &Path) -> Result<Option<Self>, SettingsError> {
        let text = match file::read_text(path, limits::SMALL_TEXT_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(SettingsError::file(path, error)),
        };
        let settings = toml::from_str::<Self>(&text)
            .map_err(|reason| SettingsError::Invalid { path: path.to_owned(), reason: reason.into() })?;
        Ok(Some(settings.validated()))
    }

    /// Saves the settings, whole or not at all. Creates the folder.
    ///
    /// # Errors
    /// [`SettingsError`] if the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), SettingsError> {
        let text = toml::to_string(self)
            .map_err(|reason| SettingsError::Unwritable { path: path.to_owned(), reason: reason.into() })?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let write = || {
            std::fs::create_dir_all(folder)?;
            let mut file = tempfile::NamedTempFile::new_in(folder)?;
            file.write_all(text.as_bytes())?;
            file.persist(path)?;
            Ok(())
        };
        write().map_err(|error: std::io::Error| SettingsError::file(path, error))
    }

    /// Copies saved settings into tools; a quality `given` for this run takes precedence.
    pub fn apply(&self, tools: &mut Tools, given: Option<Quality>) {
        let Self {
            mode,
            radius,
            front_only,
            light_panels,
            scale,
            gradient,
            occlusion,
            grid,
            smooth_views,
            room_near,
            ..
        } = *self;
        let quality = given.unwrap_or(self.quality);
        *tools = Tools {
            mode,
            radius,
            front_only,
            quality,
            light_panels,
            scale,
            gradient,
            occlusion,
            grid,
            smooth_views,
            room_near,
            ..tools.clone()
        };
    }

    /// The settings to save after a run that began with `before`. A quality given for that run alone, and not changed
    /// since, is left out.
    #[must_use]
    pub fn without_override(self, before: &Self, given: Option<Quality>) -> Self {
        let quality = if given == Some(self.quality) { before.quality } else { self.quality };
        Self { quality, ..self }
    }

    /// With every number in its range.
    fn validated(mut self) -> Self {
        let first = Self::default();
        let within = |x: f64, low: f64, high: f64, first: f64| if (low..=high).contains(&x) { x } else { first };
        self.width = within(self.width, 320.0, 16_384.0, first.width);
        self.height = within(self.height, 240.0, 16_384.0, first.height);
        self.radius = within(self.radius, Tools::RADII.0, Tools::RADII.1, first.radius);
        self.room_near = within(self.room_near, Tools::ROOM_NEARS.0, Tools::ROOM_NEARS.1, first.room_near);
        self.scale = within(self.scale.into(), 0.5, 4.0, first.scale.into()) as f32;
        self.recent.retain(|path| path.is_absolute());
        self.recent.truncate(RECENT_FILES);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quality_that_is_given_comes_before_the_one_that_is_remembered() {
        let loaded = Settings { quality: Quality::Exact, radius: 0.1, ..Settings::default() };
        let mut tools = Tools { quality: Quality::Fast, ..Tools::default() };
        loaded.apply(&mut tools, Some(Quality::Fast));
        assert_eq!((tools.quality, tools.radius), (Quality::Fast, 0.1));
        loaded.apply(&mut tools, None);
        assert_eq!(tools.quality, Quality::Exact);
        // A quality given for one run is not saved; a person's choice is.
        let at_the_end =
            |quality| Settings { quality, ..loaded.clone() }.without_override(&loaded, Some(Quality::Fast));
        assert_eq!(at_the_end(Quality::Fast).quality, Quality::Exact);
        assert_eq!(at_the_end(Quality::Standard).quality, Quality::Standard);
    }

    #[test]
    fn smooth_views_are_kept_and_on_at_first() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("window.toml");
        let mut tools = Tools::default();
        assert!(tools.smooth_views);
        Settings { smooth_views: false, ..Settings::default() }.save(&path).unwrap();
        Settings::load(&path).unwrap().unwrap().apply(&mut tools, None);
        assert!(!tools.smooth_views);
        // A file of an earlier version has no such line.
        std::fs::write(&path, "grid = true\n").unwrap();
        Settings::load(&path).unwrap().unwrap().apply(&mut tools, None);
        assert!(tools.smooth_views && tools.grid);
    }

    #[test]
    fn what_is_kept_is_read_and_what_makes_no_sense_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/window.toml");
        assert_eq!(Settings::load(&path).unwrap(), None);
        let settings = Settings {
            width: 800.0,
            navigation_mode: NavigationMode::Fly,
            mode: BrushMode::Point,
            ..Settings::default()
        };
        settings.save(&path).unwrap();
        assert_eq!(Settings::load(&path).unwrap(), Some(settings));
        std::fs::write(&path, "width = 1e9\nradius = nan\nroom_near = 0.7\nmanner = \"fly\"\nnews = 3\n").unwrap();
        assert_eq!(
            Settings::load(&path).unwrap(),
            Some(Settings { navigation_mode: NavigationMode::Fly, ..Settings::default() })
        );
        std::fs::write(&path, "manner = \"swim\"").unwrap();
        assert!(Settings::load(&path).unwrap_err().to_string().contains("window.toml"));
    }
}
