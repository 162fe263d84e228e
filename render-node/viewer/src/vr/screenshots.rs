//! Pictures that a person in a headset keeps, drawn beside the loop as a window's are.

use std::path::PathBuf;
use std::sync::Arc;

use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::display::{NOTICES, Notice};
use crate::hands::{Eye, Fov, Placement, Pose};
use crate::window;
use crate::window::exporter::{ExportJob, ExportResult, Exporter};
use sg_raster::finish::Finish;

/// Width and height of a picture, pixels.
const SIZE: [u32; 2] = [1600, 1200];

/// Angle from straight ahead to the left and the right edge of a picture, radians.
const HALF_WIDTH: f64 = 0.7;

/// Number of the first line about a picture: behind all lines of the services.
const FIRST: u64 = 1 << 62;

/// Keeps pictures of what a person sees.
pub(super) struct Screenshots {
    scene: Arc<Scene>,
    folder: PathBuf,
    /// Made for the first picture.
    exporter: Option<Exporter>,
    /// Lines about pictures, newest last.
    lines: Vec<Notice>,
    count: u64,
    /// As they were handed out last.
    joined: Option<JoinedLines>,
}

/// The services' lines, and those with the lines about pictures behind them.
struct JoinedLines {
    of: Arc<[Notice]>,
    joined: Arc<[Notice]>,
}

/// The view of a head between its eyes, upright or not as the head is.
fn camera(head: &Pose, placement: &Placement, near: f64, appearance: &Appearance) -> Camera {
    let [width, height] = SIZE;
    let up = (HALF_WIDTH.tan() * f64::from(height) / f64::from(width)).atan();
    let fov = Fov { left: -HALF_WIDTH, right: HALF_WIDTH, up, down: -up };
    Eye { pose: *head, fov }.camera(SIZE, placement, near, appearance.background.to_array(), appearance.light)
}

impl Screenshots {
    pub(super) fn new(scene: Arc<Scene>, folder: PathBuf) -> Self {
        Self { scene, folder, exporter: None, lines: Vec::new(), count: 0, joined: None }
    }

    /// Pictures the same Gaussians from now on, some of them elsewhere.
    pub(super) fn show_scene(&mut self, scene: Arc<Scene>) {
        self.scene = scene;
    }

    /// Begins a picture of what a head sees of the placed scene, where Gaussians fade within `near` metres of the room. It replaces
    /// one that waits.
    pub(super) fn take(&mut self, head: &Pose, placement: &Placement, near: f64, appearance: Appearance) {
        if self.exporter.is_none() {
            let made = window::threads()
                .map_err(|e| e.to_string())
                .and_then(|pool| Exporter::new(self.folder.clone(), pool, || ()).map_err(|e| e.to_string()));
            match made {
                Ok(exporter) => self.exporter = Some(exporter),
                Err(error) => {
                    self.tell(Err(format!("no threads to draw with: {error}")));
                    return;
                }
            }
        }
        if let Some(exporter) = &self.exporter {
            let camera = camera(head, placement, near, &appearance);
            let finish = Finish::to_look_at(appearance.background, false);
            exporter.export(&self.scene, ExportJob::Picture(Box::new(camera), appearance, finish));
        }
    }

    fn tell(&mut self, outcome: Result<String, String>) {
        let refused = outcome.is_err();
        let text = outcome.unwrap_or_else(|error| format!("nothing was saved: {error}"));
        tracing::info!("screenshot: {text}");
        let number = FIRST + self.count;
        self.count += 1;
        self.lines.push(Notice { number, text, refused });
        self.lines.drain(..self.lines.len().saturating_sub(NOTICES));
        self.joined = None;
    }

    /// The services' lines, and those about finished pictures behind them. The same list as before without a change.
    pub(super) fn with_notices(&mut self, notices: &Arc<[Notice]>) -> Arc<[Notice]> {
        if let Some(outcome) = self.exporter.as_ref().and_then(Exporter::take_result) {
            self.tell(outcome.map(|done| match done {
                ExportResult::Saved(line) => line,
                ExportResult::Drawn { path, .. } => format!("drew {}", path.display()),
            }));
        }
        if self.lines.is_empty() {
            return Arc::clone(notices);
        }
        match &self.joined {
            Some(JoinedLines { of, joined }) if Arc::ptr_eq(of, notices) => Arc::clone(joined),
            _ => {
                let joined: Arc<[Notice]> = notices.iter().chain(&self.lines).cloned().collect();
                self.joined = Some(JoinedLines { of: Arc::clone(notices), joined: Arc::clone(&joined) });
                joined
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hands::{Origin, Stance};
    use glam::{DQuat, DVec3};
    use sg_scene::synthetic::{point_scene, random_points};
    use std::time::{Duration, Instant};

    #[test]
    fn a_picture_is_kept_and_its_line_is_the_last() {
        let folder = tempfile::tempdir().unwrap();
        let scene = Arc::new(point_scene(&random_points(50, 3)));
        let placement = Placement::fit(scene.bounds, DVec3::Z, DVec3::Y, Stance::Standing, Origin::Floor);
        let head = Pose { position: DVec3::new(0.0, 1.6, 0.0), orientation: DQuat::from_rotation_x(-0.3) };
        let appearance = Appearance::of(&scene);
        let seen = camera(&head, &placement, 0.05, &appearance);
        assert!(seen.check("a head").is_ok() && (seen.fx - seen.fy).abs() < 1e-9 * seen.fx, "square pixels");
        let mut screenshots = Screenshots::new(scene, folder.path().join("pictures"));
        let said: Arc<[Notice]> = Arc::from([Notice { number: 4, text: "hello".to_owned(), refused: false }]);
        assert!(Arc::ptr_eq(&screenshots.with_notices(&said), &said));
        screenshots.take(&head, &placement, 0.05, appearance);
        let begun = Instant::now();
        let lines = loop {
            let lines = screenshots.with_notices(&said);
            if lines.len() == 2 {
                break lines;
            }
            assert!(begun.elapsed() < Duration::from_secs(60), "no picture: {lines:?}");
            std::thread::sleep(Duration::from_millis(20));
        };
        assert!(lines[0].text == "hello" && lines[1].text.starts_with("saved ") && lines[1].number > lines[0].number);
        assert!(Arc::ptr_eq(&lines, &screenshots.with_notices(&said)), "no new list without a change");
        let kept = std::fs::read_dir(folder.path().join("pictures")).unwrap().count();
        assert_eq!(kept, 1);
    }
}
