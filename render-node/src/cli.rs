//! Offline: one picture of a scene file.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command talks to its user")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Args, ValueEnum};
use glam::Vec3;
use serde::Serialize;
use sg_render_node::image::ImageFormat;
use sg_render_node::render::{Quality, Rendered, render};
use sg_render_node::report::Report;
use sg_render_node::view;
use sg_scene::appearance::{Appearance, Overlay};
use sg_scene::camera::Camera;
use sg_scene::load::{LoadOptions, load};
use sg_scene::model::{Convention, Scene, ShadingModel};

/// Exit status for arguments or input that are wrong.
const WRONG_INPUT: u8 = 2;

/// Edge of the picture where neither a camera nor a size is given.
const DEFAULT_SIZE: u32 = 1024;

/// What to draw, how, and where to.
// One flat list: clap's derive takes an optional group of arguments for absent where it has another group within.
#[derive(Debug, Args)]
pub(crate) struct Picture {
    /// The scene: a Gaussian file or `scene.toml`.
    scene: PathBuf,
    /// Camera file (JSON); without one the scene is framed: from the front for plain splats, obliquely with z up for
    /// scenes made from volumes.
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Picture to write: `.png` (8-bit RGB) or `.npy` (float32, height × width × 4).
    #[arg(long)]
    out: PathBuf,
    /// Width in pixels of a framed view [default: 1024].
    #[arg(long, conflicts_with = "camera", value_parser = clap::value_parser!(u32).range(1..=16_384))]
    width: Option<u32>,
    /// Height in pixels of a framed view [default: 1024].
    #[arg(long, conflicts_with = "camera", value_parser = clap::value_parser!(u32).range(1..=16_384))]
    height: Option<u32>,
    /// What draws.
    #[arg(long, value_enum, default_value_t = BackendName::Auto)]
    backend: BackendName,
    /// Error against the reference: none; ≥ 50 dB; ≥ 40 dB.
    #[arg(long, value_enum, default_value_t = QualityName::Standard)]
    quality: QualityName,
    /// Shading model, instead of the one in the scene file.
    #[arg(long, value_enum)]
    shading: Option<ShadingName>,
    /// How the shading columns of iVR-GS files are stored, instead of the reader's own finding.
    #[arg(long, value_enum)]
    convention: Option<ConventionName>,
    /// Palette colour of every base unit with shading columns, each 0 to 1, instead of the one in the files.
    #[arg(long, value_name = "R,G,B", value_parser = color)]
    palette: Option<Vec3>,
    /// Gaussians to highlight: `.npy`, uint8 (n,), 0 or 1.
    #[arg(long)]
    mask: Option<PathBuf>,
    /// Highlight colour, each 0 to 1.
    #[arg(long, requires = "mask", value_name = "R,G,B", default_value = "1,0.5,0", value_parser = color)]
    mask_color: Vec3,
    /// Share of the highlight colour, 0 to 1.
    #[arg(long, requires = "mask", default_value_t = 0.5, value_parser = share)]
    mask_mix: f32,
    /// Factor on the opacity of what is highlighted.
    #[arg(long, requires = "mask", default_value_t = 1.0, value_parser = factor)]
    mask_opacity: f32,
    /// Print a report as JSON on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BackendName {
    /// The fastest there is.
    Auto,
    /// All cores of this machine.
    Cpu,
}

#[derive(Debug, Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum QualityName {
    Exact,
    Standard,
    Fast,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ShadingName {
    Paper,
    IvrgsTrain,
    IvrgsViewer,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ConventionName {
    Ours,
    Legacy,
    HeadRaw,
    HeadActivated,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct PictureReport<'a> {
    out: &'a Path,
    backend: &'static str,
    quality: QualityName,
    threads: usize,
    camera: &'a Camera,
    #[serde(flatten)]
    report: Report,
}

/// An error line and the exit status that goes with it.
struct Failure {
    status: u8,
    line: String,
}

impl Failure {
    fn input(error: impl std::fmt::Display) -> Self {
        Self { status: WRONG_INPUT, line: error.to_string() }
    }

    fn work(error: impl std::fmt::Display) -> Self {
        Self { status: 1, line: error.to_string() }
    }
}

/// Draws one picture and says what went wrong.
pub(crate) fn run(picture: &Picture) -> ExitCode {
    match draw(picture) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {}", failure.line);
            ExitCode::from(failure.status)
        }
    }
}

fn draw(picture: &Picture) -> Result<(), Failure> {
    // A wrong ending is found before any work is done.
    ImageFormat::of(&picture.out).map_err(Failure::input)?;
    let camera = picture.camera.as_deref().map(Camera::read).transpose().map_err(Failure::input)?;
    let scene = read_scene(picture)?;
    let camera = camera.unwrap_or_else(|| {
        view::default_view(&scene, picture.width.unwrap_or(DEFAULT_SIZE), picture.height.unwrap_or(DEFAULT_SIZE))
    });
    let mut appearance = Appearance::of(&scene);
    appearance.light = camera.light;
    appearance.background = camera.background();
    appearance.overlay = read_overlay(picture, &scene)?;
    let quality = match picture.quality {
        QualityName::Exact => Quality::Exact,
        QualityName::Standard => Quality::Standard,
        QualityName::Fast => Quality::Fast,
    };
    let backend = match picture.backend {
        BackendName::Auto | BackendName::Cpu => "cpu",
    };
    let Rendered { image, report } = render(&scene, &appearance, &camera, quality).map_err(Failure::input)?;
    image.save(&picture.out).map_err(Failure::work)?;
    if report.dropped_non_finite > 0 {
        eprintln!("warning: {} Gaussians with NaN or infinite attributes were left out", report.dropped_non_finite);
    }
    eprintln!(
        "{}: {} x {} pixels, {} of {} Gaussians, {:.3} s (preprocess {:.3}, sort {:.3}, bin {:.3}, raster {:.3})",
        picture.out.display(),
        image.width,
        image.height,
        report.drawn,
        report.gaussians,
        report.seconds.total,
        report.seconds.preprocess,
        report.seconds.sort,
        report.seconds.bin,
        report.seconds.raster
    );
    if picture.json {
        let report = PictureReport {
            out: &picture.out,
            backend,
            quality: picture.quality,
            threads: rayon::current_num_threads(),
            camera: &camera,
            report,
        };
        println!("{}", serde_json::to_string_pretty(&report).map_err(Failure::work)?);
    }
    Ok(())
}

fn read_scene(picture: &Picture) -> Result<Scene, Failure> {
    let options = LoadOptions {
        convention: picture.convention.map(|name| match name {
            ConventionName::Ours => Convention::Ours,
            ConventionName::Legacy => Convention::Legacy,
            ConventionName::HeadRaw => Convention::HeadRaw,
            ConventionName::HeadActivated => Convention::HeadActivated,
        }),
        shading: picture.shading.map(|name| match name {
            ShadingName::Paper => ShadingModel::Paper,
            ShadingName::IvrgsTrain => ShadingModel::IvrgsTrain,
            ShadingName::IvrgsViewer => ShadingModel::IvrgsViewer,
        }),
        palette: picture.palette,
    };
    let loaded = load(&picture.scene, &options).map_err(Failure::input)?;
    for warning in &loaded.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(loaded.scene)
}

fn read_overlay(picture: &Picture, scene: &Scene) -> Result<Option<Overlay>, Failure> {
    let Some(path) = &picture.mask else { return Ok(None) };
    let mask = sg_scene::npy::read_mask(path, scene.len()).map_err(Failure::input)?;
    Ok(Some(Overlay {
        mask: Arc::new(mask),
        color: picture.mask_color,
        mix: picture.mask_mix,
        opacity: picture.mask_opacity,
    }))
}

fn color(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').map(|part| share(part.trim())).collect::<Result<_, _>>()?;
    match numbers.as_slice() {
        &[r, g, b] => Ok(Vec3::new(r, g, b)),
        _ => Err(format!("{} numbers; three are needed: red,green,blue", numbers.len())),
    }
}

fn share(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|x| (0.0..=1.0).contains(x)).ok_or_else(|| format!("`{text}` is no number from 0 to 1"))
}

fn factor(text: &str) -> Result<f32, String> {
    text.parse::<f32>()
        .ok()
        .filter(|x| *x >= 0.0 && x.is_finite())
        .ok_or_else(|| format!("`{text}` is no finite number of at least 0"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_the_command_line() {
        assert_eq!(color("1, 0.5,0"), Ok(Vec3::new(1.0, 0.5, 0.0)));
        assert!(color("1,0").is_err() && color("1,0,2").is_err() && color("red").is_err());
        assert_eq!(factor("3"), Ok(3.0));
        assert!(factor("-1").is_err() && factor("inf").is_err() && factor("NaN").is_err());
        assert!(share("NaN").is_err());
    }
}
