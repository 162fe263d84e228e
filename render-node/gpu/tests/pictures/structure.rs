//! Views of the structure: colours of clusters, outlines, maps of attributes.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Vec3};
use sg_raster::attributes::{Attribute, AttributeError, attribute_colors};
use sg_raster::color_map::ColorMap;
use sg_raster::outline::{OutlineStyle, draw_outlines};
use sg_raster::pick::{SURFACE, front_ids};
use sg_raster::render::{Projection, Quality, render};
use sg_raster::structure::{ClusterColoring, NO_CLUSTER, cluster_colors};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::scenes::{Blob, camera, logit, scene, surface, unit};

/// A surface cut into cells of a lattice, far more than there are colours.
fn cells(n: usize) -> (Scene, Vec<u32>) {
    let scene = scene(&surface(n, 41));
    let labels = (0..n)
        .map(|i| {
            let cell = (scene.position(i).unwrap() / 0.2).floor().as_ivec3();
            // Labels with gaps, in no order.
            (cell.x.rem_euclid(32) + 32 * cell.y.rem_euclid(32) + 1024 * cell.z.rem_euclid(32)) as u32 * 7 % 30_011
        })
        .collect();
    (scene, labels)
}

#[test]
fn neighbours_have_colours_that_everybody_tells_apart() {
    let (scene, labels) = cells(6000);
    let random = |seed| cluster_colors(&scene, &labels, ClusterColoring::Random { seed }).unwrap();
    let colors = random(3);
    assert_eq!(colors, random(3), "a seed gives its colours");
    assert_ne!(colors, random(4));
    let mut clusters = labels.clone();
    clusters.sort_unstable();
    clusters.dedup();
    assert!(clusters.len() > 150, "{}", clusters.len());
    let mut differing = 0;
    for i in 0..scene.len() {
        for j in i + 1..scene.len() {
            let close = scene.position(i).unwrap().distance(scene.position(j).unwrap()) < 0.02;
            if labels[i] == labels[j] {
                assert_eq!(colors[i], colors[j]);
            } else if close {
                assert!(colors[i].distance(colors[j]) > 0.1, "{i} {j}: {} {}", colors[i], colors[j]);
                differing += 1;
            }
        }
    }
    assert!(differing > 100, "{differing}");
    let some = cluster_colors(&scene, &vec![NO_CLUSTER; 6000], ClusterColoring::Random { seed: 1 }).unwrap();
    assert!(some.iter().all(|c| *c == ColorMap::MISSING));
    assert!(cluster_colors(&scene, &labels[1..], ClusterColoring::Random { seed: 1 }).is_err());
}

#[test]
fn the_first_component_runs_from_end_to_end() {
    let row: Vec<Blob> = (0..40)
        .map(|i| Blob { position: Vec3::new(0.1 * i as f32, 0.01 * (i % 3) as f32, 2.0), ..Blob::default() })
        .collect();
    let scene = scene(&row);
    let labels: Vec<u32> = (0..40).map(|i| if i == 7 { NO_CLUSTER } else { 900 - i / 4 }).collect();
    let colors = cluster_colors(&scene, &labels, ClusterColoring::FirstComponent(ColorMap::Cividis)).unwrap();
    assert_eq!((colors[0], colors[39]), (ColorMap::Cividis.at(0.0), ColorMap::Cividis.at(1.0)));
    assert_eq!(colors[7], ColorMap::MISSING);
    assert!((4..36).step_by(4).all(|i| colors[i as usize].y < colors[i as usize + 4].y), "brighter along x");
}

#[test]
fn outlines_lie_where_the_front_cluster_changes() {
    // Two opaque discs side by side before a third that shows all around them.
    let disc = |x: f32, z: f32, size: f32| Blob {
        position: Vec3::new(x, 0.0, z),
        log_scale: Vec3::new(size.ln(), size.ln(), -8.0),
        logit: 30.0,
        color: Vec3::splat(0.5),
        ..Blob::default()
    };
    let scene = scene(&[disc(-0.4, 2.0, 0.25), disc(0.4, 2.0, 0.25), disc(0.0, 4.0, 30.0)]);
    let look = Appearance::of(&scene);
    let camera = camera(40.0, 64, 48);
    let (front, _) = front_ids(&scene, &look, &camera, Projection::Affine, SURFACE).unwrap();
    let plain = render(&scene, &look, &camera, Quality::Standard).unwrap().image;
    let style = OutlineStyle { color: Vec3::X, width: 1 };
    let lined = |labels: &[u32], style| {
        let mut image = plain.clone();
        draw_outlines(&mut image, &front, labels, style).unwrap();
        image
    };
    assert_eq!(lined(&[5, 5, 5], style), plain, "one cluster has no outline");
    for labels in [[1, 2, 3], [1, 1, 3], [1, 2, NO_CLUSTER]] {
        let image = lined(&labels, style);
        let label = |x, y| front.at(x, y).map(|i| labels[i as usize]).filter(|l| *l != NO_CLUSTER);
        let mut lines = 0;
        for y in 0..48 {
            for x in 0..64 {
                let changes = (x < 63 && label(x, y) != label(x + 1, y)) || (y < 47 && label(x, y) != label(x, y + 1));
                let want = if changes { [1.0, 0.0, 0.0, 1.0] } else { plain.pixel(x, y).unwrap() };
                assert_eq!(image.pixel(x, y).unwrap(), want, "{x},{y}");
                lines += usize::from(changes);
            }
        }
        assert!((40..400).contains(&lines), "{lines}");
        let thick = lined(&labels, OutlineStyle { width: 3, ..style });
        let red = thick.pixels().filter(|p| *p == [1.0, 0.0, 0.0, 1.0]).count();
        assert!(red > 2 * lines && red < 4 * lines, "{red} of {lines}");
    }
    let mut other = render(&scene, &look, &Camera { width: 63, ..camera }, Quality::Fast).unwrap().image;
    assert!(draw_outlines(&mut other, &front, &[1, 2, 3], style).is_err());
}

#[test]
fn attributes_by_hand() {
    let blob =
        |scale: Vec3, opacity: f32| Blob { log_scale: scale.map(f32::ln), logit: logit(opacity), ..Blob::default() };
    let mut one = unit("one", &[blob(Vec3::new(0.1, 0.1, 0.8), 0.25), blob(Vec3::splat(0.4), 0.75)]);
    // Twice as large, z to x.
    let turn = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    one.transform = DMat4::from_scale_rotation_translation(DVec3::splat(2.0), turn, DVec3::ONE);
    one.gaussians.shading.as_mut().unwrap().normal = vec![Vec3::Z, Vec3::ZERO];
    let mut plain = unit("plain", &[blob(Vec3::splat(0.0), 0.5)]);
    plain.gaussians.shading = None;
    let scene = Scene::compose(vec![one, plain], None);
    let of = |attribute, range| attribute_colors(&scene, attribute, ColorMap::Viridis, range).unwrap();
    let at = |t: f64| ColorMap::Viridis.at(t);
    let near = |got: Vec3, want: Vec3| assert!(got.distance(want) < 1e-5, "{got} {want}");
    // ∛(0.2·0.2·1.6) = 0.4, and 0.8; a point is below every range.
    let scale = of(Attribute::Scale, Some((0.2, 3.2)));
    near(scale.colors[0], at(0.25));
    near(scale.colors[1], at(0.5));
    near(scale.colors[2], at(0.0));
    let legend = scale.legend.unwrap();
    assert!((legend.low, legend.high, legend.logarithmic) == (0.2, 3.2, true));
    let own = of(Attribute::Scale, None).legend.unwrap();
    assert!((own.low - 0.4).abs() < 1e-6 && (own.high - 0.8).abs() < 1e-6, "{own:?}");
    let thin = of(Attribute::Anisotropy, Some((1.0, 64.0)));
    near(thin.colors[0], at(0.5));
    near(thin.colors[1], at(0.0));
    near(thin.colors[2], ColorMap::MISSING);
    let opacity = of(Attribute::Opacity, None);
    near(opacity.colors[0], at(0.25));
    near(opacity.colors[1], at(0.75));
    let normal = of(Attribute::Normal, None);
    near(normal.colors[0], Vec3::new(1.0, 0.5, 0.5));
    assert!(normal.colors[1] == ColorMap::MISSING && normal.colors[2] == ColorMap::MISSING && normal.legend.is_none());
    near(of(Attribute::PrincipalAxis, None).colors[0], Vec3::X);
    near(of(Attribute::OffsetColor, None).colors[0], Vec3::new(1.0, 0.5, 0.25));
    let error = |attribute, range| attribute_colors(&scene, attribute, ColorMap::Viridis, range).unwrap_err();
    for range in [(1.0, 1.0), (0.0, 1.0), (-1.0, 1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
        assert!(matches!(error(Attribute::Scale, Some(range)), AttributeError::Range { .. }), "{range:?}");
    }
    assert!(matches!(error(Attribute::Normal, Some((0.0, 1.0))), AttributeError::NoRange(_)));
    let bare = Scene::compose(vec![scene.units[1].clone()], None);
    let missing = attribute_colors(&bare, Attribute::OffsetColor, ColorMap::Viridis, None);
    assert!(matches!(missing, Err(AttributeError::Missing(_))));
    // Shown colours are drawn as they are.
    let look = Appearance { colors: Some(Arc::clone(&scale.colors)), ..Appearance::of(&scene) };
    assert!(render(&scene, &look, &camera(20.0, 9, 9), Quality::Standard).is_ok());
}
