//! Ray marching against fields that are known everywhere: a homogeneous sphere with its closed form, and the signal of
//! Marschner and Lobb (1994, "An evaluation of reconstruction filters for volume rendering", section 4).

use std::f64::consts::PI;

use glam::{DMat3, DMat4, DVec3, Vec3};

use super::{
    ClipRegion, HalfSpace, Illumination, Lighting, Material, Pinhole, RayMarcher, VolumeRenderer as _, intersect_box,
};
use crate::grid::Grid;
use crate::opacity::correct_opacity;
use crate::surfaceness::Surfaceness;
use crate::transfer::{ControlPoint, Scale, TransferFunction, Units};
use crate::volume::Volume;
use crate::{Classifier, Field};

/// A camera that looks from `eye` to the origin, with a vertical field of view of 45°.
fn looking_from(eye: DVec3, size: usize) -> Pinhole {
    let ahead = -eye.normalize();
    let right = ahead.cross(DVec3::Z).normalize();
    let axes = DMat3::from_cols(right, ahead.cross(right), ahead).transpose();
    let focal = 0.5 * size as f64 / (PI / 8.0).tan();
    Pinhole {
        width: size,
        height: size,
        focal: [focal; 2],
        center: [0.5 * size as f64; 2],
        world_to_camera: DMat4::from_mat3(axes) * DMat4::from_translation(-eye),
    }
}

/// The unit direction of each pixel's ray, row by row.
fn directions(camera: &Pinhole) -> impl Iterator<Item = DVec3> {
    let to_world = camera.world_to_camera.inverse();
    (0..camera.width * camera.height).map(move |i| {
        let at = |k: usize, axis: usize| (k as f64 + 0.5 - camera.center[axis]) / camera.focal[axis];
        let (x, y) = (at(i % camera.width, 0), at(i / camera.width, 1));
        to_world.transform_vector3(DVec3::new(x, y, 1.0)).normalize()
    })
}

/// `n`³ values of a function over the cube from −`half` to `half`.
fn sampled(n: usize, half: f64, of: impl Fn(DVec3) -> f64) -> Field {
    let spacing = DVec3::splat(2.0 * half / (n - 1) as f64);
    let grid = Grid::new([n; 3], spacing, DVec3::splat(-half), DMat3::IDENTITY).unwrap();
    let values: Vec<f32> = (0..grid.len()).map(|i| of(grid.to_world(grid.voxel(i).as_dvec3())) as f32).collect();
    Volume::new(grid, values.into(), None).unwrap().to_field()
}

fn function(domain: [f64; 2], points: &[(f64, Vec3, f64)]) -> TransferFunction {
    let point = |&(value, color, opacity): &(f64, Vec3, f64)| ControlPoint {
        value,
        color: color.to_array(),
        opacity: opacity as f32,
    };
    let points = points.iter().map(point).collect();
    TransferFunction { domain, units: Units::Raw, scale: Scale::Linear, variable: None, points, base_units: Vec::new() }
}

#[test]
fn a_homogeneous_sphere_has_the_transmittance_of_its_chords() {
    let (radius, opacity) = (16.0, 0.05_f32);
    let field = sampled(49, 24.0, |at| radius - at.length());
    let edge = [(0.0, Vec3::ONE, 0.0), (1e-4, Vec3::ONE, f64::from(opacity))];
    let classifier = function([-20.0, 20.0], &edge).classifier(field.range()).unwrap();
    let eye = DVec3::new(10.0, -50.0, 20.0);
    let camera = looking_from(eye, 40);
    let reference = field.grid().reference_length();
    let coverage = |chord: f64| correct_opacity(f64::from(opacity), chord.max(0.0), reference);
    let chord = |radius: f64, nearest: f64| 2.0 * (radius * radius - nearest * nearest).max(0.0).sqrt();
    // Between voxels the distance is taken for straight, which makes the sphere smaller by up to 1/64 of a voxel.
    let inner = radius - 1.0 / 64.0;
    for step in [1.0, 0.5, 0.125] {
        let marcher = RayMarcher::new(&field, classifier.clone(), step);
        for picture in [
            marcher.picture(&camera, Lighting::Unlit, Vec3::ZERO),
            marcher.fast_picture(&camera, Lighting::Unlit, Vec3::ZERO),
        ] {
            let (mut error, mut pixels) = (0.0, 0.0);
            for (direction, pixel) in directions(&camera).zip(&picture.pixels) {
                let nearest = (eye + direction * -eye.dot(direction)).length();
                // The ends lie anywhere between two samples.
                let least = coverage(chord(inner, nearest) - step) - 1e-5;
                let most = if nearest < radius { coverage(chord(radius, nearest) + step) + 1e-5 } else { 0.0 };
                let found = f64::from(pixel[3]);
                assert!((least..=most).contains(&found), "step {step}, {nearest}: {least} {found} {most}");
                if nearest < radius {
                    error += (found - coverage(chord(radius, nearest))).abs();
                    pixels += 1.0;
                }
            }
            assert!(pixels > 500.0 && error / pixels < 0.002 + 0.008 * step, "{step}: {}", error / pixels);
        }
    }
}

/// ρ of Marschner and Lobb with f_M = 6 and α = ¼, from 0 to 1.
fn marschner_lobb(at: DVec3) -> f64 {
    let ripple = (2.0 * PI * 6.0 * (0.5 * PI * at.truncate().length()).cos()).cos();
    (1.0 - (0.5 * PI * at.z).sin() + 0.25 * (1.0 + ripple)) / (2.0 * 1.25)
}

const MATERIAL: Material = Material { specular: 0.0, ..Material::STANDARD };

/// Half of the cube that is drawn.
const SHOWN: f64 = 0.9;

/// Length between two samples.
const STEP: f64 = 0.01;

/// The picture of the signal itself, marched by the rules of this module.
fn picture_of_the_signal(field: &Field, classifier: &Classifier, camera: &Pinhole, light: DVec3) -> Vec<[f32; 4]> {
    let reference = field.grid().reference_length();
    let surfaceness = Surfaceness::new(field, classifier);
    let eye = camera.world_to_camera.inverse().transform_point3(DVec3::ZERO);
    let slope = |at: DVec3| {
        let along = |axis: DVec3| (marschner_lobb(at + 1e-5 * axis) - marschner_lobb(at - 1e-5 * axis)) / 2e-5;
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    };
    let of_ray = |direction: DVec3| {
        let (mut color, mut transmittance) = (DVec3::ZERO, 1.0);
        let box_of = (DVec3::splat(-SHOWN), DVec3::splat(SHOWN));
        if let Some((near, far)) = intersect_box(eye, direction, box_of.0, box_of.1) {
            for k in 0..((far - near) / STEP).ceil() as usize {
                let from = near + k as f64 * STEP;
                let length = STEP.min(far - from);
                let at = eye + direction * (from + 0.5 * length);
                let value = marschner_lobb(at);
                let (own, opacity) = classifier.evaluate(value);
                let alpha = correct_opacity(f64::from(opacity), length, reference);
                let slope = slope(at);
                let facing = -slope.normalize_or_zero().dot(light);
                let material = MATERIAL.with_surfaceness(surfaceness.at(value, slope.length() as f32));
                let shade = f64::from(material.ambient) + f64::from(material.diffuse) * facing.max(0.0);
                color += transmittance * alpha * (shade * own.as_dvec3()).clamp(DVec3::ZERO, DVec3::ONE);
                transmittance *= 1.0 - alpha;
            }
        }
        [color.x, color.y, color.z, 1.0 - transmittance].map(|value| value as f32)
    };
    directions(camera).map(of_ray).collect()
}

/// The signal lies just below the highest frequency that 41³ samples hold. With twice the samples, what interpolation and
/// central differences leave falls to a quarter.
#[test]
fn the_signal_of_marschner_and_lobb_is_met_to_second_order() {
    let camera = looking_from(DVec3::new(0.8, -1.6, 2.2), 48);
    let light = DVec3::new(0.3, -0.5, 0.8).normalize();
    let lighting = Lighting::Lit(MATERIAL, Illumination::Direction(light.as_vec3()));
    let mut errors = Vec::new();
    for n in [41, 81, 161] {
        let field = sampled(n, 1.0, marschner_lobb);
        let reference = field.grid().reference_length();
        let over = |opacity: f64| correct_opacity(opacity, reference, 0.05);
        let layer = [
            (0.35, Vec3::new(1.0, 0.3, 0.1), 0.0),
            (0.5, Vec3::new(0.9, 0.9, 0.2), over(0.5)),
            (0.65, Vec3::new(0.1, 0.4, 1.0), 0.0),
        ];
        let classifier = function([0.0, 1.0], &layer).classifier(field.range()).unwrap();
        let want = picture_of_the_signal(&field, &classifier, &camera, light);
        let sides = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
        let sides = sides.map(|normal| HalfSpace { normal, offset: -SHOWN }).collect();
        let marcher = RayMarcher::new(&field, classifier, STEP / field.grid().spacing().x)
            .clipped(vec![ClipRegion { sides, keeps_inside: true }]);
        let pictures =
            [marcher.picture(&camera, lighting, Vec3::ZERO), marcher.fast_picture(&camera, lighting, Vec3::ZERO)];
        errors.push(pictures.map(|picture| {
            let differences = picture.pixels.as_flattened().iter().zip(want.as_flattened()).map(|(a, b)| a - b);
            let squares: f32 = differences.map(|d| d * d).sum();
            (squares / picture.pixels.as_flattened().len() as f32).sqrt()
        }));
        assert!(want.iter().filter(|pixel| pixel[3] > 0.3).count() > 500, "nothing to see");
    }
    for [coarse, middle, fine] in [0, 1].map(|twin| [0, 1, 2].map(|k| errors[k][twin])) {
        assert!(coarse < 0.09 && middle < coarse / 3.5 && fine < middle / 3.5, "{errors:?}");
    }
}
