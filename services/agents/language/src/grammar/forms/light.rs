//! The light: brightness, its parts, where it comes from.

use sg_proto::language::Act;
use sg_proto::scene::{LightMode, SetLight, Vector, View};
use winnow::Parser;
use winnow::combinator::{alt, opt, peek, repeat};
use winnow::error::EmptyError;

use super::{Degree, Reading, connector, degree, factor_by};
use crate::grammar::phrase::{Input, Outcome, article, end, exactly, one_of, quantity, skip, times};
use crate::grammar::target::target_then;

/// A part of the light that has a strength.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// Ambient and diffuse together: how bright the picture is.
    Brightness,
    Ambient,
    Diffuse,
    Specular,
    Shininess,
    /// Specular strength and exponent together: how shiny things are.
    Gloss,
}

impl Part {
    fn set(self, value: f64, relative: bool) -> SetLight {
        let value = Some(value as f32);
        let mut light = SetLight { relative, ..SetLight::default() };
        match self {
            Self::Brightness => (light.ambient, light.diffuse) = (value, value),
            Self::Ambient => light.ambient = value,
            Self::Diffuse => light.diffuse = value,
            Self::Specular => light.specular = value,
            Self::Shininess => light.shininess = value,
            Self::Gloss => (light.specular, light.shininess) = (value, value),
        }
        light
    }

    /// By how much it grows where nothing was said.
    fn step(self, degree: Degree) -> f64 {
        if self == Self::Brightness { degree.pick(1.1, 1.25, 1.6) } else { degree.pick(1.2, 1.5, 2.5) }
    }

    fn scaled(self, grows: bool, by: Option<f64>, degree: Degree) -> SetLight {
        let step = self.step(degree);
        self.set(by.unwrap_or(if grows { step } else { 1.0 / step }), true)
    }
}

fn light(change: SetLight) -> Reading {
    Reading::plain(Act::SetLight).map(|c| c.light = Some(change))
}

fn part(input: &mut Input<'_>) -> Outcome<Part> {
    const NOUN: &str = "light | lighting | term | part | component | factor | reflection | reflections | highlights | \
     highlight | illumination | shading | strength | intensity | contribution | level";
    let plain = alt((
        one_of("specular exponent | shininess | exponent | sharpness of the highlights").map(|_| Part::Shininess),
        exactly("gloss | glossiness | shine").map(|_| Part::Gloss),
        (exactly("ambient"), opt(exactly(NOUN))).map(|_| Part::Ambient),
        (exactly("diffuse"), opt(exactly(NOUN))).map(|_| Part::Diffuse),
        (exactly("specular | specularity"), opt(exactly(NOUN))).map(|_| Part::Specular),
        exactly("highlights | reflections").map(|_| Part::Specular),
        one_of(
            "light intensity | light level | light strength | lights | light | lighting | illumination | \
         brightness | lamp",
        )
        .map(|_| Part::Brightness),
    ));
    alt((
        (exactly("intensity | strength | amount"), exactly("of"), opt(exactly("the")), part_alone)
            .map(|(_, _, _, p)| p),
        plain,
    ))
    .parse_next(input)
}

fn part_alone(input: &mut Input<'_>) -> Outcome<Part> {
    alt((exactly("light | lights | lighting").map(|_| Part::Brightness), exactly("highlights").map(|_| Part::Specular)))
        .parse_next(input)
}

/// "brighter", "much darker by 20 %", "shinier", "twice as bright": said of the scene, or of nothing.
pub(super) fn quality(input: &mut Input<'_>) -> Outcome<SetLight> {
    let multiplied = |input: &mut Input<'_>| {
        let times = alt((exactly("half").map(|_| 0.5), times)).parse_next(input)?;
        exactly("as").parse_next(input)?;
        let bright = alt((exactly("bright").map(|_| true), exactly("dark").map(|_| false))).parse_next(input)?;
        let factor = if bright { times } else { 1.0 / times };
        if factor.is_finite() { Ok(Part::Brightness.set(factor, true)) } else { Err(EmptyError) }
    };
    let compared = |input: &mut Input<'_>| {
        let degree = degree(input)?;
        let (part, grows) = alt((
            exactly("brighter").map(|_| (Part::Brightness, true)),
            exactly("darker | dimmer").map(|_| (Part::Brightness, false)),
            exactly("shinier | glossier").map(|_| (Part::Gloss, true)),
            exactly("duller | flatter").map(|_| (Part::Gloss, false)),
            (exactly("more | less"), exactly("bright | luminous")).map(|(m, _)| (Part::Brightness, m.text == "more")),
            (exactly("more | less"), exactly("dark | dim")).map(|(m, _)| (Part::Brightness, m.text == "less")),
            (exactly("more | less"), exactly("shiny | glossy | reflective"))
                .map(|(m, _)| (Part::Gloss, m.text == "more")),
            (exactly("more | less"), exactly("matte | matt | dull")).map(|(m, _)| (Part::Gloss, m.text == "less")),
        ))
        .parse_next(input)?;
        let by = opt(|i: &mut Input<'_>| factor_by(grows, i)).parse_next(input)?;
        Ok(part.scaled(grows, by, degree))
    };
    let plain = alt((
        exactly("shiny | glossy").map(|_| Part::Gloss.scaled(true, None, Degree::Plain)),
        exactly("matte | matt").map(|_| Part::Specular.set(0.0, false)),
    ));
    alt((multiplied, compared, plain)).parse_next(input)
}

fn headlight(input: &mut Input<'_>) -> Outcome<SetLight> {
    article(input)?;
    one_of("headlight | head light | headlamp | camera light | eye light").parse_next(input)?;
    Ok(SetLight { mode: LightMode::Headlight.into(), ..SetLight::default() })
}

/// "brighter", "more light", "less specular", "no ambient", "a headlight".
pub(super) fn words(input: &mut Input<'_>) -> Outcome<Reading> {
    let amount = |input: &mut Input<'_>| {
        let degree = degree(input)?;
        let more = exactly("more | less | no").parse_next(input)?.text.clone();
        let part = part(input)?;
        if more == "no" {
            // No light at all would leave a black picture, which nobody asks for in these words.
            return if part == Part::Brightness { Err(EmptyError) } else { Ok(part.set(0.0, false)) };
        }
        let grows = more == "more";
        let by = opt(|i: &mut Input<'_>| factor_by(grows, i)).parse_next(input)?;
        Ok(part.scaled(grows, by, degree))
    };
    let change = alt((amount, headlight, quality)).parse_next(input)?;
    skip("on | mode").parse_next(input)?;
    end(input)?;
    Ok(light(change))
}

/// "the ambient light to 50 %", "the light brighter", "the lights up a bit", "the light to a headlight", "specular off".
pub(super) fn property(input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    let part = part(input)?;
    let change = alt((
        |i: &mut Input<'_>| {
            connector(i)?;
            skip("come | shine | coming").parse_next(i)?;
            exactly("from").parse_next(i)?;
            if part == Part::Brightness { source(i) } else { Err(EmptyError) }
        },
        |i: &mut Input<'_>| {
            let grows = alt((
                exactly("up | higher | stronger | more").map(|_| true),
                exactly("down | lower | weaker | less").map(|_| false),
            ))
            .parse_next(i)?;
            let by = opt(|i: &mut Input<'_>| factor_by(grows, i)).parse_next(i)?;
            let degree = degree(i)?;
            Ok(part.scaled(grows, by, degree))
        },
        |i: &mut Input<'_>| {
            exactly("off").parse_next(i)?;
            if part == Part::Brightness { Err(EmptyError) } else { Ok(part.set(0.0, false)) }
        },
        |i: &mut Input<'_>| {
            connector(i)?;
            let degree = degree(i)?;
            let grows = alt((exactly("stronger | higher").map(|_| true), exactly("weaker | lower").map(|_| false)))
                .parse_next(i)?;
            Ok(part.scaled(grows, None, degree))
        },
        |i: &mut Input<'_>| {
            connector(i)?;
            let found = alt((quality, headlight)).parse_next(i)?;
            if part == Part::Brightness { Ok(found) } else { Err(EmptyError) }
        },
        |i: &mut Input<'_>| {
            connector(i)?;
            let value = quantity(i)?;
            let value = if part == Part::Shininess { value.value } else { value.as_opacity() };
            if (0.0..=1000.0).contains(&value) { Ok(part.set(value, false)) } else { Err(EmptyError) }
        },
    ))
    .parse_next(input)?;
    end(input)?;
    Ok(light(change))
}

/// "from the left", "it from above", "comes from behind", "on the left".
pub(super) fn from(input: &mut Input<'_>) -> Outcome<Reading> {
    let place = |input: &mut Input<'_>| {
        skip("come | comes | coming | shine | is | so that it comes").parse_next(input)?;
        let placed = opt(one_of("from | to come from | on | at | to | towards")).parse_next(input)?;
        let over = exactly("above | below | behind | overhead | over | under | underneath | beneath");
        if placed.is_none() {
            peek(over).parse_next(input)?;
        }
        let change = source(input)?;
        end(input)?;
        Ok(change)
    };
    let about = |input: &mut Input<'_>| {
        let (target, change) = target_then(input, |rest, _| place(rest))?;
        if target.unknown > 0 { Err(EmptyError) } else { Ok(change) }
    };
    let change = alt((place, about)).parse_next(input)?;
    Ok(light(change))
}

/// The light brought up or down by a verb: "the light by 20 %", "the specular highlights", nothing after "brighten".
pub(super) fn change(opening: &str, up: bool, input: &mut Input<'_>) -> Outcome<Reading> {
    let named = |input: &mut Input<'_>| {
        article(input)?;
        part(input)
    };
    let bare = matches!(opening, "brighten" | "brighten up" | "darken");
    let part = if bare {
        let object = opt(alt((
            named,
            one_of(
                "it | the scene | the picture | the image | everything | things | it all | the view | \
             the whole scene",
            )
            .map(|_| Part::Brightness),
        )))
        .parse_next(input)?;
        object.unwrap_or(Part::Brightness)
    } else {
        named(input)?
    };
    if matches!(opening, "turn off" | "switch off" | "remove") {
        end(input)?;
        return if part == Part::Brightness { Err(EmptyError) } else { Ok(light(part.set(0.0, false))) };
    }
    let to = opt((one_of("to | up to | down to"), quantity)).parse_next(input)?;
    if let Some((_, value)) = to {
        end(input)?;
        return Ok(light(part.set(value.as_opacity(), false)));
    }
    let by = opt(|i: &mut Input<'_>| factor_by(up, i)).parse_next(input)?;
    let degree = degree(input)?;
    end(input)?;
    let factor = match opening {
        "double" => Some(2.0),
        "triple" => Some(3.0),
        "halve" => Some(0.5),
        _ => by,
    };
    Ok(light(part.scaled(up, factor, degree)))
}

/// Sides as the viewer sees them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
    Above,
    Below,
    Front,
    Behind,
}

/// Where light comes from: one or more sides ("the upper left"), or the eye.
fn source(input: &mut Input<'_>) -> Outcome<SetLight> {
    article(input)?;
    let eye = opt(one_of("eye | eyes | camera | viewer | viewpoint | me | here | where i am")).parse_next(input)?;
    if eye.is_some() {
        return Ok(SetLight { mode: LightMode::Headlight.into(), ..SetLight::default() });
    }
    let side = |input: &mut Input<'_>| {
        skip("and | and from | and the | and from the | the").parse_next(input)?;
        alt((
            exactly("left").map(|_| Side::Left),
            exactly("right").map(|_| Side::Right),
            exactly("above | top | upper | overhead | over").map(|_| Side::Above),
            exactly("below | bottom | underneath | beneath | lower | under").map(|_| Side::Below),
            exactly("front").map(|_| Side::Front),
            exactly("behind | back | rear").map(|_| Side::Behind),
        ))
        .parse_next(input)
    };
    let sides: Vec<Side> = repeat(1..=3, side).parse_next(input)?;
    opt((opt(exactly("hand")), exactly("side | corner | edge"))).parse_next(input)?;
    skip("of the picture | of the scene | of the image | of it").parse_next(input)?;
    let axes = Axes::of(input.state.view);
    let mut sum = [0.0; 3];
    for side in sides {
        let along = axes.towards(side);
        for (s, a) in sum.iter_mut().zip(along) {
            *s += a;
        }
    }
    let direction = unit(sum).ok_or(EmptyError)?;
    let [x, y, z] = direction;
    Ok(SetLight { mode: LightMode::Direction.into(), direction: Some(Vector { x, y, z }), ..SetLight::default() })
}

/// The viewer's axes in the scene frame.
struct Axes {
    right: [f64; 3],
    up: [f64; 3],
    to_eye: [f64; 3],
}

impl Axes {
    /// The axes of a view; where there is none, those of the front view (the eye at -y, z up).
    fn of(view: Option<&View>) -> Self {
        view.and_then(Self::from_view).unwrap_or(Self {
            right: [1.0, 0.0, 0.0],
            up: [0.0, 0.0, 1.0],
            to_eye: [0.0, -1.0, 0.0],
        })
    }

    fn from_view(view: &View) -> Option<Self> {
        let [eye, target, up] = [view.eye?, view.target?, view.up?].map(|v| [v.x, v.y, v.z]);
        let to_eye = unit([eye[0] - target[0], eye[1] - target[1], eye[2] - target[2]])?;
        let up = unit(up)?;
        let right = unit(cross(up, to_eye))?;
        Some(Self { right, up, to_eye })
    }

    fn towards(&self, side: Side) -> [f64; 3] {
        match side {
            Side::Right => self.right,
            Side::Left => self.right.map(|c| -c),
            Side::Above => self.up,
            Side::Below => self.up.map(|c| -c),
            Side::Front => self.to_eye,
            Side::Behind => self.to_eye.map(|c| -c),
        }
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    (length.is_finite() && length > 1e-9).then(|| v.map(|c| c / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_left_is_the_viewers_left() {
        let vector = |x, y, z| Some(Vector { x, y, z });
        let front = View {
            eye: vector(0.0, -5.0, 0.0),
            target: vector(0.0, 0.0, 0.0),
            up: vector(0.0, 0.0, 1.0),
            fov_y_degrees: 45.0,
        };
        assert_eq!(Axes::of(Some(&front)).towards(Side::Left), [-1.0, 0.0, 0.0]);
        let back = View { eye: vector(0.0, 5.0, 0.0), ..front };
        assert_eq!(Axes::of(Some(&back)).towards(Side::Left), [1.0, 0.0, 0.0]);
        assert_eq!(Axes::of(Some(&back)).towards(Side::Front), [0.0, 1.0, 0.0]);
    }

    #[test]
    fn a_view_along_its_own_up_falls_back() {
        let vector = |x, y, z| Some(Vector { x, y, z });
        let view = View {
            eye: vector(0.0, 0.0, 5.0),
            target: vector(0.0, 0.0, 0.0),
            up: vector(0.0, 0.0, 1.0),
            fov_y_degrees: 45.0,
        };
        assert_eq!(Axes::of(Some(&view)).towards(Side::Right), [1.0, 0.0, 0.0]);
    }
}
