//! The poses drawn on a device: measured milliseconds beside the predicted ones, and how counted work and seconds correlate.

use std::time::{Duration, Instant};

use sg_gpu::counts::{Card, FrameWork, Pass, PassWork};
use sg_gpu::{Gpu, Options, PassSeconds, Renderer, Settings};
use sg_scene::appearance::Appearance;
use sg_scene::model::Scene;
use sg_tests::bench::quantile;

use crate::{PLACES, Pose, Row};

/// Pearson's correlation of logarithms; `None` where one of them hardly varies.
pub(crate) fn correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> =
        pairs.iter().filter(|(a, b)| *a > 0.0 && *b > 0.0).map(|(a, b)| (a.ln(), b.ln())).collect();
    let n = logs.len() as f64;
    let (mean_a, mean_b) = (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    let moment = |of: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / n;
    let (aa, bb) = (moment(&|p| (p.0 - mean_a).powi(2)), moment(&|p| (p.1 - mean_b).powi(2)));
    let ab = moment(&|p| (p.0 - mean_a) * (p.1 - mean_b));
    (aa > 1e-4 && bb > 1e-4).then(|| ab / (aa * bb).sqrt())
}

/// What a software device works through in a pass: every evaluation and fragment, and bytes elsewhere.
pub(crate) fn software_work(pass: &PassWork) -> f64 {
    match pass.pass {
        Pass::Blend => (pass.evaluated + pass.blended) as f64,
        Pass::Compose => pass.stored as f64,
        _ => (pass.bytes_read + pass.bytes_written) as f64,
    }
}

/// The passes that a device times together, and their name.
pub(crate) const TIMED: [(&str, &[Pass]); 7] = [
    ("cull", &[Pass::Cull]),
    ("project", &[Pass::Project]),
    ("sort by depth", &[Pass::Sort]),
    ("tile lists", &[Pass::TileLists]),
    ("sort by tile", &[Pass::PairSort]),
    ("blend", &[Pass::Blend]),
    ("compose", &[Pass::Compose]),
];

/// Pictures of each pose. With fewer, the clock of a card lags behind.
const PICTURES: usize = 8;

/// Time of drawing before the first measurement.
const WARM_UP: Duration = Duration::from_secs(1);

/// The measured seconds of a pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    /// Those of [`TIMED`].
    pub(crate) passes: [f64; TIMED.len()],
    /// From the begin of the first pass to the end of the last one.
    device: f64,
    /// From the call to the finished picture: recording, device and one wait.
    wall: f64,
}

/// Draws the poses on a device; the fastest of [`PICTURES`] counts. Nothing from a device without timestamps.
pub(crate) fn measured(
    gpu: &Gpu,
    scene: &Scene,
    poses: &[Pose],
    settings: Settings,
    options: Options,
) -> Vec<Measured> {
    let look = Appearance::of(scene);
    let mut renderer = Renderer::with_options(gpu, scene, options).unwrap();
    let mut drawn = Vec::new();
    // A card at rest has a fraction of its clock.
    let begun = Instant::now();
    while let Some(pose) = poses.first().filter(|_| begun.elapsed() < WARM_UP) {
        renderer.draw_complete(&pose.eyes, &look, settings).unwrap();
    }
    for pose in poses {
        renderer.draw_complete(&pose.eyes, &look, settings).unwrap();
        let pictures = (0..PICTURES).filter_map(|_| {
            let begun = Instant::now();
            renderer.draw(&pose.eyes, &look, settings).unwrap();
            let (stats, _) = renderer.finish().unwrap();
            let wall = begun.elapsed().as_secs_f64();
            let PassSeconds { list, project, sort, bin, pair_sort, blend, compose } = stats.seconds?;
            Some(Measured {
                passes: [list, project, sort, bin, pair_sort, blend, compose],
                device: stats.device_seconds?,
                wall,
            })
        });
        let Some(fastest) = pictures.min_by(|a, b| a.device.total_cmp(&b.device)) else { return drawn };
        drawn.push(fastest);
    }
    drawn
}

/// Lines of a row's measured milliseconds: the whole frame as in the table of predictions, and each pass of each part beside its prediction.
pub(crate) fn compared(row: &Row, measured: &[Measured], device: &str, card: &Card) -> [Vec<String>; 2] {
    let at = |place: Option<usize>| {
        row.places.iter().zip(measured).filter(move |(at, _)| place.is_none_or(|p| p == **at)).map(|(_, m)| m)
    };
    let whole = [
        row.line_of(&format!("{device}, device"), |place| at(place).map(|m| 1e3 * m.device).collect()),
        row.line_of(&format!("{device}, wall"), |place| at(place).map(|m| 1e3 * m.wall).collect()),
    ];
    let mut passes = Vec::new();
    for (place, (name, _)) in PLACES.iter().enumerate() {
        for (k, (pass, of)) in TIMED.iter().enumerate() {
            let works = row.places.iter().zip(&row.works).filter(|(at, _)| **at == place).map(|(_, work)| work);
            let predict = |work: &FrameWork| {
                let seconds = work.seconds(card);
                let chosen = work.passes.iter().zip(&seconds).filter(|(w, _)| of.contains(&w.pass));
                1e3 * chosen.map(|(_, s)| s).sum::<f64>()
            };
            let predicted = quantile(&mut works.map(predict).collect::<Vec<_>>(), 0.5);
            if predicted <= 0.0 {
                continue;
            }
            let ms = quantile(&mut at(Some(place)).map(|m| 1e3 * m.passes[k]).collect::<Vec<_>>(), 0.5);
            passes.push(format!(
                "| {}, {} | {} | {name} | {pass} | {predicted:.3} | {ms:.3} | {:.2} |",
                row.scene,
                row.gaussians,
                row.name,
                ms / predicted
            ));
        }
    }
    [whole.to_vec(), passes]
}
