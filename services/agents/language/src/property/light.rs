//! Values of the light: brightness, terms, gloss.

use sg_proto::scene::{LightMode, SetLight};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use crate::syntax::modifier::{Degree, degree, factor_by};
use crate::syntax::number::times;
use crate::syntax::phrase::{Input, Outcome, article, exactly, one_of};

/// A quantity of the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// Ambient and diffuse: the brightness of the picture.
    Brightness,
    Ambient,
    Diffuse,
    Specular,
    Shininess,
    /// Specular strength and exponent.
    Gloss,
}

impl Part {
    pub(crate) fn set(self, value: f64, relative: bool) -> SetLight {
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

    /// Default factor of an increase.
    fn step(self, degree: Degree) -> f64 {
        if self == Self::Brightness { degree.pick(1.1, 1.25, 1.6) } else { degree.pick(1.2, 1.5, 2.5) }
    }

    pub(crate) fn scaled(self, grows: bool, by: Option<f64>, degree: Degree) -> SetLight {
        let step = self.step(degree);
        self.set(by.unwrap_or(if grows { step } else { 1.0 / step }), true)
    }
}

pub(crate) fn part(input: &mut Input<'_>) -> Outcome<Part> {
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

/// Parses "brighter", "much darker by 20 %", "shinier", "twice as bright".
pub(crate) fn quality(input: &mut Input<'_>) -> Outcome<SetLight> {
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

pub(crate) fn headlight(input: &mut Input<'_>) -> Outcome<SetLight> {
    article(input)?;
    one_of("headlight | head light | headlamp | camera light | eye light").parse_next(input)?;
    Ok(SetLight { mode: LightMode::Headlight.into(), ..SetLight::default() })
}
