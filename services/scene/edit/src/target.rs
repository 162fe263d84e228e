//! What a command acts on.

use sg_proto::scene::Target;

use super::error::EditError;
use super::names::listed;
use super::state::{EditState, UnitRef};
use sg_scene::mask::Mask;

/// A target looked up in a state.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Resolved {
    /// Every Gaussian it means.
    pub(super) members: Mask,
    /// Units it means by name.
    pub(super) named: Vec<UnitRef>,
    /// The whole scene.
    pub(super) everything: bool,
    /// Gaussians that it means otherwise than by a unit's name: the selection, or all that is not named.
    pub(super) unnamed: Option<Mask>,
    /// Names of the units in it, as they are called in the scene, named or excepted: what "it" refers to afterwards.
    pub(super) names: Vec<String>,
    /// The target in words.
    pub(super) phrase: String,
    /// Whether the Gaussians without a unit's name are the selection, not all that is left of something.
    pub(super) of_selection: bool,
}

impl EditState {
    /// Looks a target up.
    pub(super) fn resolve(&self, target: Option<&Target>) -> Result<Resolved, EditError> {
        let target = target.ok_or(EditError::NoTarget)?;
        let mut members = Mask::empty(self.count());
        let mut named = Vec::new();
        let mut names: Vec<String> = Vec::new();
        for name in &target.units {
            let unit = self.find(name)?;
            if !named.contains(&unit) {
                named.push(unit);
                names.extend(self.name_of(unit).map(str::to_owned));
                members.union_with(&self.members(unit));
            }
        }
        let mut parts = names.clone();
        if target.selection {
            if self.selection.mask().is_none() {
                return Err(EditError::NothingSelected);
            }
            members.union_with(self.selection.mask());
            parts.push("the selection".to_owned());
        }
        // "All that is not named" with nothing named is all there is.
        let nothing_named = parts.is_empty() && !target.everything;
        if nothing_named && !target.complement {
            return Err(EditError::NoTarget);
        }
        if target.everything || nothing_named {
            if target.everything && target.complement {
                return Err(EditError::EmptyTarget("what is left of everything".to_owned()));
            }
            return Ok(Resolved {
                members: Mask::full(self.count()),
                named: Vec::new(),
                everything: true,
                unnamed: None,
                names: Vec::new(),
                phrase: "everything".to_owned(),
                of_selection: false,
            });
        }
        let phrase = listed(&parts);
        if target.complement {
            members.invert();
            let phrase = format!("everything but {phrase}");
            if members.is_none() {
                return Err(EditError::EmptyTarget(phrase));
            }
            return Ok(Resolved {
                unnamed: Some(members.clone()),
                members,
                named: Vec::new(),
                everything: false,
                names,
                phrase,
                of_selection: false,
            });
        }
        let unnamed = target.selection.then(|| (**self.selection.mask()).clone());
        let of_selection = target.selection;
        Ok(Resolved { members, named, everything: false, unnamed, names, phrase, of_selection })
    }
}
