//! Names of tensors in the two layouts of files, and the layers made from them.

use sg_layers::{
    Activation, Kind, LayerNorm, Linear, Matrix, ModelError, Perceptron, Precision, SelfAttention, Weights,
};

use crate::config::{EPSILON, StackSize};

/// A layout of weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    /// Hugging Face's transformers: `model.safetensors`.
    HuggingFace {
        /// What all names begin with.
        prefix: &'static str,
    },
    /// CTranslate2: `model.bin`.
    CTranslate2,
}

/// The two halves of a model.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    Encoder,
    Decoder,
}

impl Part {
    fn name(self) -> &'static str {
        match self {
            Self::Encoder => "encoder",
            Self::Decoder => "decoder",
        }
    }
}

/// Reads the layers of one model.
pub(crate) struct LayerReader {
    pub(crate) weights: Weights,
    pub(crate) layout: Layout,
    pub(crate) precision: Precision,
    /// Components of a frame or token.
    pub(crate) width: usize,
}

/// What a token of the decoder asks of the sound: queries, keys and values, and the layer behind the attention.
pub(crate) struct CrossAttention {
    pub(crate) query: Linear,
    /// Keys and values, in this order, by one multiplication.
    pub(crate) key_value: Linear,
    pub(crate) output: Linear,
}

impl LayerReader {
    fn name(&self, part: Part, hugging_face: &str, ctranslate2: &str) -> String {
        match self.layout {
            Layout::HuggingFace { prefix } => format!("{prefix}{}.{hugging_face}", part.name()),
            Layout::CTranslate2 => format!("{}/{ctranslate2}", part.name()),
        }
    }

    fn block_name(&self, part: Part, at: usize, hugging_face: &str, ctranslate2: &str) -> String {
        self.name(part, &format!("layers.{at}.{hugging_face}"), &format!("layer_{at}/{ctranslate2}"))
    }

    fn weight(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let separator = if self.layout == Layout::CTranslate2 { '/' } else { '.' };
        self.weights.values(&format!("{name}{separator}weight"), shape, Kind::Projection)
    }

    fn bias(&mut self, name: &str, outputs: usize) -> Result<Vec<f32>, ModelError> {
        let separator = if self.layout == Layout::CTranslate2 { '/' } else { '.' };
        self.weights.values(&format!("{name}{separator}bias"), &[outputs], Kind::Shift)
    }

    fn linear(&mut self, name: &str, [outputs, inputs]: [usize; 2]) -> Result<Linear, ModelError> {
        let values = self.weight(name, &[outputs, inputs])?;
        let bias = self.bias(name, outputs)?;
        Ok(Linear::new(Matrix::of_layer(values, outputs, inputs, self.precision)?, Some(bias)))
    }

    /// Layers of one input as one layer. Projections to keys have no bias of their own.
    fn stacked(&mut self, prefix: &str, projections: &[&str]) -> Result<Linear, ModelError> {
        let width = self.width;
        let (mut matrix, mut biases) = (Vec::new(), Vec::new());
        for projection in projections {
            let name = format!("{prefix}.{projection}");
            matrix.extend(self.weight(&name, &[width, width])?);
            biases.extend(if *projection == "k_proj" { vec![0.0; width] } else { self.bias(&name, width)? });
        }
        let outputs = projections.len() * width;
        Ok(Linear::new(Matrix::of_layer(matrix, outputs, width, self.precision)?, Some(biases)))
    }

    fn norm(&mut self, name: &str) -> Result<LayerNorm, ModelError> {
        if self.layout != Layout::CTranslate2 {
            return LayerNorm::read(&mut self.weights, name, self.width, EPSILON);
        }
        let scale = self.weights.values(&format!("{name}/gamma"), &[self.width], Kind::Scale)?;
        let shift = self.weights.values(&format!("{name}/beta"), &[self.width], Kind::Shift)?;
        LayerNorm::new(scale, shift, EPSILON)
    }

    /// The norm behind all blocks.
    pub(crate) fn last_norm(&mut self, part: Part) -> Result<LayerNorm, ModelError> {
        self.norm(&self.name(part, "layer_norm", "layer_norm"))
    }

    /// The norm before a block's attention to itself.
    pub(crate) fn self_attention_norm(&mut self, part: Part, at: usize) -> Result<LayerNorm, ModelError> {
        self.norm(&self.block_name(part, at, "self_attn_layer_norm", "self_attention/layer_norm"))
    }

    /// Queries, keys and values of a block's attention to itself, and the layer behind it.
    pub(crate) fn self_attention_layers(&mut self, part: Part, at: usize) -> Result<[Linear; 2], ModelError> {
        let width = self.width;
        let stacked = match self.layout {
            Layout::CTranslate2 => {
                self.linear(&self.block_name(part, at, "", "self_attention/linear_0"), [3 * width, width])?
            }
            Layout::HuggingFace { .. } => {
                self.stacked(&self.block_name(part, at, "self_attn", ""), &["q_proj", "k_proj", "v_proj"])?
            }
        };
        let output =
            self.linear(&self.block_name(part, at, "self_attn.out_proj", "self_attention/linear_1"), [width, width])?;
        Ok([stacked, output])
    }

    /// Attention of a block of the encoder.
    pub(crate) fn self_attention(&mut self, at: usize, size: StackSize) -> Result<SelfAttention, ModelError> {
        let [stacked, output] = self.self_attention_layers(Part::Encoder, at)?;
        Ok(SelfAttention::new(stacked, output, size.heads))
    }

    /// The norm before a block's attention to the sound, and that attention.
    pub(crate) fn cross_attention(&mut self, at: usize) -> Result<(LayerNorm, CrossAttention), ModelError> {
        let (part, width) = (Part::Decoder, self.width);
        let norm = self.norm(&self.block_name(part, at, "encoder_attn_layer_norm", "attention/layer_norm"))?;
        let query =
            self.linear(&self.block_name(part, at, "encoder_attn.q_proj", "attention/linear_0"), [width, width])?;
        let key_value = match self.layout {
            Layout::CTranslate2 => {
                self.linear(&self.block_name(part, at, "", "attention/linear_1"), [2 * width, width])?
            }
            Layout::HuggingFace { .. } => {
                self.stacked(&self.block_name(part, at, "encoder_attn", ""), &["k_proj", "v_proj"])?
            }
        };
        let output =
            self.linear(&self.block_name(part, at, "encoder_attn.out_proj", "attention/linear_2"), [width, width])?;
        Ok((norm, CrossAttention { query, key_value, output }))
    }

    /// The norm before a block's perceptron, and the perceptron.
    pub(crate) fn perceptron(
        &mut self,
        part: Part,
        at: usize,
        size: StackSize,
    ) -> Result<(LayerNorm, Perceptron), ModelError> {
        let norm = self.norm(&self.block_name(part, at, "final_layer_norm", "ffn/layer_norm"))?;
        let up = self.linear(&self.block_name(part, at, "fc1", "ffn/linear_0"), [size.inner, self.width])?;
        let down = self.linear(&self.block_name(part, at, "fc2", "ffn/linear_1"), [self.width, size.inner])?;
        Ok((norm, Perceptron::new(up, down, Activation::Gelu)))
    }

    /// A convolution over 3 neighbouring frames, as a layer of their inputs, the earliest frame's first.
    pub(crate) fn convolution(&mut self, name: &str, inputs: usize) -> Result<Linear, ModelError> {
        let (outputs, name) = (self.width, self.name(Part::Encoder, name, name));
        let kernel = self.weight(&name, &[outputs, inputs, 3])?;
        let bias = self.bias(&name, outputs)?;
        let row = 3 * inputs;
        // A file keeps the three places of an input beside each other.
        let place = |at: usize| at / row * row + at % inputs * 3 + at % row / inputs;
        let values = (0..kernel.len()).map(|at| kernel[place(at)]).collect();
        Ok(Linear::new(Matrix::of_layer(values, outputs, row, self.precision)?, Some(bias)))
    }

    /// What each place of a sequence adds, `rows` × width.
    pub(crate) fn positions(&mut self, part: Part, rows: usize) -> Result<Vec<f32>, ModelError> {
        let name = self.name(part, "embed_positions.weight", "position_encodings/encodings");
        self.weights.values(&name, &[rows, self.width], Kind::Table)
    }

    /// Vectors of tokens, by which the decoder's outputs are compared with tokens too.
    pub(crate) fn tokens(&mut self, vocabulary: usize) -> Result<Matrix, ModelError> {
        let name = self.name(Part::Decoder, "embed_tokens.weight", "embeddings/weight");
        let values = self.weights.values(&name, &[vocabulary, self.width], Kind::Table)?;
        Ok(Matrix::of_table(values, vocabulary, self.width, self.precision)?)
    }
}
