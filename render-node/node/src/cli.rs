//! Offline: one picture of a scene file or of a volume, or a film of it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use glam::{DVec2, Vec3};
use serde::Serialize;
use sg_formats::staged_file;
use sg_input::number_format::grouped;
use sg_input::print;
use sg_raster::image::ImageFormat;
use sg_raster::pick;
use sg_raster::render::Rendered;
use sg_raster::report::Report;
use sg_scene::camera::Camera;

mod counts;
mod failure;
mod film;
mod look;
mod names;
mod show;
mod transfer_function;
mod values;
mod volume;

use failure::Failure;
use look::{Look, Painter};
use names::{
    BackendName, ConventionName, FilterName, LightName, ProjectionName, QualityName, RasterizerName, ShadingName,
    TermName,
};
use values::{Background, background, color, factor, length, lengths, numbers, share, step};
use volume::SeenVolume;

/// Examples in the help of the command.
pub(crate) const EXAMPLES: &str = "Examples:
  supergaussian render scene.toml --camera front.json --out front.png --quality exact
  supergaussian render tooth.ply --out anisotropy.png --show anisotropy --color-map cividis
  supergaussian render scene.toml --out clusters.png --show clusters --clusters labels.npy --outlines 2
  supergaussian render scene.toml --out half.png --clip-plane 0,0,0,1,0,0 --mask sac.npy --pick 512,512
  supergaussian render scene.toml --counts --both-eyes --rasterizer quads --card rtx-3090
  supergaussian render scene.toml --counts --both-eyes --foveation 30 --card rtx-3090
  supergaussian render bonsai/scene.toml --turntable --camera-path way.txt --out film --frames 120 --fps 24
  supergaussian render bonsai_256x256x256_uint8.raw.zst --transfer-function bonsai.tf.json --out volume.png
  supergaussian render ct/slices --out head.png";

/// Example in the help of `serve`.
pub(crate) const SERVE_EXAMPLE: &str = "Example (a supervisor does this):
  supergaussian-render-node serve --session demo --role render-view --instance render-view-1 \\
    --connect unixsock-stream/$RUN/bus.sock --run-dir $RUN --params '{\"display\": \"window\"}'";

/// Arguments of the render command.
// One flat list: clap's derive takes an optional group of arguments for absent where it has another group within.
#[derive(Debug, Args)]
pub(crate) struct Picture {
    /// The scene: a Gaussian file or `scene.toml`. Or a volume, for ray marching: a file, or a folder of DICOM slices.
    scene: PathBuf,
    /// Transfer function of a volume [default: an automatic one from the histogram]. Or another one for a scene of a volume, whose
    /// Gaussians keep the volume's values [default: that of the scene].
    #[arg(long, value_name = "TF.json")]
    transfer_function: Option<PathBuf>,
    /// Distance between two samples on a ray through a volume, in voxels, or in 1/256 of a mesh's diagonal [default: 0.5].
    #[arg(long, value_name = "VOXELS", value_parser = step)]
    step: Option<f64>,
    /// Millimetres between voxels along x, y and z, for raw volumes: they store none.
    #[arg(long, value_name = "X,Y,Z", value_parser = lengths)]
    spacing: Option<[f64; 3]>,
    /// Quantity to draw, of a file that holds several. NAME:K is component K of a vector; NAME alone is its length. Default: that of the
    /// transfer function, or the first one.
    #[arg(long, value_name = "NAME")]
    variable: Option<String>,
    /// Series to draw, of a folder of DICOM slices with several: its number from 1, as a note tells it. Default: that of the named
    /// file, or the largest one.
    #[arg(long, value_name = "N")]
    series: Option<usize>,
    /// Camera file (JSON). Without one, the whole scene is framed: plain splats from the front, volume scenes obliquely with
    /// z up.
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Picture to write: `.png` (8-bit RGB) or `.npy` (float32, height × width × 4). For a film its folder, which is new or
    /// holds an earlier film.
    #[arg(long, required_unless_present = "counts")]
    out: Option<PathBuf>,
    /// Width of the picture in pixels, where no camera is given [default: 1024, of a film 1280].
    #[arg(long, conflicts_with = "camera", value_parser = clap::value_parser!(u32).range(1..=16_384))]
    width: Option<u32>,
    /// Height of the picture in pixels, where no camera is given [default: 1024, of a film 720].
    #[arg(long, conflicts_with = "camera", value_parser = clap::value_parser!(u32).range(1..=16_384))]
    height: Option<u32>,
    /// Makes a film of a turn around the scene: numbered pictures, and a video of them where `ffmpeg` is installed. With a camera
    /// path the turn begins at its first pose, and the path follows.
    #[arg(long, conflicts_with_all = ["camera", "counts", "pick"])]
    turntable: bool,
    /// Makes a film of a smooth way through the poses of a text file. Its lines are `pose X Y Z X Y Z` (the eye, then a point that it
    /// looks at), `up X Y Z`, `near LENGTH` and `fov DEGREES` (vertical).
    #[arg(long, value_name = "PATH.txt", conflicts_with_all = ["camera", "counts", "pick"])]
    camera_path: Option<PathBuf>,
    /// Pictures of a turn, and as many of a camera path [default: 240].
    #[arg(long, value_name = "PICTURES", value_parser = clap::value_parser!(u32).range(2..=4999))]
    frames: Option<u32>,
    /// Pictures of the video in a second [default: 30].
    #[arg(long, value_name = "PICTURES", value_parser = clap::value_parser!(u32).range(1..=120))]
    fps: Option<u32>,
    /// Makes no video of a film's pictures.
    #[arg(long)]
    no_video: bool,
    /// Device that draws.
    #[arg(long, value_enum, default_value_t = BackendName::Auto)]
    backend: BackendName,
    /// Blending method of a graphics device.
    #[arg(long, value_enum, default_value_t = RasterizerName::Tiles)]
    rasterizer: RasterizerName,
    /// Quality of the picture, as its error against the reference. A volume is drawn in f64 for `exact`, otherwise in f32.
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
    /// Half resolution beyond so many degrees from the optical axis, 1 to 89, as a headset may have it. Not for `exact`, `per-ray` and
    /// quadrilaterals [default: none].
    #[arg(long, value_name = "DEGREES", value_parser = clap::value_parser!(u8).range(1..=89))]
    foveation: Option<u8>,
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
    /// Keeps one side of a plane: the side to which N points, with P on the plane. It cuts Gaussians that cross it. Scene
    /// coordinates. Repeatable.
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ", value_parser = numbers::<6>, allow_hyphen_values = true)]
    clip_plane: Vec<[f64; 6]>,
    /// Keeps the inside of the box between two corners. Scene coordinates. Repeatable.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = numbers::<6>, allow_hyphen_values = true)]
    clip_box: Vec<[f64; 6]>,
    /// Leaves out the inside of the box between two corners. Scene coordinates. Repeatable.
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

impl Picture {
    /// Whether a film is asked for.
    fn is_film(&self) -> bool {
        self.turntable || self.camera_path.is_some()
    }
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
    legend: Option<&'a show::LegendReport>,
    /// Absent without a request; null if nothing is in front.
    #[serde(skip_serializing_if = "Option::is_none")]
    pick: Option<Option<show::HitReport>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    work: Option<counts::WorkReport>,
    #[serde(flatten)]
    report: Report,
}

/// Ends the process because the command line names no scene.
pub(crate) fn refuse_without_scene(mut command: clap::Command) -> ! {
    let missing = clap::error::ErrorKind::MissingRequiredArgument;
    command.error(missing, "name a scene, and the picture to write with --out").exit()
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
    if picture.is_film() {
        return film::make(picture);
    }
    if picture.frames.is_some() || picture.fps.is_some() || picture.no_video {
        return Err(Failure::input("--frames, --fps and --no-video are of films: add --turntable or --camera-path"));
    }
    // A wrong ending is found before any work is done.
    let format = picture.out.as_deref().map(ImageFormat::of).transpose().map_err(Failure::input)?;
    if format == Some(ImageFormat::Npy) && matches!(picture.background, Some(Background::Transparent)) {
        return Err(Failure::input("--background transparent: a .npy picture always has its coverage; write a .png"));
    }
    let inputs = [
        Some(&picture.scene),
        picture.transfer_function.as_ref(),
        picture.camera.as_ref(),
        picture.clusters.as_ref(),
        picture.mask.as_ref(),
    ];
    staged_file::check_outputs(picture.out.as_deref(), inputs.into_iter().flatten().map(PathBuf::as_path))
        .map_err(Failure::input)?;
    let camera = picture.camera.as_deref().map(Camera::read).transpose().map_err(Failure::input)?;
    let clock = Instant::now();
    if let Some(volume) = SeenVolume::read(picture)? {
        return volume::draw(picture, &volume, camera, clock.elapsed().as_secs_f64());
    }
    let scene = look::read_scene(picture)?;
    let appearance = look::clipped(picture, &scene);
    let camera = look::camera(picture, &scene, &appearance, camera);
    let look = Look::new(picture, &scene, &camera, appearance)?;
    let count = || counts::count(picture, &scene, &look.appearance, &camera, look::settings(picture));
    let work = picture.counts.then(count).transpose()?;
    let out = match (&picture.out, work.as_ref()) {
        (Some(out), _) => out,
        (None, Some(work)) if picture.json => return print_json(work),
        (None, Some(work)) => return print::result(&work.table()).map_err(Failure::work),
        (None, None) => return Err(Failure::input("name the picture to write with --out")),
    };
    let mut painter = Painter::new(picture, scene, &look)?;
    let Rendered { image, report } = painter.draw(&camera)?;
    let (scene, projection) = (painter.engine().scene(), painter.options().projection);
    let hit = picture
        .pick
        .map(|at| pick::pick(scene, &look.appearance, &camera, projection, DVec2::from_array(at), pick::SURFACE))
        .transpose()
        .map_err(Failure::input)?;
    let (plain, finish) = look.finish(picture);
    image.save_finished(out, plain, &finish).map_err(Failure::work)?;
    look::warn_of_dropped(report.dropped_non_finite);
    print::status(&format!(
        "{}: {} x {} pixels, {} of {} Gaussians, {:.3} s (preprocess {:.3}, sort {:.3}, bin {:.3}, raster {:.3})",
        out.display(),
        image.width,
        image.height,
        grouped(report.drawn as u64),
        grouped(report.gaussians as u64),
        report.seconds.total,
        report.seconds.preprocess,
        report.seconds.sort,
        report.seconds.bin,
        report.seconds.raster
    ));
    if let Some(legend) = &look.legend {
        print::status(&legend.to_string());
    }
    if let Some(hit) = &hit {
        print::status(&show::HitReport::line(hit.as_ref()));
    }
    if picture.json {
        let report = PictureReport {
            out,
            backend: painter.engine().name(),
            quality: picture.quality,
            projection: picture.projection,
            threads: rayon::current_num_threads(),
            camera: &camera,
            legend: look.legend.as_ref(),
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
