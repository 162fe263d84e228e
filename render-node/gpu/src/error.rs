//! Errors of graphics devices and of drawing on them.

use crate::device_class::DeviceClass;

/// An error of a graphics device.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No device of the requested class exists.
    #[error(
        "no Vulkan device was found ({class:?}); install a driver (mesa-vulkan-drivers has a software device), or draw with the CPU"
    )]
    NoDevice {
        /// The requested class.
        class: DeviceClass,
    },
    /// The driver did not open the device.
    #[error("{device}: {reason}; draw with the CPU")]
    Refused {
        /// Name of the device.
        device: String,
        /// Message of the driver.
        reason: String,
    },
    /// The device was lost. Open it again and make a new renderer.
    #[error("{device} was lost: {reason}; open it again")]
    Lost {
        /// Name of the device.
        device: String,
        /// Message of the driver.
        reason: String,
    },
    /// The device is out of memory.
    #[error("{device} has too little memory: {reason}; draw the scene in parts, or with the CPU")]
    Memory {
        /// Name of the device.
        device: String,
        /// Message of the driver.
        reason: String,
    },
    /// Any other error of the driver.
    #[error("{device}: {reason}")]
    Failed {
        /// Name of the device.
        device: String,
        /// Message of the driver.
        reason: String,
    },
    /// A pass has no resource for a variable of its shader: a defect of this program.
    #[error("the pass `{pass}` has no resource named `{resource}`; report this defect, and draw with the CPU")]
    Unbound {
        /// Entry point of the pass.
        pass: &'static str,
        /// Name of the variable.
        resource: String,
    },
    /// The buffers of one picture cannot list all Gaussians in view.
    #[error(
        "{found} Gaussians are in view and {device} can list {capacity} at once; hide or clip a part, or draw with the CPU"
    )]
    TooMany {
        /// Name of the device.
        device: String,
        /// Number of Gaussians in view.
        found: u64,
        /// Number of Gaussians that fit.
        capacity: u64,
    },
    /// The buffers of one picture cannot hold all Gaussians that rays evaluate in the affine projection.
    #[error(
        "{found} Gaussians are near the eye or large in view, and {device} can draw {capacity} such at once; hide or clip a \
         part, go farther away, or draw with the CPU"
    )]
    TooManyNear {
        /// Name of the device.
        device: String,
        /// Number of such Gaussians in view, each eye's counted.
        found: u64,
        /// Number of those that fit.
        capacity: u64,
    },
    /// The scene, the appearance or the camera is invalid.
    #[error(transparent)]
    Input(#[from] sg_raster::render::RenderError),
    /// The device cannot draw these cameras together, or at this size.
    #[error("{0}")]
    Views(String),
}
