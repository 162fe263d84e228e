//! Offline: one picture of a scene file.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use clap::{Args, ValueEnum};
use glam::{DVec2, DVec3, DVec4, Vec3};
use serde::Serialize;
use sg_edit::wire::decode_vector;
use sg_formats::load::{LoadOptions, load};
use sg_formats::staged_file;
use sg_gpu::backend::{Backend, Engine};
use sg_gpu::{GpuError, Rasterizer, Settings};
use sg_input::print;
use sg_proto::light_presets::{LightPreset, ViewerAxes};
use sg_raster::finish::{Backdrop, Finish, Gradient};
use sg_raster::image::ImageFormat;
use sg_raster::occlusion::ambient_occlusion;
use sg_raster::outline::{OutlineStyle, draw_outlines};
use sg_raster::pick;
use sg_raster::render::{Options, Projection, Quality, Rendered};
use sg_raster::report::Report;
use sg_scene::appearance::{Appearance, Clip, Overlay, PixelFilter, ShadingTerm};
use sg_scene::camera::{Camera, Light, LightMode};
use sg_scene::framing;
use sg_scene::model::{Convention, Scene, ShadingModel};

mod counts;
mod failure;
mod show;

use failure::Failure;

/// Edge of the picture where neither a camera nor a size is given.
const DEFAULT_SIZE: u32 = 1024;

/// Examples in the help of the command.
pub(crate) const EXAMPLES: &str = "Examples:
  supergaussian render scene.toml --camera front.json --out front.png --quality exact
  supergaussian render tooth.ply --out anisotropy.png --show anisotropy --color-map cividis
  supergaussian render scene.toml --out clusters.png --show clusters --clusters labels.npy --outlines 2
  supergaussian render scene.toml --out half.png --clip-plane 0,0,0,1,0,0 --mask sac.npy --pick 512,512
  supergaussian render scene.toml --counts --both-eyes --rasterizer quads --card rtx-3090";

/// Example in the help of `serve`.
pub(crate) const SERVE_EXAMPLE: &str = "Example (a supervisor does this):
  supergaussian-render-node serve --session demo --role render-view --instance render-view-1 \\
    --connect unixsock-stream/$RUN/bus.sock --run-dir $RUN --params '{\"display\": \"window\"}'";

/// Arguments of the render command.
// One flat list: clap's derive takes an optional group of arguments for absent where it has another group within.
#[derive(Debug, Args)]
pub(crate) struct Picture {
    /// The scene: a Gaussian file or `scene.toml`.
    scene: PathBuf,
    /// Camera file (JSON). Without one, the whole scene is framed: plain splats from the front, volume scenes obliquely with
    /// z up.
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Picture to write: `.png` (8-bit RGB) or `.npy` (float32, height × width × 4).
    #[arg(long, required_unless_present = "counts")]
    out: Option<PathBuf>,
    /// Width of the picture in pixels, where no camera is given [default: 1024].
    #[arg(long, conflicts_with = "camera", value_parser = clap::value_parser!(u32).range(1..=16_384))]
    width: Option<u32>,
    /// Height of the picture in pixels, where no camera is given [default: 1024].
    #[arg(long, conflicts_with = "camera", value_parser = clap::value_parser!(u32).range(1..=16_384))]
    height: Option<u32>,
    /// Device that draws.
    #[arg(long, value_enum, default_value_t = BackendName::Auto)]
    backend: BackendName,
    /// Blending method of a graphics device.
    #[arg(long, value_enum, default_value_t = RasterizerName::Tiles)]
    rasterizer: RasterizerName,
    /// Quality of the picture, as its error against the reference.
    #[arg(long, value_enum, default_value_t = QualityName::Standard)]
    quality: QualityName,
    /// Shading model. Replaces the one of the scene file.
    #[arg(long, value_enum)]
    shading: Option<ShadingName>,
    /// Convention of the shading columns in iVR-GS files. Without it, the reader recognizes the convention.
    #[arg(long, value_enum)]
    convention: Option<ConventionName>,
    /// Palette colour of every base unit with shading columns, each number 0 to 1. Replaces the one in the files.
    #[arg(long, value_name = "R,G,B", value_parser = color)]
    palette: Option<Vec3>,
    /// Projection of a Gaussian.
    #[arg(long, value_enum, default_value_t = ProjectionName::Affine)]
    projection: ProjectionName,
    /// Distance from the eye, in the scene's unit, within which Gaussians fade out. Replaces the camera's [default: a two-hundredth of
    /// the scene's longest edge: 5 cm in a room where that is 10 m].
    #[arg(long, value_name = "LENGTH", value_parser = length)]
    near: Option<f64>,
    /// Opacity of small Gaussians, which are widened to a pixel.
    #[arg(long, value_enum, default_value_t = FilterName::FromFile)]
    filter: FilterName,
    /// Term of the shading to draw.
    #[arg(long, value_enum, default_value_t = TermName::Full)]
    term: TermName,
    /// Keeps only Gaussians with centres on one side of a plane: the side to which N points, with P on the plane. Scene
    /// coordinates. Repeatable.
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ", value_parser = numbers::<6>, allow_hyphen_values = true)]
    clip_plane: Vec<[f64; 6]>,
    /// Keeps only Gaussians with centres in the box between two corners. Scene coordinates. Repeatable.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = numbers::<6>, allow_hyphen_values = true)]
    clip_box: Vec<[f64; 6]>,
    /// Leaves out Gaussians with centres in the box between two corners. Scene coordinates. Repeatable.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = numbers::<6>, allow_hyphen_values = true)]
    cut_box: Vec<[f64; 6]>,
    /// Draws Super-Gaussians or an attribute as colours, without shading. The first two values need --clusters.
    #[arg(long, value_enum, conflicts_with = "term")]
    show: Option<show::Shown>,
    /// Super-Gaussian of each Gaussian: `.npy`, int32 (n,), -1 for none. `supergaussian selection cluster` writes it.
    #[arg(long, value_name = "LABELS.npy")]
    clusters: Option<PathBuf>,
    /// Seed of the random colours of `--show clusters`.
    #[arg(long, requires = "show", default_value_t = 1)]
    seed: u64,
    /// Colour map of `--show`.
    #[arg(long, value_enum, requires = "show", default_value_t = show::MapName::Viridis)]
    color_map: show::MapName,
    /// Values at the ends of the colour map [default: 2 % of the Gaussians lie below the first, 2 % above the second].
    #[arg(long, requires = "show", value_name = "LOW,HIGH", value_parser = numbers::<2>, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Draws the outlines of the Super-Gaussians in front, with this width in pixels.
    #[arg(long, requires_all = ["clusters", "out"], value_name = "PIXELS", num_args = 0..=1, default_missing_value = "1",
        value_parser = clap::value_parser!(u32).range(1..=64))]
    outlines: Option<u32>,
    /// Colour of the outlines, each 0 to 1.
    #[arg(long, requires = "outlines", value_name = "R,G,B", default_value = "1,1,1", value_parser = color)]
    outline_color: Vec3,
    /// Also prints the front Gaussian at these pixel coordinates, and its position.
    #[arg(long, requires = "out", value_name = "X,Y", value_parser = numbers::<2>, allow_hyphen_values = true)]
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
    /// Light, seen from the camera. Replaces the one of the camera file [default: headlight].
    #[arg(long, value_enum)]
    light: Option<LightName>,
    /// Darkens the ambient light where other Gaussians are in its way.
    #[arg(long)]
    ambient_occlusion: bool,
    /// Background: `plain` (the camera file's colour, else black), a `gradient` about it, a colour, two colours from the top
    /// to the bottom, or `transparent`. Numbers are 0 to 1 [default: plain].
    #[arg(long, value_name = "plain|gradient|transparent|R,G,B|R,G,B/R,G,B", value_parser = background)]
    background: Option<Background>,
    /// Rounds the colours of a PNG instead of dithering them, for comparisons.
    #[arg(long)]
    no_dither: bool,
    /// Counts the work of a graphics device for the picture, without such a device: fragments, pairs, bytes and commands of each
    /// pass, and predicted milliseconds. Draws only with --out.
    #[arg(long)]
    counts: bool,
    /// Counts both eyes of a headset at the camera's pose: 2064 × 2208 pixels each unless --width and --height say otherwise, the
    /// longest edge of the scene one metre of the room.
    #[arg(long, requires = "counts", conflicts_with = "out")]
    both_eyes: bool,
    /// Card of the predicted milliseconds [default: all of them].
    #[arg(long, requires = "counts", value_enum)]
    card: Option<counts::CardName>,
    /// Prints a report as JSON on standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BackendName {
    /// A graphics card if there is one, otherwise the cores.
    Auto,
    /// All cores of this machine.
    Cpu,
    /// A graphics device of any kind, including software devices.
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
    /// No error: the reference itself.
    Exact,
    /// At least 50 dB.
    Standard,
    /// At least 40 dB.
    Fast,
}

#[derive(Debug, Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum ProjectionName {
    /// To an ellipse, as 3DGS does.
    Affine,
    /// For each pixel's ray; the same however the camera turns.
    PerRay,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum FilterName {
    /// As the scene was trained, from its file.
    FromFile,
    /// Unchanged.
    Plain,
    /// Reduced by the growth (Mip-Splatting).
    Compensated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TermName {
    /// All terms together.
    Full,
    /// The normals as colours.
    Normal,
    /// The ambient term alone.
    Ambient,
    /// The diffuse term alone.
    Diffuse,
    /// The specular term alone.
    Specular,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum LightName {
    /// From the eye.
    Headlight,
    /// From the upper left, with highlights.
    Studio,
    /// From above behind the scene: bright edges.
    Rim,
    /// Ambient light only.
    Flat,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ShadingName {
    /// One-sided, clamped to 0 to 1.
    Paper,
    /// Two-sided, as iVR-GS trains.
    IvrgsTrain,
    /// Two-sided, as the viewer of iVR-GS draws.
    IvrgsViewer,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ConventionName {
    /// Stored as used: files of this program.
    Ours,
    /// Checkpoints of iVR-GS before January 2025.
    Legacy,
    /// Float files of iVR-GS since January 2025.
    HeadRaw,
    /// Quantised files of iVR-GS since January 2025.
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
    #[serde(skip_serializing_if = "Option::is_none")]
    work: Option<counts::WorkReport>,
    #[serde(flatten)]
    report: Report,
}

/// Draws one picture; prints errors.
pub(crate) fn run(picture: &Picture) -> ExitCode {
    match draw(picture) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            print::status(&format!("error: {}", failure.line));
            ExitCode::from(failure.status)
        }
    }
}

fn draw(picture: &Picture) -> Result<(), Failure> {
    // A wrong ending is found before any work is done.
    let format = picture.out.as_deref().map(ImageFormat::of).transpose().map_err(Failure::input)?;
    if format == Some(ImageFormat::Npy) && matches!(picture.background, Some(Background::Transparent)) {
        return Err(Failure::input("--background transparent: a .npy picture always has its coverage; write a .png"));
    }
    let inputs = [Some(&picture.scene), picture.camera.as_ref(), picture.clusters.as_ref(), picture.mask.as_ref()];
    staged_file::check_outputs(picture.out.as_deref(), inputs.into_iter().flatten().map(PathBuf::as_path))
        .map_err(Failure::input)?;
    let camera = picture.camera.as_deref().map(Camera::read).transpose().map_err(Failure::input)?;
    let scene = read_scene(picture)?;
    let mut appearance = Appearance::of(&scene);
    appearance.clips = clips(picture);
    let mut camera = camera.unwrap_or_else(|| {
        let [width, height] = [picture.width, picture.height].map(|edge| edge.unwrap_or(DEFAULT_SIZE));
        framing::default_camera_of(&scene, &appearance, width, height)
    });
    camera.near = match picture.near {
        Some(near) => near,
        None if camera.near == 0.0 => framing::near_distance(&scene),
        None => camera.near,
    };
    if let Some(light) = picture.light {
        camera.light = preset_light(light, &camera);
    }
    if let Some(Background::Color(color)) = picture.background {
        camera.background = color.to_array();
    }
    appearance.light = camera.light;
    appearance.background = camera.background();
    appearance.overlay = read_overlay(picture, &scene)?;
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
    if picture.ambient_occlusion {
        let began = Instant::now();
        appearance.occlusion = ambient_occlusion(&scene, &appearance);
        match appearance.occlusion {
            Some(_) => print::status(&format!("ambient occlusion: {:.3} s", began.elapsed().as_secs_f64())),
            None => print::status("warning: no ambient occlusion, since nothing visible has shading columns"),
        }
    }
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
        print::status("warning: `exact` and `per-ray` are drawn by the cores, not by a graphics device");
    }
    let rasterizer = match picture.rasterizer {
        RasterizerName::Tiles => Rasterizer::Tiles,
        RasterizerName::Quads => Rasterizer::Quads,
        RasterizerName::Bands => Rasterizer::Bands,
    };
    let settings = Settings { quality, projection, rasterizer, ..Settings::default() };
    let work = picture.counts.then(|| counts::count(picture, &scene, &appearance, &camera, settings)).transpose()?;
    let out = match (&picture.out, work.as_ref()) {
        (Some(out), _) => out,
        (None, Some(work)) if picture.json => return print_json(work),
        (None, Some(work)) => return print::result(&work.table()).map_err(Failure::work),
        (None, None) => return Err(Failure::input("name the picture to write with --out")),
    };
    let mut engine = Engine::new(scene, backend, Some(rasterizer)).map_err(Failure::work)?;
    let drawn = engine.draw(&appearance, &camera, options);
    let Rendered { mut image, report } = drawn.map_err(|e| match e {
        GpuError::Input(_) => Failure::input(e),
        _ => Failure::work(e),
    })?;
    if let Some(trouble) = engine.take_fallback_error() {
        print::status(&format!("warning: {trouble}"));
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
    let plain = camera.background();
    let finish = Finish { backdrop: backdrop(picture.background, plain), dither: !picture.no_dither };
    image.save_finished(out, plain, &finish).map_err(Failure::work)?;
    if report.dropped_non_finite > 0 {
        print::status(&format!(
            "warning: {} Gaussians with NaN or infinite attributes were left out",
            report.dropped_non_finite
        ));
    }
    print::status(&format!(
        "{}: {} x {} pixels, {} of {} Gaussians, {:.3} s (preprocess {:.3}, sort {:.3}, bin {:.3}, raster {:.3})",
        out.display(),
        image.width,
        image.height,
        report.drawn,
        report.gaussians,
        report.seconds.total,
        report.seconds.preprocess,
        report.seconds.sort,
        report.seconds.bin,
        report.seconds.raster
    ));
    if let Some(legend) = &legend {
        print::status(&legend.to_string());
    }
    if let Some(hit) = &hit {
        print::status(&show::HitReport::line(hit.as_ref()));
    }
    if picture.json {
        let report = PictureReport {
            out,
            backend: engine.name(),
            quality: picture.quality,
            projection: picture.projection,
            threads: rayon::current_num_threads(),
            camera: &camera,
            legend,
            pick: hit.map(|hit| hit.map(show::HitReport::from)),
            work,
            report,
        };
        print_json(&report)?;
    } else if let Some(work) = &work {
        print::result(&work.table()).map_err(Failure::work)?;
    }
    Ok(())
}

fn print_json(report: &impl Serialize) -> Result<(), Failure> {
    print::result(&serde_json::to_string_pretty(report).map_err(Failure::work)?).map_err(Failure::work)
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
        print::status(&format!("warning: {warning}"));
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

/// A preset as this camera's viewer sees it.
fn preset_light(name: LightName, camera: &Camera) -> Light {
    let preset = match name {
        LightName::Headlight => LightPreset::Headlight,
        LightName::Studio => LightPreset::Studio,
        LightName::Rim => LightPreset::Rim,
        LightName::Flat => LightPreset::Flat,
    };
    // The rows of the view are the camera's axes: right, down, forward.
    let rows = camera.view().transpose();
    let axis = |row: DVec4, sign: f64| (sign * row.truncate()).normalize_or_zero().to_array();
    let axes =
        ViewerAxes { right: axis(rows.x_axis, 1.0), up: axis(rows.y_axis, -1.0), backward: axis(rows.z_axis, -1.0) };
    let set = preset.set_light(&axes);
    let own = Light::default();
    let (mode, direction) = match set.direction {
        Some(to) => (LightMode::Direction, decode_vector(&to).as_vec3().to_array()),
        None => (LightMode::Headlight, own.direction),
    };
    let [ka, kd, ks, shininess] =
        [set.ambient, set.diffuse, set.specular, set.shininess].map(|factor| factor.unwrap_or(1.0));
    Light { mode, direction, ka, kd, ks, shininess }
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

/// The wanted background.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Background {
    Plain,
    /// A gradient about the plain colour.
    Around,
    Transparent,
    Color(Vec3),
    Gradient(Gradient),
}

fn background(text: &str) -> Result<Background, String> {
    match (text, text.split_once('/')) {
        ("plain", _) => Ok(Background::Plain),
        ("gradient", _) => Ok(Background::Around),
        ("transparent", _) => Ok(Background::Transparent),
        (_, Some((top, bottom))) => Ok(Background::Gradient(Gradient { top: color(top)?, bottom: color(bottom)? })),
        (_, None) => color(text).map(Background::Color),
    }
}

fn backdrop(wanted: Option<Background>, plain: Vec3) -> Backdrop {
    match wanted {
        None | Some(Background::Plain | Background::Color(_)) => Backdrop::Plain,
        Some(Background::Around) => Backdrop::Gradient(Gradient::around(plain)),
        Some(Background::Gradient(gradient)) => Backdrop::Gradient(gradient),
        Some(Background::Transparent) => Backdrop::Transparent,
    }
}

fn share(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|x| (0.0..=1.0).contains(x)).ok_or_else(|| format!("`{text}` is no number from 0 to 1"))
}

fn length(text: &str) -> Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|x| *x >= 0.0 && x.is_finite())
        .ok_or_else(|| format!("`{text}` is no finite length of at least 0"))
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
        assert_eq!(background("gradient"), Ok(Background::Around));
        assert_eq!(background("0,0.5,1"), Ok(Background::Color(Vec3::new(0.0, 0.5, 1.0))));
        let gradient = Gradient { top: Vec3::ONE, bottom: Vec3::ZERO };
        assert_eq!(background("1,1,1/0,0,0"), Ok(Background::Gradient(gradient)));
        assert!(background("red").is_err() && background("1,1,1/").is_err());
        assert_eq!(numbers("-1, 2.5"), Ok([-1.0, 2.5]));
        assert!(numbers::<2>("1").is_err() && numbers::<2>("1,2,3").is_err() && numbers::<1>("inf").is_err());
    }
}
