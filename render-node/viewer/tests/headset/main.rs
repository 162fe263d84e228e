//! Headset and hands: the mathematics of holding a scene, and sessions under a real OpenXR runtime.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test fails by panicking and says what it measured"
)]

/// Metres of the room from an eye within which Gaussians fade.
const NEAR: f64 = 0.05;

mod eye;
#[cfg(feature = "xr")]
mod fingers;
mod holding;
mod joints;
mod mask;
#[cfg(feature = "xr")]
mod monado;
mod pointing;
#[cfg(feature = "xr")]
mod rooms;
#[cfg(feature = "xr")]
mod seen;
#[cfg(feature = "xr")]
mod sessions;
#[cfg(feature = "xr")]
mod together;
#[cfg(feature = "xr")]
mod traces;

#[cfg(feature = "xr")]
#[allow(dead_code, reason = "made for pictures of every kind; here one is enough")]
#[path = "../../../gpu/tests/pictures/scenes.rs"]
mod scenes;
