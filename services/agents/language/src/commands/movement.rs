//! Movements of Gaussians: "move the sac 5 mm left", "turn it by 30 degrees around z", "scale it to 50 %", "put it back".

use sg_proto::language::movement::Kind;
use sg_proto::language::{Act, Clause, PutBack, Rotation, Scale, Shift, Way};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Axis, PatientSide, Target as SceneTarget, TransformGaussians, Vector};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use super::orbit::angle;
use super::verbs::MAKE;
use crate::property::assignment::becoming;
use crate::property::size::factor;
use crate::resolution::{Refusal, Step, missing, target_of};
use crate::syntax::length::length;
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{Target, target_then};
use crate::syntax::viewer_axes::CameraAxes;
use crate::text;

/// The command "move".
pub(super) const TRANSFORM: Command = Command {
    act: Act::Transform,
    title: "move",
    constructs: &[
        Construct::with_ellipsis(
            "move | shift | push | pull | slide | drag | nudge | translate | bring",
            Ellipsis::Verb,
            shifted,
        ),
        Construct::with_ellipsis("rotate | turn | spin | tilt | revolve | swing", Ellipsis::Verb, rotated),
        Construct::with_ellipsis("scale | resize | enlarge | magnify | shrink | grow", Ellipsis::Verb, scaled),
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
        Construct::with_ellipsis("put | move | return | send", Ellipsis::Verb, put_back),
        Construct::with_ellipsis("put back | move back", Ellipsis::Verb, put_back_first),
    ],
    examples: &[
        "move the {unit} 5 mm to the left",
        "rotate the {unit} by 30 degrees around z",
        "scale the {unit} to 50 %",
        "make the {unit} twice as big",
        "move the {unit} up by 3",
        "put the {unit} back",
    ],
    fields: &[Field::required("target"), Field::required("movement")],
    effect: Effect::Visible,
    resolve,
};

/// The camera and the light move by other commands.
fn is_no_structure(target: &Target) -> bool {
    const OTHERS: [&str; 12] = [
        "camera",
        "view",
        "viewpoint",
        "eye",
        "eyes",
        "light",
        "lights",
        "lamp",
        "headlight",
        "cursor",
        "mouse",
        "window",
    ];
    target.unknown > 0 && target.reference.names.iter().any(|name| OTHERS.contains(&name.to_lowercase().as_str()))
}

/// Parses "the sac 5 mm to the left", "it up by 3", "the sac 2 mm towards anterior", "the sac left".
fn shifted(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, (way, length)) = target_then(input, |rest, _| {
        let before = opt((skip("by"), length).map(|(_, length)| length)).parse_next(rest)?;
        let way = opt(way).parse_next(rest)?;
        skip("a bit | a little | slightly").parse_next(rest)?;
        let after =
            if before.is_none() { opt((skip("by"), length).map(|(_, length)| length)).parse_next(rest)? } else { None };
        skip("further | more").parse_next(rest)?;
        end(rest)?;
        let length = before.or(after);
        // Neither a way nor a length is another command.
        if way.is_none() && length.is_none() { Err(EmptyError) } else { Ok((way, length)) }
    })?;
    if is_no_structure(&target) {
        return Err(EmptyError);
    }
    let shift = Shift {
        way: way.unwrap_or(Way::Unspecified).into(),
        distance: length.map(|l| l.value),
        millimetres: length.is_some_and(|l| l.millimetres),
    };
    Ok(Reading::movement(target, Kind::Shift(shift)))
}

/// Parses a direction: "to the left", "up", "towards me", "anterior", "to the patient's left".
fn way(input: &mut Input<'_>) -> Outcome<Way> {
    skip("to | towards | toward | into | in").parse_next(input)?;
    article(input)?;
    let patient = opt((exactly("patient"), opt(exactly("'s")), opt(exactly("own")))).parse_next(input)?;
    if patient.is_some() {
        let side = alt((exactly("left").map(|_| Way::PatientLeft), exactly("right").map(|_| Way::PatientRight)));
        return alt((side, anatomical)).parse_next(input);
    }
    let found = alt((
        exactly("left | leftwards | leftward").map(|_| Way::Left),
        exactly("right | rightwards | rightward").map(|_| Way::Right),
        exactly("up | upwards | upward | top").map(|_| Way::Up),
        exactly("down | downwards | downward | bottom").map(|_| Way::Down),
        one_of("viewer | eye | camera | me | us | nearer | closer | forward | forwards | out").map(|_| Way::Nearer),
        one_of(
            "away from me | away from the viewer | away from the camera | farther away | further away | farther | deeper | \
             back | backward | backwards | away",
        )
        .map(|_| Way::Farther),
        anatomical,
    ))
    .parse_next(input)?;
    opt(exactly("side | direction")).parse_next(input)?;
    Ok(found)
}

fn anatomical(input: &mut Input<'_>) -> Outcome<Way> {
    alt((
        exactly("anterior | anteriorly | ventral | ventrally").map(|_| Way::Anterior),
        exactly("posterior | posteriorly | dorsal | dorsally").map(|_| Way::Posterior),
        exactly("superior | superiorly | cranial | cranially | head").map(|_| Way::Superior),
        exactly("inferior | inferiorly | caudal | caudally | feet").map(|_| Way::Inferior),
    ))
    .parse_next(input)
}

/// Parses "the sac by 30 degrees around z", "the sac 90° to the right", "it 45 degrees left" after a clause about a unit.
fn rotated(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let around = |input: &mut Input<'_>| {
        exactly("around | about | round").parse_next(input)?;
        article(input)?;
        let axis = alt((
            exactly("x").map(|_| Axis::PlusX),
            exactly("y").map(|_| Axis::PlusY),
            exactly("z").map(|_| Axis::PlusZ),
        ))
        .parse_next(input)?;
        opt(exactly("axis")).parse_next(input)?;
        Ok(axis)
    };
    let side = |input: &mut Input<'_>| {
        let found = way(input)?;
        if matches!(found, Way::Left | Way::Right | Way::Up | Way::Down) { Ok(found) } else { Err(EmptyError) }
    };
    let (target, rotation) = target_then(input, |rest, _| {
        let (mut degrees, mut axis, mut to) = (None, None, None);
        // In any order, each once.
        loop {
            if degrees.is_none()
                && let Some(found) = opt(angle).parse_next(rest)?
            {
                degrees = Some(found);
            } else if axis.is_none()
                && let Some(found) = opt(around).parse_next(rest)?
            {
                axis = Some(found);
            } else if to.is_none()
                && let Some(found) = opt(side).parse_next(rest)?
            {
                to = Some(found);
            } else {
                break;
            }
        }
        end(rest)?;
        if (axis.is_some() && to.is_some()) || (degrees.is_none() && axis.is_none() && to.is_none()) {
            return Err(EmptyError);
        }
        // Without a direction an object turns as the view of it does.
        let to = if axis.is_none() { to.or(Some(Way::Right)) } else { None };
        Ok(Rotation { way: to.map_or(0, i32::from), axis: axis.map_or(0, i32::from), degrees })
    })?;
    // "Turn it" without an angle turns the view, and so does everything about the whole scene.
    let about = &target.reference;
    let about_it = about.focus && about.names.is_empty() && !about.selection;
    let explicit = rotation.axis != 0 || (rotation.degrees.is_some() && input.state.has_focus);
    if about.everything || is_no_structure(&target) || (about_it && !explicit) {
        return Err(EmptyError);
    }
    Ok(Reading::movement(target, Kind::Rotation(rotation)))
}

/// Parses "the sac to 50 %", "the sac by a factor of 2", "it to half its size", "the sac".
fn scaled(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, factor) = target_then(input, |rest, _| {
        let grows = match verb.phrase {
            "enlarge" | "magnify" | "grow" => Some(true),
            "shrink" => Some(false),
            _ => None,
        };
        let found = opt(|i: &mut Input<'_>| factor(grows, i)).parse_next(rest)?;
        end(rest)?;
        Ok(found)
    })?;
    let about = &target.reference;
    let about_it = about.focus && about.names.is_empty() && !about.selection;
    let of_view = matches!(verb.phrase, "enlarge" | "magnify" | "shrink" | "grow");
    // "Enlarge it" without a number enlarges the picture, and so does everything about the whole scene.
    if of_view && (about.everything || (about_it && (factor.is_none() || !input.state.has_focus))) {
        return Err(EmptyError);
    }
    if is_no_structure(&target) {
        return Err(EmptyError);
    }
    Ok(Reading::movement(target, Kind::Scale(Scale { factor })))
}

/// Words for the former place.
const PLACE: &str = "to its place | to its old place | to its former place | to its original place | in its place | in place | \
 into place | where it was | where it came from | to where it was | to its position | to its original position | \
 to their places | to their place | where they were";

/// Parses "the sac back", "it back where it was".
fn put_back(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, _| {
        let back = opt(exactly("back")).parse_next(rest)?;
        let place = opt(one_of(PLACE)).parse_next(rest)?;
        end(rest)?;
        match (back, place) {
            (None, None) => Err(EmptyError),
            (None, Some(_)) if verb.phrase != "return" => Err(EmptyError),
            _ => Ok(()),
        }
    })?;
    if is_no_structure(&target) {
        return Err(EmptyError);
    }
    Ok(Reading::movement(target, Kind::PutBack(PutBack {})))
}

/// Parses "the sac", after "put back".
fn put_back_first(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, _| {
        skip(PLACE).parse_next(rest)?;
        end(rest)
    })?;
    if is_no_structure(&target) {
        return Err(EmptyError);
    }
    Ok(Reading::movement(target, Kind::PutBack(PutBack {})))
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let kind = clause.movement.as_ref().and_then(|m| m.kind.as_ref()).ok_or_else(|| missing("movement"))?;
    let target = target_of(clause, context.state)?;
    let units = target.units.clone();
    let (what, _) = text::target(&target);
    let transform = transform(kind, target, &what, context)?;
    Ok(Step::Change { action: Action::TransformGaussians(transform), units })
}

fn transform(
    kind: &Kind,
    target: SceneTarget,
    what: &str,
    context: &Context<'_>,
) -> Result<TransformGaussians, Refusal> {
    let target = Some(target);
    let plain = TransformGaussians { target, ..TransformGaussians::default() };
    let axes = CameraAxes::of(context.state.view.as_ref());
    match kind {
        Kind::Shift(shift) => {
            if shift.way() == Way::Unspecified {
                return Err(Refusal::invalid(format!(
                    "Which way? Say “move {what} {} to the left”, or right, up, down, nearer, farther, anterior, posterior, \
                     superior or inferior.",
                    shift.distance.map_or("5 mm".to_owned(), |d| length_text(d, shift.millimetres))
                )));
            }
            let distance = shift.distance.ok_or_else(|| {
                let (way, unit) = (way_text(shift.way()), "mm");
                Refusal::invalid(format!("How far? Say “move {what} 5 {unit} {way}”, or “5 units” of the scene."))
            })?;
            if !distance.is_finite() {
                return Err(missing("finite length"));
            }
            let millimetres = shift.millimetres;
            Ok(match (patient_side(shift.way()), axes.way(shift.way())) {
                (Some(side), _) => TransformGaussians { towards: side.into(), distance, millimetres, ..plain },
                (None, Some(unit)) => {
                    let [x, y, z] = unit.map(|c| c * distance);
                    TransformGaussians { shift: Some(Vector { x, y, z }), millimetres, ..plain }
                }
                (None, None) => return Err(missing("direction")),
            })
        }
        Kind::Rotation(rotation) => {
            let degrees = rotation.degrees.ok_or_else(|| {
                Refusal::invalid(format!(
                    "By how many degrees? Say “rotate {what} by 30 degrees around z”. “Rotate left” turns the view."
                ))
            })?;
            let axis = match rotation.axis() {
                Axis::Unspecified => axes.turning(rotation.way()).ok_or_else(|| missing("direction"))?,
                Axis::PlusX => [1.0, 0.0, 0.0],
                Axis::MinusX => [-1.0, 0.0, 0.0],
                Axis::PlusY => [0.0, 1.0, 0.0],
                Axis::MinusY => [0.0, -1.0, 0.0],
                Axis::PlusZ => [0.0, 0.0, 1.0],
                Axis::MinusZ => [0.0, 0.0, -1.0],
            };
            let [x, y, z] = axis;
            Ok(TransformGaussians { axis: Some(Vector { x, y, z }), degrees, ..plain })
        }
        Kind::Scale(scale) => {
            let factor = scale.factor.filter(|f| f.is_finite() && *f > 0.0).ok_or_else(|| {
                Refusal::invalid(format!(
                    "To which size? Say “make {what} twice as big” or “scale {what} to 50 %”. “Zoom in” enlarges the picture."
                ))
            })?;
            Ok(TransformGaussians { factor: Some(factor), ..plain })
        }
        Kind::PutBack(_) => Ok(TransformGaussians { restore: true, ..plain }),
    }
}

fn patient_side(way: Way) -> Option<PatientSide> {
    match way {
        Way::Anterior => Some(PatientSide::Anterior),
        Way::Posterior => Some(PatientSide::Posterior),
        Way::Superior => Some(PatientSide::Superior),
        Way::Inferior => Some(PatientSide::Inferior),
        Way::PatientLeft => Some(PatientSide::Left),
        Way::PatientRight => Some(PatientSide::Right),
        _ => None,
    }
}

/// A direction in a sentence.
fn way_text(way: Way) -> &'static str {
    match way {
        Way::Unspecified => "there",
        Way::Left => "to the left",
        Way::Right => "to the right",
        Way::Up => "up",
        Way::Down => "down",
        Way::Nearer => "nearer",
        Way::Farther => "farther away",
        Way::Anterior => "anterior",
        Way::Posterior => "posterior",
        Way::Superior => "superior",
        Way::Inferior => "inferior",
        Way::PatientLeft => "to the patient's left",
        Way::PatientRight => "to the patient's right",
    }
}

fn length_text(value: f64, millimetres: bool) -> String {
    let number = text::factor(value);
    match (millimetres, number.as_str()) {
        (true, _) => format!("{number} mm"),
        (false, "1") => "1 unit".to_owned(),
        (false, _) => format!("{number} units"),
    }
}

/// One sentence about a movement that was carried out. `None` where the clause has none.
pub(crate) fn report(clause: &Clause, target: Option<&SceneTarget>) -> Option<String> {
    let (what, plural) = text::target(target?);
    let verb = if plural { "are" } else { "is" };
    let done = match clause.movement.as_ref()?.kind.as_ref()? {
        Kind::Shift(shift) => {
            let length = length_text(shift.distance?, shift.millimetres);
            format!("Moved {what} {length} {}.", way_text(shift.way()))
        }
        Kind::Rotation(rotation) => {
            let degrees = text::factor(rotation.degrees?);
            match rotation.axis() {
                Axis::Unspecified => format!("Turned {what} {degrees}° {}.", way_text(rotation.way())),
                axis => {
                    let name = axis.as_str_name().to_lowercase();
                    let letter = name.rsplit('_').next().unwrap_or_default();
                    let sign = if name.contains("minus") { "-" } else { "" };
                    format!("Turned {what} {degrees}° around {sign}{letter}.")
                }
            }
        }
        Kind::Scale(scale) => {
            let has = if plural { "have" } else { "has" };
            format!("{} {has} {} of the former size.", text::capital(&what), text::percent(scale.factor?))
        }
        Kind::PutBack(_) => format!("{} {verb} back in the place of the file.", text::capital(&what)),
    };
    Some(format!("{done} Ctrl+Z takes it back."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::language::Movement;

    #[test]
    fn a_movement_is_told_in_plain_words() {
        let sac = SceneTarget { units: vec!["sac".into()], ..SceneTarget::default() };
        let told = |kind| {
            let clause = Clause { movement: Some(Movement { kind: Some(kind) }), ..Clause::default() };
            report(&clause, Some(&sac)).unwrap()
        };
        let shift = Shift { way: Way::Left.into(), distance: Some(5.0), millimetres: true };
        assert_eq!(told(Kind::Shift(shift)), "Moved the sac 5 mm to the left. Ctrl+Z takes it back.");
        let up = Shift { way: Way::Up.into(), distance: Some(1.0), millimetres: false };
        assert_eq!(told(Kind::Shift(up)), "Moved the sac 1 unit up. Ctrl+Z takes it back.");
        let around = Rotation { axis: Axis::PlusZ.into(), degrees: Some(30.0), ..Rotation::default() };
        assert_eq!(told(Kind::Rotation(around)), "Turned the sac 30° around z. Ctrl+Z takes it back.");
        let right = Rotation { way: Way::Right.into(), degrees: Some(90.0), ..Rotation::default() };
        assert_eq!(told(Kind::Rotation(right)), "Turned the sac 90° to the right. Ctrl+Z takes it back.");
        let scale = Scale { factor: Some(2.0) };
        assert_eq!(told(Kind::Scale(scale)), "The sac has 200 % of the former size. Ctrl+Z takes it back.");
    }
}
