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

mod appearance_buffers;
pub mod backend;
mod buffers;
mod compose;
mod depth;
mod depth_layer;
mod device;
mod device_class;
mod early_out;
mod error;
mod frame_uniform;
mod pass_chain;
mod pipeline;
mod present;
mod quads;
mod radix_sort;
mod ray_tiles;
mod readback;
mod renderer;
mod scene_buffers;
mod settings;
mod shader_layout;
mod shader_source;
mod sort_window;
mod splats;
mod stats;
mod textures;
mod tiles;
mod view_limits;
mod vignette;
mod visibility_mask;

pub use depth_layer::{DEPTH_FAR, DEPTH_NEAR, DepthLayer};
pub use device::{Gpu, OPTIONAL_FEATURES};
pub use device_class::DeviceClass;
pub use error::GpuError;
pub use present::Present;
pub use renderer::Renderer;
pub use settings::{FrameStats, Options, Rasterizer, Settings};
pub use stats::PassSeconds;
pub use vignette::Vignette;
