//! From an image to a model's patches: resize, crop at the centre, normalise.

use rayon::prelude::*;

use crate::image::{Pixels, RgbImage};
use crate::resample::{Axis, Filter, Sample, resample};

/// How an image gets its size before it is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Resize {
    /// The shorter side gets this many pixels, and the proportions stay.
    ShortestEdge(usize),
    Exact {
        width: usize,
        height: usize,
    },
}

/// Where the crop begins when an odd number of pixels goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CropRounding {
    /// At the lower place, as in transformers.
    Down,
    /// At the even place, as in torchvision.
    HalfToEven,
}

/// A model's preparation of images.
#[derive(Clone, Debug)]
pub(crate) struct Preprocess {
    /// Pixels on a side of the result.
    pub(crate) side: usize,
    pub(crate) resize: Resize,
    pub(crate) filter: Filter,
    pub(crate) rounding: CropRounding,
    /// Factor of 8-bit values.
    pub(crate) factor: f32,
    pub(crate) mean: [f32; 3],
    pub(crate) deviation: [f32; 3],
}

impl Preprocess {
    /// Checks the numbers, or says which key of `preprocessor_config.json` has a wrong one, and why.
    pub(crate) fn checked(self, crops: bool) -> Result<Self, (&'static str, String)> {
        let side = self.side;
        let sizes = match self.resize {
            Resize::ShortestEdge(edge) => [edge; 2],
            Resize::Exact { width, height } => [width, height],
        };
        let fits = |size: usize| if crops { (side..=2 * side).contains(&size) } else { size == side };
        if !sizes.into_iter().all(fits) || !crops && matches!(self.resize, Resize::ShortestEdge(_)) {
            let [width, height] = sizes;
            let problem =
                format!("images of {width} × {height} do not become the {side} × {side} that the model takes");
            return Err(("size", problem));
        }
        if !self.factor.is_normal() {
            return Err(("rescale_factor", format!("{}; it is a positive number", self.factor)));
        }
        if !self.mean.iter().all(|mean| mean.is_finite()) {
            return Err(("image_mean", format!("{:?}; it has three finite numbers", self.mean)));
        }
        if !self.deviation.iter().all(|deviation| deviation.is_normal() && *deviation > 0.0) {
            return Err(("image_std", format!("{:?}; it has three positive numbers", self.deviation)));
        }
        Ok(self)
    }

    /// The patches of all images, row by row: images · patches × (3 · patch · patch), channel by channel within a patch.
    pub(crate) fn patches(&self, images: &[RgbImage], patch: usize) -> Vec<f32> {
        let across = self.side / patch;
        let of_image = |image: &RgbImage| {
            let values = self.values(image);
            let mut patches = Vec::with_capacity(across * across * 3 * patch * patch);
            for row in 0..across {
                for column in 0..across {
                    for channel in 0..3 {
                        for y in 0..patch {
                            let start = 3 * ((row * patch + y) * self.side + column * patch);
                            let line = &values[start..start + 3 * patch];
                            patches.extend(line.chunks_exact(3).map(|pixel| pixel[channel]));
                        }
                    }
                }
            }
            patches
        };
        images.par_iter().map(of_image).collect::<Vec<_>>().concat()
    }

    /// The normalised values of a square image, pixel by pixel.
    pub(crate) fn values(&self, image: &RgbImage) -> Vec<f32> {
        let levels: Vec<f32> = match image.pixels() {
            Pixels::Bytes(values) => self.square(image, values).into_iter().map(f32::from).collect(),
            Pixels::Floats(values) => self.square(image, values).into_iter().map(|value| 255.0 * value).collect(),
        };
        let normalised = |(at, level): (usize, f32)| (level * self.factor - self.mean[at % 3]) / self.deviation[at % 3];
        levels.into_iter().enumerate().map(normalised).collect()
    }

    /// The square of the resized image. Only what the crop leaves is computed, however long the image is.
    fn square<S: Sample>(&self, image: &RgbImage, pixels: &[S]) -> Vec<S> {
        let (width, height) = (image.width(), image.height());
        let (to_width, to_height) = match self.resize {
            Resize::Exact { width, height } => (width, height),
            Resize::ShortestEdge(edge) if width <= height => (edge, edge * height / width),
            Resize::ShortestEdge(edge) => (edge * width / height, edge),
        };
        let axis = |from, to| Axis { from, to, first: self.crop_start(to), count: self.side };
        resample(pixels, self.filter, axis(width, to_width), axis(height, to_height))
    }

    fn crop_start(&self, size: usize) -> usize {
        let surplus = size - self.side;
        match self.rounding {
            CropRounding::Down => surplus / 2,
            CropRounding::HalfToEven if surplus % 4 == 3 => surplus / 2 + 1,
            CropRounding::HalfToEven => surplus / 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn preprocess(resize: Resize, rounding: CropRounding) -> Preprocess {
        Preprocess {
            side: 8,
            resize,
            filter: Filter::Bicubic,
            rounding,
            factor: 1.0 / 255.0,
            mean: [0.5; 3],
            deviation: [0.25; 3],
        }
    }

    #[test]
    fn the_crop_begins_as_published() {
        let rounded = |rounding: CropRounding| {
            let preprocess = preprocess(Resize::ShortestEdge(8), rounding);
            [8, 9, 10, 11, 12, 13, 15].map(|size| preprocess.crop_start(size))
        };
        assert_eq!(rounded(CropRounding::Down), [0, 0, 1, 1, 2, 2, 3]);
        // round(0.5) = 0, round(1.5) = 2, round(2.5) = 2 and round(3.5) = 4.
        assert_eq!(rounded(CropRounding::HalfToEven), [0, 0, 1, 2, 2, 2, 4]);
    }

    #[test]
    fn floats_become_what_bytes_become() {
        let preprocess = preprocess(Resize::ShortestEdge(8), CropRounding::Down);
        let bytes: Vec<u8> = (0..3 * 8 * 11).map(|i| (i * 53 % 256) as u8).collect();
        let floats = bytes.iter().map(|value| f32::from(*value) / 255.0).collect();
        let of = |pixels| preprocess.values(&RgbImage::new(8, 11, pixels).unwrap());
        let (of_bytes, of_floats) = (of(Pixels::Bytes(bytes)), of(Pixels::Floats(floats)));
        assert_eq!(of_bytes.len(), 3 * 8 * 8);
        assert!(of_bytes.iter().zip(&of_floats).all(|(a, b)| (a - b).abs() < 1e-5));
        // 1 normalised is (1 − 0.5)/0.25.
        assert!(of(Pixels::Floats(vec![1e30; 3 * 8 * 11])).iter().all(|value| (value - 2.0).abs() < 1e-5));
    }

    #[test]
    fn a_very_long_image_costs_no_more_than_its_crop() {
        let preprocess = preprocess(Resize::ShortestEdge(8), CropRounding::Down);
        let long = RgbImage::new(1, 60_000, Pixels::Bytes(vec![200; 180_000])).unwrap();
        assert_eq!(preprocess.values(&long).len(), 3 * 8 * 8);
    }

    #[test]
    fn a_size_that_the_model_does_not_take_is_refused() {
        let key = |resize, crops| preprocess(resize, CropRounding::Down).checked(crops).map_err(|(key, _)| key);
        assert!(key(Resize::ShortestEdge(9), true).is_ok());
        assert!(key(Resize::Exact { width: 8, height: 8 }, false).is_ok());
        for (resize, crops) in [
            (Resize::ShortestEdge(7), true),
            (Resize::ShortestEdge(8), false),
            (Resize::ShortestEdge(usize::MAX), true),
            (Resize::Exact { width: 8, height: 9 }, false),
        ] {
            assert_eq!(key(resize, crops).unwrap_err(), "size", "{resize:?}");
        }
    }
}
