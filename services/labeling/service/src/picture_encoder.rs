//! Embeddings of pictures of a region, and of texts, by an image-text model such as CLIP.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Deserialize;
use sg_encoders::{Embedding, EncoderError, ImageTextEncoder, ImageTextModel, Pixels, RgbImage};
use sg_encoders::{EmbeddingError, OnnxImageTextModel, OnnxRuntime, Precision};
use sg_input::file;
use sg_labeling::frame::Frame;
use sg_raster::image::Image;
use sg_raster::render::{Quality, render};
use sg_scene::model::Scene;

use crate::label_encoder::threads;
use crate::region_views::{ChoicePictures, MeasuredViews, RegionViewsError, ViewOrder};

/// The pictures by which views are chosen.
const CHOICE: ChoicePictures = ChoicePictures { pixels: 64, quality: Quality::Fast, gaussians: 4096 };
/// Side of the pictures that are encoded. The model makes them as large as it needs them; usual models take 224 or more.
const PICTURE_PIXELS: u32 = 256;
/// Files of a model that its embeddings depend on, those that are there.
const MODEL_FILES: [&str; 6] = [
    "config.json",
    "open_clip_config.json",
    "preprocessor_config.json",
    "tokenizer.json",
    "model.safetensors",
    "open_clip_model.safetensors",
];
/// Files of a model that is run by ONNX Runtime, beside those: graphs, and weights by the usual names.
const GRAPH_FILES: [&str; 6] = [
    "onnx/vision_model.onnx",
    "onnx/vision_model.onnx_data",
    "onnx/vision_model.onnx.data",
    "onnx/text_model.onnx",
    "onnx/text_model.onnx_data",
    "onnx/text_model.onnx.data",
];
/// First bytes of what a stored embedding is named by. Another version makes other embeddings of the same region.
const METHOD: &[u8] = b"supergaussian picture embedding 1";
/// Words before a label, as captions have them (Radford et al. 2021, section 3.1.4).
const CAPTION: &str = "a picture of";

/// Which image encoder is used.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(from = "String")]
pub(crate) enum ImageEncoderChoice {
    /// None.
    #[default]
    None,
    /// A model in a folder.
    Folder(PathBuf),
}

impl From<String> for ImageEncoderChoice {
    fn from(text: String) -> Self {
        if text == "none" { Self::None } else { Self::Folder(PathBuf::from(text)) }
    }
}

/// Why a region has no embedding.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PictureError {
    /// Its pictures could not be drawn.
    #[error(transparent)]
    Views(#[from] RegionViewsError),
    /// They could not be encoded, or the model could not be read.
    #[error(transparent)]
    Encoder(#[from] EncoderError),
    /// A file of the model could not be read.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// ONNX Runtime was asked for weights that its graphs do not have.
    #[error(
        "`image_precision` is not f32, but ONNX Runtime (`onnxruntime`) runs graphs in f32; leave one of the two out"
    )]
    Precision,
    /// The embeddings have no mean.
    #[error("the mean of the pictures: {0}")]
    Mean(#[from] EmbeddingError),
}

/// A model with the name of what it makes.
pub(crate) struct PictureEncoder {
    model: Box<dyn ImageTextEncoder>,
    /// For a person: the folder's last part.
    name: String,
    /// Hash of the model and of how regions are drawn.
    method: blake3::Hash,
    views: usize,
}

/// The embedding of a region's pictures.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RegionEmbedding {
    pub(crate) embedding: Embedding,
    /// Number of pictures in it.
    pub(crate) views: usize,
    pub(crate) render_ms: f64,
    pub(crate) encode_ms: f64,
}

impl PictureEncoder {
    /// The model of a folder, for embeddings of `views` pictures each.
    ///
    /// # Errors
    /// [`PictureError`] for a folder that has no readable model.
    pub(crate) fn open(folder: &Path, precision: Precision, views: usize) -> Result<Self, PictureError> {
        let model = Box::new(ImageTextModel::open(folder, precision)?);
        let method = method(folder, precision, views, None)?;
        Ok(Self { model, name: name_of(folder), method, views })
    }

    /// The model of a folder, run by the ONNX Runtime of a file.
    ///
    /// # Errors
    /// [`PictureError`] for a folder that has no readable graphs, or a file that is not this library.
    pub(crate) fn open_graphs(folder: &Path, library: &Path, views: usize) -> Result<Self, PictureError> {
        let runtime = OnnxRuntime::load(library)?;
        let model = Box::new(OnnxImageTextModel::open(folder, &runtime, threads())?);
        let method = method(folder, Precision::F32, views, Some(&runtime))?;
        Ok(Self { model, name: name_of(folder), method, views })
    }

    /// The name of the model, for a person.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The name under which the embedding of a region is stored: BLAKE3 over its Gaussians with their looks, the model, and how
    /// regions are drawn.
    pub(crate) fn key(&self, alone: &Scene) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.method.as_bytes());
        hasher.update(alone.content_hash().as_bytes());
        for unit in &alone.units {
            // The content of a scene is its Gaussians. Edits also change these.
            let look = (unit.palette.to_array(), unit.opacity, unit.shading);
            hasher.update(format!("{look:?}").as_bytes());
        }
        hasher.finalize()
    }

    /// The mean embedding of the best views of a region, each of the same weight. Light and background are the usual ones, so
    /// that those of the scene change nothing. `between` is called before each picture, and may end the work.
    ///
    /// # Errors
    /// [`PictureError`].
    pub(crate) fn encode_region(
        &self,
        alone: Scene,
        edge: f64,
        between: &dyn Fn() -> Result<(), RegionViewsError>,
    ) -> Result<RegionEmbedding, PictureError> {
        let start = Instant::now();
        let measured = measure_views(alone, edge, between)?;
        self.encode_views(&measured, ViewOrder::default(), start, between)
    }

    /// As [`PictureEncoder::encode_region`], one embedding for each of some orders of the views, which are measured once. The time
    /// of measuring counts for each. [`PictureEncoder::key`] names the embedding of the usual order alone.
    ///
    /// # Errors
    /// [`PictureError`].
    pub(crate) fn encode_region_by(
        &self,
        orders: &[ViewOrder],
        alone: Scene,
        edge: f64,
    ) -> Result<Vec<RegionEmbedding>, PictureError> {
        let start = Instant::now();
        let measured = measure_views(alone, edge, &|| Ok(()))?;
        let measuring = start.elapsed();
        let of_order = |order: &ViewOrder| {
            let begun = Instant::now().checked_sub(measuring).unwrap_or(start);
            self.encode_views(&measured, *order, begun, &|| Ok(()))
        };
        orders.iter().map(of_order).collect()
    }

    /// The mean embedding of the views that are best by an order. Drawing began at `start`.
    fn encode_views(
        &self,
        measured: &MeasuredViews,
        order: ViewOrder,
        start: Instant,
        between: &dyn Fn() -> Result<(), RegionViewsError>,
    ) -> Result<RegionEmbedding, PictureError> {
        let mut pictures = Vec::with_capacity(self.views);
        for image in self.draw(measured, order, between)? {
            let (width, height) = (image.width as usize, image.height as usize);
            pictures.push(RgbImage::new(width, height, Pixels::Bytes(image.rgb8()))?);
        }
        let drawn = start.elapsed();
        between()?;
        // All at once takes two thirds of the time of one by one.
        let embeddings = self.model.encode_images(&pictures)?;
        let embedding = mean(&embeddings)?;
        let encode_ms = (start.elapsed() - drawn).as_secs_f64() * 1e3;
        Ok(RegionEmbedding { embedding, views: embeddings.len(), render_ms: drawn.as_secs_f64() * 1e3, encode_ms })
    }

    /// The pictures of a region that are encoded, the best view first.
    fn draw(
        &self,
        measured: &MeasuredViews,
        order: ViewOrder,
        between: &dyn Fn() -> Result<(), RegionViewsError>,
    ) -> Result<Vec<Image>, RegionViewsError> {
        let mut pictures = Vec::with_capacity(self.views);
        for (view, _) in measured.best(order, self.views)? {
            between()?;
            let camera = view.camera(PICTURE_PIXELS, PICTURE_PIXELS);
            pictures.push(render(&measured.alone, &measured.look, &camera, Quality::Standard)?.image);
        }
        Ok(pictures)
    }

    /// The embedding of one picture of anything.
    ///
    /// # Errors
    /// [`PictureError`] for weights that give no direction.
    pub(crate) fn encode_picture(&self, picture: &RgbImage) -> Result<Embedding, PictureError> {
        let encoded = self.model.encode_images(std::slice::from_ref(picture))?.pop();
        encoded.ok_or(PictureError::Mean(EmbeddingError::Empty))
    }

    /// Embeddings of texts, as captions of pictures.
    ///
    /// # Errors
    /// [`EncoderError`].
    pub(crate) fn encode_texts(&self, texts: &[&str]) -> Result<Vec<Embedding>, EncoderError> {
        let captions: Vec<String> = texts.iter().map(|text| format!("{CAPTION} {text}")).collect();
        self.model.encode_texts(&captions.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// The share of one text among several for a picture. `cosine` is the picture's cosine with that text, and `others` are its
    /// cosines with the other texts. Models with a sigmoid give their own probability, the others their softmax.
    pub(crate) fn share(&self, cosine: f32, others: &[f32]) -> f64 {
        let own = f64::from(self.model.logit(cosine));
        if self.model.layout() == sg_encoders::Layout::SigLip {
            return 1.0 / (1.0 + (-own).exp());
        }
        let sum: f64 = others.iter().map(|other| (f64::from(self.model.logit(*other)) - own).exp()).sum();
        1.0 / (1.0 + sum)
    }

    /// The best picture of a region.
    #[cfg(test)]
    pub(crate) fn best_picture(&self, alone: Scene, edge: f64) -> Image {
        let measured = measure_views(alone, edge, &|| Ok(())).unwrap();
        self.draw(&measured, ViewOrder::default(), &|| Ok(())).unwrap().remove(0)
    }

    /// A model with tiny random weights.
    #[cfg(test)]
    pub(crate) fn tiny(views: usize) -> Self {
        Self::open(&fixture("clip-gelu"), Precision::F32, views).unwrap()
    }

    /// Opens a model with random weights: for measurements of time.
    #[cfg(test)]
    pub(crate) fn random(folder: &Path, views: usize) -> Self {
        let model = Box::new(ImageTextModel::with_random_weights(folder, Precision::F32, 1).unwrap());
        Self { model, name: name_of(folder), method: method(folder, Precision::F32, views, None).unwrap(), views }
    }
}

/// The views around a region, measured as their choice needs it.
fn measure_views(
    alone: Scene,
    edge: f64,
    between: &dyn Fn() -> Result<(), RegionViewsError>,
) -> Result<MeasuredViews, RegionViewsError> {
    MeasuredViews::of(alone, (edge, &Frame::XYZ), CHOICE, between)
}

/// The folder of a model that the tests of the encoders use.
#[cfg(test)]
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../encoders/tests/fixtures").join(name)
}

fn name_of(folder: &Path) -> String {
    folder.file_name().map_or_else(|| folder.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// Hash of a model's files, of what runs it and of how regions are drawn.
fn method(
    folder: &Path,
    precision: Precision,
    views: usize,
    runtime: Option<&OnnxRuntime>,
) -> Result<blake3::Hash, PictureError> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(METHOD);
    hasher.update(format!("{precision:?} {views} {CHOICE:?} {PICTURE_PIXELS} {CAPTION}").as_bytes());
    if let Some(runtime) = runtime {
        hasher.update(format!("ONNX Runtime {}", runtime.version()).as_bytes());
    }
    let graphs: &[&str] = if runtime.is_some() { &GRAPH_FILES } else { &[] };
    for name in MODEL_FILES.iter().chain(graphs) {
        let path = folder.join(name);
        // A model has some of these files; opening it has read those that it needs.
        let Ok(opened) = file::open(&path) else { continue };
        hasher.update(name.as_bytes());
        hasher.update_reader(opened.file).map_err(|source| PictureError::File { path, source })?;
    }
    Ok(hasher.finalize())
}

/// The mean of unit vectors, as an embedding.
fn mean(embeddings: &[Embedding]) -> Result<Embedding, EmbeddingError> {
    let dimension = embeddings.first().map_or(0, Embedding::dimension);
    let sum = |at: usize| embeddings.iter().filter_map(|e| e.unit().get(at)).map(|x| f64::from(*x)).sum::<f64>();
    let count = embeddings.len().max(1) as f64;
    Embedding::new(&(0..dimension).map(|at| (sum(at) / count) as f32).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::print_stdout, reason = "a test tells what it measured")]

    use std::cell::Cell;

    use glam::Vec3;
    use sg_scene::synthetic::test_scene;

    use super::*;

    fn encode(encoder: &PictureEncoder, scene: &Scene) -> RegionEmbedding {
        encoder.encode_region(scene.clone(), scene.bounds.longest_edge(), &|| Ok(())).unwrap()
    }

    #[test]
    fn the_same_region_has_the_same_embedding_and_name() {
        let (encoder, scene) = (PictureEncoder::tiny(3), test_scene(&[("bone", 300)]));
        let (first, again) = (encode(&encoder, &scene), encode(&encoder, &scene));
        assert_eq!((first.views, &first.embedding), (3, &again.embedding));
        assert_eq!(encoder.key(&scene), encoder.key(&scene.clone()));
        // What changes the pictures changes the name: colour, opacity, place, model, number of views.
        let mut changed = [scene.clone(), scene.clone(), scene.clone()];
        changed[0].units[0].palette = Vec3::new(0.9, 0.1, 0.1);
        changed[1].units[0].opacity = 0.5;
        changed[2].units[0].gaussians.position[0] += Vec3::X;
        let mut names: Vec<blake3::Hash> = changed.iter().map(|scene| encoder.key(scene)).collect();
        names.push(encoder.key(&scene));
        names.push(PictureEncoder::tiny(4).key(&scene));
        let other = PictureEncoder::open(&fixture("clip-quick-gelu"), Precision::F32, 3).unwrap();
        names.push(other.key(&scene));
        let distinct: std::collections::HashSet<&[u8; 32]> = names.iter().map(blake3::Hash::as_bytes).collect();
        assert_eq!(distinct.len(), names.len());
        let mut renamed = scene.clone();
        renamed.units[0].name = "femur".into();
        assert_eq!(encoder.key(&renamed), encoder.key(&scene), "a name is not seen");
        let red = encode(&encoder, &changed[0]);
        assert!(red.embedding.cosine(&first.embedding).unwrap() < 1.0 - 1e-6);
    }

    #[test]
    fn a_change_of_the_region_ends_the_work() {
        let (encoder, scene) = (PictureEncoder::tiny(2), test_scene(&[("bone", 300)]));
        let pictures = Cell::new(0);
        let edge = scene.bounds.longest_edge();
        let whole = encoder.encode_region(scene.clone(), edge, &|| {
            pictures.set(pictures.get() + 1);
            Ok(())
        });
        assert!(whole.is_ok());
        for last in [0, 5, pictures.get() - 1] {
            let drawn = Cell::new(0);
            let ended = encoder.encode_region(scene.clone(), edge, &|| {
                drawn.set(drawn.get() + 1);
                if drawn.get() > last { Err(RegionViewsError::Superseded) } else { Ok(()) }
            });
            assert!(matches!(ended, Err(PictureError::Views(RegionViewsError::Superseded))), "{last}");
        }
    }

    #[test]
    fn shares_are_probabilities_among_texts() {
        let encoder = PictureEncoder::tiny(1);
        assert!((encoder.share(0.3, &[0.3]) - 0.5).abs() < 1e-9 && encoder.share(0.3, &[]) == 1.0);
        assert!(encoder.share(0.4, &[0.3, 0.2]) > encoder.share(0.3, &[0.3, 0.2]));
        let siglip = PictureEncoder::open(&fixture("siglip"), Precision::F32, 1).unwrap();
        // Others do not matter to a sigmoid.
        assert_eq!(siglip.share(0.1, &[0.9]), siglip.share(0.1, &[]));
        let missing = PictureEncoder::open(Path::new("/nowhere"), Precision::F32, 1).err().unwrap();
        assert!(missing.to_string().contains("/nowhere"), "{missing}");
    }

    #[test]
    #[ignore = "a measurement for docs/labeling.md"]
    fn embeddings_of_large_regions() {
        // The configuration of openai/clip-vit-base-patch32, with a tokenizer of few tokens.
        let encoder = PictureEncoder::random(&fixture("vit-b-32"), 5);
        for count in [100, 1000, 10_000, 100_000] {
            let scene = test_scene(&[("part", count)]);
            let mut best = encode(&encoder, &scene);
            for _ in 0..2 {
                let made = encode(&encoder, &scene);
                if made.render_ms + made.encode_ms < best.render_ms + best.encode_ms {
                    best = made;
                }
            }
            let start = Instant::now();
            let name = encoder.encode_texts(&["aneurysm sac"]).unwrap();
            let text_ms = start.elapsed().as_secs_f64() * 1e3;
            let start = Instant::now();
            sg_encoders::fuse(&best.embedding, &name[0], sg_encoders::Fusion::Normalised).unwrap();
            let fuse_ms = start.elapsed().as_secs_f64() * 1e3;
            let RegionEmbedding { views, render_ms, encode_ms, .. } = best;
            println!(
                "{count} Gaussians: {views} views, render {render_ms:.0} ms, encode {encode_ms:.0} ms, name {text_ms:.0} ms, \
                 fuse {fuse_ms:.3} ms"
            );
        }
    }
}
