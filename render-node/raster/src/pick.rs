//! Picking: the front Gaussian at a pixel, along a ray, or at every pixel of a picture.
//!
//! The *front surface* lies where the opacity accumulated from the eye first reaches a level; ½ matches a person's
//! perception.

use std::time::Instant;

use glam::{DVec2, DVec3};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::cutoffs::radius;
use crate::footprint::{Footprint, footprints};
use crate::project::{DILATION, NEAR, place_one};
use crate::raster::{TileOf, rasterize};
use crate::ray_consistent::reference_f64::{Layer, bounded, layers_at};
use crate::ray_consistent::{self, Pinhole, RaySplat};
use crate::render::{Projection, RenderError, check};
use crate::report::{Culled, Report};
use crate::tiles::TILE;

/// Accumulated opacity at which a surface is taken to begin.
pub const SURFACE: f64 = 0.5;

/// The front surface along one ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Scene-wide index of the Gaussian that carries the accumulated opacity to the level.
    pub gaussian: u32,
    /// View z of [`Self::point`], above 0, in the scene's length unit.
    pub depth: f64,
    /// The point on the ray with that Gaussian's greatest density, in the scene frame.
    pub point: DVec3,
}

/// The front Gaussian of every pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrontIds {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Scene-wide index of the front Gaussian of each pixel, rows from the top; `None` where the level is not reached.
    pub ids: Vec<Option<u32>>,
}

impl FrontIds {
    /// The front Gaussian at column `x` and row `y`; `None` outside as well.
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> Option<u32> {
        if x >= self.width {
            return None;
        }
        self.ids.get(y as usize * self.width as usize + x as usize).copied().flatten()
    }
}

/// The front surface at pixel coordinates `at` of a camera: the place where the accumulated opacity first reaches `level`. The
/// first pixel's centre is (0.5, 0.5). Any place between pixels or outside the picture is valid. `None` if the opacity never
/// reaches the level.
///
/// # Errors
/// [`RenderError`] as for a picture, and for a level that is not above 0 and at most 1.
pub fn pick(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    projection: Projection,
    at: DVec2,
    level: f64,
) -> Result<Option<Hit>, RenderError> {
    check(scene, appearance, camera)?;
    check_level(level)?;
    let mut layers = match projection {
        Projection::Affine => {
            let layer = |index, p: Footprint| {
                let alpha = p.alpha(at);
                if alpha > 0.0 { Ok(Layer { depth: p.order, alpha, item: index }) } else { Err(Culled::Outside) }
            };
            footprints(scene, appearance, camera, layer).0
        }
        Projection::PerRay => {
            let layer = |splat: RaySplat| {
                let meeting = splat.meet(at);
                let alpha = splat.alpha(meeting);
                if alpha > 0.0 {
                    Ok(Layer { depth: meeting.depth, alpha, item: splat.index })
                } else {
                    Err(Culled::Outside)
                }
            };
            ray_consistent::splats(scene, appearance, camera, layer).0
        }
    };
    layers.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    Ok(front(&layers, level).and_then(|gaussian| hit_of(scene, appearance, camera, gaussian, at)))
}

/// The point where the ray through `at` (as in [`pick`]) meets a Gaussian that is known to be in front, such as from
/// [`FrontIds`]. `None` for one that is hidden or not finite.
#[must_use]
pub fn hit_of(scene: &Scene, appearance: &Appearance, camera: &Camera, gaussian: u32, at: DVec2) -> Option<Hit> {
    let placed = place_one(scene, appearance, camera, gaussian)?;
    let splat = ray_consistent::splat(gaussian, &placed, camera)?;
    // An ellipse may reach where its Gaussian lies behind the eye.
    let depth = splat.meet(at).depth.max(NEAR);
    let point = camera.view().inverse().transform_point3(depth * ray_consistent::ray(camera, at));
    Some(Hit { gaussian, depth, point })
}

/// The centre of a Gaussian as pictures draw it, in view axes relative to the eye: that of the kept part where a clip cuts it. `None`
/// for one that is hidden, clipped away or not finite.
#[must_use]
pub fn drawn_center(scene: &Scene, appearance: &Appearance, camera: &Camera, gaussian: u32) -> Option<DVec3> {
    Some(place_one(scene, appearance, camera, gaussian)?.center)
}

/// The front surface along the half-line from `origin` in `direction` (of any length, scene frame), evaluated per ray.
///
/// `spread` is the angle of the ray in radians, at least 1e-6. Thinner Gaussians are widened to it, as a picture
/// widens them to the size of a pixel; it is √0.3 of that size. The depth of the hit is its distance from the
/// origin.
///
/// # Errors
/// [`RenderError`] as for [`pick`], and where the ray has no direction.
pub fn pick_ray(
    scene: &Scene,
    appearance: &Appearance,
    origin: DVec3,
    direction: DVec3,
    spread: f64,
    level: f64,
) -> Result<Option<Hit>, RenderError> {
    let direction = direction.try_normalize().ok_or(RenderError::Ray)?;
    let camera = ray_camera(origin, direction, spread);
    pick(scene, appearance, &camera, Projection::PerRay, DVec2::splat(0.5), level)
}

/// [`pick_ray`] among some Gaussians of the scene, given by their scene-wide indices. It takes time for these alone. Others
/// neither are hit nor hide what is. `None` for a ray without a direction or a level out of range too.
#[must_use]
pub fn pick_ray_among(
    scene: &Scene,
    appearance: &Appearance,
    (origin, direction): (DVec3, DVec3),
    spread: f64,
    level: f64,
    gaussians: &[u32],
) -> Option<Hit> {
    let direction = direction.try_normalize().filter(|_| check_level(level).is_ok())?;
    let camera = ray_camera(origin, direction, spread);
    let at = DVec2::splat(0.5);
    let layer = |index: &u32| {
        let placed = place_one(scene, appearance, &camera, *index)?;
        let splat = ray_consistent::splat(*index, &placed, &camera)?;
        let meeting = splat.meet(at);
        let alpha = splat.alpha(meeting);
        (alpha > 0.0).then_some(Layer { depth: meeting.depth, alpha, item: *index })
    };
    let mut layers: Vec<Layer> = gaussians.iter().filter_map(layer).collect();
    layers.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    front(&layers, level).and_then(|gaussian| hit_of(scene, appearance, &camera, gaussian, at))
}

/// A camera of one pixel, with a ray through its middle.
fn ray_camera(origin: DVec3, direction: DVec3, spread: f64) -> Camera {
    let up = direction.any_orthonormal_vector();
    let focal = DILATION.sqrt() / spread.max(1e-6);
    let camera = Camera::look_at(origin, origin + direction, up, 90.0, 1, 1);
    Camera { fx: focal, fy: focal, cx: 0.5, cy: 0.5, ..camera }
}

/// The front Gaussian of every pixel, by the same rules as [`pick`].
///
/// # Errors
/// [`RenderError`] as for [`pick`].
pub fn front_ids(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    projection: Projection,
    level: f64,
) -> Result<(FrontIds, Report), RenderError> {
    check(scene, appearance, camera)?;
    check_level(level)?;
    let began = Instant::now();
    let (ids, mut report) = match projection {
        Projection::Affine => affine_ids(scene, appearance, camera, level),
        Projection::PerRay => {
            let (bounded, mut report) = bounded(scene, appearance, camera);
            let tile = |[x0, y0]: [usize; 2], list: &[u32]| -> TileOf<Option<u32>> {
                let mut layers = Vec::with_capacity(list.len());
                std::array::from_fn(|k| {
                    let pixel = DVec2::new((x0 + k % TILE) as f64 + 0.5, (y0 + k / TILE) as f64 + 0.5);
                    layers_at(&bounded, list, pixel, &mut layers);
                    front(&layers, level).and_then(|item| bounded.get(item as usize)).map(|b| b.splat.index)
                })
            };
            let ids = rasterize([camera.width, camera.height], &bounded, |b| (b.reach, 1.0), tile, &mut report);
            (ids, report)
        }
    };
    report.seconds.total = began.elapsed().as_secs_f64();
    Ok((FrontIds { width: camera.width, height: camera.height, ids }, report))
}

fn check_level(level: f64) -> Result<(), RenderError> {
    if level > 0.0 && level <= 1.0 { Ok(()) } else { Err(RenderError::Level { level }) }
}

/// The item that carries the accumulated opacity to the level.
fn front(layers: &[Layer], level: f64) -> Option<u32> {
    let mut transmittance = 1.0;
    layers.iter().find_map(|layer| {
        transmittance *= 1.0 - layer.alpha;
        (1.0 - transmittance >= level).then_some(layer.item)
    })
}

/// The α that is left out if every pixel examines many Gaussians. A million of them move the accumulated opacity by
/// 1e-10.
const FAINTEST: f64 = 1e-16;

fn affine_ids(scene: &Scene, appearance: &Appearance, camera: &Camera, level: f64) -> (Vec<Option<u32>>, Report) {
    let pinhole = Pinhole::of(camera);
    let (mut splats, mut report) = footprints(scene, appearance, camera, |index, p| {
        let level = p.level(radius(p.opacity, FAINTEST), &pinhole).ok_or(Culled::Outside)?;
        Ok((index, p, level))
    });
    splats.sort_by(|a, b| a.1.order.total_cmp(&b.1.order));
    let tile = |[x0, y0]: [usize; 2], list: &[u32]| -> TileOf<Option<u32>> {
        let mut transmittance = [1.0_f64; TILE * TILE];
        let mut ids = [None; TILE * TILE];
        let mut open = TILE * TILE;
        for (index, p, (ellipse, reach)) in list.iter().filter_map(|k| splats.get(*k as usize)) {
            for (k, (t, id)) in transmittance.iter_mut().zip(&mut ids).enumerate().filter(|(_, (_, id))| id.is_none()) {
                let pixel = DVec2::new((x0 + k % TILE) as f64 + 0.5, (y0 + k / TILE) as f64 + 0.5);
                if (pixel.y - ellipse.center.y).abs() > reach * ellipse.over_rows {
                    continue;
                }
                *t *= 1.0 - p.alpha(pixel);
                if 1.0 - *t >= level {
                    *id = Some(*index);
                    open -= 1;
                }
            }
            if open == 0 {
                break;
            }
        }
        ids
    };
    let ids = rasterize([camera.width, camera.height], &splats, |s| s.2, tile, &mut report);
    (ids, report)
}
