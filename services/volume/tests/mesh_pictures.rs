//! Pictures of meshes against closed forms and fine sums along single rays.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use glam::{DMat3, DMat4, DVec3, Vec3};
use proptest::prelude::*;
use sg_volume::dvr::{ClipRegion, HalfSpace, Illumination, Image, Lighting, Material, Pinhole, VolumeRenderer};
use sg_volume::mesh::{MeshMarcher, MeshValues};
use sg_volume::opacity::correct_opacity;
use sg_volume::transfer::{BaseUnitRange, ControlPoint, Scale, Units};
use sg_volume::{Classifier, Field, Mesh, MeshField, TransferFunction};

/// The six tetrahedra of a cube between its corners 0 and 7 (Kuhn 1960); bit k of a corner is its place along axis k.
const KUHN: [[usize; 4]; 6] = [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]];

/// A mesh of `n`³ cubes over the unit cube. `place` moves its points, `value` gives their values.
fn cubes(n: usize, place: impl Fn(DVec3) -> DVec3, value: impl Fn(DVec3) -> f64) -> Mesh {
    let at = |x: usize, y: usize, z: usize| x + (n + 1) * (y + (n + 1) * z);
    let mut points = Vec::new();
    for z in 0..=n {
        for y in 0..=n {
            for x in 0..=n {
                points.push(place(DVec3::new(x as f64, y as f64, z as f64) / n as f64));
            }
        }
    }
    let mut cells = Vec::new();
    for z in 0..n {
        for y in 0..n {
            for x in 0..n {
                let corner = |k: usize| at(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)) as u32;
                cells.extend(KUHN.map(|cell| cell.map(corner)));
            }
        }
    }
    let values: Vec<f64> = points.iter().map(|p| value(*p)).collect();
    Mesh::new(points, cells, MeshValues::Points(values.into()), None).unwrap()
}

fn function(points: &[(f64, f32, f32)]) -> TransferFunction {
    let point = |&(value, gray, opacity)| ControlPoint { value, color: [gray, 1.0 - gray, 0.5], opacity };
    TransferFunction {
        domain: [0.0, 1.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: points.iter().map(point).collect(),
        base_units: Vec::new(),
    }
}

fn classifier(field: &MeshField, points: &[(f64, f32, f32)]) -> Classifier {
    function(points).classifier(field.range()).unwrap()
}

/// A camera at `eye` that looks at `target`.
fn camera(eye: DVec3, target: DVec3, size: usize) -> Pinhole {
    let ahead = (target - eye).normalize();
    let right = ahead.cross(if ahead.z.abs() > 0.9 { DVec3::X } else { DVec3::Z }).normalize();
    let axes = DMat3::from_cols(right, ahead.cross(right), ahead).transpose();
    let world_to_camera = DMat4::from_mat3(axes) * DMat4::from_translation(-eye);
    let half = 0.5 * size as f64;
    Pinhole { width: size, height: size, focal: [0.8 * size as f64; 2], center: [half; 2], world_to_camera }
}

/// The eye and the unit direction of a pixel's ray.
fn ray(camera: &Pinhole, pixel: usize) -> (DVec3, DVec3) {
    let back = camera.world_to_camera.inverse();
    let x = ((pixel % camera.width) as f64 + 0.5 - camera.center[0]) / camera.focal[0];
    let y = ((pixel / camera.width) as f64 + 0.5 - camera.center[1]) / camera.focal[1];
    (back.transform_point3(DVec3::ZERO), back.transform_vector3(DVec3::new(x, y, 1.0)).normalize())
}

/// The part of a ray within the unit cube, before the eye.
fn within_cube(eye: DVec3, direction: DVec3) -> Option<(f64, f64)> {
    let (a, b) = ((-eye) / direction, (DVec3::ONE - eye) / direction);
    let (near, far) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
    (near < far).then_some((near, far))
}

fn eyes() -> [DVec3; 4] {
    [
        DVec3::new(2.3, 1.1, 0.9),
        DVec3::new(-0.4, 0.5, 2.0),
        // Within the mesh, and on one of its points.
        DVec3::new(0.3, 0.45, 0.52),
        DVec3::splat(0.5),
    ]
}

fn greatest_difference(a: &Image, b: &Image) -> f32 {
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Moves the inner points and leaves the faces in place.
fn bent(p: DVec3) -> DVec3 {
    let inner = p * (DVec3::ONE - p);
    p + 0.2 * inner * DVec3::new((9.0 * p.y).sin(), (7.0 * p.z).cos(), (8.0 * p.x).sin())
}

#[test]
fn a_homogeneous_cube_has_the_transmittance_of_its_length_from_any_eye() {
    let field = cubes(6, bent, |_| 0.5).to_field();
    let opacity = 0.03_f32;
    let classifier = classifier(&field, &[(0.0, 1.0, opacity), (1.0, 1.0, opacity)]);
    for step in [0.5, 4.0] {
        let marcher = MeshMarcher::new(&field, classifier.clone(), step);
        for eye in eyes() {
            let camera = camera(eye, DVec3::new(0.51, 0.48, 0.5), 40);
            let image = marcher.picture(&camera, Lighting::Unlit, Vec3::ZERO);
            for (pixel, found) in image.pixels.iter().enumerate() {
                let (eye, direction) = ray(&camera, pixel);
                let length = within_cube(eye, direction).map_or(0.0, |(near, far)| far - near);
                let expected = correct_opacity(f64::from(opacity), length, field.reference_length());
                assert!((f64::from(found[3]) - expected).abs() < 2e-5, "{eye} pixel {pixel}: {} {expected}", found[3]);
                assert!((found[0] - found[3]).abs() < 1e-5 && found[1].abs() < 1e-6);
            }
        }
    }
}

#[test]
fn linear_values_give_the_sums_of_fine_steps_along_each_ray() {
    let value = |p: DVec3| 0.1 + 0.5 * p.x + 0.2 * p.y + 0.15 * p.z;
    let field = cubes(5, bent, value).to_field();
    let points =
        [(0.0, 0.2, 0.0), (0.3, 0.2, 0.0), (0.42, 0.9, 0.12), (0.5, 0.4, 0.02), (0.5, 0.1, 0.2), (0.8, 0.7, 0.0)];
    let classifier = classifier(&field, &points);
    let marcher = MeshMarcher::new(&field, classifier.clone(), 0.5);
    for eye in eyes() {
        let camera = camera(eye, DVec3::new(0.51, 0.48, 0.5), 24);
        let image = marcher.picture(&camera, Lighting::Unlit, Vec3::new(0.1, 0.2, 0.3));
        for (pixel, found) in image.pixels.iter().enumerate() {
            let (eye, direction) = ray(&camera, pixel);
            let (mut color, mut through) = (Vec3::ZERO, 1.0_f64);
            if let Some((near, far)) = within_cube(eye, direction) {
                let steps = 20_000;
                let step = (far - near) / f64::from(steps);
                for k in 0..steps {
                    let at = eye + direction * (near + (f64::from(k) + 0.5) * step);
                    let (own, opacity) = classifier.evaluate(value(at));
                    let alpha = correct_opacity(f64::from(opacity), step, field.reference_length());
                    color += (through * alpha) as f32 * own;
                    through *= 1.0 - alpha;
                }
            }
            let color = color + Vec3::new(0.1, 0.2, 0.3) * through as f32;
            let expected = [color.x, color.y, color.z, 1.0 - through as f32];
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-3, "{eye} pixel {pixel}: {found} {expected}");
            }
        }
    }
}

#[test]
fn a_thin_peak_within_one_large_tetrahedron_is_not_missed() {
    let field = cubes(1, |p| p, |p| p.x).to_field();
    // The peak is a ten-thousandth of the cube, a thousandth of a sample's distance.
    let classifier = classifier(&field, &[(0.5, 1.0, 0.0), (0.500_05, 1.0, 0.9), (0.500_1, 1.0, 0.0)]);
    let marcher = MeshMarcher::new(&field, classifier, 8.0);
    let camera = camera(DVec3::new(3.0, 0.51, 0.52), DVec3::new(0.0, 0.51, 0.52), 1);
    let found = marcher.picture(&camera, Lighting::Unlit, Vec3::ZERO).pixels[0][3];
    let depth: f64 = (0..1000).map(|k| -(1.0 - 0.9 * (k as f64 + 0.5) / 1000.0).ln()).sum::<f64>() / 1000.0;
    let expected = 1.0 - (-depth * 1e-4 / field.reference_length()).exp();
    // One sample on each side of the peak.
    assert!((f64::from(found) / expected - 1.0).abs() < 0.2, "{found} {expected}");
}

#[test]
fn values_of_cells_are_constant_within_them() {
    let mesh = cubes(2, |p| p, |p| p.x);
    let of_cells: Vec<u8> = (0..mesh.cells().len()).map(|k| u8::from(k < 6)).collect();
    let field = Mesh::new(mesh.points().to_vec(), mesh.cells().to_vec(), MeshValues::Cells(of_cells.into()), None)
        .unwrap()
        .to_field();
    let classifier = classifier(&field, &[(0.0, 1.0, 0.0), (0.9, 1.0, 0.0), (0.9, 1.0, 0.1), (1.0, 1.0, 0.1)]);
    let marcher = MeshMarcher::new(&field, classifier, 0.5);
    // The first cube has the value 1: half of the edge, in front of the eye.
    let camera = camera(DVec3::new(-2.0, 0.26, 0.24), DVec3::new(0.0, 0.26, 0.24), 1);
    let found = marcher.picture(&camera, Lighting::Unlit, Vec3::ZERO).pixels[0][3];
    let expected = correct_opacity(0.1, 0.5, field.reference_length());
    assert!((f64::from(found) - expected).abs() < 1e-5, "{found} {expected}");
}

#[test]
fn clips_take_away_what_is_on_their_other_side() {
    let field = cubes(4, bent, |_| 0.5).to_field();
    let opacity = 0.02_f32;
    let classifier = classifier(&field, &[(0.0, 1.0, opacity), (1.0, 1.0, opacity)]);
    let side = |normal: DVec3, offset| ClipRegion { sides: vec![HalfSpace { normal, offset }], keeps_inside: true };
    let marcher = MeshMarcher::new(&field, classifier, 0.5).clipped(vec![side(DVec3::X, 0.3), side(-DVec3::X, -0.7)]);
    let camera = camera(DVec3::new(3.0, 0.51, 0.52), DVec3::new(0.0, 0.51, 0.52), 1);
    let found = marcher.picture(&camera, Lighting::Unlit, Vec3::ZERO).pixels[0][3];
    let expected = correct_opacity(f64::from(opacity), 0.4, field.reference_length());
    assert!((f64::from(found) - expected).abs() < 1e-5, "{found} {expected}");
}

#[test]
fn far_from_the_origin_nothing_changes() {
    let value = |p: DVec3| p.x * p.y;
    let near = cubes(4, bent, value);
    let far = DVec3::new(4e5, -3e5, 7e5);
    let moved =
        Mesh::new(near.points().iter().map(|p| *p + far).collect(), near.cells().to_vec(), near.values().clone(), None)
            .unwrap();
    let points = [(0.0, 0.2, 0.0), (0.4, 0.9, 0.1), (0.8, 0.3, 0.0)];
    let material = Material { haze_ambient: 0.6, ambient: 0.3, diffuse: 0.6, specular: 0.2, shininess: 9.0 };
    let lit = Lighting::Lit(material, Illumination::Headlight);
    let picture = |mesh: &Mesh, by: DVec3| {
        let field = mesh.to_field();
        let camera = camera(by + DVec3::new(2.0, 1.2, 0.7), by + DVec3::splat(0.5), 32);
        MeshMarcher::new(&field, classifier(&field, &points), 0.5).picture(&camera, lit, Vec3::ZERO)
    };
    let (a, b) = (picture(&near, DVec3::ZERO), picture(&moved, far));
    assert!(a.pixels.iter().any(|p| p[3] > 0.3));
    assert!(greatest_difference(&a, &b) < 1e-4, "{}", greatest_difference(&a, &b));
}

#[test]
fn a_mesh_and_a_fine_grid_of_the_same_values_look_alike_under_light() {
    let value = |p: DVec3| (1.0 - 2.0 * (p - 0.5).length()).clamp(0.0, 1.0);
    let field = cubes(48, |p| p, value).to_field();
    let points = [(0.0, 0.2, 0.0), (0.3, 0.3, 0.0), (0.5, 0.9, 0.2), (1.0, 0.3, 0.3)];
    // Surfaceness refers to a voxel, or to the reference length of a mesh: 1/148 of the edge.
    let grid: Field = field.resampled(148).unwrap();
    assert!(grid.values().iter().all(|v| v.is_finite()), "the mesh fills its box");
    let material = Material { haze_ambient: 0.6, ambient: 0.3, diffuse: 0.6, specular: 0.2, shininess: 9.0 };
    for light in [Illumination::Headlight, Illumination::Direction(Vec3::new(1.0, 2.0, 0.5))] {
        let lit = Lighting::Lit(material, light);
        let camera = camera(DVec3::new(2.0, 1.2, 0.7), DVec3::splat(0.5), 64);
        let mesh = MeshMarcher::new(&field, classifier(&field, &points), 0.5);
        let a = mesh.picture(&camera, lit, Vec3::ZERO);
        let of_grid = function(&points).classifier(grid.range()).unwrap();
        let b = sg_volume::dvr::render(&grid, &of_grid, &camera, lit, Vec3::ZERO, 0.3);
        let squares: f32 = a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).map(|(a, b)| (a - b).powi(2)).sum();
        let psnr = -10.0 * (squares / (4.0 * 64.0 * 64.0)).log10();
        assert!(psnr > 40.0, "{psnr} dB");
        assert!(greatest_difference(&a, &mesh.fast_picture(&camera, lit, Vec3::ZERO)) < 1.0 / 255.0);
    }
}

#[test]
fn cells_without_a_value_are_transparent_and_those_of_hidden_base_units_too() {
    let mesh = cubes(4, |p| p, |p| if p.x > 0.6 { f64::NAN } else { p.x });
    let field = mesh.to_field();
    assert_eq!(field.range().non_finite, 50);
    let mut function = function(&[(0.0, 1.0, 0.05), (1.0, 1.0, 0.05)]);
    let unit = |name: &str, low, high| BaseUnitRange { name: name.into(), range: [low, high] };
    function.base_units = vec![unit("a", 0.0, 0.25), unit("b", 0.25, 1.0)];
    let classifier = function.classifier(field.range()).unwrap();
    let camera = camera(DVec3::new(3.0, 0.51, 0.52), DVec3::new(0.0, 0.51, 0.52), 1);
    let alpha = |classifier: Classifier| {
        let marcher = MeshMarcher::new(&field, classifier, 0.5);
        f64::from(marcher.picture(&camera, Lighting::Unlit, Vec3::ZERO).pixels[0][3])
    };
    for (shown, length) in [(classifier.clone(), 0.5), (classifier.only(0), 0.25), (classifier.only(1), 0.25)] {
        let expected = correct_opacity(f64::from(0.05_f32), length, field.reference_length());
        assert!((alpha(shown) - expected).abs() < 1e-5, "{length}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_single_tetrahedron_has_the_length_between_its_faces(
        corners in prop::array::uniform4(prop::array::uniform3(-1.0..1.0_f64)),
        eye in prop::array::uniform3(-2.0..2.0_f64),
    ) {
        let corners = corners.map(DVec3::from_array);
        let eye = DVec3::from_array(eye);
        prop_assume!(eye.length() > 0.1);
        let values = MeshValues::Points(vec![0.5_f64; 4].into());
        let Ok(mesh) = Mesh::new(corners.to_vec(), vec![[0, 1, 2, 3]], values, None) else { return Ok(()) };
        let field = mesh.to_field();
        let classifier = classifier(&field, &[(0.0, 1.0, 0.1), (1.0, 1.0, 0.1)]);
        let camera = camera(eye, DVec3::ZERO, 16);
        let image = MeshMarcher::new(&field, classifier, 0.5).picture(&camera, Lighting::Unlit, Vec3::ZERO);
        let cell = field.cell(0);
        for (pixel, found) in image.pixels.iter().enumerate() {
            let (eye, direction) = ray(&camera, pixel);
            // The fraction of fine steps inside, by coordinates.
            let steps = 8000;
            let step = 6.0 / f64::from(steps);
            let inside = (0..steps).filter(|k| {
                let at = eye + direction * (f64::from(*k) + 0.5) * step;
                cell.coordinates(at - field.middle()).iter().all(|c| *c >= 0.0)
            });
            let length = inside.count() as f64 * step;
            let of = |length: f64| correct_opacity(f64::from(0.1_f32), length.max(0.0), field.reference_length());
            let found = f64::from(found[3]);
            prop_assert!(found >= of(length - 2.0 * step) - 1e-4 && found <= of(length + 2.0 * step) + 1e-4, "{found} {}", of(length));
        }
    }
}
