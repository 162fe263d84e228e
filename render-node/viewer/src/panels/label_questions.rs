//! A person's questions to the labeling service, and the pictures of its answer.

use std::fmt;
use std::sync::Arc;

use egui::{ColorImage, Context, TextureHandle, TextureOptions};

use crate::display::{Answer, PicturedView, REGION_VIEWS, RegionViews, ViewState};

/// A question to the service.
#[derive(Debug)]
pub(super) struct Question {
    pub(super) number: u64,
    /// What it is about, for a person.
    pub(super) about: String,
}

impl Question {
    /// Its answer, once there is one.
    pub(super) fn answer<'a, T>(&self, newest: Option<&'a Arc<Answer<T>>>) -> Option<&'a Arc<Answer<T>>> {
        newest.filter(|answer| answer.number == self.number)
    }
}

/// The newest questions to the labeling service, and the pictures of its answer.
#[derive(Debug, Default)]
pub(super) struct LabelQuestions {
    /// Number of the newest question; 0 before the first.
    newest: u64,
    pub(super) find: Option<Question>,
    pub(super) views: Option<Question>,
    pub(super) thumbnails: Option<Thumbnails>,
}

impl LabelQuestions {
    /// A question about this, with the next number.
    pub(super) fn next(&mut self, state: &ViewState, about: String) -> Question {
        // A display may have had other panels before.
        self.newest = self.newest.max(state.labeling.newest_number()) + 1;
        Question { number: self.newest, about }
    }

    /// Gives all questions up. Their answers are not shown.
    pub(super) fn give_up(&mut self) {
        (self.find, self.views, self.thumbnails) = (None, None, None);
    }
}

/// The pictures of an answer as textures of a context. They are freed with the answer.
pub(super) struct Thumbnails {
    answer: Arc<Answer<RegionViews>>,
    context: Context,
    /// One for each view; `None` where its picture cannot be shown.
    pub(super) textures: Vec<Option<TextureHandle>>,
}

impl fmt::Debug for Thumbnails {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Thumbnails").field("answer", &self.answer.number).finish_non_exhaustive()
    }
}

impl Thumbnails {
    pub(super) fn new(context: &Context, answer: &Arc<Answer<RegionViews>>, views: &[PicturedView]) -> Self {
        let texture = |(k, view): (usize, &PicturedView)| {
            let picture = view.picture.as_ref().ok()?;
            let image = ColorImage::from_rgba_unmultiplied(picture.size, &picture.rgba);
            Some(context.load_texture(format!("best view {}", k + 1), image, TextureOptions::LINEAR))
        };
        let textures = views.iter().take(REGION_VIEWS).enumerate().map(texture).collect();
        Self { answer: Arc::clone(answer), context: context.clone(), textures }
    }

    /// Whether these are the pictures of this answer in this context.
    pub(super) fn are_of(&self, context: &Context, answer: &Arc<Answer<RegionViews>>) -> bool {
        Arc::ptr_eq(&self.answer, answer) && self.context == *context
    }
}
