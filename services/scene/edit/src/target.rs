//! The target of a command.

use sg_proto::scene::Target;

use super::error::EditError;
use super::names::join_names;
use super::state::{EditState, UnitRef};
use sg_scene::mask::Mask;

/// A target looked up in a state.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ResolvedTarget {
    /// Every Gaussian it means.
    pub(super) members: Mask,
    /// Units it means by name.
    pub(super) named: Vec<UnitRef>,
    /// The whole scene.
    pub(super) everything: bool,
    /// Gaussians without a unit's name: the selection, or the complement of named units.
    pub(super) unnamed: Option<Mask>,
    /// Names of the units in it, named or excepted: the meaning of "it" afterwards.
    pub(super) names: Vec<String>,
    /// The target in words.
    pub(super) phrase: String,
    /// Whether the unnamed Gaussians are the selection, not a complement.
    pub(super) of_selection: bool,
}

impl EditState {
    /// The Gaussians that a target means.
    ///
    /// # Errors
    /// [`EditError::NoTarget`] for one that names nothing, and the refusals of its names.
    pub fn targeted(&self, target: &Target) -> Result<Mask, EditError> {
        self.resolve(Some(target)).map(|resolved| resolved.members)
    }

    /// Looks a target up.
    pub(super) fn resolve(&self, target: Option<&Target>) -> Result<ResolvedTarget, EditError> {
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
            return Ok(ResolvedTarget {
                members: self.existing(),
                named: Vec::new(),
                everything: true,
                unnamed: None,
                names: Vec::new(),
                phrase: "everything".to_owned(),
                of_selection: false,
            });
        }
        let phrase = join_names(&parts);
        if target.complement {
            let members = self.rest_of(&members);
            let phrase = format!("everything but {phrase}");
            if members.is_none() {
                return Err(EditError::EmptyTarget(phrase));
            }
            return Ok(ResolvedTarget {
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
        Ok(ResolvedTarget { members, named, everything: false, unnamed, names, phrase, of_selection })
    }
}
