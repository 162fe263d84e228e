//! What the labeling service has answered to a display: units that a text means, and the best views of a region.

use std::io::Cursor;
use std::sync::Arc;

use sg_proto::labeling::{FindReply, State, ViewsReply};
use sg_proto::scene::View;

/// Most views of an answer that are kept.
pub const REGION_VIEWS: usize = 4;

/// Largest width and height of a kept picture, pixels: the largest that the service draws.
const PICTURE_SIDE: u32 = 512;

/// Most bytes that the decoder of a picture may take for itself.
const DECODER_BYTES: usize = 4 << 20;

/// What the labeling service has told. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Labeling {
    /// State of the service; absent while it is away.
    pub state: Option<Arc<State>>,
    /// Units that a text means: the answer to the newest question.
    pub found: Option<Arc<Answer<FindReply>>>,
    /// The best views of a region: the answer to the newest question.
    pub views: Option<Arc<Answer<RegionViews>>>,
}

/// An answer to a numbered question.
#[derive(Debug)]
pub struct Answer<T> {
    /// The number of the question. A later question has a greater one.
    pub number: u64,
    /// The answer, or the reason why there is none, for a person.
    pub result: Result<T, String>,
}

impl Labeling {
    /// Takes the units that a text means, unless a later question has its answer already.
    pub fn take_found(&mut self, answer: Answer<FindReply>) {
        take_newer(&mut self.found, answer);
    }

    /// Takes the views of a region, unless a later question has its answer already.
    pub fn take_views(&mut self, answer: Answer<RegionViews>) {
        take_newer(&mut self.views, answer);
    }

    /// The greatest number of an answered question; 0 without one.
    #[must_use]
    pub fn newest_number(&self) -> u64 {
        let found = self.found.as_ref().map_or(0, |answer| answer.number);
        self.views.as_ref().map_or(0, |answer| answer.number).max(found)
    }
}

fn take_newer<T>(kept: &mut Option<Arc<Answer<T>>>, answer: Answer<T>) {
    if kept.as_ref().is_none_or(|older| older.number < answer.number) {
        *kept = Some(Arc::new(answer));
    }
}

/// The best views of a region, the best first, with decoded pictures.
#[derive(Debug)]
pub struct RegionViews {
    /// At most [`REGION_VIEWS`] views.
    pub views: Vec<PicturedView>,
}

/// A view of a region with its picture.
#[derive(Debug)]
pub struct PicturedView {
    /// The view.
    pub view: Option<View>,
    /// Normalized entropy of the picture's opacity, 0 to 1.
    pub entropy: f64,
    /// Share of the opacity that nothing else in the scene hides, 0 to 1.
    pub unhidden: f64,
    /// The picture of the region alone.
    pub picture: Result<Picture, PictureError>,
}

impl RegionViews {
    /// Decodes the pictures of a reply. It takes about a millisecond; a loop that draws leaves it to another thread.
    #[must_use]
    pub fn of(reply: &ViewsReply) -> Self {
        let views = reply.views.iter().take(REGION_VIEWS).map(|seen| PicturedView {
            view: seen.view,
            entropy: seen.entropy,
            unhidden: seen.unhidden,
            picture: Picture::decode(&seen.picture),
        });
        Self { views: views.collect() }
    }
}

/// A small picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Bytes of RGBA (sRGB, opacity not multiplied in), row by row from the top.
    pub rgba: Vec<u8>,
}

/// Reason why a picture cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// There are no bytes.
    #[error("the answer has no picture")]
    Missing,
    /// It is not a whole PNG file.
    #[error("the picture is no PNG file: {0}")]
    Png(#[from] png::DecodingError),
    /// Its side is too long.
    #[error("the picture has {0} × {1} pixels; at most {PICTURE_SIDE} × {PICTURE_SIDE} are shown")]
    Large(u32, u32),
    /// Its pixels are neither RGB nor RGBA with eight bits each.
    #[error("the picture has pixels of {0:?} with {1:?} bits; RGB and RGBA with 8 bits are shown")]
    Kind(png::ColorType, png::BitDepth),
}

impl Picture {
    /// Decodes a PNG file of at most 512 × 512 pixels, RGB or RGBA with eight bits each.
    ///
    /// # Errors
    /// Bytes that are no such file.
    pub fn decode(file: &[u8]) -> Result<Self, PictureError> {
        if file.is_empty() {
            return Err(PictureError::Missing);
        }
        let limits = png::Limits { bytes: DECODER_BYTES };
        let mut reader = png::Decoder::new_with_limits(Cursor::new(file), limits).read_info()?;
        let (width, height) = (reader.info().width, reader.info().height);
        if width > PICTURE_SIDE || height > PICTURE_SIDE {
            return Err(PictureError::Large(width, height));
        }
        let (color, depth) = reader.output_color_type();
        let channels = match (color, depth) {
            (png::ColorType::Rgb, png::BitDepth::Eight) => 3,
            (png::ColorType::Rgba, png::BitDepth::Eight) => 4,
            _ => return Err(PictureError::Kind(color, depth)),
        };
        let size = [width as usize, height as usize];
        let mut bytes = vec![0; size[0] * size[1] * channels];
        reader.next_frame(&mut bytes)?;
        let rgba = if channels == 4 {
            bytes
        } else {
            bytes.chunks_exact(3).flat_map(|rgb| rgb.iter().copied().chain([u8::MAX])).collect()
        };
        Ok(Self { size, rgba })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png_of(width: u32, height: u32, color: png::ColorType, depth: png::BitDepth, bytes: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(bytes).unwrap();
        writer.finish().unwrap();
        file
    }

    #[test]
    fn pictures_are_decoded_and_others_are_refused() {
        let eight = png::BitDepth::Eight;
        let rgb = Picture::decode(&png_of(2, 1, png::ColorType::Rgb, eight, &[1, 2, 3, 4, 5, 6])).unwrap();
        assert_eq!(rgb, Picture { size: [2, 1], rgba: vec![1, 2, 3, 255, 4, 5, 6, 255] });
        let rgba = Picture::decode(&png_of(1, 2, png::ColorType::Rgba, eight, &[1, 2, 3, 4, 5, 6, 7, 8])).unwrap();
        assert_eq!(rgba, Picture { size: [1, 2], rgba: vec![1, 2, 3, 4, 5, 6, 7, 8] });

        assert!(matches!(Picture::decode(&[]), Err(PictureError::Missing)));
        let gray = png_of(2, 2, png::ColorType::Grayscale, eight, &[0; 4]);
        assert!(matches!(Picture::decode(&gray), Err(PictureError::Kind(png::ColorType::Grayscale, _))));
        let deep = png_of(1, 1, png::ColorType::Rgb, png::BitDepth::Sixteen, &[0; 6]);
        assert!(matches!(Picture::decode(&deep), Err(PictureError::Kind(_, png::BitDepth::Sixteen))));
        let wide = png_of(513, 1, png::ColorType::Rgb, eight, &[0; 3 * 513]);
        assert!(matches!(Picture::decode(&wide), Err(PictureError::Large(513, 1))));
        let whole = png_of(64, 64, png::ColorType::Rgb, eight, &[7; 3 * 64 * 64]);
        for end in 1..whole.len() / 2 {
            assert!(Picture::decode(&whole[..end]).is_err(), "cut after {end} bytes");
        }
        assert!(matches!(Picture::decode(b"no picture at all"), Err(PictureError::Png(_))));
    }

    #[test]
    fn an_answer_to_an_earlier_question_does_not_replace_a_later_one() {
        let mut labeling = Labeling::default();
        assert_eq!(labeling.newest_number(), 0);
        let answer = |number| Answer { number, result: Ok(FindReply { revision: number, ..FindReply::default() }) };
        labeling.take_found(answer(2));
        labeling.take_found(answer(1));
        assert_eq!(labeling.found.as_ref().unwrap().number, 2);
        labeling.take_found(Answer { number: 3, result: Err("the service did not answer in time".to_owned()) });
        assert!(labeling.found.as_ref().unwrap().result.is_err());
        labeling.take_views(Answer { number: 7, result: Ok(RegionViews { views: Vec::new() }) });
        assert_eq!(labeling.newest_number(), 7);
    }

    #[test]
    fn a_reply_keeps_at_most_four_views_and_says_which_pictures_are_missing() {
        let seen = sg_proto::labeling::RegionView { entropy: 0.5, ..Default::default() };
        let reply = ViewsReply { views: vec![seen; 9], ..ViewsReply::default() };
        let views = RegionViews::of(&reply).views;
        assert_eq!(views.len(), REGION_VIEWS);
        assert!(views.iter().all(|view| matches!(view.picture, Err(PictureError::Missing))));
    }
}
