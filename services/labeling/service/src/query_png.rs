//! Pictures of queries in PNG files.

use std::io::Cursor;

use sg_encoders::{EncoderError, Pixels, RgbImage};

/// Longest file, bytes.
pub const MAX_BYTES: usize = 3 << 20;
/// Most pixels of a side.
const MAX_SIDE: u32 = 4096;
/// Most memory of the decoder beside the pixels, bytes.
const DECODER_BYTES: usize = 8 << 20;

/// Why the picture of a query was not read.
#[derive(Debug, thiserror::Error)]
pub enum QueryPngError {
    /// The file is too long.
    #[error("the picture has {0} bytes; the limit is {MAX_BYTES}; make it smaller")]
    Long(usize),
    /// A side is too long.
    #[error("the picture has {0} × {1} pixels; the limit is {MAX_SIDE} × {MAX_SIDE}; make it smaller")]
    Large(u32, u32),
    /// It is not a whole PNG file.
    #[error("the picture is no whole PNG file: {0}; save it as PNG again")]
    Damaged(#[from] png::DecodingError),
    /// It has no pixels.
    #[error("the picture cannot be taken: {0}")]
    Image(#[from] EncoderError),
}

/// The picture of a PNG file of any kind of pixels, over white. Of an animation, the first one.
///
/// # Errors
/// [`QueryPngError`] for a file that is too long, too large or damaged.
pub fn decode(file: &[u8]) -> Result<RgbImage, QueryPngError> {
    if file.len() > MAX_BYTES {
        return Err(QueryPngError::Long(file.len()));
    }
    let limits = png::Limits { bytes: DECODER_BYTES };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(file), limits);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info()?;
    let (width, height) = (header.width, header.height);
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(QueryPngError::Large(width, height));
    }
    let mut reader = decoder.read_info()?;
    let length = reader.output_buffer_size().ok_or(png::DecodingError::LimitsExceeded)?;
    let mut bytes = vec![0; length];
    let frame = reader.next_frame(&mut bytes)?;
    let pixels = bytes.get(..frame.buffer_size()).unwrap_or_default().chunks_exact(frame.color_type.samples());
    let rgb: Vec<u8> = pixels.flat_map(over_white).collect();
    let (width, height) = (frame.width as usize, frame.height as usize);
    Ok(RgbImage::new(width, height, Pixels::Bytes(rgb))?)
}

/// RGB of a pixel of grey or RGB, with or without opacity.
fn over_white(pixel: &[u8]) -> [u8; 3] {
    let (color, opacity) = match *pixel {
        [grey] => ([grey; 3], u8::MAX),
        [grey, opacity] => ([grey; 3], opacity),
        [red, green, blue] => ([red, green, blue], u8::MAX),
        [red, green, blue, opacity] => ([red, green, blue], opacity),
        // PNG has no other kinds of pixels; one without samples shows the white behind it.
        _ => ([u8::MAX; 3], 0),
    };
    let (opacity, white) = (u32::from(opacity), u32::from(u8::MAX));
    color.map(|value| ((u32::from(value) * opacity + white * (white - opacity) + white / 2) / white) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a PNG file says beside its pixels.
    #[derive(Default)]
    struct Extras {
        palette: Option<Vec<u8>>,
        /// Opacities of the palette's colours.
        transparency: Option<Vec<u8>>,
    }

    fn png_file(
        (width, height): (u32, u32),
        (color, depth): (png::ColorType, png::BitDepth),
        pixels: &[u8],
        extras: Extras,
    ) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if let Some(palette) = extras.palette {
            encoder.set_palette(palette);
        }
        if let Some(transparency) = extras.transparency {
            encoder.set_trns(transparency);
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(pixels).unwrap();
        writer.finish().unwrap();
        file
    }

    fn rgb8(size: (u32, u32), pixels: &[u8]) -> Vec<u8> {
        png_file(size, (png::ColorType::Rgb, png::BitDepth::Eight), pixels, Extras::default())
    }

    fn bytes(picture: &RgbImage) -> Vec<u8> {
        let Pixels::Bytes(bytes) = picture.pixels() else { panic!("no bytes") };
        bytes.clone()
    }

    fn decoded(file: &[u8]) -> Vec<u8> {
        bytes(&decode(file).unwrap())
    }

    #[test]
    fn all_kinds_of_pixels_become_rgb_over_white() {
        use png::BitDepth::{Eight, One, Sixteen};
        use png::ColorType::{Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};
        let of = |kind, pixels: &[u8]| decoded(&png_file((2, 1), kind, pixels, Extras::default()));
        assert_eq!(decoded(&rgb8((2, 1), &[1, 2, 3, 250, 251, 252])), [1, 2, 3, 250, 251, 252]);
        assert_eq!(of((Grayscale, Eight), &[7, 200]), [7, 7, 7, 200, 200, 200]);
        assert_eq!(of((Grayscale, One), &[0b0100_0000]), [0, 0, 0, 255, 255, 255]);
        assert_eq!(of((GrayscaleAlpha, Eight), &[100, 0, 100, 255]), [255, 255, 255, 100, 100, 100]);
        // Half of a colour and half of white: (51 · 10 + 204 · 255)/255 = 206.
        assert_eq!(of((Rgba, Eight), &[10, 0, 255, 51, 4, 5, 6, 255]), [206, 204, 255, 4, 5, 6]);
        let wide = [0, 1, 0, 2, 0, 3, 250, 9, 251, 9, 252, 9];
        assert_eq!(of((Rgb, Sixteen), &wide), [0, 0, 0, 250, 251, 252]);
        let palette = || Some(vec![9, 8, 7, 60, 50, 40]);
        let solid = Extras { palette: palette(), transparency: None };
        assert_eq!(decoded(&png_file((2, 1), (Indexed, Eight), &[1, 0], solid)), [60, 50, 40, 9, 8, 7]);
        let seen_through = Extras { palette: palette(), transparency: Some(vec![0]) };
        assert_eq!(decoded(&png_file((2, 1), (Indexed, Eight), &[1, 0], seen_through)), [60, 50, 40, 255, 255, 255]);
    }

    #[test]
    fn what_is_no_picture_is_refused_in_one_line() {
        let whole = rgb8((16, 16), &[7; 3 * 256]);
        assert!(decode(&whole).is_ok());
        for end in [0, 7, 20, 40, whole.len() - 13] {
            let error = decode(&whole[..end]).unwrap_err();
            assert!(matches!(error, QueryPngError::Damaged(_)), "cut at {end}: {error}");
            assert!(error.to_string().starts_with("the picture is no whole PNG file: "), "{error}");
        }
        let mut damaged = whole.clone();
        damaged[45] ^= 0x55;
        assert!(matches!(decode(&damaged), Err(QueryPngError::Damaged(_))));
        let error = decode(&vec![0; MAX_BYTES + 1]).unwrap_err();
        assert_eq!(error.to_string(), "the picture has 3145729 bytes; the limit is 3145728; make it smaller");
        for size in [(MAX_SIDE + 1, 1), (1, MAX_SIDE + 1)] {
            let long = rgb8(size, &vec![0; 3 * (MAX_SIDE as usize + 1)]);
            let error = decode(&long).unwrap_err();
            assert!(matches!(error, QueryPngError::Large(..)) && !error.to_string().contains('\n'), "{error}");
        }
        assert!(decode(&rgb8((MAX_SIDE, 1), &vec![0; 3 * MAX_SIDE as usize])).is_ok());
    }
}
