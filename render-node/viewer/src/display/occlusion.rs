//! Ambient occlusion of a display's pictures. It is computed beside the loop after each change of what is visible; until then the
//! pictures keep the last one.

use std::sync::Arc;

use sg_raster::occlusion::ambient_occlusion;
use sg_scene::appearance::{Appearance, ShadingTerm};
use sg_scene::camera::Light;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;

use super::latest_worker::LatestWorker;

/// A scene as it looks.
type Look = (Arc<Scene>, Appearance);

/// The factors of the newest appearance.
pub(crate) struct OcclusionWorker {
    worker: LatestWorker<Look, Option<Arc<[f32]>>>,
    requested: Option<Look>,
    factors: Option<Arc<[f32]>>,
}

impl OcclusionWorker {
    /// A worker on `pool`, that calls `wake` after each result.
    pub(crate) fn new(pool: Arc<rayon::ThreadPool>, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let work = move |(scene, appearance): Look| pool.install(|| ambient_occlusion(&scene, &appearance));
        Ok(Self { worker: LatestWorker::new("occludes", work, wake)?, requested: None, factors: None })
    }

    /// The newest factors. Asks for those of `scene` and `appearance` where they are not known; does not wait.
    pub(crate) fn factors(&mut self, scene: &Arc<Scene>, appearance: &Appearance) -> Option<Arc<[f32]>> {
        if let Some(found) = self.worker.take() {
            self.factors = found;
        }
        if !is_requested(self.requested.as_ref(), scene, appearance) {
            let wanted = (Arc::clone(scene), visible_parts(appearance));
            self.worker.submit(wanted.clone());
            self.requested = Some(wanted);
        }
        // Those of other Gaussians fit nothing: some were duplicated meanwhile, or a duplicate went.
        self.factors.clone().filter(|factors| factors.len() == scene.len())
    }

    /// Whether nothing is computed or waits.
    pub(crate) fn is_idle(&self) -> bool {
        self.worker.is_idle()
    }
}

/// Whether a request is for this very scene and an appearance that shows the same. It runs in every frame and allocates nothing.
pub(crate) fn is_requested(
    requested: Option<&(Arc<Scene>, Appearance)>,
    scene: &Arc<Scene>,
    appearance: &Appearance,
) -> bool {
    requested.is_some_and(|(of, wanted)| Arc::ptr_eq(of, scene) && shows_the_same(wanted, appearance))
}

/// Whether two appearances agree in all that [`visible_parts`] keeps for occlusion and for the box of what is visible.
fn shows_the_same(a: &Appearance, b: &Appearance) -> bool {
    bases(a).eq(bases(b)) && units(a).eq(units(b)) && a.clips == b.clips && a.filter == b.filter
}

/// Opacity of each base unit, and whether it is drawn.
fn bases(appearance: &Appearance) -> impl Iterator<Item = (f32, bool)> {
    appearance.base.iter().map(|base| (base.opacity, base.visible))
}

/// Members of each editable unit, their opacity, and whether they are drawn.
fn units(appearance: &Appearance) -> impl Iterator<Item = (&Arc<Mask>, f32, bool)> {
    appearance.units.iter().map(|unit| (&unit.mask, unit.opacity, unit.visible))
}

/// What occlusion depends on, and the box of what is visible: opacities, what is hidden, clips.
pub(crate) fn visible_parts(appearance: &Appearance) -> Appearance {
    let mut parts = Appearance { overlay: None, colors: None, occlusion: None, ..appearance.clone() };
    (parts.light, parts.term, parts.background) = (Light::default(), ShadingTerm::Full, glam::Vec3::ZERO);
    for base in &mut parts.base {
        (base.palette, base.multipliers) = (glam::Vec3::ZERO, [1.0; 4]);
    }
    parts.units.iter_mut().for_each(|unit| unit.color = None);
    parts
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use sg_scene::appearance::UnitAppearance;
    use sg_scene::synthetic::test_scene;
    use sg_scene::tone::Tone;

    use super::*;

    fn newest(worker: &mut OcclusionWorker, scene: &Arc<Scene>, appearance: &Appearance) -> Option<Arc<[f32]>> {
        worker.factors(scene, appearance);
        let end = Instant::now() + Duration::from_secs(60);
        while !worker.is_idle() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        worker.factors(scene, appearance)
    }

    #[test]
    fn only_a_change_of_what_is_visible_is_computed() {
        let scene = Arc::new(test_scene(&[("cloud", 500)]));
        let pool = Arc::new(rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap());
        let mut worker = OcclusionWorker::new(pool, || ()).unwrap();
        let mut look = Appearance::of(&scene);
        let first = newest(&mut worker, &scene, &look).unwrap();
        assert!(first.len() == 500 && first.iter().any(|f| *f < 0.99), "a cloud occludes itself");
        // Another light, colour or highlight changes nothing.
        look.light.kd = 2.0;
        look.base[0].palette = glam::Vec3::X;
        let mask = Arc::new(Mask::from_fn(500, |i| i < 250));
        assert!(Arc::ptr_eq(&first, &newest(&mut worker, &scene, &look).unwrap()));
        look.units = vec![UnitAppearance { mask, color: None, opacity: 1.0, visible: false, tone: Tone::NEUTRAL }];
        let half = newest(&mut worker, &scene, &look).unwrap();
        let sum = |factors: &[f32]| factors.iter().sum::<f32>();
        assert!(sum(&half) > sum(&first), "what is hidden gives no shadow");
        look.units[0].tone = Tone { saturation: 0.5, ..Tone::NEUTRAL };
        look.units[0].color = Some(glam::Vec3::Y);
        assert!(Arc::ptr_eq(&half, &newest(&mut worker, &scene, &look).unwrap()), "no colour gives shadow");
        let mut moved = Scene::clone(&scene);
        moved.units[0].gaussians.position.iter_mut().for_each(|p| *p *= 100.0);
        let apart = newest(&mut worker, &Arc::new(moved), &look).unwrap();
        assert!(sum(&apart) > sum(&half), "what is far away gives no shadow");
    }
}
