//! Derived units: the appearance of Gaussians that a command addressed without a unit's name.
//!
//! "Make the selection red" and "fade everything else" create a derived unit with that appearance. A later command on
//! the same attribute of the same Gaussians removes them from the derived unit. A neutral derived unit is deleted.
//! Example: "show only the sac" hides the vessel through a derived unit; "show the vessel" then shows it.

use std::sync::Arc;

use super::error::EditError;
use super::state::Unit;
use super::transaction::Transaction;
use sg_scene::mask::Mask;
use sg_scene::tone::Tone;

/// An attribute that a unit can override.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Attribute {
    /// Their colour.
    Color,
    /// The factor on their opacity.
    Opacity,
    /// Whether they are drawn.
    Visibility,
    /// The factor on their saturation.
    Saturation,
    /// The factor on their brightness.
    Brightness,
    /// Their temperature.
    Temperature,
}

impl Attribute {
    const ALL: [Self; 6] =
        [Self::Color, Self::Opacity, Self::Visibility, Self::Saturation, Self::Brightness, Self::Temperature];

    fn word(self) -> &'static str {
        match self {
            Self::Color => "colour",
            Self::Opacity => "opacity",
            Self::Visibility => "hidden",
            Self::Saturation => "saturation",
            Self::Brightness => "brightness",
            Self::Temperature => "temperature",
        }
    }
}

impl Unit {
    /// Whether it overrides an attribute.
    fn says(&self, attribute: Attribute) -> bool {
        match attribute {
            Attribute::Color => self.color.is_some(),
            Attribute::Opacity => self.opacity != 1.0,
            Attribute::Visibility => !self.visible,
            Attribute::Saturation => self.tone.saturation != 1.0,
            Attribute::Brightness => self.tone.brightness != 1.0,
            Attribute::Temperature => self.tone.temperature != 0.0,
        }
    }

    /// The same unit without its override of an attribute.
    fn without(&self, attribute: Attribute) -> Self {
        let mut unit = self.clone();
        match attribute {
            Attribute::Color => unit.color = None,
            Attribute::Opacity => unit.opacity = 1.0,
            Attribute::Visibility => unit.visible = true,
            Attribute::Saturation => unit.tone.saturation = 1.0,
            Attribute::Brightness => unit.tone.brightness = 1.0,
            Attribute::Temperature => unit.tone.temperature = 0.0,
        }
        unit
    }

    /// The same unit without its overrides of other attributes.
    fn only(&self, attribute: Attribute) -> Self {
        Attribute::ALL
            .into_iter()
            .filter(|other| *other != attribute)
            .fold(self.clone(), |unit, other| unit.without(other))
    }
}

impl Transaction<'_> {
    /// Removes members from an attribute of all derived units but `except`. Their other members and attributes stay.
    pub(super) fn supersede(
        &mut self,
        attribute: Attribute,
        members: &Mask,
        except: Option<u64>,
    ) -> Result<(), EditError> {
        let concerned: Vec<Unit> = self
            .state
            .units
            .values()
            .filter(|u| u.derived && Some(u.id) != except && u.says(attribute) && u.mask.intersects(members))
            .cloned()
            .collect();
        for unit in concerned {
            let mut rest = (*unit.mask).clone();
            rest.subtract(members);
            let rest = Arc::new(rest);
            let others = unit.without(attribute);
            if rest.is_none() {
                self.insert(others);
            } else if others.is_neutral() {
                self.insert(Unit { mask: rest, ..unit });
            } else {
                // One unit for the attribute over the remainder, one for the rest of the look over all members. The part
                // with the colour keeps the id: among colours, and only there, the order of units matters.
                let part = Unit { mask: rest, ..unit.only(attribute) };
                let (stays, mut leaves, word) = match attribute {
                    Attribute::Color => (part, others, "look"),
                    _ => (others, part, attribute.word()),
                };
                leaves.id = self.fresh_id()?;
                leaves.name = self.state.free_name(&format!("{} ({word})", unit.name));
                self.insert(stays);
                self.insert(leaves);
            }
        }
        self.prune();
        Ok(())
    }

    /// Clears the colour of derived units, but `except`, that lie within these members.
    pub(super) fn drop_covered_colors(&mut self, members: &Mask, except: Option<u64>) {
        for unit in self.state.units.values_mut() {
            if unit.derived && Some(unit.id) != except && unit.mask.is_subset_of(members) {
                unit.color = None;
            }
        }
        self.prune();
    }

    /// Id of the derived unit of exactly these members. With `newest`, only a unit that lies over all others.
    pub(super) fn derived_of(&self, members: &Mask, newest: bool) -> Option<u64> {
        let last = self.state.units.keys().next_back().copied();
        self.state
            .units
            .values()
            .rev()
            .find(|u| u.derived && *u.mask == *members && (!newest || Some(u.id) == last))
            .map(|u| u.id)
    }

    /// Creates a neutral derived unit with a free name from `stem`; `numbered` counts from 1.
    pub(super) fn derive(&mut self, members: &Mask, stem: &str, numbered: bool) -> Result<u64, EditError> {
        let id = self.fresh_id()?;
        let name = if numbered {
            (1_u32..)
                .map(|n| format!("{stem} {n}"))
                .find(|name| self.state.is_taken(name, None).is_none())
                .unwrap_or_else(|| stem.to_owned())
        } else {
            self.state.free_name(stem)
        };
        let mask = Arc::new(members.clone());
        self.insert(Unit {
            id,
            name,
            mask,
            color: None,
            opacity: 1.0,
            visible: true,
            derived: true,
            deleted: None,
            locked: false,
            tone: Tone::NEUTRAL,
        });
        Ok(id)
    }
}
