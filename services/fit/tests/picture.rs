//! The image of a direct start against the ray-marched image of its volume: unlit, 45° field of view.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use glam::{DVec3, Vec3};
use sg_fit::{Options, direct_start};
use sg_raster::image_error::Difference;
use sg_raster::render::{Quality, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_volume::dvr::{self, Lighting, Pinhole};
use sg_volume::phantom::{self, VesselTree};

use sg_volume::{Field, TransferFunction};

/// The vessel tree, its transfer function, and a camera.
struct Subject {
    field: Field,
    function: TransferFunction,
    camera: Camera,
}

impl Subject {
    /// The tree seen from a direction, at a distance in volume diagonals.
    fn new(from: DVec3) -> Self {
        let field = VesselTree::new().rasterize(64, 1).unwrap().volume().unwrap().to_field();
        let bounds = field.grid().bounds();
        let (middle, size) = (0.5 * (bounds.min + bounds.max), (bounds.max - bounds.min).length());
        let camera = Camera::look_at(middle + from * size, middle, DVec3::Z, 45.0, 320, 320);
        Self { field, function: phantom::transfer_function(), camera }
    }

    /// Difference between the Gaussians and the volume. The opacity fades both.
    fn difference(&self, gaussians: usize, flattening: f64, opacity: f32) -> Difference {
        self.difference_of(Options { gaussians, flattening, ..Options::default() }, opacity)
    }

    fn difference_of(&self, options: Options, opacity: f32) -> Difference {
        let Self { field, function, camera } = self;
        let pinhole = Pinhole {
            width: 320,
            height: 320,
            focal: [camera.fx, camera.fy],
            center: [camera.cx, camera.cy],
            world_to_camera: camera.view(),
        };
        let mut faded = function.clone();
        for point in &mut faded.points {
            point.opacity *= opacity;
        }
        let classifier = faded.classifier(field.range()).unwrap();
        let marched = dvr::render(field, &classifier, &pinhole, Lighting::Unlit, Vec3::ZERO, 0.5);

        let mut scene = direct_start(field, function, &options, |_| {}).unwrap().scene;
        for unit in &mut scene.units {
            let shading = unit.gaussians.shading.as_mut().unwrap();
            shading.ambient.fill(1.0);
            shading.diffuse.fill(0.0);
            shading.specular.fill(0.0);
        }
        let mut appearance = Appearance::of(&scene);
        appearance.background = Vec3::ZERO;
        for unit in &mut appearance.base {
            unit.opacity = opacity;
        }
        let image = render(&scene, &appearance, camera, Quality::Standard).unwrap().image;
        let mut reference = image.clone();
        reference.rgba = marched.pixels.iter().flatten().copied().collect();
        Difference::between(&image, &reference).unwrap()
    }
}

#[test]
fn more_and_flatter_gaussians_come_nearer_to_the_volume() {
    let subject = Subject::new(DVec3::new(0.3, -1.0, 0.25));
    let quality = |gaussians, flattening| subject.difference(gaussians, flattening, 1.0);
    let (few, some, many) = (quality(1_000, 0.6), quality(5_000, 0.6), quality(20_000, 0.6));
    let thick = quality(5_000, 1.0);
    let table = format!("1k {few:?}\n5k {some:?}\n20k {many:?}\n5k unflattened {thick:?}");
    assert!(few.psnr_db > FEW && some.psnr_db > SOME && many.psnr_db > MANY, "{table}");
    assert!(some.footprint_psnr_db > few.footprint_psnr_db + 2.0, "{table}");
    assert!(some.footprint_psnr_db > thick.footprint_psnr_db + 2.0, "{table}");
    assert!(many.coverage_error < 0.03, "{table}");
}

/// Near enough for single Gaussians to be resolved.
#[test]
fn a_faded_surface_shows_no_lattice() {
    let subject = Subject::new(DVec3::new(0.0, -0.6, 0.1));
    let (full, faded) = (subject.difference(40_000, 0.6, 1.0), subject.difference(40_000, 0.6, 0.2));
    assert!(full.footprint_psnr_db > FULL && faded.footprint_psnr_db > FADED, "{full:?} {faded:?}");
}

/// What the surface hides is seen once it fades.
#[test]
fn a_faded_surface_shows_what_it_hides() {
    let subject = Subject::new(DVec3::new(0.3, -1.0, 0.25));
    let of = |interior, opacity| {
        subject.difference_of(Options { gaussians: 5_000, interior, ..Options::default() }, opacity).footprint_psnr_db
    };
    let [shell, filled] = [0.0, Options::default().interior].map(|interior| [of(interior, 1.0), of(interior, 0.2)]);
    assert!(filled[1] > shell[1] + 1.0 && filled[0] > shell[0] - 0.5, "{shell:?} {filled:?}");
}

/// Least PSNR over the footprint in dB. With centres that follow the lattice of the voxels, it was 27.4 and 21.4.
const FULL: f64 = 28.2;
const FADED: f64 = 23.5;
/// Least PSNR over the frame in dB for each budget.
const FEW: f64 = 27.0;
const SOME: f64 = 34.0;
const MANY: f64 = 35.0;
