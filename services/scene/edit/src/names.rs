//! Names of units: case-insensitive, unique among base and editable units.

use sg_proto::limits::MAX_NAME_BYTES;

use super::error::EditError;
use super::state::{EditState, UnitRef};

/// Below this likeness (Jaro-Winkler, 0 to 1) a name is no suggestion for another.
const NEAR: f64 = 0.75;

impl EditState {
    /// Name of a unit, if it exists.
    #[must_use]
    pub fn name_of(&self, unit: UnitRef) -> Option<&str> {
        match unit {
            UnitRef::Base(i) => self.base.get(i).map(|b| b.name.as_str()),
            UnitRef::Editable(id) => self.units.get(&id).map(|u| u.name.as_str()),
        }
    }

    /// All units by name: base units in scene order, then editable units, oldest first.
    pub fn names(&self) -> impl Iterator<Item = (&str, UnitRef)> {
        let base = self.base.iter().enumerate().map(|(i, b)| (b.name.as_str(), UnitRef::Base(i)));
        base.chain(self.units.values().map(|u| (u.name.as_str(), UnitRef::Editable(u.id))))
    }

    /// The unit of a name: an exact match, else the only one that differs in capitals.
    ///
    /// # Errors
    /// [`EditError::UnknownUnit`] with near names, [`EditError::Ambiguous`].
    pub fn find(&self, name: &str) -> Result<UnitRef, EditError> {
        let name = name.trim();
        if let Some((_, unit)) = self.names().find(|(n, _)| *n == name) {
            return Ok(unit);
        }
        let folded = name.to_lowercase();
        let meant: Vec<_> = self.names().filter(|(n, _)| n.to_lowercase() == folded).collect();
        match meant.as_slice() {
            [(_, unit)] => Ok(*unit),
            [] => Err(EditError::UnknownUnit { name: shortened(name), near: self.near(&folded) }),
            many => Err(EditError::Ambiguous {
                name: shortened(name),
                meant: many.iter().map(|(n, _)| format!("`{n}`")).collect(),
            }),
        }
    }

    /// Whether some unit other than `except` has this name in any capitals.
    pub(super) fn is_taken(&self, name: &str, except: Option<UnitRef>) -> Option<UnitRef> {
        let folded = name.to_lowercase();
        self.names().find(|(n, unit)| Some(*unit) != except && n.to_lowercase() == folded).map(|(_, unit)| unit)
    }

    /// A name that no unit has: `stem` itself, or the first of `stem 2`, `stem 3`, … that is free.
    pub(super) fn free_name(&self, stem: &str) -> String {
        first_name(stem, |name| self.is_taken(name, None).is_none())
    }

    fn near(&self, folded: &str) -> Vec<String> {
        let mut near: Vec<_> = self
            .names()
            .map(|(n, _)| (strsim::jaro_winkler(folded, &n.to_lowercase()), n))
            .filter(|(likeness, _)| *likeness >= NEAR)
            .collect();
        near.sort_by(|a, b| b.0.total_cmp(&a.0));
        if near.is_empty() {
            return self.names().take(20).map(|(n, _)| n.to_owned()).collect();
        }
        near.into_iter().take(3).map(|(_, n)| n.to_owned()).collect()
    }
}

/// The first of `stem`, `stem 2`, `stem 3`, … that is free.
pub(super) fn first_name(stem: &str, is_free: impl Fn(&str) -> bool) -> String {
    let stem = shortened(stem);
    std::iter::once(stem.clone())
        .chain((2_u32..).map(|n| format!("{stem} {n}")))
        .find(|name| is_free(name))
        .unwrap_or(stem)
}

/// A name that a person gives, without surrounding white space.
///
/// # Errors
/// [`EditError::Malformed`] if it is empty, too long or holds control characters.
pub(super) fn checked_name(name: &str, field: &'static str) -> Result<String, EditError> {
    let name = name.trim();
    let wrong = |reason: String| Err(EditError::Malformed { field, reason });
    if name.is_empty() {
        return wrong("the name is empty; give one".to_owned());
    }
    if name.len() > MAX_NAME_BYTES {
        return wrong(format!("the name has {} bytes; it may have {MAX_NAME_BYTES}", name.len()));
    }
    if name.chars().any(char::is_control) {
        return wrong("the name holds control characters; use printable ones".to_owned());
    }
    Ok(name.to_owned())
}

/// A name made here, cut at a character so that a number still fits behind it.
fn shortened(name: &str) -> String {
    let room = MAX_NAME_BYTES - 8;
    if name.len() <= room {
        return name.to_owned();
    }
    let end = name.char_indices().map(|(i, _)| i).take_while(|i| *i <= room - '…'.len_utf8()).last().unwrap_or(0);
    format!("{}…", name.get(..end).unwrap_or_default().trim_end())
}

/// `a`, `a and b`, `a, b and c`, `a, b and 4 more`.
pub(super) fn join_names(names: &[String]) -> String {
    match names {
        [] => "nothing".to_owned(),
        [one] => one.clone(),
        [a, b] => format!("{a} and {b}"),
        [a, b, c] => format!("{a}, {b} and {c}"),
        [a, b, rest @ ..] => format!("{a}, {b} and {} more", rest.len()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::synthetic::test_scene;

    fn state(names: &[&str]) -> EditState {
        let units: Vec<_> = names.iter().map(|n| (*n, 2)).collect();
        EditState::of_scene(&test_scene(&units), "", "")
    }

    #[test]
    fn capitals_do_not_matter_unless_they_tell_two_apart() {
        let state = state(&["Bone", "skin", "SKIN"]);
        assert_eq!(state.find(" bone "), Ok(UnitRef::Base(0)));
        assert_eq!(state.find("skin"), Ok(UnitRef::Base(1)));
        assert!(matches!(state.find("Skin"), Err(EditError::Ambiguous { meant, .. }) if meant.len() == 2));
    }

    #[test]
    fn near_names_are_offered_closest_first_and_all_when_none_is_near() {
        let state = state(&["aneurysm", "vessel", "vessels"]);
        let near = |name: &str| state.find(name).unwrap_err().details();
        assert_eq!(near("anuerysm"), ["aneurysm"]);
        assert_eq!(near("vesel"), ["vessel", "vessels"]);
        assert_eq!(near("qqq").len(), 3);
        let message = state.find("anuerysm").unwrap_err().to_string();
        assert_eq!(message, "there is no unit `anuerysm`; did you mean `aneurysm`?");
    }

    #[test]
    fn made_names_are_free_and_short_enough() {
        let state = state(&["everything but sac", "Everything but sac 2"]);
        assert_eq!(state.free_name("everything but sac"), "everything but sac 3");
        let long = state.free_name(&"ä".repeat(100));
        assert!(long.len() <= MAX_NAME_BYTES && long.ends_with('…'), "{}", long.len());
    }

    #[test]
    fn given_names_are_trimmed_and_checked() {
        assert_eq!(checked_name("  sac ", "name"), Ok("sac".to_owned()));
        for bad in ["", "   ", "a\nb", "\u{0}", &"x".repeat(MAX_NAME_BYTES + 1)] {
            assert!(checked_name(bad, "name").is_err(), "{bad:?}");
        }
        assert!(checked_name(&"x".repeat(MAX_NAME_BYTES), "name").is_ok());
    }
}
