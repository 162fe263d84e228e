//! Drawing on a graphics device through wgpu: the f32 twin of the CPU renderer, held to the same promise against `exact`.
//!
//! A scene's columns are uploaded once ([`Renderer::new`]); what edits change goes up as it changes, masks as the words that
//! differ. A picture is then a chain of passes without any answer from the device in between: mark what may be seen, list it
//! in index order, project and shade, sort by the full 32-bit depth, blend by tiles or by quadrilaterals, put over the
//! background. See `shaders/` for each.

pub mod backend;
mod closing;
mod columns;
mod depth;
mod depth_layer;
mod device;
mod hidden;
mod kernel;
mod look;
mod passes;
mod present;
mod rays;
mod reading;
mod renderer;
mod sort;
mod timing;
mod uniform;
mod vignette;
mod work;

pub use depth_layer::{DepthLayer, FARTHEST, NEAREST};
pub use device::{Gpu, USEFUL, Wanted};
pub use present::Present;
pub use renderer::{Drawn, Options, PassSeconds, Rasterizer, Renderer, Settings};
pub use vignette::Vignette;

/// What a device did not do.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// None will do.
    #[error(
        "no Vulkan device was found ({wanted:?}); install a driver (mesa-vulkan-drivers has one made of processor cores), or draw with the CPU"
    )]
    NoDevice {
        /// What was looked for.
        wanted: Wanted,
    },
    /// The driver did not open it.
    #[error("{device}: {reason}; draw with the CPU")]
    Refused {
        /// Its name.
        device: String,
        /// What the driver said.
        reason: String,
    },
    /// The device went away; a renderer made anew on a device opened anew may succeed.
    #[error("{device} was lost: {reason}; it has to be opened again")]
    Lost {
        /// Its name.
        device: String,
        /// What the driver said.
        reason: String,
    },
    /// Memory.
    #[error("{device} has not enough memory: {reason}; draw the scene in parts, or with the CPU")]
    Memory {
        /// Its name.
        device: String,
        /// What the driver said.
        reason: String,
    },
    /// Anything else that the driver refused.
    #[error("{device}: {reason}")]
    Failed {
        /// Its name.
        device: String,
        /// What the driver said.
        reason: String,
    },
    /// More Gaussians in view than the buffers of one picture can hold.
    #[error(
        "{found} Gaussians are in view and {device} can list {capacity} at once; hide or clip a part, or draw with the CPU"
    )]
    TooMany {
        /// Its name.
        device: String,
        /// Gaussians in view.
        found: u64,
        /// Gaussians that fit.
        capacity: u64,
    },
    /// Input that makes no picture.
    #[error(transparent)]
    Input(#[from] sg_raster::render::RenderError),
    /// Cameras that cannot be drawn together.
    #[error("{0}")]
    Views(String),
}

/// The device that tests draw with: `None`, said loudly, on a machine without one, unless it is required.
#[cfg(test)]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
pub(crate) fn test_device() -> Option<Gpu> {
    match Gpu::open(Wanted::Any) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "{error}");
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}
