//! Conditions on the state that an utterance leads to.

use std::collections::BTreeSet;

use glam::Vec3;
use sg_color::oklab;

use super::outcome::{Look, Outcome};

/// Greatest distance in Oklab of two colours that count as one.
const SAME_COLOR: f32 = 0.16;
/// Greatest difference of opacities that count as one.
const SAME_OPACITY: f32 = 0.05;

/// A condition.
#[derive(Debug, Clone, PartialEq)]
pub enum Condition {
    /// A property of some units.
    Look(Vec<String>, Property),
    /// The selection.
    Selection(Selected),
    /// Whether there is a unit of this name.
    Unit(String, bool),
    /// The Gaussians of a unit are deleted.
    Deleted(String),
    /// The background has a colour.
    Background([f32; 3]),
    /// The light has changed.
    Light,
    /// The displayed part of the shading, by its name.
    Term(String),
    /// The viewpoint.
    View(Viewed),
    /// Whether a viewpoint of this name is kept.
    Kept(String, bool),
    /// The tour.
    Tour(Toured),
    /// Nothing changes.
    Unchanged,
    /// Nothing changes, and the assistant asks back.
    Asks,
}

/// A property of a unit.
#[derive(Debug, Clone, PartialEq)]
pub enum Property {
    /// It has a colour.
    Color([f32; 3]),
    /// It has the colour of the file.
    OwnColor,
    /// It has this opacity.
    Opacity(f32),
    /// It is less opaque than before.
    LessOpaque,
    /// It is more opaque than before.
    MoreOpaque,
    /// Whether it is drawn.
    Visible(bool),
    /// Whether it is locked.
    Locked(bool),
    /// Its saturation, brightness or temperature has changed.
    Tone,
}

/// What is selected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Selected {
    /// These units, and nothing else.
    Units(Vec<String>),
    /// Everything.
    All,
    /// Nothing.
    None,
    /// Something else than before.
    Changed,
}

/// Where the view is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Viewed {
    /// Elsewhere than before.
    Changed,
    /// Nearer to the target than before.
    Closer,
    /// Farther from it.
    Farther,
    /// Where it was when the scene was opened.
    Initial,
    /// Where a kept viewpoint is.
    Kept(String),
}

/// What a tour does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Toured {
    /// It is under way.
    On,
    /// There is none.
    Off,
    /// It waits.
    Paused,
}

fn names(list: &str) -> Vec<String> {
    list.split(',').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

impl Condition {
    /// Parses a condition.
    ///
    /// # Errors
    /// The problem, for a person.
    pub fn parse(text: &str) -> Result<Self, String> {
        let unknown = || format!("`{text}` is no condition");
        let color = |name: &str| sg_color::from_phrase(name).ok_or_else(|| format!("`{name}` is no colour"));
        let text = text.trim();
        if let Some(condition) = Self::of_words(text) {
            return Ok(condition);
        }
        if let Some(units) = text.strip_suffix(".tone changed") {
            return Ok(Self::Look(names(units), Property::Tone));
        }
        if let Some((units, sign)) = text.split_once(".opacity ") {
            let property = match sign.trim() {
                "< before" => Property::LessOpaque,
                "> before" => Property::MoreOpaque,
                value => {
                    let value = value.strip_prefix('=').and_then(|value| value.trim().parse().ok());
                    Property::Opacity(value.ok_or_else(unknown)?)
                }
            };
            return Ok(Self::Look(names(units), property));
        }
        let (left, right) = text.split_once('=').ok_or_else(unknown)?;
        let (left, right) = (left.trim(), right.trim());
        if let Some((units, property)) = left.rsplit_once('.') {
            let flag = || right.parse::<bool>().map_err(|_| unknown());
            let property = match property {
                "color" if right == "own" => Property::OwnColor,
                "color" => Property::Color(color(right)?),
                "visible" => Property::Visible(flag()?),
                "locked" => Property::Locked(flag()?),
                _ => return Err(unknown()),
            };
            return Ok(Self::Look(names(units), property));
        }
        Ok(match (left, right) {
            ("selection", "none") => Self::Selection(Selected::None),
            ("selection", "all") => Self::Selection(Selected::All),
            ("selection", units) => Self::Selection(Selected::Units(names(units))),
            ("background", name) => Self::Background(color(name)?),
            ("term", name) => Self::Term(name.to_owned()),
            ("view", "initial") => Self::View(Viewed::Initial),
            ("view", name) => Self::View(Viewed::Kept(name.to_owned())),
            _ => return Err(unknown()),
        })
    }

    /// A condition without a sign.
    fn of_words(text: &str) -> Option<Self> {
        let named = |lead: &str| text.strip_prefix(lead).map(|name| name.trim().to_owned());
        Some(match text {
            "unchanged" => Self::Unchanged,
            "asks" => Self::Asks,
            "light changed" => Self::Light,
            "selection changed" => Self::Selection(Selected::Changed),
            "view changed" => Self::View(Viewed::Changed),
            "view closer" => Self::View(Viewed::Closer),
            "view farther" => Self::View(Viewed::Farther),
            "tour on" => Self::Tour(Toured::On),
            "tour off" => Self::Tour(Toured::Off),
            "tour paused" => Self::Tour(Toured::Paused),
            _ => {
                return named("no unit ")
                    .map(|name| Self::Unit(name, false))
                    .or_else(|| named("unit ").map(|name| Self::Unit(name, true)))
                    .or_else(|| named("not kept ").map(|name| Self::Kept(name, false)))
                    .or_else(|| named("kept ").map(|name| Self::Kept(name, true)))
                    .or_else(|| named("deleted ").map(Self::Deleted));
            }
        })
    }

    /// Whether it holds after an utterance.
    #[must_use]
    pub fn holds(&self, before: &Outcome, after: &Outcome, asks: bool) -> bool {
        match self {
            Self::Look(units, property) => units.iter().all(|unit| {
                let looks = (before.looks.get(unit), after.looks.get(unit));
                matches!(looks, (Some(old), Some(new)) if property.holds(old, new))
            }),
            Self::Selection(Selected::None) => after.selected.is_empty(),
            Self::Selection(Selected::All) => after.selected.len() == after.existing,
            Self::Selection(Selected::Changed) => after.selected != before.selected,
            Self::Selection(Selected::Units(units)) => {
                let members = units.iter().flat_map(|unit| after.members.get(unit).into_iter().flatten().copied());
                let members: BTreeSet<usize> = members.collect();
                !members.is_empty() && members.iter().eq(&after.selected)
            }
            Self::Unit(name, there) => after.names.iter().any(|known| known.eq_ignore_ascii_case(name)) == *there,
            Self::Deleted(unit) => after.looks.get(unit).is_none_or(|look| look.deleted),
            Self::Background(color) => is_color(after.background, *color),
            Self::Light => before.light != after.light,
            Self::Term(name) => after.term == *name,
            Self::View(Viewed::Changed) => !before.view.is_near(&after.view),
            Self::View(Viewed::Closer) => after.view.distance() < 0.999 * before.view.distance(),
            Self::View(Viewed::Farther) => after.view.distance() > 1.001 * before.view.distance(),
            Self::View(Viewed::Initial) => after.view.is_near(&after.initial),
            Self::View(Viewed::Kept(name)) => {
                after.kept.iter().any(|(kept, view)| kept == name && after.view.is_near(view))
            }
            Self::Kept(name, there) => after.kept.iter().any(|(kept, _)| kept.eq_ignore_ascii_case(name)) == *there,
            Self::Tour(Toured::On) => after.tour == Some(false),
            Self::Tour(Toured::Off) => after.tour.is_none(),
            Self::Tour(Toured::Paused) => after.tour == Some(true),
            Self::Unchanged => before == after,
            Self::Asks => before == after && asks,
        }
    }

    /// Makes what it is about in `before` as it is in `after`, so that the rest can be compared.
    pub fn accept(&self, before: &mut Outcome, after: &Outcome) {
        match self {
            Self::Look(units, property) => {
                for unit in units {
                    if let (Some(old), Some(new)) = (before.looks.get_mut(unit), after.looks.get(unit)) {
                        property.accept(old, new);
                    }
                }
            }
            Self::Selection(_) => before.selected.clone_from(&after.selected),
            Self::Unit(..) => {
                before.take_units(after);
                // The Gaussians of a copy are new, and selected.
                if after.existing > before.existing {
                    before.existing = after.existing;
                    before.selected.clone_from(&after.selected);
                }
            }
            Self::Deleted(_) => {
                before.take_units(after);
                before.existing = after.existing;
                // Deleted Gaussians are not selected.
                before.selected.clone_from(&after.selected);
            }
            Self::Background(_) => before.background = after.background,
            Self::Light => before.light.clone_from(&after.light),
            Self::Term(_) => before.term.clone_from(&after.term),
            Self::View(_) => before.view = after.view,
            Self::Kept(..) => before.kept.clone_from(&after.kept),
            // A tour moves the view.
            Self::Tour(_) => (before.tour, before.view) = (after.tour, after.view),
            Self::Unchanged | Self::Asks => {}
        }
    }
}

impl Property {
    fn holds(&self, old: &Look, new: &Look) -> bool {
        match self {
            Self::Color(color) => is_color(new.color, *color),
            Self::OwnColor => new.color.distance(new.own_color) < 0.02,
            // What is hidden has no opacity that a person sees.
            Self::Opacity(opacity) => {
                (*opacity <= SAME_OPACITY && !new.visible) || (new.opacity - opacity).abs() <= SAME_OPACITY
            }
            Self::LessOpaque => new.opacity < old.opacity - 1e-4,
            Self::MoreOpaque => new.opacity > old.opacity + 1e-4,
            Self::Visible(visible) => new.is_seen() == *visible,
            Self::Locked(locked) => new.locked == *locked,
            Self::Tone => old.tone != new.tone,
        }
    }

    fn accept(&self, old: &mut Look, new: &Look) {
        match self {
            Self::Color(_) | Self::OwnColor => old.color = new.color,
            Self::Opacity(_) | Self::LessOpaque | Self::MoreOpaque | Self::Visible(_) => {
                (old.opacity, old.visible) = (new.opacity, new.visible);
            }
            Self::Locked(_) => old.locked = new.locked,
            Self::Tone => old.tone = new.tone,
        }
    }
}

/// Whether a colour is what a name says.
fn is_color(found: Vec3, named: [f32; 3]) -> bool {
    let [a, b] = [found.to_array(), named].map(|color| Vec3::from_array(oklab(color)));
    a.distance(b) <= SAME_COLOR
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::eval::language::outcome::Eye;

    fn outcome() -> Outcome {
        let look = Look {
            color: Vec3::new(0.2, 0.2, 0.9),
            own_color: Vec3::new(0.9, 0.4, 0.1),
            opacity: 1.0,
            visible: true,
            locked: false,
            tone: [1.0, 1.0, 0.0],
            deleted: false,
        };
        let view = Eye { eye: glam::DVec3::new(0.0, -4.0, 0.0), target: glam::DVec3::ZERO, up: glam::DVec3::Z };
        Outcome {
            looks: BTreeMap::from([("sac".to_owned(), look)]),
            members: BTreeMap::from([("sac".to_owned(), vec![1, 2, 3])]),
            names: vec!["sac".to_owned()],
            selected: Vec::new(),
            existing: 9,
            background: Vec3::ZERO,
            light: "headlight".to_owned(),
            term: "full".to_owned(),
            view,
            initial: view,
            kept: vec![("entry".to_owned(), view)],
            tour: None,
        }
    }

    fn holds(text: &str, after: &Outcome) -> (bool, bool) {
        let (mut before, condition) = (outcome(), Condition::parse(text).unwrap());
        let holds = condition.holds(&before, after, true);
        condition.accept(&mut before, after);
        (holds, before == *after)
    }

    #[test]
    fn conditions_are_about_one_thing_and_leave_the_rest() {
        let mut red = outcome();
        red.looks.get_mut("sac").unwrap().color = Vec3::new(0.85, 0.2, 0.2);
        assert_eq!(holds("sac.color = red", &red), (true, true));
        assert_eq!(holds("sac.color = green", &red), (false, true));
        assert_eq!(holds("selection = none", &red), (true, false), "the colour has changed as well");
        assert_eq!((holds("unchanged", &red).0, holds("unchanged", &outcome()).0), (false, true));
        let mut faint = outcome();
        faint.looks.get_mut("sac").unwrap().opacity = 0.2;
        for (text, expected) in
            [("sac.opacity = 0.22", true), ("sac.opacity < before", true), ("sac.opacity > before", false)]
        {
            assert_eq!(holds(text, &faint), (expected, true), "{text}");
        }
        let mut selected = outcome();
        selected.selected = vec![1, 2, 3];
        for (text, expected) in [("selection = sac", true), ("selection = all", false), ("selection changed", true)] {
            assert_eq!(holds(text, &selected), (expected, true), "{text}");
        }
        let mut near = outcome();
        near.view.eye *= 0.5;
        for (text, expected) in
            [("view closer", true), ("view farther", false), ("view = entry", false), ("view changed", true)]
        {
            assert_eq!(holds(text, &near), (expected, true), "{text}");
        }
    }

    #[test]
    fn what_is_no_condition_is_refused() {
        for text in ["", "sac is red", "sac.color = loud", "sac.opacity = much", "sac.visible = no", "sac.size = 3"] {
            assert!(Condition::parse(text).is_err(), "{text}");
        }
        for text in
            ["no unit sac", "unit left sac", "kept a", "not kept a", "deleted clip", "tour paused", "term = normal"]
        {
            assert!(Condition::parse(text).is_ok(), "{text}");
        }
    }
}
