//! What a person looks through: view state, panels, a window, hands and a headset.

pub mod display;
pub mod hands;
pub mod panels;
#[cfg(feature = "xr")]
pub mod vr;
pub mod window;
#[cfg(feature = "xr")]
pub mod xr;
