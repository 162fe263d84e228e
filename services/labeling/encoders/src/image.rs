//! Images as encoders take them: RGB, 8-bit or float.

use crate::error::EncoderError;

/// Rows from the top, each from the left, each pixel red, green, blue.
#[derive(Clone, Debug)]
pub enum Pixels {
    /// 0 to 255.
    Bytes(Vec<u8>),
    /// 0 to 1. Values outside are clamped.
    Floats(Vec<f32>),
}

/// An RGB image of any size.
#[derive(Clone, Debug)]
pub struct RgbImage {
    width: usize,
    height: usize,
    pixels: Pixels,
}

/// Most pixels on a side.
const MAX_SIDE: usize = 1 << 16;

impl RgbImage {
    /// An image of `width` × `height` pixels.
    ///
    /// # Errors
    /// [`EncoderError::Image`] for a side of 0 or of more than 65,536 pixels, another number of values than 3 for each pixel, or
    /// values that are not finite.
    pub fn new(width: usize, height: usize, pixels: Pixels) -> Result<Self, EncoderError> {
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            return Err(EncoderError::Image(format!("{width} × {height} pixels; each side has 1 to {MAX_SIDE}")));
        }
        let (values, expected) = (pixels.len(), 3 * width * height);
        if values != expected {
            let problem = format!("{width} × {height} RGB pixels have {expected} values, but there are {values}");
            return Err(EncoderError::Image(problem));
        }
        if let Pixels::Floats(values) = &pixels
            && let Some(at) = values.iter().position(|value| !value.is_finite())
        {
            let (x, y) = (at / 3 % width, at / 3 / width);
            return Err(EncoderError::Image(format!("the pixel at ({x}, {y}) is not finite")));
        }
        Ok(Self { width, height, pixels })
    }

    /// Pixels in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The values.
    #[must_use]
    pub fn pixels(&self) -> &Pixels {
        &self.pixels
    }
}

impl Pixels {
    fn len(&self) -> usize {
        match self {
            Self::Bytes(values) => values.len(),
            Self::Floats(values) => values.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_has_all_its_pixels() {
        let error = |width, height, pixels| RgbImage::new(width, height, pixels).unwrap_err().to_string();
        assert!(error(0, 3, Pixels::Bytes(vec![])).contains("0 × 3 pixels"));
        assert!(error(1 << 20, 1, Pixels::Bytes(vec![])).contains("65536"));
        assert!(error(2, 2, Pixels::Bytes(vec![0; 11])).contains("12 values, but there are 11"));
        let mut floats = vec![0.5; 12];
        floats[10] = f32::NAN;
        assert!(error(2, 2, Pixels::Floats(floats)).contains("(1, 1) is not finite"));
    }
}
