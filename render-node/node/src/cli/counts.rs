//! Counted work of a picture, and its predicted time on graphics cards.

use clap::ValueEnum;
use serde::Serialize;
use sg_gpu::counts::{Card, FrameWork, WorkOptions, frame_work};
use sg_gpu::{Commands, Options, Settings};
use sg_input::number_format::grouped;
use sg_raster::counts::{HEADSET_SIZE, headset};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::framing;
use sg_scene::model::Scene;

use super::Picture;
use super::failure::Failure;

/// Cards of [`Card::ALL`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum CardName {
    #[value(name = "rtx-3090")]
    Rtx3090,
    #[value(name = "rtx-4090")]
    Rtx4090,
    #[value(name = "rtx-3060")]
    Rtx3060,
    #[value(name = "h100")]
    H100,
}

impl CardName {
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// Predicted milliseconds.
#[derive(Debug, Clone, Serialize)]
struct Prediction {
    card: &'static str,
    total_ms: f64,
    /// In the order of the passes.
    passes_ms: Vec<f64>,
}

/// The part of the report about work.
#[derive(Debug, Clone, Serialize)]
pub(super) struct WorkReport {
    /// Width and height of one picture.
    size: [u32; 2],
    #[serde(flatten)]
    work: FrameWork,
    predictions: Vec<Prediction>,
}

/// Counts what a device does for the picture of a camera, or for both eyes of a headset there.
pub(super) fn count(
    picture: &Picture,
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    settings: Settings,
) -> Result<WorkReport, Failure> {
    let edge = framing::framed_box(scene).size().max_element();
    let size = [picture.width.unwrap_or(HEADSET_SIZE[0]), picture.height.unwrap_or(HEADSET_SIZE[1])];
    let (cameras, is_headset) = match picture.both_eyes {
        true => (headset(camera, if edge > 0.0 { edge } else { 1.0 }, size).to_vec(), true),
        false => (vec![camera.clone()], false),
    };
    let settings = Settings { depths: is_headset, ..settings };
    // As a headset's eyes are drawn.
    let renderer = Options { half_pictures: is_headset, ..Options::default() };
    let options = WorkOptions { settings, renderer, presented: is_headset, ..WorkOptions::default() };
    let work = frame_work(scene, appearance, &cameras, options).map_err(Failure::input)?;
    let chosen = |card: &&Card| picture.card.is_none_or(|name| name.name() == card.name);
    let predict = |card: &Card| {
        let seconds = work.seconds(card);
        let total_ms = 1e3 * seconds.iter().sum::<f64>();
        Prediction { card: card.name, total_ms, passes_ms: seconds.iter().map(|s| 1e3 * s).collect() }
    };
    let predictions = Card::ALL.iter().filter(chosen).map(predict).collect();
    Ok(WorkReport { size: cameras.first().map_or(size, |c| [c.width, c.height]), work, predictions })
}

/// Columns before those of the cards.
const COLUMNS: [&str; 9] =
    ["pass", "fragments", "evaluated", "tile pairs", "MB read", "MB written", "dispatches", "draws", "barriers"];

impl WorkReport {
    /// The table for a terminal, and a line above it.
    pub(super) fn table(&self) -> String {
        let Self { size: [width, height], work, predictions } = self;
        let cards = predictions.iter().map(|p| format!("{}, ms", p.card));
        let head = COLUMNS.map(str::to_owned).into_iter().chain(cards).collect();
        let mut rows: Vec<Vec<String>> = vec![head];
        let row = |name: &str, counts: [u64; 3], bytes: [u64; 2], commands: Commands, ms: Vec<f64>| -> Vec<String> {
            let megabytes = bytes.map(|bytes| format!("{:.1}", bytes as f64 / 1e6));
            let commands = [commands.dispatches, commands.draws, commands.barriers].map(|n| n.to_string());
            let counts = counts.map(|count| count.to_string());
            let texts = std::iter::once(name.to_owned()).chain(counts).chain(megabytes).chain(commands);
            texts.chain(ms.into_iter().map(|ms| format!("{ms:.3}"))).collect()
        };
        for (k, pass) in work.passes.iter().enumerate() {
            let ms = predictions.iter().map(|p| p.passes_ms.get(k).copied().unwrap_or_default()).collect();
            let counts = [pass.blended + pass.stored, pass.evaluated, pass.tile_pairs];
            rows.push(row(pass.pass.name(), counts, [pass.bytes_read, pass.bytes_written], pass.commands, ms));
        }
        let sum = |of: fn(&sg_gpu::counts::PassWork) -> u64| work.passes.iter().map(of).sum::<u64>();
        rows.push(row(
            "all",
            [sum(|p| p.blended + p.stored), sum(|p| p.evaluated), sum(|p| p.tile_pairs)],
            [sum(|p| p.bytes_read), sum(|p| p.bytes_written)],
            work.commands(),
            predictions.iter().map(|p| p.total_ms).collect(),
        ));
        let c = &work.counts;
        let views = if c.views == 1 { "one view".to_owned() } else { format!("{} views", c.views) };
        let first = format!(
            "{views} of {width} x {height} pixels: {} of {} Gaussians listed, {} splats, {} of them by rays\n\n",
            grouped(c.listed),
            grouped(c.gaussians),
            grouped(c.splats),
            grouped(c.by_rays)
        );
        first + &aligned(&rows)
    }
}

/// Columns of equal width, the first one to the left.
fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or_default();
    let width = |k: usize| rows.iter().filter_map(|row| row.get(k)).map(|text| text.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|k| width(k).unwrap_or_default()).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate().map(|(k, (text, &width))| match k {
            0 => format!("{text:width$}"),
            _ => format!("{text:>width$}"),
        });
        cells.collect::<Vec<_>>().join("  ")
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}
