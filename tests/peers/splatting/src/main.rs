//! Other renderers of splats, timed on a turn around a scene for `tests/benches/rendering.rs`.
//!
//!     splatting-peers wgpu-3dgs-viewer [--float] [--std-dev S] SCENE TURN OUT STEP VIEWS
//!     splatting-peers naive [--float] SCENE TURN OUT STEP VIEWS
//!
//! SCENE is a PLY as 3DGS writes it, TURN a JSON list of steps, each a list of cameras, one for each eye. The turn is drawn once
//! unmeasured and once measured. `{"name", "device", "ms"}` goes to standard output. The pictures of the first VIEWS of the steps 0,
//! STEP, 2 STEP … go to `OUT/0.npy`, `OUT/1.npy` …: float32 (height, width, 4), RGB over black, 0 to 1, and opacity.

mod device;
mod harmonics;
mod naive;
mod turn;
mod viewer;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, Subcommand};
use wgpu_3dgs_viewer::core::{PlyGaussians, ReadIterGaussian};

use crate::device::{Gpu, Target};
use crate::turn::{Camera, Turn};

#[derive(Debug, Parser)]
#[command(about)]
struct Arguments {
    #[command(subcommand)]
    renderer: Choice,
}

#[derive(Debug, Subcommand)]
enum Choice {
    /// The crate of that name.
    ///
    /// Its sort waits for other workgroups, which a software device with several threads does not stand: it loses Gaussians
    /// there. With LP_NUM_THREADS=1 in the environment lavapipe gives the right picture.
    #[command(name = "wgpu-3dgs-viewer")]
    Viewer {
        /// Its "maximum standard deviation", at most 3, which scales the Gaussians as well: by S / √8.
        #[arg(long, default_value_t = 3.0)]
        std_dev: f32,
        #[command(flatten)]
        job: Job,
    },
    /// What one would write first: projection and sort on one core, then instanced quads.
    Naive {
        #[command(flatten)]
        job: Job,
    },
}

/// What to draw, and where the pictures go.
#[derive(Debug, clap::Args)]
struct Job {
    /// Draws into 16-bit floats rather than into 8 bits a channel.
    #[arg(long)]
    float: bool,
    /// Gaussians: a PLY as 3DGS writes it.
    scene: PathBuf,
    /// Steps of the turn: JSON.
    turn: PathBuf,
    /// A folder that is there.
    out: PathBuf,
    /// Every how manieth step is written.
    step: usize,
    /// How many steps are written.
    views: usize,
}

/// Why nothing was drawn.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error("{0}: {1}")]
    File(PathBuf, std::io::Error),
    #[error("{0}: {1}")]
    Turn(PathBuf, serde_json::Error),
    #[error(transparent)]
    Device(#[from] device::DeviceError),
    #[error(transparent)]
    Viewer(#[from] viewer::ViewerError),
    #[error("standard output: {0}")]
    Told(#[from] serde_json::Error),
}

/// A renderer that has a scene.
trait Renderer {
    /// What it is called in the table.
    fn name(&self) -> String;

    /// Hands in all work for one picture; does not wait for it.
    fn draw(&mut self, gpu: &Gpu, camera: &Camera, target: &Target);
}

impl Job {
    /// The Gaussians of the scene, with attributes as the file has them.
    fn gaussians(&self) -> Result<PlyGaussians, Failure> {
        PlyGaussians::read_from_file(&self.scene).map_err(|e| Failure::File(self.scene.clone(), e))
    }

    fn format(&self) -> wgpu::TextureFormat {
        if self.float { wgpu::TextureFormat::Rgba16Float } else { wgpu::TextureFormat::Rgba8Unorm }
    }

    fn turn(&self) -> Result<Turn, Failure> {
        let text = std::fs::read(&self.turn).map_err(|e| Failure::File(self.turn.clone(), e))?;
        serde_json::from_slice(&text).map_err(|e| Failure::Turn(self.turn.clone(), e))
    }

    /// Times the turn, tells the times, writes pictures.
    fn run(&self, gpu: &Gpu, renderer: &mut dyn Renderer) -> Result<(), Failure> {
        let turn = self.turn()?;
        let most = turn.iter().map(Vec::len).max().unwrap_or(0);
        let size = turn.iter().flatten().next().map_or((1, 1), |c| (c.width, c.height));
        let targets: Vec<Target> = (0..most).map(|_| Target::new(gpu, size, self.format())).collect();
        let mut draw = |eyes: &[Camera]| {
            for (camera, target) in eyes.iter().zip(&targets) {
                renderer.draw(gpu, camera, target);
            }
            gpu.wait()
        };
        for eyes in &turn {
            draw(eyes)?;
        }
        let mut ms = Vec::new();
        for eyes in &turn {
            let began = Instant::now();
            draw(eyes)?;
            ms.push(1e3 * began.elapsed().as_secs_f64());
        }
        let mut written = 0;
        for eyes in turn.iter().step_by(self.step.max(1)).take(self.views) {
            draw(eyes)?;
            for target in &targets[..eyes.len()] {
                write_npy(&self.out.join(format!("{written}.npy")), size, &target.read(gpu)?)?;
                written += 1;
            }
        }
        let told = serde_json::json!({ "name": renderer.name(), "device": gpu.name(), "ms": ms });
        serde_json::to_writer(std::io::stdout(), &told)?;
        Ok(())
    }
}

/// Writes a picture of `size` (width, height), rows from the top, RGBA.
fn write_npy(path: &Path, size: (u32, u32), rgba: &[f32]) -> Result<(), Failure> {
    use npyz::WriterBuilder;
    let write = || {
        let file = std::io::BufWriter::new(std::fs::File::create(path)?);
        let shape = [size.1.into(), size.0.into(), 4];
        let mut npy = npyz::WriteOptions::<f32>::new().default_dtype().shape(&shape).writer(file).begin_nd()?;
        npy.extend(rgba.iter().copied())?;
        npy.finish()
    };
    write().map_err(|e| Failure::File(path.to_owned(), e))
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let gpu = Gpu::open()?;
    match &arguments.renderer {
        Choice::Viewer { std_dev, job } => {
            let options = viewer::Options { format: job.format(), std_dev: *std_dev };
            job.run(&gpu, viewer::open(&gpu, &job.gaussians()?, options)?.as_mut())
        }
        Choice::Naive { job } => job.run(&gpu, &mut naive::Naive::new(&gpu, job.gaussians()?, job.format())),
    }
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("splatting-peers: {e}");
            ExitCode::FAILURE
        }
    }
}
