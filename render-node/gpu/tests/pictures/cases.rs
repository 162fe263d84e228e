//! Scenes and views that break renderers or need a part of the shading model. Every renderer is tested with all of
//! them.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Vec3};
use rand::RngExt;
use sg_scene::appearance::{Appearance, Clip, Overlay, PixelFilter, ShadingTerm, UnitAppearance};
use sg_scene::camera::{Camera, LightMode};
use sg_scene::mask::Mask;
use sg_scene::model::{Harmonics, Scene, ShadingModel};
use sg_scene::tone::Tone;

use crate::scenes::{
    Blob, any_rotation, around_the_eye, camera, cloud, fog, logit, scene, seeded, side_view, surface, uniform3, unit,
};

/// A picture to draw.
pub(crate) struct Case {
    /// The difficulty.
    pub(crate) name: &'static str,
    pub(crate) scene: Scene,
    pub(crate) appearance: Appearance,
    pub(crate) camera: Camera,
}

impl Case {
    fn of(name: &'static str, scene: Scene, camera: Camera) -> Self {
        let appearance = Appearance { background: camera.background(), ..Appearance::of(&scene) };
        Self { name, scene, appearance, camera }
    }

    fn blobs(name: &'static str, blobs: &[Blob], camera: Camera) -> Self {
        Self::of(name, scene(blobs), camera)
    }

    fn with(mut self, change: impl FnOnce(&mut Appearance)) -> Self {
        change(&mut self.appearance);
        self
    }
}

/// Every case, geometry first.
pub(crate) fn all() -> Vec<Case> {
    let mut list = geometry();
    list.extend(looks());
    list
}

/// Shapes, places, opacities and views.
fn geometry() -> Vec<Case> {
    let opaque: Vec<Blob> = cloud(5000, 12).iter().map(|b| Blob { logit: f32::INFINITY, ..*b }).collect();
    let faint: Vec<Blob> = cloud(5000, 13).iter().map(|b| Blob { logit: logit(0.003), ..*b }).collect();
    let points: Vec<Blob> = cloud(3000, 8).iter().map(|b| Blob { log_scale: Vec3::splat(-9.0), ..*b }).collect();
    let sizeless: Vec<Blob> =
        cloud(3000, 17).iter().map(|b| Blob { log_scale: Vec3::splat(f32::NEG_INFINITY), ..*b }).collect();
    let (far, there) = far_from_the_origin();
    let near = |near: f64, camera: Camera| Camera { near, ..camera };
    vec![
        Case::blobs("eye in a centre", &in_the_eye(Vec3::ZERO), camera(40.0, 64, 48)),
        Case::blobs("just beside the eye", &in_the_eye(Vec3::new(0.3, 0.02, 1e-4)), camera(40.0, 64, 48)),
        Case::blobs("just behind the eye", &in_the_eye(Vec3::new(0.1, 0.05, -0.12)), camera(40.0, 64, 48)),
        Case::blobs("huge around the eye", &huge_around_the_eye(), camera(40.0, 64, 48)),
        Case::blobs("disc edge-on in the eye", &edge_on(0.0), camera(40.0, 64, 48)),
        Case::blobs("disc just below the eye", &edge_on(0.01), near(0.02, camera(40.0, 64, 48))),
        Case::blobs("eye touches a surface", &touched_surface(), camera(40.0, 64, 48)),
        Case::blobs("eye touches a surface, near distance", &touched_surface(), near(0.05, camera(40.0, 64, 48))),
        Case::blobs("near distance in a cloud", &around_the_eye(cloud(2000, 21)), near(0.4, camera(40.0, 64, 48))),
        Case::blobs("all nearer than the near distance", &in_the_eye(Vec3::ZERO), near(30.0, camera(40.0, 33, 20))),
        Case::blobs("near distance, 140 degrees", &around_the_eye(cloud(3000, 25)), near(0.02, camera(24.0, 160, 132))),
        Case::blobs("near distance, points beside the axis", &beside_the_axis(), near(0.01, camera(30.0, 160, 120))),
        Case::blobs("near distance, order changes over", &layers_at_all_distances(), near(0.01, camera(60.0, 120, 90))),
        Case::blobs("needles", &needles(), side_view(200, 150, 40.0)),
        Case::blobs("needle far from its centre", &[distant_needle()], camera(100.0, 64, 64)),
        Case::blobs("sub-pixel", &points, side_view(120, 90, 40.0)),
        Case::blobs("no size", &sizeless, side_view(120, 90, 40.0)),
        Case::blobs("huge", &huge(), camera(80.0, 40, 30)),
        Case::blobs("not numbers", &not_numbers(), camera(80.0, 33, 33)),
        Case::blobs("quaternions of any length", &quaternions(), camera(80.0, 65, 65)),
        Case::blobs("eye inside and near plane", &near_plane(), camera(40.0, 64, 48)),
        Case::blobs("110 degrees", &cloud(5000, 10), side_view(240, 180, 110.0)),
        Case::blobs("one depth", &one_depth(), camera(80.0, 120, 90)),
        Case::blobs("opacity 1", &opaque, side_view(160, 120, 40.0)),
        Case::blobs("all below 1/255", &faint, side_view(160, 120, 40.0)),
        Case::blobs("thousand layers", &thousand_layers(), camera(80.0, 65, 65)),
        Case::blobs("thousand-layer cloud", &fog(3000, 0.01, 14), side_view(100, 80, 30.0)),
        Case::blobs("offset 1e6", &far, there),
        Case::blobs("one", &[Blob::default()], camera(80.0, 33, 20)),
        Case::blobs("behind the eye", &[Blob { position: Vec3::NEG_Z, ..Blob::default() }], side_view(33, 20, 40.0)),
        Case::blobs("none", &[], side_view(33, 20, 40.0)),
        Case::of("no unit", Scene::compose(vec![], None), side_view(33, 20, 40.0)),
        Case::blobs("mixture of extremes", &extremes(), camera(20.0, 40, 30)),
    ]
}

/// Everything that edits and files change in how Gaussians look.
fn looks() -> Vec<Case> {
    let view = || side_view(120, 90, 40.0);
    let model = |name, model| Case::of(name, shaded(model), view());
    let mut list = vec![
        model("paper", ShadingModel::Paper),
        model("ivrgs-train", ShadingModel::IvrgsTrain),
        model("ivrgs-viewer", ShadingModel::IvrgsViewer),
        model("directional light", ShadingModel::Paper).with(|a| {
            a.light.mode = LightMode::Direction;
            a.light.direction = [0.4, -2.0, -1.0];
            (a.light.ka, a.light.kd, a.light.ks, a.light.shininess) = (0.5, 1.5, 2.0, 0.5);
            a.base[0].multipliers = [1.5, 0.5, 1.0, 2.0];
        }),
        Case::of("two moved units", two_moved_units(), view()),
        Case::of("two moved units, palettes and opacities", two_moved_units(), view()).with(|a| {
            (a.base[0].palette, a.base[0].opacity) = (Vec3::new(0.9, 0.1, 0.3), 0.25);
            (a.base[1].palette, a.base[1].opacity) = (Vec3::new(0.0, 0.6, 0.2), 4.0);
        }),
        model("units", ShadingModel::Paper).with(|a| a.units = overlapping_units()),
        model("highlight", ShadingModel::Paper).with(|a| {
            a.overlay =
                Some(Overlay { mask: every(3000, 3), color: Vec3::new(0.337, 0.706, 0.914), mix: 0.6, opacity: 1.5 });
        }),
        model("highlight that fades", ShadingModel::Paper).with(|a| {
            a.overlay = Some(Overlay { mask: every(3000, 2), color: Vec3::ONE, mix: 1.0, opacity: 0.1 });
        }),
        model("clip planes", ShadingModel::Paper).with(|a| {
            a.clips = vec![
                Clip::plane(DVec3::new(0.0, 0.1, 3.0), DVec3::new(0.3, 1.0, -0.2)),
                Clip::plane(DVec3::new(0.4, 0.0, 3.0), DVec3::new(-5.0, 0.0, 1.0)),
            ];
        }),
        model("clip boxes", ShadingModel::Paper).with(|a| {
            a.clips = vec![
                Clip::between(DVec3::new(-0.7, -0.7, 2.2), DVec3::new(0.9, 0.7, 4.0), true),
                Clip::between(DVec3::new(-0.3, -0.9, 2.0), DVec3::new(0.2, 0.1, 3.1), false),
            ];
        }),
        model("occlusion, units", ShadingModel::Paper).with(|a| {
            a.occlusion = Some((0..3000).map(|i| (i % 11) as f32 / 10.0).collect());
            a.units = overlapping_units();
        }),
        model("occlusion under shown colours", ShadingModel::Paper).with(|a| {
            a.occlusion = Some((0..3000).map(|_| 0.1).collect());
            a.colors = Some((0..3000).map(|i| Vec3::new(0.2, i as f32 / 3000.0, 0.7)).collect());
        }),
        model("compensated filter", ShadingModel::Paper).with(|a| a.filter = PixelFilter::Compensated),
        model("shown colours", ShadingModel::Paper).with(|a| {
            a.colors = Some((0..3000).map(|i| Vec3::new(i as f32 / 3000.0, 0.5, (i % 7) as f32 / 7.0)).collect());
            a.units = overlapping_units();
        }),
    ];
    for (name, term) in [
        ("normals", ShadingTerm::Normal),
        ("ambient term", ShadingTerm::Ambient),
        ("diffuse term", ShadingTerm::Diffuse),
        ("specular term", ShadingTerm::Specular),
    ] {
        list.push(model(name, ShadingModel::Paper).with(|a| a.term = term));
    }
    for (name, degree) in [
        ("harmonics of degree 0", 0),
        ("harmonics of degree 1", 1),
        ("harmonics of degree 2", 2),
        ("harmonics of degree 3", 3),
    ] {
        list.push(Case::of(name, harmonics(degree), view()));
    }
    let recolored = harmonics(2);
    let all = every(recolored.len(), 2);
    list.push(Case::of("harmonics, another palette", harmonics(2), view()).with(|a| {
        a.base[0].palette = Vec3::new(0.24, 0.83, 0.24);
    }));
    list.push(Case::of("harmonics, recoloured", recolored, view()).with(|a| {
        let color = Some(Vec3::new(0.83, 0.24, 0.24));
        a.units = vec![UnitAppearance { mask: all, color, opacity: 0.8, visible: true, tone: Tone::NEUTRAL }];
    }));
    let tone = |saturation, brightness, temperature| Tone { saturation, brightness, temperature };
    let toned = |n: usize| {
        let plain =
            |step, tone| UnitAppearance { mask: every(n, step), color: None, opacity: 1.0, visible: true, tone };
        let red = Some(Vec3::new(0.83, 0.24, 0.24));
        let painted = UnitAppearance { color: red, ..plain(5, tone(0.4, 1.3, -0.5)) };
        // Where they overlap their tones are one.
        vec![plain(2, tone(0.25, 1.4, 0.6)), plain(3, tone(2.5, 0.7, -0.3)), painted]
    };
    let trained = harmonics(3);
    let units = toned(trained.len());
    list.push(Case::of("harmonics, other tones", trained, view()).with(|a| a.units = units));
    for (name, shading) in [("other tones", ShadingModel::Paper), ("other tones, two sides", ShadingModel::IvrgsTrain)]
    {
        list.push(model(name, shading).with(|a| a.units = toned(3000)));
    }
    list
}

fn needles() -> Vec<Blob> {
    let mut rng = seeded(7);
    (0..400)
        .map(|_| Blob {
            position: uniform3(&mut rng, -1.0, 1.0) + Vec3::new(0.0, 0.0, 3.0),
            log_scale: Vec3::new(3.0_f32.ln(), 3e-4_f32.ln(), 3e-4_f32.ln()),
            rotation: any_rotation(&mut rng),
            logit: logit(0.7),
            color: uniform3(&mut rng, 0.0, 1.0),
        })
        .collect()
}

/// Why a tile's offset is taken in f64: this needle passes through the picture 10⁵ px from its centre.
fn distant_needle() -> Blob {
    let tilt = 0.3_f32;
    Blob {
        position: Vec3::new(2000.0 * tilt.cos(), 2000.0 * tilt.sin(), 2.0),
        log_scale: Vec3::new(800.0_f32.ln(), -20.0, -20.0),
        rotation: [(0.5 * tilt).cos(), 0.0, 0.0, (0.5 * tilt).sin()],
        logit: 30.0,
        ..Blob::default()
    }
}

fn huge() -> Vec<Blob> {
    let size = |size: f32| Blob { log_scale: Vec3::splat(size.ln()), logit: logit(0.3), ..Blob::default() };
    vec![size(1e6), size(1e20), size(1e38), Blob::default()]
}

/// Gaussians with an attribute that is not finite.
pub(crate) fn broken() -> [Blob; 10] {
    let good = Blob::default();
    let nan = f32::NAN;
    [
        Blob { position: Vec3::new(nan, 0.0, 2.0), ..good },
        Blob { position: Vec3::new(0.0, f32::INFINITY, 2.0), ..good },
        Blob { log_scale: Vec3::new(0.0, nan, 0.0), ..good },
        Blob { log_scale: Vec3::splat(f32::INFINITY), ..good },
        Blob { log_scale: Vec3::splat(700.0), ..good },
        Blob { rotation: [nan, 0.0, 0.0, 1.0], ..good },
        Blob { rotation: [f32::INFINITY, 0.0, 0.0, 1.0], ..good },
        Blob { logit: nan, ..good },
        Blob { color: Vec3::new(0.0, nan, 0.0), ..good },
        Blob { color: Vec3::new(0.0, f32::INFINITY, 0.0), ..good },
    ]
}

/// Those and a good one.
pub(crate) fn not_numbers() -> Vec<Blob> {
    let mut all = broken().to_vec();
    all.insert(4, Blob::default());
    all
}

/// One direction at lengths from 10⁻³⁰ to 10³⁰, and none.
fn quaternions() -> Vec<Blob> {
    [0.0, 1e-30_f32, 0.01, 1.0, 7.0, 1e30]
        .into_iter()
        .enumerate()
        .map(|(k, length)| Blob {
            position: Vec3::new(0.2 * k as f32 - 0.5, 0.3 * (k % 2) as f32, 2.0),
            log_scale: Vec3::new(-1.5, -3.0, -4.0),
            rotation: [0.5 * length; 4],
            ..Blob::default()
        })
        .collect()
}

/// 400 faint ones around the eye, then six pairs before, on and behind the near plane.
pub(crate) fn near_plane() -> Vec<Blob> {
    let mut blobs = around_the_eye(fog(400, 0.01, 9));
    for z in [1e-3, 1e-5, 2e-6, 1e-6, 0.0, -1e-3] {
        blobs.push(Blob { position: Vec3::new(0.0, 0.0, z), logit: logit(0.03), ..Blob::default() });
        blobs.push(Blob { position: Vec3::new(1e-3, 2e-3, z), logit: logit(0.02), ..Blob::default() });
    }
    blobs
}

/// One Gaussian at a place close to the eye, and some far ahead.
fn in_the_eye(position: Vec3) -> Vec<Blob> {
    let mut blobs = cloud(300, 22);
    blobs.push(Blob { position, log_scale: Vec3::new(-2.3, -1.9, -2.9), logit: logit(0.8), ..Blob::default() });
    blobs
}

fn huge_around_the_eye() -> Vec<Blob> {
    let mut blobs = in_the_eye(Vec3::new(0.0, 0.0, 2.0));
    let of = |size: f32, x: f32, z: f32, color| Blob {
        position: Vec3::new(x, 0.0, z),
        log_scale: Vec3::splat(size.ln()),
        logit: logit(0.4),
        color,
        ..Blob::default()
    };
    blobs.push(of(20.0, 1.0, 2.0, Vec3::X));
    blobs.push(of(3.0, 2.0, 1.0, Vec3::Y));
    blobs
}

/// A thin disc whose plane runs through the eye or `below` it.
fn edge_on(below: f32) -> Vec<Blob> {
    let mut blobs = in_the_eye(Vec3::new(0.0, 0.0, 2.5));
    blobs.push(Blob {
        position: Vec3::new(0.1, below, 0.4),
        log_scale: Vec3::new(-1.0, -8.0, -1.0),
        logit: logit(0.9),
        ..Blob::default()
    });
    blobs
}

/// A wall of discs before the eye, a floor beneath it, and both closer than a disc is wide.
fn touched_surface() -> Vec<Blob> {
    let mut rng = seeded(23);
    let mut blobs = cloud(300, 24);
    for _ in 0..1500 {
        let at = uniform3(&mut rng, -1.0, 1.0);
        let color = uniform3(&mut rng, 0.0, 1.0);
        let disc = Blob { log_scale: Vec3::new(-3.0, -3.0, -6.0), logit: logit(0.6), color, ..Blob::default() };
        blobs.push(Blob { position: Vec3::new(at.x, at.y, 0.03 + 0.002 * at.z), logit: logit(0.3), ..disc });
        let lying = Vec3::new(-3.0, -6.0, -3.0);
        blobs.push(Blob { position: Vec3::new(at.x, 0.03 + 0.002 * at.y, 0.5 * at.z), log_scale: lying, ..disc });
    }
    blobs
}

/// Points and thin discs all around, most outside the picture and many nearly beside the eye, where the dilation by angle is
/// largest.
pub(crate) fn beside_the_axis() -> Vec<Blob> {
    let mut rng = seeded(26);
    let of = |(k, at): (usize, Vec3)| {
        let thin = if k % 3 == 0 { Vec3::new(-4.0, -9.0, -4.0) } else { Vec3::splat(-9.0) };
        let color = 0.5 + 0.5 * at;
        Blob { position: Vec3::new(3.0 * at.x, 3.0 * at.y, at.z.abs()), log_scale: thin, color, ..Blob::default() }
    };
    (0..6000).map(|_| uniform3(&mut rng, -1.0, 1.0)).enumerate().map(of).collect()
}

/// Gaussians from a near distance to a thousand away, crossing where the order changes from distance to view z.
fn layers_at_all_distances() -> Vec<Blob> {
    let mut rng = seeded(27);
    let of = |(k, at): (usize, Vec3)| {
        let distance = 0.01 * 1000_f32.powf(k as f32 / 2000.0);
        let size = (0.03 * distance).ln() + at.z;
        Blob {
            position: distance * Vec3::new(at.x, 0.8 * at.y, 1.0),
            log_scale: Vec3::new(size, size - 1.0, size - 2.0),
            rotation: [at.x, at.y, at.z, 0.5],
            color: 0.5 + 0.5 * at,
            logit: logit(0.4),
        }
    };
    (0..2000).map(|_| uniform3(&mut rng, -1.0, 1.0)).enumerate().map(of).collect()
}

pub(crate) fn one_depth() -> Vec<Blob> {
    cloud(3000, 11).iter().map(|b| Blob { position: Vec3::new(b.position.x, b.position.y, 3.0), ..*b }).collect()
}

pub(crate) fn thousand_layers() -> Vec<Blob> {
    (0..1000)
        .map(|k| Blob {
            position: Vec3::new(0.0, 0.0, 2.0 + 0.001 * k as f32),
            log_scale: Vec3::splat(-1.0),
            logit: logit(0.004),
            color: if k % 2 == 0 { Vec3::ONE } else { Vec3::X },
            ..Blob::default()
        })
        .collect()
}

/// Where [`far_from_the_origin`] is.
pub(crate) const FAR: Vec3 = Vec3::new(1_048_576.0, -1_048_576.0, 524_288.0);

/// Positions in steps of 1/8, and their camera. Such positions are exact in f32 at [`FAR`] as well.
pub(crate) fn on_a_lattice() -> (Vec<Blob>, Camera) {
    let blobs = cloud(2000, 15)
        .iter()
        .map(|b| Blob { position: (b.position * 64.0).round() / 8.0, log_scale: b.log_scale + 2.0, ..*b })
        .collect();
    (blobs, lattice_view(DVec3::ZERO))
}

fn lattice_view(offset: DVec3) -> Camera {
    // No direction along which the lattice of positions has planes: equal depths would be ordered by rounding.
    let (eye, target) = (DVec3::new(10.371, -6.213, 2.137), DVec3::new(0.0, 0.0, 24.0));
    Camera::look_at(eye + offset, target + offset, DVec3::NEG_Y, 40.0, 160, 120)
}

/// Why positions become relative to the camera in f64: narrowed first, nothing of this picture would be left.
pub(crate) fn far_from_the_origin() -> (Vec<Blob>, Camera) {
    let (near, _) = on_a_lattice();
    let far = near.iter().map(|b| Blob { position: b.position + FAR, ..*b }).collect();
    (far, lattice_view(FAR.as_dvec3()))
}

fn extremes() -> Vec<Blob> {
    let mut rng = seeded(16);
    (0..500)
        .map(|_| {
            let mut extreme = || match rng.random_range(0..8) {
                0 => 0.0,
                1 => f32::MIN_POSITIVE,
                2 => 1e-30,
                3 => 3e38,
                4 => -1e-3,
                5 => 80.0,
                6 => -100.0,
                _ => 1.5,
            };
            Blob {
                position: Vec3::new(extreme(), extreme(), extreme()),
                log_scale: Vec3::new(extreme(), extreme(), extreme()),
                rotation: std::array::from_fn(|_| extreme()),
                logit: extreme(),
                color: Vec3::new(extreme(), extreme(), extreme()),
            }
        })
        .collect()
}

/// A surface of 3000 Gaussians with all shading attributes.
fn shaded(model: ShadingModel) -> Scene {
    let blobs = surface(3000, 18);
    let mut one = unit("shaded", &blobs);
    one.palette = Vec3::new(0.2, 0.3, 0.1);
    one.shading = model;
    if let Some(shading) = one.gaussians.shading.as_mut() {
        let n = blobs.len();
        let middle = Vec3::new(0.0, 0.0, 3.0);
        shading.normal = blobs.iter().map(|b| (b.position - middle).normalize_or_zero()).collect();
        shading.offset_color = blobs.iter().map(|b| 0.5 * b.color).collect();
        shading.ambient = vec![0.3; n];
        shading.diffuse = (0..n).map(|i| 0.4 + 0.3 * (i % 3) as f32).collect();
        shading.specular = (0..n).map(|i| if i % 5 == 0 { 0.0 } else { 0.4 }).collect();
        shading.shininess = (0..n).map(|i| [0.0, 1.0, 8.0, 60.0][i % 4]).collect();
    }
    Scene::compose(vec![one], None)
}

/// A sheared lit unit and a turned one of harmonics.
fn two_moved_units() -> Scene {
    let mut first = shaded(ShadingModel::Paper).units.remove(0);
    let shear =
        DMat4::from_cols_array(&[1.0, 0.2, 0.0, 0.0, 0.1, 0.8, 0.0, 0.0, 0.0, 0.0, 1.1, 0.0, 0.1, 0.0, -0.2, 1.0]);
    first.transform = shear;
    let mut second = harmonics(3).units.remove(0);
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
    let middle = DVec3::new(0.0, 0.0, 3.0);
    second.transform = DMat4::from_translation(middle)
        * DMat4::from_scale_rotation_translation(DVec3::splat(0.7), turn, DVec3::new(0.6, 0.0, 0.0))
        * DMat4::from_translation(-middle);
    Scene::compose(vec![first, second], None)
}

fn harmonics(degree: u8) -> Scene {
    let blobs = surface(2000, 19);
    let mut one = unit("harmonics", &blobs);
    one.gaussians.shading = None;
    let mut rng = seeded(20);
    let mut colors =
        Harmonics { degree, dc: blobs.iter().map(|b| (3.0 * (b.color - 0.5)).to_array()).collect(), rest: Vec::new() };
    let rows = blobs.len() * colors.rest_per_gaussian();
    colors.rest = (0..rows).map(|_| uniform3(&mut rng, -0.4, 0.4).to_array()).collect();
    one.gaussians.harmonics = Some(colors);
    Scene::compose(vec![one], None)
}

fn every(n: usize, step: usize) -> Arc<Mask> {
    Arc::new(Mask::from_fn(n, |i| i % step == 0))
}

/// A red one, a faded one over part of it, a hidden one.
fn overlapping_units() -> Vec<UnitAppearance> {
    let unit = |step, color, opacity, visible| UnitAppearance {
        mask: every(3000, step),
        color,
        opacity,
        visible,
        tone: Tone::NEUTRAL,
    };
    vec![unit(2, Some(Vec3::X), 1.0, true), unit(3, None, 0.2, true), unit(7, None, 1.0, false)]
}
