//! Offline: one picture of a scene file.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command talks to its user")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Args, ValueEnum};
use glam::{DVec2, DVec3, Vec3};
use serde::Serialize;
use sg_formats::load::{LoadOptions, load};
use sg_gpu::backend::{Backend, Engine};
use sg_gpu::{GpuError, Rasterizer};
use sg_raster::image::ImageFormat;
use sg_raster::outline::{OutlineStyle, draw_outlines};
use sg_raster::pick;
use sg_raster::render::{Options, Projection, Quality, Rendered};
use sg_raster::report::Report;
use sg_scene::appearance::{Appearance, Clip, Overlay, PixelFilter, ShadingTerm};
use sg_scene::camera::Camera;
use sg_scene::framing;
use sg_scene::model::{Convention, Scene, ShadingModel};

mod failure;
mod show;

use failure::Failure;

/// Edge of the picture where neither a camera nor a size is given.
const DEFAULT_SIZE: u32 = 1024;

/// Arguments of the render command.
// One flat list: clap's derive takes an optional group of arguments for absent where it has another group within.
#[derive(Debug, Args)]
pub(crate) struct Picture {
    /// The scene: a Gaussian file or `scene.toml`.
    scene: PathBuf,
    /// Camera file (JSON). By default the scene is framed: plain splats from the front, volume scenes obliquely with z up.
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
    /// The renderer.
    #[arg(long, value_enum, default_value_t = BackendName::Auto)]
    backend: BackendName,
    /// How a graphics device blends.
    #[arg(long, value_enum, default_value_t = RasterizerName::Tiles)]
    rasterizer: RasterizerName,
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
    /// Projection of a Gaussian: `affine` to an ellipse, as 3DGS, or per pixel ray. The latter stays the same however the
    /// camera turns.
    #[arg(long, value_enum, default_value_t = ProjectionName::Affine)]
    projection: ProjectionName,
    /// Opacity of Gaussians that are widened to a pixel: as trained (from the file), unchanged, or reduced by their growth
    /// (Mip-Splatting).
    #[arg(long, value_enum, default_value_t = FilterName::FromFile)]
    filter: FilterName,
    /// Shading term to draw.
    #[arg(long, value_enum, default_value_t = TermName::Full)]
    term: TermName,
    /// Keep only Gaussians with centres on the side of the plane through P that N points to, scene frame. Repeatable.
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ", value_parser = numbers::<6>, allow_hyphen_values = true)]
    clip_plane: Vec<[f64; 6]>,
    /// Keep only Gaussians with centres in the box between two corners, scene frame. Repeatable.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = numbers::<6>, allow_hyphen_values = true)]
    clip_box: Vec<[f64; 6]>,
    /// Leave out Gaussians with centres in the box between two corners, scene frame. Repeatable.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = numbers::<6>, allow_hyphen_values = true)]
    cut_box: Vec<[f64; 6]>,
    /// Colours that say something in place of the shaded ones; the first two need --clusters.
    #[arg(long, value_enum, conflicts_with = "term")]
    show: Option<show::Shown>,
    /// Super-Gaussians as `supergaussian selection cluster` writes them: `.npy`, int32 (n,), -1 for none.
    #[arg(long, value_name = "LABELS.npy")]
    clusters: Option<PathBuf>,
    /// Seed of the random colours of `--show clusters`.
    #[arg(long, requires = "show", default_value_t = 1)]
    seed: u64,
    /// Colours of numbers.
    #[arg(long, value_enum, requires = "show", default_value_t = show::MapName::Viridis)]
    color_map: show::MapName,
    /// Numbers at the ends of the colour map [default: those that 2 % of the Gaussians lie below and above].
    #[arg(long, requires = "show", value_name = "LOW,HIGH", value_parser = numbers::<2>, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Width in pixels of lines along the edges of the Super-Gaussians in front.
    #[arg(long, requires = "clusters", value_name = "PIXELS", num_args = 0..=1, default_missing_value = "1",
        value_parser = clap::value_parser!(u32).range(1..=64))]
    outlines: Option<u32>,
    /// Colour of the outlines, each 0 to 1.
    #[arg(long, requires = "outlines", value_name = "R,G,B", default_value = "1,1,1", value_parser = color)]
    outline_color: Vec3,
    /// Also print the Gaussian in front at these pixel coordinates, and its position.
    #[arg(long, value_name = "X,Y", value_parser = numbers::<2>, allow_hyphen_values = true)]
    pick: Option<[f64; 2]>,
    /// Gaussians to highlight: `.npy`, uint8 (n,), 0 or 1.
    #[arg(long)]
    mask: Option<PathBuf>,
    /// Highlight colour, each 0 to 1.
    #[arg(long, requires = "mask", value_name = "R,G,B", default_value = "1,0.5,0", value_parser = color)]
    mask_color: Vec3,
    /// Share of the highlight colour, 0 to 1.
    #[arg(long, requires = "mask", default_value_t = 0.5, value_parser = share)]
    mask_mix: f32,
    /// Factor on the opacity of the highlighted Gaussians.
    #[arg(long, requires = "mask", default_value_t = 1.0, value_parser = factor)]
    mask_opacity: f32,
    /// Print a report as JSON on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BackendName {
    /// A graphics card where there is one, else the cores.
    Auto,
    /// All cores of this machine.
    Cpu,
    /// A graphics device of any kind, software ones too.
    Gpu,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RasterizerName {
    /// Lists for each 16 × 16 tile, in compute shaders.
    Tiles,
    /// A quadrilateral for each Gaussian, in the fixed function.
    Quads,
    /// The same in bands; between bands, almost opaque pixels are closed.
    Bands,
}

#[derive(Debug, Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum QualityName {
    Exact,
    Standard,
    Fast,
}

#[derive(Debug, Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum ProjectionName {
    Affine,
    PerRay,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FilterName {
    FromFile,
    Plain,
    Compensated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TermName {
    Full,
    Normal,
    Ambient,
    Diffuse,
    Specular,
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

/// The JSON report.
#[derive(Debug, Serialize)]
struct PictureReport<'a> {
    out: &'a Path,
    backend: String,
    quality: QualityName,
    projection: ProjectionName,
    threads: usize,
    camera: &'a Camera,
    #[serde(skip_serializing_if = "Option::is_none")]
    legend: Option<show::LegendReport>,
    /// Absent without a request; null if nothing is in front.
    #[serde(skip_serializing_if = "Option::is_none")]
    pick: Option<Option<show::HitReport>>,
    #[serde(flatten)]
    report: Report,
}

/// Draws one picture; prints errors.
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
        framing::default_camera(&scene, picture.width.unwrap_or(DEFAULT_SIZE), picture.height.unwrap_or(DEFAULT_SIZE))
    });
    let mut appearance = Appearance::of(&scene);
    appearance.light = camera.light;
    appearance.background = camera.background();
    appearance.overlay = read_overlay(picture, &scene)?;
    appearance.clips = clips(picture);
    appearance.filter = match picture.filter {
        FilterName::FromFile => PixelFilter::FromFile,
        FilterName::Plain => PixelFilter::Plain,
        FilterName::Compensated => PixelFilter::Compensated,
    };
    appearance.term = match picture.term {
        TermName::Full => ShadingTerm::Full,
        TermName::Normal => ShadingTerm::Normal,
        TermName::Ambient => ShadingTerm::Ambient,
        TermName::Diffuse => ShadingTerm::Diffuse,
        TermName::Specular => ShadingTerm::Specular,
    };
    let labels = picture.clusters.as_deref().map(|path| show::read_labels(path, &scene)).transpose()?;
    let legend = match picture.show {
        Some(shown) => {
            let options = show::ColorOptions { map: picture.color_map, range: picture.range, seed: picture.seed };
            show::colors(shown, &options, (&scene, labels.as_deref()), &mut appearance)?
        }
        None => None,
    };
    let projection = match picture.projection {
        ProjectionName::Affine => Projection::Affine,
        ProjectionName::PerRay => Projection::PerRay,
    };
    let quality = match picture.quality {
        QualityName::Exact => Quality::Exact,
        QualityName::Standard => Quality::Standard,
        QualityName::Fast => Quality::Fast,
    };
    let options = Options { quality, projection };
    let backend = match picture.backend {
        // No device is opened for options that it cannot draw.
        _ if !options.drawn_by_devices() => Backend::Cpu,
        BackendName::Auto => Backend::Auto,
        BackendName::Cpu => Backend::Cpu,
        BackendName::Gpu => Backend::Gpu,
    };
    if matches!(picture.backend, BackendName::Gpu) && backend == Backend::Cpu {
        eprintln!("warning: `exact` and `per-ray` are drawn by the cores, not by a graphics device");
    }
    let rasterizer = match picture.rasterizer {
        RasterizerName::Tiles => Rasterizer::Tiles,
        RasterizerName::Quads => Rasterizer::Quads,
        RasterizerName::Bands => Rasterizer::Bands,
    };
    let mut engine = Engine::new(scene, backend, Some(rasterizer)).map_err(Failure::work)?;
    let drawn = engine.draw(&appearance, &camera, options);
    let Rendered { mut image, report } = drawn.map_err(|e| match e {
        GpuError::Input(_) => Failure::input(e),
        _ => Failure::work(e),
    })?;
    if let Some(trouble) = engine.take_fallback_error() {
        eprintln!("warning: {trouble}");
    }
    let scene = engine.scene();
    if let (Some(width), Some(labels)) = (picture.outlines, &labels) {
        let (front, _) =
            pick::front_ids(scene, &appearance, &camera, projection, pick::SURFACE).map_err(Failure::input)?;
        let style = OutlineStyle { color: picture.outline_color, width };
        draw_outlines(&mut image, &front, labels, style).map_err(Failure::work)?;
    }
    let hit = picture
        .pick
        .map(|at| pick::pick(scene, &appearance, &camera, projection, DVec2::from_array(at), pick::SURFACE))
        .transpose()
        .map_err(Failure::input)?;
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
    if let Some(legend) = &legend {
        eprintln!("{legend}");
    }
    if let Some(hit) = &hit {
        eprintln!("{}", show::HitReport::line(hit.as_ref()));
    }
    if picture.json {
        let report = PictureReport {
            out: &picture.out,
            backend: engine.name(),
            quality: picture.quality,
            projection: picture.projection,
            threads: rayon::current_num_threads(),
            camera: &camera,
            legend,
            pick: hit.map(|hit| hit.map(show::HitReport::from)),
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
    let mask = sg_formats::npy::read_mask(path, scene.len()).map_err(Failure::input)?;
    Ok(Some(Overlay {
        mask: Arc::new(mask),
        color: picture.mask_color,
        mix: picture.mask_mix,
        opacity: picture.mask_opacity,
    }))
}

fn clips(picture: &Picture) -> Vec<Clip> {
    let halves = |n: &[f64; 6]| (DVec3::new(n[0], n[1], n[2]), DVec3::new(n[3], n[4], n[5]));
    let planes = picture.clip_plane.iter().map(halves).map(|(point, normal)| Clip::plane(point, normal));
    let between = |keep_inside: bool| {
        move |n: &[f64; 6]| {
            let (a, b) = halves(n);
            Clip::between(a.min(b), a.max(b), keep_inside)
        }
    };
    let boxes = picture.clip_box.iter().map(between(true)).chain(picture.cut_box.iter().map(between(false)));
    planes.chain(boxes).collect()
}

/// Parses this many finite numbers between commas.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let one = |part: &str| {
        let number = part.trim().parse().ok().filter(|x: &f64| x.is_finite());
        number.ok_or_else(|| format!("`{part}` is no finite number"))
    };
    let numbers: Vec<f64> = text.split(',').map(one).collect::<Result<_, _>>()?;
    <[f64; N]>::try_from(numbers).map_err(|n| format!("{} numbers; {N} are needed, with commas between them", n.len()))
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
        assert_eq!(numbers("-1, 2.5"), Ok([-1.0, 2.5]));
        assert!(numbers::<2>("1").is_err() && numbers::<2>("1,2,3").is_err() && numbers::<1>("inf").is_err());
    }
}
