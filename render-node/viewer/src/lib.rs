//! Views of a scene for people: the state of a display, its panels, a window, and a headset.
//!
//! A display draws in a loop that never waits. It reads the newest [`display::ViewState`] from a [`display::ViewPort`] and sends
//! [`display::Request`]s back. The backend of that channel is another process's business: this crate names no bus.
//!
//! - [`display`]: view state, requests, brush, drafts, adaptive quality.
//! - [`panels`]: the egui panels, the same in a window and in a headset.
//! - [`window`]: a window with a mouse and a keyboard.
//! - [`video`]: a video of numbered pictures.
//! - [`hands`]: poses, grabbing and pointing, as pure functions in f64.
//! - [`vr`] and [`xr`]: the view in a headset, and its OpenXR session.
//!
//! An orbit around a scene, without a display or a graphics device:
//!
//! ```
//! use glam::{DVec2, DVec3};
//! use sg_scene::model::SceneBox;
//! use sg_scene::view::View;
//! use sg_viewer::window::{NavigationMode, Navigator};
//!
//! let bounds = SceneBox { min: DVec3::ZERO, max: DVec3::ONE };
//! let view = View::framing(bounds, DVec3::Y, DVec3::Z, 40.0);
//! let mut navigator = Navigator::new(view, bounds);
//! assert_eq!(navigator.navigation_mode, NavigationMode::Orbit);
//!
//! // A drag over half the height of the picture turns by 90 degrees about the upright axis.
//! navigator.turn(DVec2::new(0.5, 0.0));
//! let distance = |view: &View| view.eye.distance(view.target);
//! assert!((distance(&navigator.view) - distance(&view)).abs() < 1e-9);
//! let (before, after) = (view.eye - view.target, navigator.view.eye - navigator.view.target);
//! assert!(before.dot(after).abs() < 1e-9);
//! ```

pub mod display;
pub mod hands;
pub mod panels;
pub mod video;
#[cfg(feature = "xr")]
pub mod vr;
pub mod window;
#[cfg(feature = "xr")]
pub mod xr;
