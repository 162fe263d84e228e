//! Layers of a voice by the names of its modules.
//!
//! PyTorch's exporter folds weight norms and then gives the weights names such as `onnx::Conv_8168`. The node that uses a weight
//! keeps the module's name, such as `/flow/flows.0/enc/in_layers.0/Conv`. So weights are found through nodes, and the nodes also say
//! strides, dilations and padding.

use sg_layers::ModelError;

use crate::convolution::{Convolution, SeparableConvolution, Upsampling};
use crate::error::PiperError;
use crate::frames::{Frames, Norm};
use crate::onnx::{Graph, Node, StoredTensor};

/// Most components of a signal. Published voices have 768, and 1,536 for what distinguishes speakers.
const MAX_WIDTH: usize = 2048;
/// Most taps of a convolution.
const MAX_KERNEL: usize = 255;
/// Most steps between taps, and most outputs of an upsampling for each of its inputs.
const MAX_STEPS: usize = 1024;
/// Most weights of a layer. The largest one of a published voice has two million.
const MAX_WEIGHTS: usize = 1 << 23;
/// Most parts of one kind in a row, such as the layers of an encoder.
const MAX_PARTS: usize = 64;

/// The weights of a voice. Modules are named as in nodes: `/enc_p/encoder/attn_layers.0/conv_q`.
pub(crate) struct VoiceWeights<'a>(pub(crate) &'a Graph<'a>);

/// What a convolution has in the file.
struct Parts {
    shape: [usize; 3],
    weights: Vec<f32>,
    bias: Vec<f32>,
    stride: usize,
    dilation: usize,
    padding: [usize; 2],
}

impl VoiceWeights<'_> {
    /// A problem of a module, with the remedy.
    pub(crate) fn wrong(&self, module: &str, problem: impl Into<String>) -> PiperError {
        ModelError::config(self.0.path, module, problem).into()
    }

    /// Whether a node is there.
    pub(crate) fn has(&self, node: &str) -> bool {
        self.0.node(node).is_some()
    }

    /// Number of nodes in a row from index 0.
    pub(crate) fn count(&self, node: impl Fn(usize) -> String) -> Result<usize, PiperError> {
        let count = (0..=MAX_PARTS).take_while(|at| self.has(&node(*at))).count();
        if (1..=MAX_PARTS).contains(&count) {
            return Ok(count);
        }
        let problem = format!(
            "there are {count} such nodes, but a voice has 1 to {MAX_PARTS}; take a voice that Piper's own exporter made"
        );
        Err(self.wrong(&node(0), problem))
    }

    fn node(&self, name: &str) -> Result<&Node<'_>, PiperError> {
        let none = || self.wrong(name, "there is no such node; take a voice that Piper's own exporter made");
        self.0.node(name).ok_or_else(none)
    }

    fn tensor(&self, place: &str, name: &str) -> Result<&StoredTensor<'_>, PiperError> {
        let none = || self.wrong(place, "its weights are not in the file; take a voice that Piper's own exporter made");
        self.0.tensor(name).ok_or_else(none)
    }

    /// The shape and values of the tensor that is a node's input.
    fn input(&self, node: &str, at: usize) -> Result<(Vec<usize>, Vec<f32>), PiperError> {
        let name = self.node(node)?.inputs.get(at).copied().unwrap_or_default();
        let tensor = self.tensor(node, name)?;
        Ok((tensor.shape.clone(), self.0.values(node, tensor)?))
    }

    /// Where a node has a tensor as input.
    pub(crate) fn node_values(&self, node: &str, length: usize) -> Result<Vec<f32>, PiperError> {
        let inputs = &self.node(node)?.inputs;
        let at = inputs.iter().position(|name| self.0.tensor(name).is_some()).unwrap_or(inputs.len());
        let (shape, values) = self.input(node, at)?;
        if values.len() == length {
            Ok(values)
        } else {
            Err(self.other_shape(node, &shape, &format!("{length} values")))
        }
    }

    fn other_shape(&self, place: &str, found: &[usize], expected: &str) -> PiperError {
        self.wrong(
            place,
            format!("its weights have shape {found:?}, but the voice needs {expected}; get the voice again"),
        )
    }

    /// A tensor by its own name, of a known shape.
    pub(crate) fn named(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, PiperError> {
        let tensor = self.tensor(name, name)?;
        if tensor.shape != shape {
            return Err(self.other_shape(name, &tensor.shape, &format!("{shape:?}")));
        }
        Ok(self.0.values(name, tensor)?)
    }

    /// Whether a tensor is there.
    pub(crate) fn has_tensor(&self, name: &str) -> bool {
        self.0.tensor(name).is_some()
    }

    /// The shape of a tensor by its own name.
    pub(crate) fn shape<const N: usize>(&self, name: &str) -> Result<[usize; N], PiperError> {
        let found = &self.tensor(name, name)?.shape;
        let shape = <[usize; N]>::try_from(found.as_slice());
        let shape = shape.ok().filter(|shape| shape.iter().all(|size| (1..=MAX_WIDTH).contains(size)));
        shape.ok_or_else(|| self.other_shape(name, found, &format!("{N} dimensions of 1 to {MAX_WIDTH}")))
    }

    /// A table of which a node takes rows.
    pub(crate) fn table(&self, node: &str) -> Result<Frames, PiperError> {
        let (shape, values) = self.input(node, 0)?;
        match shape[..] {
            [rows, width] if rows > 0 && (1..=MAX_WIDTH).contains(&width) => Ok(Frames { width, values }),
            _ => Err(self.other_shape(node, &shape, "rows × width")),
        }
    }

    pub(crate) fn norm(&self, module: &str, width: usize) -> Result<Norm, PiperError> {
        let name = module.trim_start_matches('/').replace('/', ".");
        let values = |part: &str| self.named(&format!("{name}.{part}"), &[width]);
        Ok(Norm { scale: values("gamma")?, shift: values("beta")? })
    }

    fn parts(&self, node_name: &str, outputs_at: usize) -> Result<Parts, PiperError> {
        let node = self.node(node_name)?;
        let (shape, weights) = self.input(node_name, 1)?;
        let Ok(shape) = <[usize; 3]>::try_from(shape.as_slice()) else {
            return Err(self.other_shape(node_name, &shape, "3 dimensions"));
        };
        if shape.iter().any(|size| !(1..=MAX_WIDTH).contains(size)) || shape[2] > MAX_KERNEL {
            return Err(self.other_shape(
                node_name,
                &shape,
                &format!("widths to {MAX_WIDTH} and kernels to {MAX_KERNEL}"),
            ));
        }
        if weights.len() > MAX_WEIGHTS {
            return Err(self.other_shape(node_name, &shape, &format!("at most {MAX_WEIGHTS} weights in a layer")));
        }
        let bias = if node.inputs.len() > 2 { self.input(node_name, 2)?.1 } else { vec![0.0; shape[outputs_at]] };
        if bias.len() != shape[outputs_at] {
            let (found, outputs) = (bias.len(), shape[outputs_at]);
            return Err(
                self.wrong(node_name, format!("it has {found} biases for {outputs} outputs; get the voice again"))
            );
        }
        let number = |attribute: &str, at: usize, otherwise: usize| {
            let found = node.numbers(attribute).get(at).copied();
            let number = found.map_or(Some(otherwise), |number| usize::try_from(number).ok());
            let out_of_bounds =
                || self.wrong(node_name, format!("`{attribute}` is out of bounds; get the voice again"));
            number.filter(|number| *number <= MAX_STEPS).ok_or_else(out_of_bounds)
        };
        let padding = [number("pads", 0, 0)?, number("pads", 1, 0)?];
        let (stride, dilation) = (number("strides", 0, 1)?.max(1), number("dilations", 0, 1)?.max(1));
        Ok(Parts { shape, weights, bias, stride, dilation, padding })
    }

    /// A convolution whose output is as long as its input.
    pub(crate) fn convolution(&self, module: &str, inputs: usize) -> Result<Convolution, PiperError> {
        let node = format!("{module}/Conv");
        let parts = self.parts(&node, 0)?;
        if parts.shape[1] != inputs || parts.stride != 1 {
            return Err(self.other_shape(
                &node,
                &parts.shape,
                &format!("outputs × {inputs} × kernel, and a stride of 1"),
            ));
        }
        let padding = self.even_padding(&node, &parts)?;
        Convolution::new(parts.shape, &parts.weights, parts.bias, parts.dilation, padding)
    }

    /// The padding that makes the output as long as the input.
    fn even_padding(&self, node: &str, parts: &Parts) -> Result<[usize; 2], PiperError> {
        let all = parts.dilation * (parts.shape[2] - 1);
        let even = [all / 2, all - all / 2];
        // Some are padded by a node of their own, as much as the others by theirs.
        if parts.padding == even || parts.padding == [0, 0] {
            return Ok(even);
        }
        let problem = format!("it is padded by {:?}, but a voice needs {even:?}; get the voice again", parts.padding);
        Err(self.wrong(node, problem))
    }

    /// As [`Self::convolution`], with a known number of outputs.
    pub(crate) fn convolution_to(
        &self,
        module: &str,
        inputs: usize,
        outputs: usize,
    ) -> Result<Convolution, PiperError> {
        let found = self.convolution(module, inputs)?;
        if found.outputs == outputs {
            return Ok(found);
        }
        let problem = format!("it has {} outputs, but the voice needs {outputs}; get the voice again", found.outputs);
        Err(self.wrong(module, problem))
    }

    /// The layer of a voice with several speakers that adds what distinguishes them.
    pub(crate) fn of_speaker(
        &self,
        module: &str,
        speaker_width: Option<usize>,
        outputs: usize,
    ) -> Result<Option<Convolution>, PiperError> {
        speaker_width.map(|width| self.convolution_to(module, width, outputs)).transpose()
    }

    /// A convolution of each of `width` components alone.
    pub(crate) fn separable(&self, module: &str, width: usize) -> Result<SeparableConvolution, PiperError> {
        let node = format!("{module}/Conv");
        let parts = self.parts(&node, 0)?;
        if parts.shape[..2] != [width, 1] || parts.stride != 1 {
            return Err(self.other_shape(&node, &parts.shape, &format!("{width} × 1 × kernel, and a stride of 1")));
        }
        self.even_padding(&node, &parts)?;
        Ok(SeparableConvolution::new([width, parts.shape[2]], &parts.weights, parts.bias, parts.dilation))
    }

    /// A transposed convolution.
    pub(crate) fn upsampling(&self, module: &str, inputs: usize) -> Result<Upsampling, PiperError> {
        let node = format!("{module}/ConvTranspose");
        let parts = self.parts(&node, 1)?;
        let [before, behind] = parts.padding;
        let fits = parts.shape[2] == parts.stride + 2 * before && before == behind && parts.dilation == 1;
        if parts.shape[0] != inputs || !fits {
            let expected = format!("{inputs} × outputs × kernel, the kernel a stride and twice a padding");
            return Err(self.other_shape(&node, &parts.shape, &expected));
        }
        Upsampling::new(parts.shape, &parts.weights, &parts.bias, parts.stride, before)
    }
}
