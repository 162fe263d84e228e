//! Parsers of lengths: "5 mm", "half a centimetre", "3 units".

use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::number::quantity;
use super::phrase::{Input, Outcome, exactly, one_of};

/// A spoken length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Length {
    /// The number, in millimetres or in the scene's length unit.
    pub(crate) value: f64,
    /// Whether it is in millimetres.
    pub(crate) millimetres: bool,
}

/// Parses a length. A number without a unit is in the scene's length unit.
pub(crate) fn length(input: &mut Input<'_>) -> Outcome<Length> {
    let amount = quantity(input)?;
    if amount.share {
        // "half a millimetre"; a share alone is no length.
        opt(exactly("a | an")).parse_next(input)?;
        let (millimetres, factor) = unit(input)?;
        return Ok(Length { value: factor * amount.value, millimetres });
    }
    let (millimetres, factor) = opt(unit).parse_next(input)?.unwrap_or((false, 1.0));
    Ok(Length { value: factor * amount.value, millimetres })
}

/// Parses a unit: whether it is metric, and its size.
fn unit(input: &mut Input<'_>) -> Outcome<(bool, f64)> {
    let found = alt((
        exactly("mm | millimetre | millimetres | millimeter | millimeters | mms").map(|_| (true, 1.0)),
        exactly("cm | centimetre | centimetres | centimeter | centimeters").map(|_| (true, 10.0)),
        exactly("m | metre | metres | meter | meters").map(|_| (true, 1000.0)),
        exactly("um | micrometre | micrometres | micrometer | micrometers | micron | microns").map(|_| (true, 0.001)),
        one_of("scene unit | scene units | unit | units").map(|_| (false, 1.0)),
    ))
    .parse_next(input)?;
    if opt(exactly("squared | cubed")).parse_next(input)?.is_some() { Err(EmptyError) } else { Ok(found) }
}
