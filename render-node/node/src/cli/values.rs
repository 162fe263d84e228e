//! Parsers of options: numbers, colours, backgrounds.

use glam::Vec3;
use sg_raster::finish::{Backdrop, Gradient};

/// Parses this many finite numbers between commas.
pub(super) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let one = |part: &str| {
        let number = part.trim().parse().ok().filter(|x: &f64| x.is_finite());
        number.ok_or_else(|| format!("`{part}` is no finite number"))
    };
    let numbers: Vec<f64> = text.split(',').map(one).collect::<Result<_, _>>()?;
    <[f64; N]>::try_from(numbers).map_err(|n| format!("{} numbers; {N} are needed, with commas between them", n.len()))
}

pub(super) fn color(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').map(|part| share(part.trim())).collect::<Result<_, _>>()?;
    match numbers.as_slice() {
        &[r, g, b] => Ok(Vec3::new(r, g, b)),
        _ => Err(format!("{} numbers; three are needed: red,green,blue", numbers.len())),
    }
}

/// The wanted background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Background {
    Plain,
    /// A gradient about the plain colour.
    Around,
    Transparent,
    Color(Vec3),
    Gradient(Gradient),
}

pub(super) fn background(text: &str) -> Result<Background, String> {
    match (text, text.split_once('/')) {
        ("plain", _) => Ok(Background::Plain),
        ("gradient", _) => Ok(Background::Around),
        ("transparent", _) => Ok(Background::Transparent),
        (_, Some((top, bottom))) => Ok(Background::Gradient(Gradient { top: color(top)?, bottom: color(bottom)? })),
        (_, None) => color(text).map(Background::Color),
    }
}

pub(super) fn share(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|x| (0.0..=1.0).contains(x)).ok_or_else(|| format!("`{text}` is no number from 0 to 1"))
}

pub(super) fn length(text: &str) -> Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|x| *x >= 0.0 && x.is_finite())
        .ok_or_else(|| format!("`{text}` is no finite length of at least 0"))
}

/// Three lengths above 0.
pub(super) fn lengths(text: &str) -> Result<[f64; 3], String> {
    numbers::<3>(text)
        .ok()
        .filter(|lengths| lengths.iter().all(|x| *x > 0.0))
        .ok_or_else(|| format!("`{text}` is not three lengths above 0, such as 0.5,0.5,1.25"))
}

/// Voxels between two samples of a ray.
pub(super) fn step(text: &str) -> Result<f64, String> {
    let range = 0.01..=8.0;
    text.parse().ok().filter(|x| range.contains(x)).ok_or_else(|| format!("`{text}` is no number from 0.01 to 8"))
}

pub(super) fn factor(text: &str) -> Result<f32, String> {
    text.parse::<f32>()
        .ok()
        .filter(|x| *x >= 0.0 && x.is_finite())
        .ok_or_else(|| format!("`{text}` is no finite number of at least 0"))
}

/// What is put behind a picture that was drawn over the plain colour.
pub(super) fn backdrop(wanted: Option<Background>, plain: Vec3) -> Backdrop {
    match wanted {
        None | Some(Background::Plain | Background::Color(_)) => Backdrop::Plain,
        Some(Background::Around) => Backdrop::Gradient(Gradient::around(plain)),
        Some(Background::Gradient(gradient)) => Backdrop::Gradient(gradient),
        Some(Background::Transparent) => Backdrop::Transparent,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_the_command_line() {
        assert_eq!(color("1, 0.5,0"), Ok(Vec3::new(1.0, 0.5, 0.0)));
        assert!(color("1,0").is_err() && color("1,0,2").is_err() && color("red").is_err());
        assert_eq!(factor("3"), Ok(3.0));
        assert!(factor("-1").is_err() && factor("inf").is_err() && factor("NaN").is_err());
        assert!(share("NaN").is_err());
        assert_eq!(lengths("0.5,1, 2"), Ok([0.5, 1.0, 2.0]));
        assert!(lengths("0,1,1").is_err() && lengths("1,1").is_err());
        assert!(step("0.25").is_ok() && step("0").is_err() && step("NaN").is_err());
        assert_eq!(background("gradient"), Ok(Background::Around));
        assert_eq!(background("0,0.5,1"), Ok(Background::Color(Vec3::new(0.0, 0.5, 1.0))));
        let gradient = Gradient { top: Vec3::ONE, bottom: Vec3::ZERO };
        assert_eq!(background("1,1,1/0,0,0"), Ok(Background::Gradient(gradient)));
        assert!(background("red").is_err() && background("1,1,1/").is_err());
        assert_eq!(numbers("-1, 2.5"), Ok([-1.0, 2.5]));
        assert!(numbers::<2>("1").is_err() && numbers::<2>("1,2,3").is_err() && numbers::<1>("inf").is_err());
    }
}
