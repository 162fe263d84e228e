//! Viewpoints that a person keeps under names.

use std::sync::Arc;

use sg_proto::limits::MAX_KEPT_VIEWS;
use sg_proto::scene::{ForgetView, KeepView};

use super::error::EditError;
use super::names::checked_name;
use super::state::{EditState, KeptView};
use super::transaction::Transaction;

/// Stem of the names that are chosen here.
const STEM: &str = "view";

impl EditState {
    /// Kept viewpoints, oldest first.
    #[must_use]
    pub fn kept_views(&self) -> &[KeptView] {
        &self.kept_views
    }

    /// The kept viewpoint of a name, in any capitals.
    ///
    /// # Errors
    /// [`EditError::UnknownView`] with the names that there are.
    pub fn kept_view(&self, name: &str) -> Result<&KeptView, EditError> {
        let folded = folded(name);
        self.kept_views.iter().find(|kept| kept.name.to_lowercase() == folded).ok_or_else(|| EditError::UnknownView {
            name: name.trim().to_owned(),
            kept: self.kept_views.iter().map(|kept| kept.name.clone()).collect(),
        })
    }
}

impl Transaction<'_> {
    /// Keeps the viewpoint. One of the same name gets it in place of its own.
    pub(super) fn keep_view(&mut self, command: &KeepView) -> Result<String, EditError> {
        let mut kept = self.state.kept_views.to_vec();
        let name = match command.name.trim() {
            "" => free_name(&kept),
            name => checked_name(name, "keep_view.name")?,
        };
        let view = self.state.view;
        let folded = folded(&name);
        if let Some(same) = kept.iter_mut().find(|kept| kept.name.to_lowercase() == folded) {
            *same = KeptView { name: name.clone(), view };
            self.state.kept_views = kept.into();
            return Ok(format!("replaced the view “{name}”"));
        }
        if kept.len() >= MAX_KEPT_VIEWS {
            let remedy = "forget one first";
            return Err(EditError::TooMany { what: "kept views", limit: MAX_KEPT_VIEWS, remedy });
        }
        let summary = format!("kept the view as “{name}”");
        kept.push(KeptView { name, view });
        self.state.kept_views = kept.into();
        Ok(summary)
    }

    /// Forgets a kept viewpoint.
    pub(super) fn forget_view(&mut self, command: &ForgetView) -> Result<String, EditError> {
        let name = self.state.kept_view(&command.name)?.name.clone();
        let rest: Arc<[KeptView]> = self.state.kept_views.iter().filter(|kept| kept.name != name).cloned().collect();
        self.state.kept_views = rest;
        Ok(format!("forgot the view “{name}”"))
    }
}

fn folded(name: &str) -> String {
    name.trim().to_lowercase()
}

/// The first of `view 1`, `view 2`, … that no kept viewpoint has.
fn free_name(kept: &[KeptView]) -> String {
    let numbers = 1..=kept.len() + 1;
    let mut names = numbers.map(|number| format!("{STEM} {number}"));
    let is_free = |name: &String| kept.iter().all(|kept| kept.name.to_lowercase() != *name);
    // One more name than there are viewpoints: one is free.
    names.find(is_free).unwrap_or_else(|| STEM.to_owned())
}
