//! A picture as a query: which units look most like it.

use sg_encoders::RgbImage;
use sg_labeling::query::{Outcome, like_picture};
use sg_runtime::fault::Fault;
use supergaussian_labeling::query_png::{self, QueryPngError};

use crate::picture_encoder::PictureError;
use crate::unit_embeddings::UnitEmbeddings;

/// Why a picture was not compared.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PictureQueryError {
    /// There is no model that could compare it.
    #[error(
        "a picture needs an image encoder; set the parameter `image_encoder` of the service `labeling` in the launch file to the \
         folder of a model"
    )]
    NoEncoder,
    /// The file holds no picture that can be taken.
    #[error(transparent)]
    File(#[from] QueryPngError),
    /// The model could not encode it.
    #[error("the picture could not be encoded: {0}")]
    Encoder(#[from] PictureError),
}

impl From<PictureQueryError> for Fault {
    fn from(error: PictureQueryError) -> Self {
        match &error {
            PictureQueryError::NoEncoder => Self::precondition(error.to_string()),
            PictureQueryError::Encoder(_) => Self::internal(error.to_string()),
            PictureQueryError::File(_) => Self::invalid(error.to_string()),
        }
    }
}

/// The units whose pictures are most like the picture of a PNG file.
///
/// # Errors
/// [`PictureQueryError`].
pub(crate) fn find(
    file: &[u8],
    units: &[String],
    embeddings: Option<&UnitEmbeddings>,
) -> Result<Outcome, PictureQueryError> {
    let embeddings = embeddings.ok_or(PictureQueryError::NoEncoder)?;
    Ok(compare(&query_png::decode(file)?, units, embeddings)?)
}

/// The units whose pictures are most like a picture.
///
/// # Errors
/// [`PictureError`] for weights that give no direction.
pub(crate) fn compare(
    picture: &RgbImage,
    units: &[String],
    embeddings: &UnitEmbeddings,
) -> Result<Outcome, PictureError> {
    let encoder = embeddings.encoder();
    let embedding = encoder.encode_picture(picture)?;
    Ok(like_picture(&embeddings.picture_cosines(units, &embedding), encoder.name()))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sg_edit::{EditState, PlacedScene, UnitRef};
    use sg_encoders::Pixels;
    use sg_labeling::query::Ranked;
    use sg_proto::bus::Code;
    use sg_scene::synthetic::test_scene;
    use supergaussian_labeling::query_png::decode;

    use super::*;
    use crate::embedder::{Prepared, prepare};
    use crate::picture_encoder::PictureEncoder;
    use crate::unit_embeddings::FusionChoice;

    fn png_file((width, height): (u32, u32), color: png::ColorType, depth: png::BitDepth, pixels: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(pixels).unwrap();
        writer.finish().unwrap();
        file
    }

    fn rgb8(size: (u32, u32), pixels: &[u8]) -> Vec<u8> {
        png_file(size, png::ColorType::Rgb, png::BitDepth::Eight, pixels)
    }

    fn bytes(picture: &RgbImage) -> Vec<u8> {
        let Pixels::Bytes(bytes) = picture.pixels() else { panic!("no bytes") };
        bytes.clone()
    }

    #[test]
    fn a_grey_picture_of_16_bits_equals_its_twin() {
        let levels: Vec<u8> = (0..64).map(|i| (4 * i) as u8).collect();
        let deep: Vec<u8> = levels.iter().flat_map(|level| [*level; 2]).collect();
        let twin: Vec<u8> = levels.iter().flat_map(|level| [*level; 3]).collect();
        let deep = png_file((8, 8), png::ColorType::Grayscale, png::BitDepth::Sixteen, &deep);
        let (deep, twin) = (decode(&deep).unwrap(), decode(&rgb8((8, 8), &twin)).unwrap());
        assert_eq!((deep.width(), deep.height(), bytes(&deep)), (8, 8, bytes(&twin)));
        let encoder = PictureEncoder::tiny(1);
        assert_eq!(encoder.encode_picture(&deep).unwrap(), encoder.encode_picture(&twin).unwrap());
    }

    #[test]
    fn faults_say_whose_mistake_it_is() {
        let units = ["bone".to_owned()];
        let file = rgb8((2, 2), &[9; 12]);
        let missing = Fault::from(find(&file, &units, None).unwrap_err());
        assert_eq!(missing.code, Code::FailedPrecondition);
        assert!(missing.message.contains("`image_encoder`"), "{missing}");
        let embeddings = UnitEmbeddings::new(PictureEncoder::tiny(1), FusionChoice::Normalized, false).unwrap();
        let damaged = Fault::from(find(&file[..30], &units, Some(&embeddings)).unwrap_err());
        assert_eq!(damaged.code, Code::InvalidArgument);
        let Outcome::NothingMatches { why, .. } = find(&file, &units, Some(&embeddings)).unwrap() else {
            panic!("an answer without embeddings")
        };
        assert_eq!(why.to_string(), "the pictures of the units are not embedded yet");
    }

    #[test]
    fn a_picture_of_a_unit_finds_that_unit_first() {
        let mut scene = test_scene(&[("bone", 300), ("skin", 200), ("vein", 90)]);
        for (unit, color) in scene.units.iter_mut().zip([Vec3::new(0.9, 0.1, 0.1), Vec3::new(0.1, 0.8, 0.1), Vec3::Z]) {
            unit.palette = color;
        }
        let state = EditState::of_scene(&scene, "", "");
        let names: Vec<String> = scene.units.iter().map(|unit| unit.name.clone()).collect();
        let placed = PlacedScene::new(scene.into());
        // By the name alone, so that what is compared can't be the fused embedding.
        let embeddings = UnitEmbeddings::new(PictureEncoder::tiny(1), FusionChoice::Name, false).unwrap();
        let encoder = embeddings.encoder();
        let mut files = Vec::new();
        for (at, name) in names.iter().enumerate() {
            let Prepared { alone, edge, key } =
                prepare(&placed, &state, &state.members(UnitRef::Base(at)), encoder).unwrap();
            let made = encoder.encode_region(alone.clone(), edge, &|| Ok(())).unwrap();
            embeddings.add(name, key, &made.embedding).unwrap();
            let mut file = Vec::new();
            encoder.best_picture(alone, edge).write_png(&mut file).unwrap();
            files.push(file);
        }
        for (at, file) in files.iter().enumerate() {
            let Outcome::Ambiguous { candidates } = find(file, &names, Some(&embeddings)).unwrap() else {
                panic!("no question for {}", names[at])
            };
            let [first, rest @ ..] = candidates.as_slice() else { panic!("{candidates:?}") };
            assert!(first.item == at && first.score > 1.0 - 1e-6, "{}: {candidates:?}", names[at]);
            assert!(rest.len() == 2 && rest.iter().all(|r| r.score < first.score), "{candidates:?}");
            assert_eq!(first.explanation(), "pictures: alike by clip-gelu (cosine 1.00)");
            assert!(candidates.iter().all(Ranked::is_inferred));
        }
    }
}
