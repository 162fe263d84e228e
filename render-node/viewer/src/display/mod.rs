//! The displayed state, and a person's requests at a display.
//!
//! A display (a window, a headset) has a loop that draws. A [`ViewPort`] separates that loop from all asynchronous
//! services. The loop takes the newest [`ViewState`] and sends [`Request`]s; neither blocks. This module does not know the
//! bus.

mod adaptive_quality;
mod appearance_builder;
mod brush;
mod channel;
mod clusters;
mod conversation;
mod draft;
pub mod frame_trace;
mod labeling;
mod latest_worker;
pub(crate) mod number_format;
mod occlusion;
mod parameter_drag;
pub mod quality_control;
mod request;
mod request_queue;
mod scene_follower;
mod tools;
mod tour;
mod trace_recorder;
mod view_state;

pub use adaptive_quality::{AdaptiveQuality, Level};
pub use appearance_builder::{AppearanceBuilder, Colors, colors_of};
pub use brush::{BrushController, BrushSample, BrushSign};
pub use channel::{Backend, FrameStats, REQUESTS, StateWriter, ViewPort};
pub use clusters::Clusters;
pub use conversation::{Conversation, Entry, Turn};
pub use draft::Drafts;
pub use labeling::{Answer, Labeling, Picture, PictureError, PicturedView, REGION_VIEWS, RegionViews};
pub use latest_worker::LatestWorker;
pub(crate) use occlusion::{OcclusionWorker, is_requested, visible_parts};
pub use parameter_drag::{ParameterDrag, THRESHOLD_RANGE, WalkParameter, answer_place, beside_answer, other_answer};
pub use quality_control::{PictureCost, QualityControl};
pub use request::Request;
pub use request_queue::RequestQueue;
pub use scene_follower::{FollowedScene, SceneFollower};
pub use sg_edit::{LEAK_RANGE, leak_of, reach_of};
pub use tools::{BrushMode, DisplayMode, Locomotion, Tools, TurnStyle};
pub use tour::tour_sentence;
pub use trace_recorder::{RecordedFrame, TraceRecorder};
pub use view_state::{NOTICES, Notice, ServiceAvailability, ViewState, WalkCapabilities};
pub(crate) use view_state::{has_microphone, waits_to_talk};
