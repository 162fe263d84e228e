//! Direct volume rendering by ray marching (Levoy 1988; Max 1995).
//!
//! The image is the reference for Gaussians of the same volume. Rays run front to back with post-classification. The step
//! length corrects the opacities. A ray stops at a transmittance of 1e-5. It skips blocks of voxels without opacity.
//! [`RayMarcher::picture`] is exact up to its step; [`RayMarcher::fast_picture`] is its fast twin.

#[cfg(test)]
mod analytic;
mod clip;
mod fast;
mod stencil;

use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;

use crate::classifier::Classifier;
use crate::classifier_table::ClassifierTable;
use crate::field::Field;
use crate::opacity::correct_opacity;
use crate::surfaceness::Surfaceness;
use crate::visible_blocks::VisibleBlocks;

pub(crate) use clip::kept_parts;
pub use clip::{ClipRegion, HalfSpace};
use fast::FastMarcher;

/// Transmittance at which a ray ends.
const LEAST_TRANSMITTANCE: f64 = 1e-5;
/// Edge of a tile in pixels.
const TILE: usize = 8;

/// A pinhole camera: x right, y down, z forward; the first pixel's centre at (0.5, 0.5).
#[derive(Debug, Clone, PartialEq)]
pub struct Pinhole {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub center: [f64; 2],
    /// World to camera, affine.
    pub world_to_camera: DMat4,
}

impl Pinhole {
    /// The unit direction in the world through the middle of a pixel.
    pub(crate) fn direction(&self, camera_to_world: &DMat4, x: usize, y: usize) -> DVec3 {
        let x = (x as f64 + 0.5 - self.center[0]) / self.focal[0];
        let y = (y as f64 + 0.5 - self.center[1]) / self.focal[1];
        camera_to_world.transform_vector3(DVec3::new(x, y, 1.0)).normalize()
    }
}

/// Lighting of samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Lighting {
    /// The unchanged colour of the transfer function.
    #[default]
    Unlit,
    /// Blinn–Phong with one white light and the normal n = −∇v/|∇v|.
    /// `c = ka·c + kd·max(n·l,0)·c + ks·max(n·h,0)^β`, clamped to `[0, 1]`. The factors follow the [`Surfaceness`] of the
    /// sample ([`Material::with_surfaceness`]).
    Lit(Material, Illumination),
}

/// Factors of the shading of a clear boundary, and of what has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Ambient factor of homogeneous values and noise, which have no diffuse or specular part.
    pub haze_ambient: f32,
    /// Ambient factor ka.
    pub ambient: f32,
    /// Diffuse factor kd.
    pub diffuse: f32,
    /// Specular factor ks.
    pub specular: f32,
    /// Specular exponent β.
    pub shininess: f32,
}

/// The place of the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Illumination {
    /// At the eye: l, v and h are equal.
    Headlight,
    /// Far away in this direction of the world, of any length.
    Direction(Vec3),
}

/// An image, row by row: RGB composited over the background, A = 1 − transmittance.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width · height` pixels.
    pub pixels: Vec<[f32; 4]>,
}

/// A volume under a transfer function that gives pictures.
pub trait VolumeRenderer {
    /// The picture with one ray through each pixel, exact up to the step of the samples.
    #[must_use]
    fn picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image;

    /// The same picture, faster and off by less than 1/255 almost everywhere.
    #[must_use]
    fn fast_picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image;
}

/// Renders a volume. `step` is the sampling distance in units of the smallest voxel spacing; ½ is a good value.
#[must_use]
pub fn render(
    field: &Field,
    classifier: &Classifier,
    camera: &Pinhole,
    lighting: Lighting,
    background: Vec3,
    step: f64,
) -> Image {
    RayMarcher::new(field, classifier.clone(), step).picture(camera, lighting, background)
}

/// A volume under a transfer function, ready for any number of pictures.
pub struct RayMarcher<'a> {
    field: &'a Field,
    classifier: Classifier,
    table: ClassifierTable,
    surfaceness: Surfaceness,
    blocks: VisibleBlocks,
    clips: Vec<ClipRegion>,
    step: f64,
    reference: f64,
}

/// A ray within the volume.
#[derive(Clone, Copy)]
struct Ray {
    /// Its unit direction in the world.
    direction: DVec3,
    /// The eye, and the way of one unit of length, in voxel coordinates.
    start: DVec3,
    along: DVec3,
}

impl<'a> RayMarcher<'a> {
    /// Finds the blocks of the volume in which the transfer function shows something. `step` is as for [`render`].
    #[must_use]
    pub fn new(field: &'a Field, classifier: Classifier, step: f64) -> Self {
        let step = step.max(1e-3) * field.grid().spacing().min_element();
        let reference = field.grid().reference_length();
        Self {
            field,
            blocks: VisibleBlocks::of(field, &classifier),
            table: ClassifierTable::new(&classifier, field, step, reference),
            surfaceness: Surfaceness::new(field, &classifier),
            classifier,
            clips: Vec::new(),
            step,
            reference,
        }
    }

    /// Shows only what all these regions keep. Samples begin anew at each cut.
    #[must_use]
    pub fn clipped(self, clips: Vec<ClipRegion>) -> Self {
        Self { clips, ..self }
    }

    /// Calls `march` for the kept parts of each ray, from near to far.
    fn pixels(
        &self,
        camera: &Pinhole,
        background: Vec3,
        march: impl Fn(&Ray, f64, f64, &mut CollectedLight) + Sync,
    ) -> Image {
        let grid = self.field.grid();
        let high = DVec3::from_array(grid.dims().map(|d| d as f64 - 0.5));
        let camera_to_world = camera.world_to_camera.inverse();
        let eye = camera_to_world.transform_point3(DVec3::ZERO);
        let start = grid.to_voxel(eye);
        let pixel = |x: usize, y: usize| {
            let direction = camera.direction(&camera_to_world, x, y);
            let ray = Ray { direction, start, along: grid.vector_to_voxel(direction) };
            let mut light = CollectedLight::NONE;
            if let Some((near, far)) = intersect_box(start, ray.along, DVec3::splat(-0.5), high) {
                if self.clips.is_empty() {
                    march(&ray, near, far, &mut light);
                } else {
                    kept_parts(&self.clips, eye, direction, near, far)
                        .for_each(|(near, far)| march(&ray, near, far, &mut light));
                }
            }
            light.over(background)
        };
        let width = camera.width.max(1);
        let mut pixels = vec![[0.0; 4]; camera.width * camera.height];
        // Tile by tile: neighbouring rays read the same voxels, which are then still in the cache.
        pixels.par_chunks_mut(TILE * width).enumerate().for_each(|(band, rows)| {
            for left in (0..width).step_by(TILE) {
                for (row, pixels) in rows.chunks_mut(width).enumerate() {
                    for (x, out) in pixels.iter_mut().enumerate().skip(left).take(TILE) {
                        *out = pixel(x, TILE * band + row);
                    }
                }
            }
        });
        Image { width: camera.width, height: camera.height, pixels }
    }

    /// Adds the samples of one part of a ray.
    fn march(&self, ray: &Ray, (near, far): (f64, f64), lighting: Lighting, light: &mut CollectedLight) {
        let inverse = ray.along.recip();
        let steps = ((far - near) / self.step).ceil();
        let mut next = 0.0;
        while next < steps && light.transmittance >= LEAST_TRANSMITTANCE {
            let from = near + next * self.step;
            let length = self.step.min(far - from);
            let at = ray.start + ray.along * (from + 0.5 * length);
            next += 1.0;
            let around = self.blocks.stretch(at);
            if !around.is_visible {
                // Samples stay where they were, so the picture is the same to the last bit.
                next += (around.way_out(at, inverse) / self.step - 1.0).floor().max(0.0);
                continue;
            }
            let Some(value) = self.field.sample(at) else { continue };
            let (sample, opacity) = self.classifier.evaluate(value);
            if opacity <= 0.0 {
                continue;
            }
            let alpha = correct_opacity(f64::from(opacity), length, self.reference);
            light.add(alpha, self.shade(sample, value, at, ray.direction, lighting));
        }
    }

    fn shade(&self, color: Vec3, value: f64, at: DVec3, direction: DVec3, lighting: Lighting) -> Vec3 {
        match lighting {
            Lighting::Unlit => color,
            Lighting::Lit(material, light) => {
                let gradient = self.field.gradient(at);
                let surfaceness = self.surfaceness.at(value, gradient.length());
                material.lit(color, gradient, surfaceness, -direction.as_vec3(), light)
            }
        }
    }
}

impl VolumeRenderer for RayMarcher<'_> {
    /// Marches a ray through each pixel, in f64.
    fn picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image {
        self.pixels(camera, background, |ray, near, far, light| self.march(ray, (near, far), lighting, light))
    }

    /// The same picture several times as fast, off by less than 1/255 almost everywhere. Samples have the same places. Their values
    /// are in f32, colours and opacities come from a table, and a ray stops at a transmittance of 1/2000.
    fn fast_picture(&self, camera: &Pinhole, lighting: Lighting, background: Vec3) -> Image {
        let fast = FastMarcher::new(self, lighting);
        self.pixels(camera, background, |ray, near, far, light| fast.march(ray, (near, far), light))
    }
}

/// The light that a ray has collected: premultiplied colour, and the share of the light behind that comes through.
#[derive(Clone, Copy)]
pub(crate) struct CollectedLight {
    pub(crate) color: Vec3,
    pub(crate) transmittance: f64,
}

impl CollectedLight {
    /// Before the first sample.
    pub(crate) const NONE: Self = Self { color: Vec3::ZERO, transmittance: 1.0 };

    /// Adds a sample behind all others.
    pub(crate) fn add(&mut self, alpha: f64, color: Vec3) {
        self.color += (self.transmittance * alpha) as f32 * color;
        self.transmittance *= 1.0 - alpha;
    }

    /// The pixel before a background.
    pub(crate) fn over(self, background: Vec3) -> [f32; 4] {
        let c = self.color + background * self.transmittance as f32;
        [c.x, c.y, c.z, 1.0 - self.transmittance as f32]
    }
}

impl Material {
    /// That of pictures of volumes. The direct start gives its Gaussians the same. Haze is as bright as a boundary is on average
    /// over the view directions: 0.4 + 0.6·½.
    pub const STANDARD: Self = Self { haze_ambient: 0.7, ambient: 0.4, diffuse: 0.6, specular: 0.2, shininess: 20.0 };

    /// The factors between haze (0) and a clear boundary (1).
    #[must_use]
    pub fn with_surfaceness(self, surfaceness: f32) -> Self {
        Self {
            ambient: self.haze_ambient + surfaceness * (self.ambient - self.haze_ambient),
            diffuse: surfaceness * self.diffuse,
            specular: surfaceness * self.specular,
            ..self
        }
    }

    /// The colour of a sample with this gradient and surfaceness.
    pub(crate) fn lit(self, color: Vec3, gradient: Vec3, surfaceness: f32, to_eye: Vec3, light: Illumination) -> Vec3 {
        self.with_surfaceness(surfaceness).shaded(color, -gradient.normalize_or_zero(), to_eye, light)
    }

    fn shaded(&self, color: Vec3, normal: Vec3, to_eye: Vec3, light: Illumination) -> Vec3 {
        let (to_light, half) = match light {
            Illumination::Headlight => (to_eye, to_eye),
            Illumination::Direction(direction) => {
                let to_light = direction.normalize_or_zero();
                (to_light, (to_light + to_eye).normalize_or_zero())
            }
        };
        let (facing, shine) = (normal.dot(to_light).max(0.0), normal.dot(half));
        let highlight = if shine > 0.0 { self.specular * shine.powf(self.shininess) } else { 0.0 };
        (color * (self.ambient + self.diffuse * facing) + highlight).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// The interval of a ray inside an axis-aligned box, in front of its start.
fn intersect_box(start: DVec3, along: DVec3, low: DVec3, high: DVec3) -> Option<(f64, f64)> {
    let (mut near, mut far) = (0.0_f64, f64::INFINITY);
    for k in 0..3 {
        if along[k] == 0.0 {
            if start[k] < low[k] || start[k] > high[k] {
                return None;
            }
            continue;
        }
        let (a, b) = ((low[k] - start[k]) / along[k], (high[k] - start[k]) / along[k]);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near < far && far.is_finite()).then_some((near, far))
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::grid::Grid;
    use crate::transfer::{ControlPoint, Scale, TransferFunction, Units};
    use crate::volume::Volume;

    fn slab(opacity: f32) -> (Field, Classifier) {
        let grid = Grid::unit([16, 16, 16]).unwrap();
        let field = Volume::new(grid, vec![1_u8; 16 * 16 * 16].into(), None).unwrap().to_field();
        let f = TransferFunction {
            domain: [0.0, 1.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points: vec![ControlPoint { value: 1.0, color: [1.0, 0.5, 0.0], opacity }],
            base_units: Vec::new(),
        };
        let classifier = f.classifier(field.range()).unwrap();
        (field, classifier)
    }

    fn axis_camera() -> Pinhole {
        // Looks along +z from far away through the middle of the grid.
        let world_to_camera = DMat4::from_translation(DVec3::new(-7.5, -7.5, 1000.0));
        Pinhole { width: 1, height: 1, focal: [1.0; 2], center: [0.5; 2], world_to_camera }
    }

    #[test]
    fn a_homogeneous_slab_has_the_analytic_opacity_for_any_step() {
        let (field, classifier) = slab(0.02);
        let want = correct_opacity(f64::from(0.02_f32), 16.0, field.grid().reference_length());
        for step in [0.1, 0.5, 0.7, 3.0] {
            let p = render(&field, &classifier, &axis_camera(), Lighting::Unlit, Vec3::ZERO, step).pixels[0];
            assert!((f64::from(p[3]) - want).abs() < 1e-5, "step {step}: {} {want}", p[3]);
            assert!((p[0] - p[3]).abs() < 1e-5 && (p[1] - 0.5 * p[3]).abs() < 1e-5 && p[2] == 0.0);
        }
    }

    #[test]
    fn skipping_empty_blocks_changes_no_bit() {
        use crate::phantom::{VesselTree, transfer_function};

        let field = VesselTree::new().rasterize(48, 1).unwrap().volume().unwrap().to_field();
        let classifier = transfer_function().classifier(field.range()).unwrap();
        let mut marcher = RayMarcher::new(&field, classifier, 0.5);
        let bounds = field.grid().bounds();
        let middle = 0.5 * (bounds.min + bounds.max);
        for (turn, away) in [(0.3, 1.6), (2.0, 0.2), (4.0, 3.0)] {
            let out = DVec3::new(f64::cos(turn), f64::sin(turn), 0.4) * away * (bounds.max - bounds.min).max_element();
            let ahead = -out.normalize();
            let right = ahead.cross(DVec3::Z).normalize();
            let axes = DMat3::from_cols(right, ahead.cross(right), ahead).transpose();
            let world_to_camera = DMat4::from_mat3(axes) * DMat4::from_translation(-middle - out);
            let camera = Pinhole { width: 40, height: 30, focal: [40.0; 2], center: [20.0, 15.0], world_to_camera };
            let material = Material { haze_ambient: 0.6, ambient: 0.3, diffuse: 0.6, specular: 0.2, shininess: 9.0 };
            for illumination in [Illumination::Headlight, Illumination::Direction(Vec3::new(1.0, 2.0, 3.0))] {
                let lighting = Lighting::Lit(material, illumination);
                let skipped = marcher.picture(&camera, lighting, Vec3::ONE);
                let skipping = std::mem::replace(&mut marcher.blocks, VisibleBlocks::all(&field));
                let whole = marcher.picture(&camera, lighting, Vec3::ONE);
                marcher.blocks = skipping;
                assert_eq!(skipped, whole);
                assert!(whole.pixels.iter().any(|p| p[3] > 0.5), "nothing to see");
            }
        }
    }

    #[test]
    fn a_light_beside_the_eye_is_that_of_the_formula() {
        // A sphere's edge by distance; each sample of one value has the normal of its place.
        let grid = Grid::unit([32, 32, 32]).unwrap();
        let distance = |i: usize| (grid.voxel(i).as_dvec3() - 15.5).length();
        let values: Vec<f32> = (0..grid.len()).map(|i| 40.0 - distance(i) as f32).collect();
        let field = Volume::new(grid.clone(), values.into(), None).unwrap().to_field();
        let f = TransferFunction {
            domain: [0.0, 60.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points: vec![
                ControlPoint { value: 28.0, color: [1.0, 0.5, 0.25], opacity: 0.0 },
                ControlPoint { value: 28.1, color: [1.0, 0.5, 0.25], opacity: 1.0 },
            ],
            base_units: Vec::new(),
        };
        let classifier = f.classifier(field.range()).unwrap();
        let material = Material { haze_ambient: 0.0, ambient: 0.2, diffuse: 0.5, specular: 0.3, shininess: 4.0 };
        let world_to_camera = DMat4::from_translation(DVec3::new(-15.5, -15.5, 1000.0));
        let camera = Pinhole { width: 1, height: 1, focal: [1.0; 2], center: [0.5; 2], world_to_camera };
        // The middle ray meets the surface at the normal −z, towards the eye. The light is 60° from it.
        let light = Vec3::new(0.75_f32.sqrt(), 0.0, -0.5);
        let marcher = RayMarcher::new(&field, classifier, 0.1);
        let p = marcher.picture(&camera, Lighting::Lit(material, Illumination::Direction(light)), Vec3::ZERO).pixels[0];
        let shine = 0.3 * 30.0_f32.to_radians().cos().powi(4);
        for (got, color) in p.into_iter().zip([1.0, 0.5, 0.25]) {
            assert!((got - (0.45 * color + shine)).abs() < 0.01, "{p:?}");
        }
    }

    #[test]
    fn noise_on_a_cut_face_does_not_glitter() {
        // A block of 100 with noise of less than a hundredth of the range, cut in the middle.
        let grid = Grid::unit([24, 24, 24]).unwrap();
        let inside = |i: usize| (grid.voxel(i).as_dvec3() - 11.5).abs().max_element() < 9.0;
        let noise = |i: usize| (i as u32).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32 - 0.5;
        let values: Vec<f32> = (0..grid.len()).map(|i| if inside(i) { 100.0 + 0.8 * noise(i) } else { 0.0 }).collect();
        let field = Volume::new(grid.clone(), values.into(), None).unwrap().to_field();
        let point = |value: f64, opacity: f32| ControlPoint { value, color: [0.8; 3], opacity };
        let f = TransferFunction {
            domain: [0.0, 100.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points: vec![point(40.0, 0.0), point(60.0, 1.0)],
            base_units: Vec::new(),
        };
        let classifier = f.classifier(field.range()).unwrap();
        let side = HalfSpace { normal: DVec3::Z, offset: 11.5 };
        let marcher = RayMarcher::new(&field, classifier, 0.5)
            .clipped(vec![ClipRegion { sides: vec![side], keeps_inside: true }]);
        let world_to_camera = DMat4::from_translation(DVec3::new(-11.5, -11.5, 1000.0));
        let camera = Pinhole { width: 12, height: 12, focal: [1000.0; 2], center: [6.0; 2], world_to_camera };
        let lighting = Lighting::Lit(Material::STANDARD, Illumination::Headlight);
        let haze = Material::STANDARD.haze_ambient * 0.8;
        for picture in
            [marcher.picture(&camera, lighting, Vec3::ZERO), marcher.fast_picture(&camera, lighting, Vec3::ZERO)]
        {
            assert!(picture.pixels.iter().all(|p| (p[0] - haze).abs() < 0.02 && p[3] > 0.99), "not {haze}");
        }
    }

    #[test]
    fn rays_that_miss_show_the_background() {
        let (field, classifier) = slab(1.0);
        let mut camera = axis_camera();
        camera.center = [1e3, 0.5];
        let p = render(&field, &classifier, &camera, Lighting::Unlit, Vec3::new(0.1, 0.2, 0.3), 0.5).pixels[0];
        assert_eq!(p, [0.1, 0.2, 0.3, 0.0]);
    }
}
