//! The settings that a person in a headset shares with the window, from one session to the next.

use std::path::PathBuf;

use crate::display::Tools;
use crate::window::{Settings, SettingsError};

/// The file of the settings, and those at the start.
pub(super) struct SavedSettings {
    path: Option<PathBuf>,
    occlusion: bool,
    room_near: f64,
}

impl SavedSettings {
    /// Reads the file into `tools`. A near distance `given` for this run takes precedence.
    pub(super) fn read(path: Option<PathBuf>, given: Option<f64>, tools: &mut Tools) -> Self {
        let read = path.as_deref().map_or(Ok(None), Settings::load);
        let read = read.inspect_err(|why| tracing::warn!("saved settings are left out: {why}"));
        if let Ok(Some(saved)) = read {
            (tools.occlusion, tools.room_near) = (saved.occlusion, saved.room_near);
        }
        tools.room_near = given.unwrap_or(tools.room_near);
        Self { path, occlusion: tools.occlusion, room_near: tools.room_near }
    }

    /// Saves what the person has changed since; an error is logged and has no other effect.
    pub(super) fn save(&self, tools: &Tools) {
        if let Err(why) = self.try_save(tools) {
            tracing::warn!("the settings are not kept: {why}");
        }
    }

    /// Leaves all other entries as they are in the file now: a window may have saved its own meanwhile.
    fn try_save(&self, tools: &Tools) -> Result<(), SettingsError> {
        let changed = [tools.occlusion != self.occlusion, tools.room_near != self.room_near];
        let Some(path) = self.path.as_deref().filter(|_| changed.contains(&true)) else { return Ok(()) };
        let mut settings = Settings::load(path)?.unwrap_or_default();
        if changed[0] {
            settings.occlusion = tools.occlusion;
        }
        if changed[1] {
            settings.room_near = tools.room_near;
        }
        settings.save(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_in_the_headset_is_kept_beside_the_other_settings() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("window.toml");
        let mut tools = Tools::default();
        let saved = SavedSettings::read(Some(path.clone()), None, &mut tools);
        assert_eq!((tools.occlusion, tools.room_near), (false, 0.05));
        saved.save(&tools);
        assert!(!path.exists(), "nothing was changed");
        // A window saves its own meanwhile.
        Settings { radius: 0.1, occlusion: true, ..Settings::default() }.save(&path).unwrap();
        tools.room_near = 0.2;
        saved.save(&tools);
        let now = Settings::load(&path).unwrap().unwrap();
        assert_eq!((now.radius, now.occlusion, now.room_near), (0.1, true, 0.2));
        let mut next = Tools::default();
        SavedSettings::read(Some(path), None, &mut next);
        assert_eq!((next.occlusion, next.room_near), (true, 0.2));
    }

    #[test]
    fn a_near_distance_for_one_run_comes_first_and_is_not_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("window.toml");
        Settings { room_near: 0.2, ..Settings::default() }.save(&path).unwrap();
        let mut tools = Tools::default();
        let saved = SavedSettings::read(Some(path.clone()), Some(0.01), &mut tools);
        assert_eq!(tools.room_near, 0.01);
        tools.occlusion = true;
        saved.save(&tools);
        let now = Settings::load(&path).unwrap().unwrap();
        assert_eq!((now.occlusion, now.room_near), (true, 0.2));
    }

    #[test]
    fn settings_that_cannot_be_read_are_left_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("window.toml");
        std::fs::write(&path, "room_near = \"far\"").unwrap();
        let mut tools = Tools::default();
        let saved = SavedSettings::read(Some(path.clone()), None, &mut tools);
        assert_eq!(tools, Tools::default());
        tools.room_near = 0.2;
        saved.save(&tools);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "room_near = \"far\"");
    }
}
