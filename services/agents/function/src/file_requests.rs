//! Files that a person asks for in words: the supervisor writes and opens them.
//!
//! Such a request is sent once. A second one would write a second file, so no fault of it is transient.

use sg_language::report;
use sg_language::resolution::{PictureWish, Step};
use sg_proto::keys;
use sg_proto::language::ActionResult;
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{DrawnPicture, OpenRequest, SaveRequest};
use sg_proto::limits::MAX_PICTURE_PIXELS;
use sg_proto::render::{CaptureRequest, Quality};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

use crate::action_result::failure;

/// Width and height of a picture where no window shows one, pixels.
const SIZE: [u32; 2] = [1600, 1200];

/// Sends requests about files.
pub(crate) struct FileRequests {
    bus: Bus,
}

impl FileRequests {
    pub(crate) fn new(bus: Bus) -> Self {
        Self { bus }
    }

    /// Saves or opens the file of a step. Every fault fails the clause, as one sentence.
    pub(crate) async fn carry_out(&self, step: Step, context: &Context) -> ActionResult {
        let outcome = match step {
            Step::Save { request, units } => self.save(request, context).await.map(|text| (text, units)),
            Step::Picture(wish) => self.picture(wish, context).await.map(|text| (text, Vec::new())),
            Step::Open(request) => self.open(&request, context).await.map(|text| (text, Vec::new())),
            Step::Change { .. } | Step::Answer { .. } | Step::Strokes(_) | Step::BestView(_) | Step::Tour { .. } => {
                Err(Fault::internal("this step is about no file"))
            }
        };
        match outcome {
            Ok((text, units)) => ActionResult { ok: true, text, units, ..ActionResult::default() },
            Err(fault) => failure(report::sentence(&fault.message)),
        }
    }

    async fn save(&self, request: SaveRequest, context: &Context) -> Result<String, Fault> {
        let reply = self.bus.ask(&keys::SAVE, &request, &context.next()).await?;
        Ok(report::saved(request.content.as_ref(), &reply))
    }

    async fn open(&self, request: &OpenRequest, context: &Context) -> Result<String, Fault> {
        let reply = self.bus.ask(&keys::OPEN, request, &context.next()).await?;
        Ok(report::opens(request, &reply))
    }

    /// Draws the scene's view at the shape of the window, and saves the picture.
    async fn picture(&self, wish: PictureWish, context: &Context) -> Result<String, Fault> {
        let window = self.bus.newest(&keys::VIEW_STATE, &context.next()).await.unwrap_or_default();
        let [width, height] = if window.width > 0 { [window.width, window.height] } else { SIZE };
        let fits = MAX_PICTURE_PIXELS / width.max(height).max(1);
        let scale = wish.scale.min(fits).max(1);
        let capture = CaptureRequest {
            width: width * scale,
            height: height * scale,
            quality: Quality::Standard.into(),
            transparent: wish.transparent,
            ..CaptureRequest::default()
        };
        let frame = self.bus.ask(&keys::CAPTURE, &capture, &context.next()).await?;
        let picture = Content::Picture(DrawnPicture { path: frame.png_path });
        self.save(SaveRequest { path: wish.file, replace: false, content: Some(picture) }, context).await
    }
}
