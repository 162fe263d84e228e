//! Ambient occlusion of a headset's pictures, computed beside the loop as a window's is.

use std::sync::Arc;

use sg_scene::appearance::Appearance;
use sg_scene::model::Scene;

use crate::display::{OcclusionWorker, Tools};
use crate::window;

/// The factors of the newest appearance, once a person wants them.
#[derive(Default)]
pub(super) struct Occlusion {
    /// Made between two frames, when occlusion is first wanted.
    worker: Option<OcclusionWorker>,
    /// Whether the system gave no threads for it; that is logged once.
    failed: bool,
}

impl Occlusion {
    /// Between two frames: starts the threads that compute it, where it is wanted for the first time.
    pub(super) fn prepare(&mut self, tools: &Tools) {
        if !tools.occlusion || self.worker.is_some() || self.failed {
            return;
        }
        let made = window::threads().map_err(|e| e.to_string());
        match made.and_then(|pool| OcclusionWorker::new(pool, || ()).map_err(|e| e.to_string())) {
            Ok(worker) => self.worker = Some(worker),
            Err(error) => {
                tracing::warn!("pictures have no ambient occlusion: no threads to compute it: {error}");
                self.failed = true;
            }
        }
    }

    /// The newest factors of `scene`, where occlusion is wanted. Asks for those of `appearance` where they are not known; does not
    /// wait.
    pub(super) fn factors(&mut self, scene: &Arc<Scene>, appearance: &Appearance, tools: &Tools) -> Option<Arc<[f32]>> {
        self.worker.as_mut().filter(|_| tools.occlusion)?.factors(scene, appearance)
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use sg_scene::synthetic::test_scene;

    use super::*;

    #[test]
    fn factors_come_where_they_are_wanted_and_from_beside_the_loop_alone() {
        let scene = Arc::new(test_scene(&[("cloud", 500)]));
        let look = Appearance::of(&scene);
        let (off, on) = (Tools::default(), Tools { occlusion: true, ..Tools::default() });
        let mut occlusion = Occlusion::default();
        occlusion.prepare(&off);
        assert!(occlusion.factors(&scene, &look, &off).is_none() && occlusion.worker.is_none(), "nothing is started");
        assert!(occlusion.factors(&scene, &look, &on).is_none(), "a frame starts nothing");
        occlusion.prepare(&on);
        assert!(occlusion.factors(&scene, &look, &on).is_none(), "a frame does not wait");
        let end = Instant::now() + Duration::from_secs(60);
        while !occlusion.worker.as_ref().unwrap().is_idle() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        let factors = occlusion.factors(&scene, &look, &on).unwrap();
        assert!(factors.len() == 500 && factors.iter().any(|f| *f < 0.99), "a cloud occludes itself");
        assert!(Arc::ptr_eq(&factors, &occlusion.factors(&scene, &look, &on).unwrap()), "computed once");
        assert!(occlusion.factors(&scene, &look, &off).is_none());
    }
}
