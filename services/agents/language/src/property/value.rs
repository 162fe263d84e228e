//! Values that a clause assigns to a target.

use sg_proto::language::Act;
use sg_proto::language::Scale;
use sg_proto::language::movement::Kind;
use sg_proto::scene::{Color, SetLight, SetTone, set_view};
use winnow::Parser;
use winnow::combinator::alt;
use winnow::error::EmptyError;

use super::tone::Term;
use crate::syntax::phrase::{Input, Outcome, exactly, one_of};
use crate::syntax::reading::{Property, Reading};
use crate::syntax::target::Target;

/// Nouns for a colour.
pub(crate) const COLOR: &str = "colour | color | colours | colors | hue | tint";

/// A value that a clause assigns.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    Color(Color, String),
    OriginalColor,
    Opacity {
        factor: f64,
        relative: bool,
    },
    Visible(bool),
    Light(SetLight),
    Zoom(f64),
    /// A factor on the size of the target itself.
    Scale(Option<f64>),
    Tone(SetTone),
}

/// The clause that assigns a value to a target.
pub(crate) fn assign(target: Target, value: Value) -> Outcome<Reading> {
    // Light and zoom belong to the whole scene. A structure gets a brightness and a size of its own.
    let of_scene = target.reference.names.is_empty() && !target.reference.selection && !target.reference.complement;
    let unknown = target.unknown;
    Ok(match value {
        Value::Color(color, name) => Reading::of(Act::SetColor, target).map(|c| {
            c.color = Some(color);
            c.color_name.clone_from(&name);
        }),
        Value::OriginalColor => Reading::of(Act::SetColor, target),
        Value::Opacity { factor, relative } => Reading::of(Act::SetOpacity, target).map(|c| {
            c.amount = Some(factor);
            c.relative = relative;
        }),
        Value::Visible(visible) => Reading::of(if visible { Act::Show } else { Act::Hide }, target),
        Value::Light(light) if of_scene => Reading::plain(Act::SetLight).map(|c| c.light = Some(light)),
        Value::Zoom(factor) if of_scene && unknown == 0 => Reading::view(set_view::Change::Zoom(factor)),
        Value::Light(light) => match brightness(&light) {
            Some(tone) => Reading::of(Act::SetTone, target).map(|c| c.tone = Some(tone.clone())),
            None => return Err(EmptyError),
        },
        Value::Tone(tone) => Reading::of(Act::SetTone, target).map(|c| c.tone = Some(tone.clone())),
        Value::Scale(Some(factor)) if of_scene && unknown == 0 => Reading::view(set_view::Change::Zoom(factor)),
        Value::Zoom(_) => Reading::movement(target, Kind::Scale(Scale { factor: None })),
        Value::Scale(factor) => Reading::movement(target, Kind::Scale(Scale { factor })),
    })
}

/// The brightness of a structure for words that make a scene brighter.
fn brightness(light: &SetLight) -> Option<SetTone> {
    let alone = light.specular.is_none() && light.shininess.is_none() && light.ambient == light.diffuse;
    let factor = light.ambient.filter(|factor| alone && light.relative && *factor <= 4.0)?;
    Some(Term::Brightness.set(factor.into(), true))
}

/// Parses the name of a property.
pub(crate) fn property_name(input: &mut Input<'_>) -> Outcome<Property> {
    alt((
        one_of("colour temperature | color temperature | temperature").map(|_| Property::Temperature),
        exactly(COLOR).map(|_| Property::Color),
        exactly("opacity | opacities | alpha | opaqueness").map(|_| Property::Opacity),
        exactly("transparency | translucency | transparence").map(|_| Property::Transparency),
        exactly("saturation | colourfulness | colorfulness").map(|_| Property::Saturation),
        exactly("brightness | lightness").map(|_| Property::Brightness),
    ))
    .parse_next(input)
}
