//! Shared parts of the tests of drawing.

use sg_gpu::{DeviceClass, Gpu};

/// The device that tests draw with. On a machine without one: `None` and a message, unless it is required.
pub(crate) fn device() -> Option<Gpu> {
    match Gpu::open(DeviceClass::Any) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "{error}");
            println!("SKIPPED on a graphics device: {error}");
            None
        }
    }
}
