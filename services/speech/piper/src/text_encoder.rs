//! The text encoder: a transformer with relative positions (Kim et al. 2021, section 2.1.2 and appendix B; Shaw et al. 2018).

use candle_core::{Device, Tensor};

use crate::convolution::Convolution;
use crate::error::PiperError;
use crate::frames::{Frames, Norm};
use crate::weights::VoiceWeights;

/// Most queries whose weights of attention are in memory at once.
const MAX_QUERIES: usize = 256;

/// The transformer over phonemes.
pub(crate) struct TextEncoder {
    /// Symbols × width.
    symbols: Frames,
    layers: Vec<Layer>,
    /// Mean and logarithm of the deviation of the prior, side by side.
    projection: Convolution,
}

struct Layer {
    attention: Attention,
    norms: [Norm; 2],
    feed_forward: [Convolution; 2],
}

struct Attention {
    query: Convolution,
    key: Convolution,
    value: Convolution,
    output: Convolution,
    head_width: usize,
    /// Furthest relative position that has an embedding.
    window: usize,
    /// (2 · window + 1) × head width.
    relative_keys: Frames,
    relative_values: Frames,
}

/// What the text gives to the rest of the voice. All have a row for each phoneme.
pub(crate) struct EncodedText {
    pub(crate) hidden: Frames,
    /// m of the prior N(m, σ²) (equation 4).
    pub(crate) means: Frames,
    /// log σ.
    pub(crate) log_deviations: Frames,
}

impl TextEncoder {
    pub(crate) fn read(weights: &VoiceWeights) -> Result<Self, PiperError> {
        let symbols = weights.table("/enc_p/emb/Gather")?;
        let width = symbols.width;
        let count = weights.count(|at| format!("/enc_p/encoder/attn_layers.{at}/conv_q/Conv"))?;
        let layers = (0..count).map(|at| Layer::read(weights, at, width)).collect::<Result<_, _>>()?;
        let projection = weights.convolution("/enc_p/proj", width)?;
        if !projection.outputs.is_multiple_of(2) {
            return Err(weights.wrong("/enc_p/proj", "its outputs are no pairs; get the voice again"));
        }
        Ok(Self { symbols, layers, projection })
    }

    /// Number of symbols that it knows.
    pub(crate) fn symbols(&self) -> usize {
        self.symbols.len()
    }

    /// Components of a phoneme.
    pub(crate) fn width(&self) -> usize {
        self.symbols.width
    }

    /// Components of the prior, which are those of the flow.
    pub(crate) fn prior_width(&self) -> usize {
        self.projection.outputs / 2
    }

    /// Encodes ids, each less than [`Self::symbols`].
    pub(crate) fn apply(
        &self,
        ids: &[u32],
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<EncodedText, PiperError> {
        let values: Vec<f32> = ids.iter().flat_map(|id| self.symbols.row(*id as usize)).copied().collect();
        let mut hidden = Frames { width: self.width(), values };
        let scale = (self.width() as f32).sqrt();
        hidden.each(|value| value * scale);
        for layer in &self.layers {
            hidden = layer.apply(&hidden, go_on)?;
        }
        let prior = self.projection.apply(&hidden)?;
        let half = self.prior_width();
        Ok(EncodedText { means: prior.components(0, half), log_deviations: prior.components(half, 2 * half), hidden })
    }
}

impl Layer {
    fn read(weights: &VoiceWeights, at: usize, width: usize) -> Result<Self, PiperError> {
        let norm = |kind: usize| weights.norm(&format!("/enc_p/encoder/norm_layers_{kind}.{at}"), width);
        let feed_forward = format!("/enc_p/encoder/ffn_layers.{at}");
        let first = weights.convolution(&format!("{feed_forward}/conv_1"), width)?;
        let second = weights.convolution_to(&format!("{feed_forward}/conv_2"), first.outputs, width)?;
        let attention = Attention::read(weights, &format!("/enc_p/encoder/attn_layers.{at}"), width)?;
        Ok(Self { attention, norms: [norm(1)?, norm(2)?], feed_forward: [first, second] })
    }

    fn apply(&self, hidden: &Frames, go_on: &dyn Fn() -> Result<(), PiperError>) -> Result<Frames, PiperError> {
        let mut sum = self.attention.apply(hidden, go_on)?;
        sum.add(hidden);
        self.norms[0].apply(&mut sum);
        let mut inner = self.feed_forward[0].apply(&sum)?;
        inner.rectify(0.0);
        self.feed_forward[1].add_to(&inner, &mut sum)?;
        self.norms[1].apply(&mut sum);
        Ok(sum)
    }
}

impl Attention {
    fn read(weights: &VoiceWeights, module: &str, width: usize) -> Result<Self, PiperError> {
        let name = module.trim_start_matches('/').replace('/', ".");
        let keys = format!("{name}.emb_rel_k");
        let [heads, positions, head_width] = weights.shape(&keys)?;
        if heads != 1 || positions.is_multiple_of(2) || !width.is_multiple_of(head_width) {
            let problem = format!(
                "its shape is [{heads}, {positions}, {head_width}]; one odd number of positions for all heads is supported"
            );
            return Err(weights.wrong(&keys, problem));
        }
        let relative = |part: &str| -> Result<Frames, PiperError> {
            let values = weights.named(&format!("{name}.{part}"), &[1, positions, head_width])?;
            Ok(Frames { width: head_width, values })
        };
        let layer = |part: &str| weights.convolution_to(&format!("{module}/{part}"), width, width);
        Ok(Self {
            query: layer("conv_q")?,
            key: layer("conv_k")?,
            value: layer("conv_v")?,
            output: layer("conv_o")?,
            head_width,
            window: positions / 2,
            relative_keys: relative("emb_rel_k")?,
            relative_values: relative("emb_rel_v")?,
        })
    }

    fn apply(&self, hidden: &Frames, go_on: &dyn Fn() -> Result<(), PiperError>) -> Result<Frames, PiperError> {
        let mut query = self.query.apply(hidden)?;
        let scale = (self.head_width as f32).sqrt().recip();
        query.each(|value| value * scale);
        let (key, value) = (self.key.apply(hidden)?, self.value.apply(hidden)?);
        let (length, width, of_head) = (hidden.len(), hidden.width, self.head_width);
        let mut attended = Frames::zeros(length, width);
        for head in (0..width).step_by(of_head) {
            let part = |frames: &Frames| frames.components(head, head + of_head);
            let tensor = |frames: Frames| Tensor::from_vec(frames.values, (length, of_head), &Device::Cpu);
            let queries = part(&query);
            let (keys, values) = (tensor(part(&key))?.t()?, tensor(part(&value))?);
            for first in (0..length).step_by(MAX_QUERIES) {
                go_on()?;
                let rows = queries.between(first, length.min(first + MAX_QUERIES));
                let found = self.attend(&rows, first, &keys, &values)?;
                for (row, found) in found.rows().enumerate() {
                    attended.values[(first + row) * width + head..][..of_head].copy_from_slice(found);
                }
            }
        }
        self.output.apply(&attended)
    }

    /// Attention of queries from step `first` on, in one head. Relative positions within the window have embeddings for keys and
    /// for values (Shaw et al. 2018, equations 3 and 4).
    fn attend(&self, queries: &Frames, first: usize, keys: &Tensor, values: &Tensor) -> Result<Frames, PiperError> {
        let (count, length) = (queries.len(), keys.dim(1)?);
        let rows = Tensor::from_slice(&queries.values, (count, self.head_width), &Device::Cpu)?;
        let mut scores = Frames { width: length, values: rows.matmul(keys)?.flatten_all()?.to_vec1()? };
        let near = |query: usize| {
            let from = (first + query).saturating_sub(self.window);
            (from..length.min(first + query + self.window + 1)).map(move |at| (at, at + self.window - first - query))
        };
        for (at, row) in scores.rows_mut().enumerate() {
            for (key, relative) in near(at) {
                let pairs = queries.row(at).iter().zip(self.relative_keys.row(relative));
                row[key] += pairs.map(|(a, b)| a * b).sum::<f32>();
            }
            let most = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            row.iter_mut().for_each(|score| *score = (*score - most).exp());
            let sum: f32 = row.iter().sum();
            row.iter_mut().for_each(|score| *score /= sum);
        }
        let weights = Tensor::from_slice(&scores.values, (count, length), &Device::Cpu)?;
        let mut sums = Frames { width: self.head_width, values: weights.matmul(values)?.flatten_all()?.to_vec1()? };
        for (at, sum) in sums.rows_mut().enumerate() {
            for (value, relative) in near(at) {
                let weight = scores.row(at)[value];
                let pairs = sum.iter_mut().zip(self.relative_values.row(relative));
                pairs.for_each(|(sum, value)| *sum += weight * value);
            }
        }
        Ok(sums)
    }
}
