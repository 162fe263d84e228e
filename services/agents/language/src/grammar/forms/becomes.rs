//! What a target becomes, and the properties that have a name.

use sg_proto::language::Act;
use sg_proto::scene::{Color, SetLight, SetView, set_view};
use winnow::Parser;
use winnow::combinator::alt;
use winnow::error::EmptyError;

use super::Reading;
use crate::grammar::phrase::{Input, Outcome, exactly};
use crate::grammar::target::Target;

/// Words for colour.
pub(super) const COLOR: &str = "colour | color | colours | colors | hue | tint";

/// What a target becomes.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Becomes {
    Color(Color, String),
    OwnColor,
    Opacity { factor: f64, relative: bool },
    Visible(bool),
    Light(SetLight),
    Zoom(f64),
}

/// The clause of a target that becomes something.
pub(super) fn reading(target: Target, becomes: Becomes) -> Outcome<Reading> {
    // The light and the distance are the whole scene's: "make the sac brighter" asks for something else.
    let of_scene = target.reference.names.is_empty() && !target.reference.selection && !target.reference.complement;
    let unknown = target.unknown;
    Ok(match becomes {
        Becomes::Color(color, name) => Reading::of(Act::SetColor, target).map(|c| {
            c.color = Some(color);
            c.color_name.clone_from(&name);
        }),
        Becomes::OwnColor => Reading::of(Act::SetColor, target),
        Becomes::Opacity { factor, relative } => Reading::of(Act::SetOpacity, target).map(|c| {
            c.amount = Some(factor);
            c.relative = relative;
        }),
        Becomes::Visible(visible) => Reading::of(if visible { Act::Show } else { Act::Hide }, target),
        Becomes::Light(light) if of_scene => Reading::plain(Act::SetLight).map(|c| c.light = Some(light)),
        Becomes::Zoom(factor) if of_scene && unknown == 0 => {
            let view = SetView { change: Some(set_view::Change::Zoom(factor)) };
            Reading::plain(Act::SetView).map(|c| c.view = Some(view.clone()))
        }
        Becomes::Light(_) | Becomes::Zoom(_) => return Err(EmptyError),
    })
}

/// Properties that have a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::grammar) enum Property {
    /// Colour.
    Color,
    /// Opacity.
    Opacity,
    /// One minus opacity.
    Transparency,
}

/// A property by name.
pub(super) fn property_name(input: &mut Input<'_>) -> Outcome<Property> {
    alt((
        exactly(COLOR).map(|_| Property::Color),
        exactly("opacity | opacities | alpha | opaqueness").map(|_| Property::Opacity),
        exactly("transparency | translucency | transparence").map(|_| Property::Transparency),
    ))
    .parse_next(input)
}
