//! Where the hands' rays meet the scene, found beside the loop.

use std::sync::Arc;

use glam::DVec3;
use sg_raster::pick::{SURFACE, pick_ray_among};
use sg_scene::appearance::Appearance;
use sg_scene::model::Scene;
use sg_selection::brush::Brush;

use crate::display::LatestWorker;

/// How far a ray reaches, metres of the room.
pub(super) const LENGTH: f64 = 4.0;

/// Greatest distance of a Gaussian's center from the ray, as a share of the longest edge of the scene's box.
const ASIDE: f64 = 0.02;

/// Angle of the ray, radians: thinner Gaussians are widened to it.
const SPREAD: f64 = 2e-3;

/// A ray in the scene frame: where it begins, and its whole length.
pub(super) type Ray = (DVec3, DVec3);

/// Rays of both hands through a scene of this look.
struct Job {
    scene: Arc<Scene>,
    brush: Arc<Brush>,
    appearance: Appearance,
    rays: [Option<Ray>; 2],
}

/// Hits of both hands' rays, in the scene frame.
pub(super) struct SceneHits {
    /// `None` if the system gives no thread: then rays meet panels alone.
    worker: Option<LatestWorker<Job, [Option<DVec3>; 2]>>,
    scene: Arc<Scene>,
    brush: Arc<Brush>,
    newest: [Option<DVec3>; 2],
}

impl SceneHits {
    pub(super) fn new(scene: Arc<Scene>, brush: Arc<Brush>) -> Self {
        let work = |Job { scene, brush, appearance, rays }: Job| rays.map(|ray| hit(&scene, &brush, &appearance, ray?));
        let worker = LatestWorker::new("aims", work, || ());
        let worker = worker.inspect_err(|e| tracing::warn!("rays do not meet the scene: no thread for them: {e}"));
        Self { worker: worker.ok(), scene, brush, newest: [None; 2] }
    }

    /// Meets the same Gaussians from now on, some of them elsewhere.
    pub(super) fn show_scene(&mut self, scene: Arc<Scene>, brush: Arc<Brush>) {
        (self.scene, self.brush) = (scene, brush);
    }

    /// Asks for the hits of these rays, and returns the newest ones that are known: a frame or two old.
    pub(super) fn step(&mut self, appearance: &Appearance, rays: [Option<Ray>; 2]) -> [Option<DVec3>; 2] {
        if let Some(worker) = &self.worker {
            if let Some(hits) = worker.take() {
                self.newest = hits;
            }
            if rays.iter().any(Option::is_some) {
                let (scene, brush) = (Arc::clone(&self.scene), Arc::clone(&self.brush));
                worker.submit(Job { scene, brush, appearance: appearance.clone(), rays });
            }
        }
        for (newest, ray) in self.newest.iter_mut().zip(&rays) {
            *newest = newest.filter(|_| ray.is_some());
        }
        self.newest
    }
}

/// The scene's front surface on a ray, among the Gaussians close to it.
fn hit(scene: &Scene, brush: &Brush, appearance: &Appearance, (origin, along): Ray) -> Option<DVec3> {
    let near = brush.hits(&[origin, origin + along], ASIDE * scene.bounds.longest_edge());
    let hit = pick_ray_among(scene, appearance, (origin, along), SPREAD, SURFACE, &near)?;
    (hit.depth <= along.length()).then_some(hit.point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_raster::pick::pick_ray;
    use sg_scene::synthetic::random_points;

    /// A wall of opaque Gaussians at z = 0.5.
    fn wall() -> Scene {
        let points: Vec<[f32; 3]> = random_points(4000, 7).iter().map(|[x, y, _]| [*x, *y, 0.5]).collect();
        sg_scene::synthetic::point_scene(&points)
    }

    #[test]
    fn a_ray_meets_the_same_surface_as_a_pick_of_the_whole_scene() {
        let scene = wall();
        let (brush, appearance) = (Brush::of_scene(&scene), Appearance::of(&scene));
        for k in 0..20 {
            let origin = DVec3::new(0.3 + 0.02 * f64::from(k), 0.5, -1.0);
            let along = 4.0 * DVec3::new(0.01, 0.0, 1.0).normalize();
            let whole = pick_ray(&scene, &appearance, origin, along, SPREAD, SURFACE).unwrap();
            let found = hit(&scene, &brush, &appearance, (origin, along));
            let apart = found.zip(whole).map(|(found, whole)| found.distance(whole.point));
            assert!(apart.is_some_and(|apart| apart < 0.01), "ray {k}: {found:?}, not {whole:?}");
        }
        let short = (DVec3::new(0.5, 0.5, -1.0), 0.5 * DVec3::Z);
        assert_eq!(hit(&scene, &brush, &appearance, short), None, "a short ray ends before it");
        assert_eq!(hit(&scene, &brush, &appearance, (DVec3::splat(0.5), DVec3::ZERO)), None);
    }
}
