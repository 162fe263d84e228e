//! Milliseconds against decibels of each quality level on a made scene of so many Gaussians, or on a scene file:
//! `cargo run --release -p sg-render-node --example bench -- 168000 1032 1104`.

#![allow(clippy::print_stdout, reason = "a bench prints its table")]

use std::error::Error;
use std::path::Path;

use glam::{DMat4, Quat, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_render_node::metrics::Difference;
use sg_render_node::render::{Quality, render};
use sg_render_node::view;
use sg_scene::appearance::Appearance;
use sg_scene::load::{LoadOptions, load};
use sg_scene::model::{BaseUnit, Convention, Gaussians, Scene, ShadingColumns, ShadingModel};

/// Flat shaded Gaussians on nested wrinkled shells, the outer ones fainter: what a fit of a volume looks like.
fn shells(n: usize) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut uniform = |low: f32, high: f32| low + (high - low) * rng.random::<f32>();
    let mut g = Gaussians::default();
    let mut shading = ShadingColumns::default();
    for i in 0..n {
        let shell = (i % 4) as f32;
        let z = uniform(-1.0, 1.0);
        let (sin, cos) = uniform(0.0, std::f32::consts::TAU).sin_cos();
        let ring = (1.0 - z * z).sqrt();
        let d = Vec3::new(ring * cos, ring * sin, z);
        let radius = (0.4 + 0.2 * shell) * (1.0 + 0.1 * (9.0 * d.x).sin() * (7.0 * d.y).cos());
        let q = Quat::from_rotation_arc(Vec3::Z, d);
        let size = (2.5 * radius / (n as f32 / 4.0).sqrt()).ln();
        g.position.push(radius * d);
        g.rotation.push([q.w, q.x, q.y, q.z]);
        g.log_scale.push(
            Vec3::new(size, size, size - 1.2) + Vec3::new(uniform(-0.4, 0.4), uniform(-0.4, 0.4), uniform(-0.4, 0.4)),
        );
        g.opacity_logit.push(2.0 - 1.2 * shell + uniform(-1.0, 1.0));
        shading.offset_color.push(0.3 * (Vec3::ONE + d));
        shading.normal.push(d);
        shading.ambient.push(0.3);
        shading.diffuse.push(0.6);
        shading.specular.push(0.3);
        shading.shininess.push(20.0);
    }
    g.shading = Some(shading);
    let unit = BaseUnit {
        name: "shells".into(),
        file: None,
        gaussians: g,
        first: 0,
        palette: Vec3::new(0.3, 0.2, 0.1),
        opacity: 1.0,
        transform: DMat4::IDENTITY,
        convention: Convention::Ours,
        shading: ShadingModel::Paper,
        oriented_normals: true,
        transfer_function: None,
    };
    Scene::compose(vec![unit], None)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, width, height] = arguments.as_slice() else {
        return Err("three arguments: a number of Gaussians or a scene file, width, height".into());
    };
    let (width, height): (u32, u32) = (width.parse()?, height.parse()?);
    let scene = match what.parse() {
        Ok(n) => shells(n),
        Err(_) => load(Path::new(what), &LoadOptions::default())?.scene,
    };
    let appearance = Appearance::of(&scene);
    let first = view::default_view(&scene, width, height);
    let bounds = view::visible_box(&scene);
    let frame = |x: f64| view::orbit(&first, 0.5 * (bounds.min + bounds.max), 60.0 * x, 0.0);
    let exact: Vec<_> = [0.0, 1.0]
        .into_iter()
        .map(|x| render(&scene, &appearance, &frame(x), Quality::Exact).map(|r| (frame(x), r)))
        .collect::<Result<_, _>>()?;
    for (_, r) in &exact {
        println!("exact     {:7.1} ms   {:?}", 1e3 * r.report.seconds.total, r.report);
    }
    for (name, quality) in [("standard", Quality::Standard), ("fast", Quality::Fast)] {
        for (camera, reference) in &exact {
            let mut runs =
                (0..15).map(|_| render(&scene, &appearance, camera, quality)).collect::<Result<Vec<_>, _>>()?;
            runs.sort_by(|a, b| a.report.seconds.total.total_cmp(&b.report.seconds.total));
            let (Some(least), Some(median)) = (runs.first(), runs.get(runs.len() / 2)) else { continue };
            let s = median.report.seconds;
            let d = Difference::between(&median.image, &reference.image)?;
            println!(
                "{name:9} {:7.1} ms min {:7.1} median (preprocess {:.1}, sort {:.1}, bin {:.1}, raster {:.1}), {} tile pairs: {:.1} dB, footprint {:.1} dB, coverage {:.3} %",
                1e3 * least.report.seconds.total,
                1e3 * s.total,
                1e3 * s.preprocess,
                1e3 * s.sort,
                1e3 * s.bin,
                1e3 * s.raster,
                median.report.tile_pairs,
                d.psnr_db,
                d.footprint_psnr_db,
                100.0 * d.coverage_error
            );
        }
    }
    Ok(())
}
