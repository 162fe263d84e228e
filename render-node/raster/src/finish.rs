//! The last step of a picture that people look at: a gradient as background, and dithering of 8-bit colours.
//!
//! Both are off for pictures that are measured or compared. A renderer blends over one colour b and keeps the coverage A.
//! So another background g is exact afterwards: C + (1 − A)·(g − b).
//!
//! Dithering is ordered: colour c becomes ⌊255·c + u⌋, with u between 0 and 1 from the position alone. So a picture is the same at
//! every drawing. u is the additive sequence R₂ over columns and rows (M. Roberts, "The unreasonable effectiveness of
//! quasirandom sequences", 2018): nearby pixels have very different values, so that the mean over a few pixels is the colour.
//! It is computed in 32-bit integers, alike on cores and devices (`shaders/present.wgsl`). Multiples of 1/255 stay as they
//! are.

use std::io::{self, Write};
use std::path::Path;

use glam::Vec3;

use crate::image::{Image, ImageError, ImageFormat, save};

/// The golden ratio's counterparts in two dimensions, 1/ρ and 1/ρ² with ρ³ = ρ + 1, times 2³².
const STEPS: [u32; 2] = [0xC13F_A9A9, 0x91E1_0DA6];

/// Distance of the three channels in the sequence: a third of 2³².
const CHANNEL: u32 = 0x5555_5555;

/// Share of the range of u that is left out at either end, so that exact multiples of 1/255 survive rounding.
const EDGE: f32 = 1.0 / 64.0;

/// A background that changes from the top to the bottom of the picture. RGB 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gradient {
    /// At the upper edge.
    pub top: Vec3,
    /// At the lower edge.
    pub bottom: Vec3,
}

impl Gradient {
    /// A gradient that suits a scene's background: bluish grey above it, nearly its own colour below. Bright backgrounds darken
    /// downwards instead.
    #[must_use]
    pub fn around(background: Vec3) -> Self {
        const TOWARDS: Vec3 = Vec3::new(0.36, 0.42, 0.50);
        let brightness = background.dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let (near, far) = (background.lerp(TOWARDS, 0.12), background.lerp(TOWARDS, 0.5));
        if brightness < 0.5 {
            Self { top: far, bottom: near }
        } else {
            Self { top: background, bottom: background.lerp(TOWARDS, 0.4) }
        }
    }

    /// Its colour in the middle of row `y` of a picture of `height` rows.
    #[must_use]
    pub fn at(&self, y: u32, height: u32) -> Vec3 {
        self.top.lerp(self.bottom, (y as f32 + 0.5) / height.max(1) as f32)
    }
}

/// What lies behind a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Backdrop {
    /// The one colour over which it was drawn.
    #[default]
    Plain,
    /// A gradient instead.
    Gradient(Gradient),
    /// Nothing: files keep the coverage.
    Transparent,
}

/// The last step of a picture. The default leaves it as it is.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Finish {
    /// What lies behind it.
    pub backdrop: Backdrop,
    /// Whether 8-bit colours are dithered.
    pub dither: bool,
}

impl Finish {
    /// That of pictures to look at, over a scene's background: dithered, with a gradient if wanted.
    #[must_use]
    pub fn to_look_at(background: Vec3, gradient: bool) -> Self {
        let backdrop = if gradient { Backdrop::Gradient(Gradient::around(background)) } else { Backdrop::Plain };
        Self { backdrop, dither: true }
    }

    /// The gradient, if there is one.
    #[must_use]
    pub fn gradient(&self) -> Option<Gradient> {
        if let Backdrop::Gradient(gradient) = self.backdrop { Some(gradient) } else { None }
    }
}

/// The threshold u of a pixel and channel, above 0 and below 1.
#[must_use]
pub fn threshold(x: u32, y: u32, channel: u32) -> f32 {
    let [a, b] = STEPS;
    let at = x.wrapping_mul(a).wrapping_add(y.wrapping_mul(b)).wrapping_add(channel.wrapping_mul(CHANNEL));
    // 24 bits are exact in f32.
    let share = ((at >> 8) as f32 + 0.5) / (1 << 24) as f32;
    EDGE + (1.0 - 2.0 * EDGE) * share
}

/// The 8-bit value of a channel: dithered by the threshold of its place, or rounded.
#[must_use]
pub fn byte(value: f32, threshold: Option<f32>) -> u8 {
    let value = 255.0 * value.clamp(0.0, 1.0);
    // The conversion bounds 256 to 255 and makes 0 of NaN, as for rounded colours.
    threshold.map_or(value.round(), |u| (value + u).floor()) as u8
}

impl Image {
    /// Replaces the background `plain`, over which the picture was drawn.
    pub fn put_over(&mut self, plain: Vec3, gradient: &Gradient) {
        let (width, height) = (self.width.max(1) as usize, self.height);
        for (y, row) in (0..height).zip(self.rgba.chunks_mut(4 * width)) {
            let other = (gradient.at(y, height) - plain).to_array();
            for pixel in row.chunks_exact_mut(4) {
                let seen = 1.0 - pixel.last().copied().unwrap_or(1.0);
                pixel.iter_mut().zip(other).for_each(|(c, d)| *c += seen * d);
            }
        }
    }

    /// 8-bit RGB of the picture over its background, row by row from the top.
    #[must_use]
    pub fn rgb8_dithered(&self) -> Vec<u8> {
        self.bytes::<3>(|pixel| [pixel[0], pixel[1], pixel[2], 0.0], true)
    }

    /// 8-bit RGBA of the picture without the background `plain`, over which it was drawn: colours not multiplied by their
    /// coverage, as PNG stores them. Rows from the top.
    #[must_use]
    pub fn rgba8(&self, plain: Vec3, dither: bool) -> Vec<u8> {
        let straight = |pixel: [f32; 4]| {
            let [r, g, b, coverage] = pixel;
            // Beneath a step of an 8-bit picture there is no colour to recover.
            if coverage < 0.5 / 255.0 {
                return [0.0; 4];
            }
            let color = (Vec3::new(r, g, b) - (1.0 - coverage) * plain) / coverage;
            [color.x, color.y, color.z, coverage]
        };
        self.bytes::<4>(straight, dither)
    }

    /// 8-bit RGB of the picture with its last step; `plain` is the background over which it was drawn. A transparent backdrop
    /// shows that background.
    #[must_use]
    pub fn finished_rgb8(&self, plain: Vec3, finish: &Finish) -> Vec<u8> {
        if let Some(gradient) = finish.gradient() {
            let mut over = self.clone();
            over.put_over(plain, &gradient);
            return over.finished_rgb8(plain, &Finish { backdrop: Backdrop::Plain, ..*finish });
        }
        if finish.dither { self.rgb8_dithered() } else { self.rgb8() }
    }

    /// A PNG file of the picture with its last step; `plain` is the background over which it was drawn. A transparent backdrop
    /// makes RGBA of it, every other RGB.
    ///
    /// # Errors
    /// When `writer` fails.
    pub fn write_finished_png(&self, plain: Vec3, finish: &Finish, writer: impl Write) -> io::Result<()> {
        if finish.backdrop == Backdrop::Transparent {
            return self.encode_png(writer, png::ColorType::Rgba, &self.rgba8(plain, finish.dither));
        }
        self.encode_png(writer, png::ColorType::Rgb, &self.finished_rgb8(plain, finish))
    }

    /// As [`Image::save`], with a last step; `plain` is the background over which the picture was drawn. A NumPy file gets a
    /// gradient only: it needs no dithering, and has the coverage beside the colour.
    ///
    /// # Errors
    /// As [`Image::save`].
    pub fn save_finished(&self, path: &Path, plain: Vec3, finish: &Finish) -> Result<(), ImageError> {
        save(path, |format, file| match (format, finish.gradient()) {
            (ImageFormat::Png, _) => self.write_finished_png(plain, finish, file),
            (ImageFormat::Npy, None) => self.write_npy(file),
            (ImageFormat::Npy, Some(gradient)) => {
                let mut over = self.clone();
                over.put_over(plain, &gradient);
                over.write_npy(file)
            }
        })
    }

    fn bytes<const N: usize>(&self, of: impl Fn([f32; 4]) -> [f32; 4], dither: bool) -> Vec<u8> {
        let width = self.width.max(1);
        let mut bytes = Vec::with_capacity(N * self.pixels().len());
        let places = (0..self.height).flat_map(|y| (0..width).map(move |x| (x, y)));
        for (pixel, (x, y)) in self.pixels().zip(places) {
            let Ok(pixel) = <[f32; 4]>::try_from(pixel) else { continue };
            let values = of(pixel).into_iter().zip(0..).take(N);
            // Coverage is rounded: noise in it would show over every background.
            bytes.extend(values.map(|(c, k)| byte(c, (dither && k < 3).then(|| threshold(x, y, k)))));
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(width: u32, height: u32, pixel: [f32; 4]) -> Image {
        Image { width, height, rgba: pixel.repeat((width * height) as usize) }
    }

    #[test]
    fn dithered_colours_have_the_mean_of_the_picture() {
        for level in [0.0_f32, 0.3, 17.25, 100.5, 127.9, 200.0, 254.6, 255.0] {
            let bytes = flat(64, 64, [level / 255.0; 4]).rgb8_dithered();
            for corner in [(0, 0), (24, 8), (56, 48)] {
                let block = (0..8).flat_map(|y| (0..8).map(move |x| 3 * (64 * (corner.1 + y) + corner.0 + x)));
                let mean = block.map(|at| f32::from(bytes[at])).sum::<f32>() / 64.0;
                assert!((mean - level).abs() < 0.06, "{level} became {mean} in the block at {corner:?}");
            }
            let off = bytes.iter().map(|b| (f32::from(*b) - level).abs()).fold(0.0, f32::max);
            assert!(off < 1.0, "{level}: {off}");
        }
    }

    #[test]
    fn levels_of_8_bits_stay_as_they_are() {
        for level in 0..=255_u8 {
            let bytes = flat(32, 32, [f32::from(level) / 255.0; 4]).rgb8_dithered();
            assert!(bytes.iter().all(|b| *b == level), "{level}");
        }
        let picture = Image { width: 2, height: 1, rgba: vec![-3.0, 7.0, 0.5, 1.0, f32::NAN, 0.2, 1.0, 0.0] };
        let bytes = picture.rgb8_dithered();
        assert_eq!((bytes[0], bytes[1], bytes[3], bytes[4], bytes[5]), (0, 255, 0, 51, 255));
    }

    /// A ramp over 128 rows of 6 levels in 8 bits: rounded, it has bands 20 rows wide. Dithered, every 8 rows are brighter
    /// than those before by the same step.
    #[test]
    fn a_dark_gradient_has_no_bands() {
        let gradient = Gradient { top: Vec3::splat(0.02), bottom: Vec3::splat(0.045) };
        let mut picture = flat(64, 128, [0.0; 4]);
        picture.put_over(Vec3::ZERO, &gradient);
        let steps = |finish: Finish| {
            let bytes = picture.finished_rgb8(Vec3::ZERO, &finish);
            let mean = |rows: &[u8]| rows.iter().map(|b| f32::from(*b)).sum::<f32>() / rows.len() as f32;
            let means: Vec<f32> = bytes.chunks(3 * 64 * 8).map(mean).collect();
            let off = |pair: &[f32]| (pair[1] - pair[0] - 255.0 * 0.025 / 16.0).abs();
            means.windows(2).map(off).fold(0.0, f32::max)
        };
        let (rounded, dithered) = (steps(Finish::default()), steps(Finish { dither: true, ..Finish::default() }));
        assert!(rounded > 0.3 && dithered < 0.05, "{rounded} {dithered}");
    }

    #[test]
    fn png_files_have_the_backdrop_that_is_wanted() {
        let picture = flat(4, 4, [0.3, 0.3, 0.3, 0.5]);
        let written = |backdrop| {
            let mut file = Vec::new();
            picture.write_finished_png(Vec3::ZERO, &Finish { backdrop, dither: false }, &mut file).unwrap();
            let mut reader = png::Decoder::new(io::Cursor::new(file)).read_info().unwrap();
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            (reader.info().color_type, bytes)
        };
        let (kind, bytes) = written(Backdrop::Transparent);
        assert_eq!((kind, &bytes[..4]), (png::ColorType::Rgba, &[153, 153, 153, 128][..]));
        let white = Gradient { top: Vec3::ONE, bottom: Vec3::ONE };
        let (kind, bytes) = written(Backdrop::Gradient(white));
        assert_eq!((kind, &bytes[..3]), (png::ColorType::Rgb, &[204; 3][..]));
        let mut plain = Vec::new();
        picture.write_png(&mut plain).unwrap();
        let mut same = Vec::new();
        picture.write_finished_png(Vec3::ZERO, &Finish::default(), &mut same).unwrap();
        assert_eq!(plain, same);
    }

    #[test]
    fn a_background_is_replaced_as_if_it_had_been_there() {
        let plain = Vec3::new(0.2, 0.0, 1.0);
        let (color, coverage) = (Vec3::new(0.5, 0.25, 0.1), 0.6);
        let over = |b: Vec3| coverage * color + (1.0 - coverage) * b;
        let drawn = over(plain);
        let mut picture = flat(3, 5, [drawn.x, drawn.y, drawn.z, coverage]);
        let straight = picture.rgba8(plain, false);
        assert_eq!(straight[..4], [128, 64, 26, 153]);
        let gradient = Gradient { top: Vec3::ONE, bottom: Vec3::ZERO };
        picture.put_over(plain, &gradient);
        for y in 0..5 {
            let wanted = over(Vec3::splat(1.0 - (y as f32 + 0.5) / 5.0));
            let got = picture.pixel(1, y).unwrap();
            assert!((Vec3::from_slice(&got) - wanted).length() < 1e-6 && got[3] == coverage, "{y}: {got:?}");
        }
        assert_eq!(flat(1, 1, [0.2, 0.0, 1.0, 0.0]).rgba8(plain, true), [0; 4]);
    }

    #[test]
    fn the_gradient_of_a_background_stays_near_it_and_within_range() {
        for background in [Vec3::ZERO, Vec3::splat(0.5), Vec3::ONE, Vec3::new(0.9, 0.1, 0.2)] {
            let Gradient { top, bottom } = Gradient::around(background);
            for color in [top, bottom] {
                assert!(color.min_element() >= 0.0 && color.max_element() <= 1.0, "{color}");
            }
            assert!((bottom - background).length().min((top - background).length()) < 0.15, "{background}");
            assert!((top - bottom).length() > 0.05, "{background} has a visible gradient");
        }
    }
}
