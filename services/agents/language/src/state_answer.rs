//! Short answers to questions about the state of a scene: "No, the bone is visible.", "The clip is grey."

use sg_proto::language::Way;
use sg_proto::render::Frame;
use sg_proto::scene::{Color, LightMode, State, Vector};

use crate::color;
use crate::query::{UnitSummary, coverage, summaries};
use crate::syntax::viewer_axes::CameraAxes;
use crate::text::{capital, is_plural, join, percent, the};
use crate::unit_names;

/// Most names in an answer.
const MOST_NAMES: usize = 12;

/// Least share of a direction along an axis of the picture that an answer names.
const NAMED_SHARE: f64 = 0.4;

/// What a question asks of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quality {
    /// It is drawn.
    Visible,
    /// It is not drawn.
    Hidden,
    /// Edits of it are refused.
    Locked,
    /// It can be edited.
    Unlocked,
    /// One sees through it.
    Transparent,
    /// One does not see through it.
    Opaque,
}

impl Quality {
    fn holds(self, unit: &UnitSummary<'_>) -> bool {
        match self {
            Self::Visible => is_seen(unit),
            Self::Hidden => !is_seen(unit),
            Self::Locked => unit.locked,
            Self::Unlocked => !unit.locked,
            Self::Transparent => is_seen(unit) && unit.opacity < 1.0,
            Self::Opaque => is_seen(unit) && unit.opacity >= 1.0,
        }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Visible => "visible",
            Self::Hidden => "hidden",
            Self::Locked => "locked",
            Self::Unlocked => "unlocked",
            Self::Transparent => "transparent",
            Self::Opaque => "opaque",
        }
    }
}

fn is_seen(unit: &UnitSummary<'_>) -> bool {
    unit.visible && unit.opacity > 0.0
}

fn unit<'s>(name: &str, state: &'s State) -> Option<UnitSummary<'s>> {
    summaries(state).into_iter().find(|unit| unit.name == name)
}

/// "The bone is", "the vessels are".
fn subject(name: &str) -> String {
    format!("{} {}", the(name), if is_plural(name) { "are" } else { "is" })
}

/// How a unit is drawn: "hidden", "visible, at 40 % opacity".
fn drawn(unit: &UnitSummary<'_>) -> String {
    match unit.opacity {
        _ if !unit.visible => "hidden".to_owned(),
        opacity if opacity <= 0.0 => "shown at 0 % opacity, so nothing of it is seen".to_owned(),
        opacity if opacity < 1.0 => format!("visible, at {} opacity", percent(opacity.into())),
        _ => "visible".to_owned(),
    }
}

/// Yes or no to the question whether something holds of a unit. `None`: no such unit.
pub(crate) fn yes_or_no(name: &str, quality: Quality, state: &State, frame: Option<&Frame>) -> Option<String> {
    let unit = unit(name, state)?;
    let subject = subject(name);
    let outside = coverage(name, frame).is_some_and(|share| share <= 0.0);
    if quality == Quality::Visible && is_seen(&unit) && outside {
        return Some(format!("No: {subject} shown, but outside the picture. Say “frame {}”.", the(name)));
    }
    let now = match quality {
        Quality::Locked | Quality::Unlocked => (if unit.locked { "locked" } else { "not locked" }).to_owned(),
        Quality::Opaque if quality.holds(&unit) => "opaque".to_owned(),
        Quality::Transparent if is_seen(&unit) && !quality.holds(&unit) => "opaque".to_owned(),
        _ => drawn(&unit),
    };
    if quality.holds(&unit) {
        return Some(format!("Yes: {subject} {now}."));
    }
    let hint =
        if quality == Quality::Visible { format!(" Say “show {}” to see it.", the(name)) } else { String::new() };
    Some(format!("No, {subject} {now}.{hint}"))
}

/// Whether a unit is drawn and within the picture, as far as that is known.
pub(crate) fn is_visible(name: &str, state: &State) -> bool {
    unit(name, state).is_some_and(|unit| is_seen(&unit))
}

/// The colour of a unit. `None`: no such unit, or one with its original colours.
pub(crate) fn own_color(name: &str, state: &State) -> Option<Color> {
    unit(name, state)?.color.copied()
}

/// The colour of a unit in words. `None`: no such unit.
pub(crate) fn color_of(name: &str, state: &State) -> Option<String> {
    let unit = unit(name, state)?;
    let text = match unit.color {
        Some(color) => format!("{} {}.", subject(name), color::name_of(color)),
        None if is_plural(name) => format!("{} have their original colours.", the(name)),
        None => format!("{} has its original colours.", the(name)),
    };
    Some(capital(&text))
}

/// The opacity of a unit. `None`: no such unit.
pub(crate) fn opacity_of(name: &str, state: &State) -> Option<String> {
    let unit = unit(name, state)?;
    let opacity = f64::from(unit.opacity);
    let pronoun = if is_plural(name) { "they are" } else { "it is" };
    let hidden = if unit.visible { String::new() } else { format!(" But {pronoun} hidden.") };
    let through = if opacity < 1.0 {
        format!("{} transparent ({} opacity)", percent(1.0 - opacity), percent(opacity))
    } else {
        format!("opaque ({} opacity)", percent(opacity))
    };
    Some(capital(&format!("{} {through}.{hidden}", subject(name))))
}

/// Names with articles, the first of many.
fn named(names: &[&str]) -> String {
    let mut listed: Vec<String> = names.iter().take(MOST_NAMES).map(|name| the(name)).collect();
    if names.len() > MOST_NAMES {
        listed.push(format!("{} more", names.len() - MOST_NAMES));
    }
    join(&listed)
}

/// The units of which something holds: "Hidden: the bone and the skin."
pub(crate) fn all_with(quality: Quality, state: &State) -> String {
    let addressable = unit_names::addressable(state);
    let units = summaries(state);
    let names: Vec<&str> =
        units.iter().filter(|u| addressable.contains(&u.name) && quality.holds(u)).map(|u| u.name).collect();
    match names.as_slice() {
        [] => format!("Nothing with a name is {}.", quality.word()),
        names => format!("{}: {}.", capital(quality.word()), named(names)),
    }
}

/// The number of units with their names.
pub(crate) fn count(state: &State) -> String {
    match unit_names::addressable(state).as_slice() {
        [] => "None: nothing has a name yet.".to_owned(),
        [name] => format!("1: {}.", the(name)),
        names => format!("{}: {}.", names.len(), named(names)),
    }
}

/// The colour of the background.
pub(crate) fn background(state: &State) -> String {
    match &state.background {
        Some(color) => format!("The background is {}.", color::name_of(color)),
        None => "The background has its usual colour.".to_owned(),
    }
}

/// From where the light comes, as the person sees it.
pub(crate) fn light(state: &State) -> String {
    const FROM_EYE: &str = "The light comes from your eye, and moves with the view.";
    let Some(light) = state.light.as_ref().filter(|light| light.mode() == LightMode::Direction) else {
        return FROM_EYE.to_owned();
    };
    let Vector { x, y, z } = light.direction.unwrap_or_default();
    let length = (x * x + y * y + z * z).sqrt();
    let axes = CameraAxes::of(state.view.as_ref());
    let along = |way: Way| axes.way(way).map_or(0.0, |[a, b, c]| (a * x + b * y + c * z) / length);
    let sides: Vec<String> = [
        (Way::Left, "the left"),
        (Way::Right, "the right"),
        (Way::Up, "above"),
        (Way::Down, "below"),
        (Way::Nearer, "the front"),
        (Way::Farther, "behind"),
    ]
    .into_iter()
    .filter(|(way, _)| along(*way) >= NAMED_SHARE)
    .map(|(_, side)| side.to_owned())
    .collect();
    if sides.is_empty() {
        return "The light comes from a fixed direction.".to_owned();
    }
    format!("The light comes from {}, as you look at the scene now.", join(&sides))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::render::UnitCoverage;
    use sg_proto::scene::{BaseUnit, Light, Unit};

    fn scene() -> State {
        let base = |name: &str, opacity, visible, locked| BaseUnit {
            name: name.to_owned(),
            opacity,
            visible,
            locked,
            palette: Some(Color { red: 1.0, green: 0.0, blue: 0.0 }),
            ..BaseUnit::default()
        };
        State {
            base_units: vec![base("bone", 1.0, false, false), base("vessels", 0.4, true, true)],
            units: vec![Unit { name: "clip".into(), opacity: 1.0, visible: true, ..Unit::default() }],
            background: Some(Color { red: 1.0, green: 1.0, blue: 1.0 }),
            ..State::default()
        }
    }

    #[test]
    fn questions_get_yes_or_no() {
        for (name, quality, text) in [
            ("bone", Quality::Hidden, "Yes: the bone is hidden."),
            ("bone", Quality::Visible, "No, the bone is hidden. Say “show the bone” to see it."),
            ("vessels", Quality::Hidden, "No, the vessels are visible, at 40 % opacity."),
            ("vessels", Quality::Locked, "Yes: the vessels are locked."),
            ("clip", Quality::Locked, "No, the clip is not locked."),
            ("clip", Quality::Unlocked, "Yes: the clip is not locked."),
            ("clip", Quality::Transparent, "No, the clip is opaque."),
            ("vessels", Quality::Opaque, "No, the vessels are visible, at 40 % opacity."),
        ] {
            assert_eq!(yes_or_no(name, quality, &scene(), None).as_deref(), Some(text));
        }
        assert_eq!(yes_or_no("moon", Quality::Hidden, &scene(), None), None);
        let units = vec![UnitCoverage { unit: "clip".into(), share: 0.0, mean_color: None }];
        let frame = Frame { units, ..Frame::default() };
        let outside = yes_or_no("clip", Quality::Visible, &scene(), Some(&frame)).unwrap();
        assert_eq!(outside, "No: the clip is shown, but outside the picture. Say “frame the clip”.");
    }

    #[test]
    fn colours_opacities_and_lists_are_short() {
        let scene = scene();
        assert_eq!(color_of("vessels", &scene).unwrap(), "The vessels are red.");
        assert_eq!(color_of("clip", &scene).unwrap(), "The clip has its original colours.");
        assert_eq!(opacity_of("vessels", &scene).unwrap(), "The vessels are 60 % transparent (40 % opacity).");
        assert_eq!(opacity_of("bone", &scene).unwrap(), "The bone is opaque (100 % opacity). But it is hidden.");
        assert_eq!(all_with(Quality::Hidden, &scene), "Hidden: the bone.");
        assert_eq!(all_with(Quality::Locked, &scene), "Locked: the vessels.");
        assert_eq!(count(&scene), "3: the bone, the vessels and the clip.");
        assert_eq!(background(&scene), "The background is white.");
        assert_eq!(count(&State::default()), "None: nothing has a name yet.");
    }

    #[test]
    fn the_light_is_told_as_the_person_sees_it() {
        assert_eq!(light(&State::default()), "The light comes from your eye, and moves with the view.");
        let from = |x, y, z| {
            let direction = Some(Vector { x, y, z });
            let light = Light { mode: LightMode::Direction.into(), direction, ..Light::default() };
            super::light(&State { light: Some(light), ..State::default() })
        };
        // Without a view, the front is at -y.
        assert_eq!(from(-1.0, 0.0, 1.0), "The light comes from the left and above, as you look at the scene now.");
        assert_eq!(from(0.0, -3.0, 0.0), "The light comes from the front, as you look at the scene now.");
        assert_eq!(from(0.0, 0.0, 0.0), "The light comes from a fixed direction.");
    }
}
