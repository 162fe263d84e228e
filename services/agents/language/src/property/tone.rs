//! Values of saturation, brightness and temperature of a unit.

use sg_proto::scene::SetTone;
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use crate::syntax::modifier::{Degree, degree, factor_by};
use crate::syntax::number::times;
use crate::syntax::phrase::{Input, Outcome, exactly};

/// A term of a unit's tone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Term {
    Saturation,
    Brightness,
    Temperature,
}

impl Term {
    pub(crate) fn set(self, value: f64, relative: bool) -> SetTone {
        let value = Some(value as f32);
        let mut tone = SetTone { relative, ..SetTone::default() };
        match self {
            Self::Saturation => tone.saturation = value,
            Self::Brightness => tone.brightness = value,
            Self::Temperature => tone.temperature = value,
        }
        tone
    }

    /// The term as the file has it.
    pub(crate) fn original(self) -> SetTone {
        self.set(if self == Self::Temperature { 0.0 } else { 1.0 }, false)
    }

    /// The usual step of more or less.
    pub(crate) fn step(self, more: bool, degree: Degree) -> f64 {
        match (self, more) {
            (Self::Saturation, true) => degree.pick(1.2, 1.5, 2.5),
            (Self::Saturation, false) => degree.pick(0.8, 0.5, 0.25),
            (Self::Brightness, true) => degree.pick(1.1, 1.25, 1.6),
            (Self::Brightness, false) => degree.pick(0.9, 0.8, 0.6),
            (Self::Temperature, true) => degree.pick(0.1, 0.25, 0.5),
            (Self::Temperature, false) => degree.pick(-0.1, -0.25, -0.5),
        }
    }
}

const SATURATED: &str = "saturated | vivid | colourful | colorful | intense";

/// Parses "less saturated", "a bit more vivid by 20 %", "twice as saturated", "warmer", "desaturated".
pub(crate) fn tone(input: &mut Input<'_>) -> Outcome<SetTone> {
    let multiplied = |input: &mut Input<'_>| {
        let times = alt((exactly("half").map(|_| 0.5), times)).parse_next(input)?;
        (exactly("as"), exactly(SATURATED)).parse_next(input)?;
        if times <= 4.0 { Ok(Term::Saturation.set(times, true)) } else { Err(EmptyError) }
    };
    let compared = |input: &mut Input<'_>| {
        let degree = degree(input)?;
        let (term, more) = alt((
            (exactly("more | less"), exactly(SATURATED)).map(|(m, _)| (Term::Saturation, m.text == "more")),
            exactly("warmer | redder").map(|_| (Term::Temperature, true)),
            exactly("cooler | colder | bluer").map(|_| (Term::Temperature, false)),
        ))
        .parse_next(input)?;
        let by = if term == Term::Temperature {
            None
        } else {
            opt(|i: &mut Input<'_>| factor_by(more, i)).parse_next(input)?
        };
        Ok(term.set(by.unwrap_or_else(|| term.step(more, degree)), true))
    };
    let plain = alt((
        exactly("desaturated | unsaturated | colourless | colorless").map(|_| Term::Saturation.set(0.0, false)),
        exactly("saturated | vivid").map(|_| Term::Saturation.set(1.5, false)),
    ));
    alt((multiplied, compared, plain)).parse_next(input)
}
