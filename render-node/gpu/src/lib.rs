//! Gaussian splatting on a graphics device through wgpu: sort, pipelines, shaders.
//!
//! The device draws in f32. The error of its pictures against the f64 reference of [`sg_raster`] has the same bound as that of the
//! CPU renderer. [`Renderer::new`] uploads the columns of a scene once. Edits upload only their changes.
//!
//! A frame is one chain of passes without readback: mark visible Gaussians, list them, project and shade, sort by the full
//! 32-bit depth, blend by tiles or quadrilaterals, compose over the background.
//!
//! ```
//! use sg_gpu::{DeviceClass, Gpu, GpuError};
//!
//! let gpu = match Gpu::open(DeviceClass::Any) {
//!     Ok(gpu) => gpu,
//!     Err(error @ GpuError::NoDevice { .. }) => {
//!         eprintln!("{error}");
//!         return Ok(());
//!     }
//!     Err(error) => return Err(error),
//! };
//! assert!(!gpu.name().is_empty() && !gpu.is_lost());
//! # Ok::<(), GpuError>(())
//! ```
//!
//! # A new pass
//!
//! `pass_chain` lists the passes of a frame in their order, with the resources that they read and write.
//!
//! 1. Write `shaders/NAME.wgsl`. Its variables have the names of their resources, such as `frame` or `depth_order`.
//! 2. Declare new structs and constants in `shader_layout`. Rust and all shaders then know them by the same names.
//! 3. Make a `Shader` of the text, and of it a `Kernel` or a `DrawPipeline` for each entry point.
//! 4. Bind the pipeline to `Resources`, with new buffers under the names of step 1. A missing one is a [`GpuError::Unbound`].
//! 5. Encode the bound pass in its place of `pass_chain`, and add its row to the table there.
//! 6. Describe its commands in `counts/pass_table`, so that `supergaussian render --counts` counts them. A test compares the two.

mod appearance_buffers;
pub mod backend;
mod barriers;
mod buffers;
mod compose;
pub mod counts;
mod created;
mod depth;
mod depth_layer;
mod device;
mod device_class;
mod early_out;
mod error;
mod frame_uniform;
mod hidden_tiles;
mod kept_bindings;
mod meshes;
mod pass_chain;
mod pipeline;
mod pipeline_cache;
mod present;
mod quads;
mod radix_sort;
mod ray_tiles;
mod readback;
mod recorded;
mod renderer;
mod resources;
mod scene_buffers;
mod settings;
mod shader;
mod shader_layout;
mod sort_window;
mod splats;
mod stats;
mod textures;
mod tile_shader;
mod tiles;
mod trial;
mod trusted;
mod uploads;
mod view_limits;
mod vignette;
mod visibility_mask;
mod wgsl;
mod work_timer;

pub use barriers::Commands;
pub use created::{Created, created_on_this_thread};
pub use depth_layer::{DEPTH_FAR, DEPTH_NEAR, DepthLayer};
pub use device::{Gpu, OPTIONAL_FEATURES};
pub use device_class::DeviceClass;
pub use error::GpuError;
pub use meshes::{MOST_MESHES, MeshCorner, MeshEye, MeshLayer, MeshLook, PlacedMesh};
pub use pipeline_cache::keep_pipelines_in;
pub use present::Present;
pub use recorded::record_commands;
pub use renderer::Renderer;
pub use settings::{FrameStats, Options, Rasterizer, Settings};
pub use stats::PassSeconds;
pub use trial::{Candidate, Trial};
pub use vignette::Vignette;
pub use work_timer::WorkTimer;
