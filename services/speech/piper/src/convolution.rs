//! Convolutions over time as products of matrices.
//!
//! A signal is cut into blocks of steps that fit a core's cache. The inputs of each step of a block are laid side by side, and
//! one product of matrices gives the block's outputs. Cores share the blocks.
//!
//! A transposed convolution is a convolution too. Its outputs are all steps of a stride, side by side. These are already the steps in
//! their order.

use candle_core::{Device, Storage, Tensor};
use rayon::prelude::*;

use crate::error::PiperError;
use crate::frames::Frames;

/// Values of a block's inputs side by side: 1 MiB. Smaller blocks spend their time between products, larger ones leave the cache.
const BLOCK: usize = 1 << 18;

/// A convolution with a stride of one.
#[derive(Debug)]
pub(crate) struct Convolution {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) kernel: usize,
    pub(crate) dilation: usize,
    /// Zeros before and behind the signal.
    pub(crate) padding: [usize; 2],
    /// (kernel · inputs) × outputs.
    weights: Tensor,
    /// One for each output.
    bias: Vec<f32>,
}

impl Convolution {
    /// `weights` are outputs × inputs × kernel, as ONNX has them.
    pub(crate) fn new(
        [outputs, inputs, kernel]: [usize; 3],
        weights: &[f32],
        bias: Vec<f32>,
        dilation: usize,
        padding: [usize; 2],
    ) -> Result<Self, PiperError> {
        let mut columns = vec![0.0; weights.len()];
        for (output, weights) in weights.chunks_exact(inputs * kernel).enumerate() {
            for (input, weights) in weights.chunks_exact(kernel).enumerate() {
                for (tap, weight) in weights.iter().enumerate() {
                    columns[(tap * inputs + input) * outputs + output] = *weight;
                }
            }
        }
        let weights = Tensor::from_vec(columns, (kernel * inputs, outputs), &Device::Cpu)?;
        Ok(Self { inputs, outputs, kernel, dilation, padding, weights, bias })
    }

    /// Steps that an output looks to each side.
    pub(crate) fn reach(&self) -> usize {
        let all = self.dilation * (self.kernel - 1);
        self.padding[0].max(all.saturating_sub(self.padding[0]))
    }

    /// The convolution of a signal.
    pub(crate) fn apply(&self, signal: &Frames) -> Result<Frames, PiperError> {
        let reach = self.dilation * (self.kernel - 1);
        let length = (signal.len() + self.padding[0] + self.padding[1]).saturating_sub(reach);
        let mut outputs = Frames::zeros(length, self.outputs);
        self.run(signal, &mut outputs, false)?;
        Ok(outputs)
    }

    /// Adds the convolution of a signal to `sum`, which has its shape.
    pub(crate) fn add_to(&self, signal: &Frames, sum: &mut Frames) -> Result<(), PiperError> {
        self.run(signal, sum, true)
    }

    fn run(&self, signal: &Frames, outputs: &mut Frames, add: bool) -> Result<(), PiperError> {
        let columns = self.kernel * self.inputs;
        let rows = (BLOCK / columns).clamp(16, 4096);
        let blocks = outputs.values.par_chunks_mut(rows * self.outputs).enumerate();
        blocks.try_for_each(|(at, block)| {
            let steps = block.len() / self.outputs;
            let side_by_side =
                Tensor::from_vec(self.side_by_side(signal, at * rows, steps), (steps, columns), &Device::Cpu)?;
            let product = side_by_side.matmul(&self.weights)?;
            let (storage, _) = product.storage_and_layout();
            let Storage::Cpu(storage) = &*storage else { return Ok(()) };
            for (to, from) in
                block.chunks_exact_mut(self.outputs).zip(storage.as_slice::<f32>()?.chunks_exact(self.outputs))
            {
                let values = to.iter_mut().zip(from).zip(&self.bias);
                if add {
                    values.for_each(|((to, from), bias)| *to += from + bias);
                } else {
                    values.for_each(|((to, from), bias)| *to = from + bias);
                }
            }
            Ok(())
        })
    }

    /// The inputs of `steps` outputs from `first` on, side by side.
    fn side_by_side(&self, signal: &Frames, first: usize, steps: usize) -> Vec<f32> {
        let length = signal.len();
        let mut all = Vec::with_capacity(steps * self.kernel * self.inputs);
        for step in first..first + steps {
            for tap in 0..self.kernel {
                match (step + tap * self.dilation).checked_sub(self.padding[0]).filter(|at| *at < length) {
                    Some(at) => all.extend_from_slice(signal.row(at)),
                    None => all.resize(all.len() + self.inputs, 0.0),
                }
            }
        }
        all
    }
}

/// A transposed convolution whose output has `stride` times the steps of its input.
#[derive(Debug)]
pub(crate) struct Upsampling {
    pub(crate) stride: usize,
    pub(crate) outputs: usize,
    /// Outputs are `stride` steps of `outputs` components.
    pub(crate) phases: Convolution,
}

impl Upsampling {
    /// `weights` are inputs × outputs × kernel, as ONNX has them. The output is cut by `padding` on both sides, which makes it
    /// `stride` times as long as the input: kernel = stride + 2 · padding.
    ///
    /// Output step `stride`·q + r sums the inputs q − d with tap `stride`·d + r + `padding`, for all d with such a tap.
    pub(crate) fn new(
        [inputs, outputs, kernel]: [usize; 3],
        weights: &[f32],
        bias: &[f32],
        stride: usize,
        padding: usize,
    ) -> Result<Self, PiperError> {
        let before = (kernel - 1 - padding) / stride;
        let behind = padding.div_ceil(stride);
        let taps = before + behind + 1;
        let mut phases = vec![0.0; stride * outputs * inputs * taps];
        for phase in 0..stride {
            for tap in 0..taps {
                // Input q − before + tap, so d = before − tap.
                let of_kernel = (stride * before + phase + padding).checked_sub(stride * tap).filter(|at| *at < kernel);
                let Some(of_kernel) = of_kernel else { continue };
                for output in 0..outputs {
                    for input in 0..inputs {
                        phases[((phase * outputs + output) * inputs + input) * taps + tap] =
                            weights[(input * outputs + output) * kernel + of_kernel];
                    }
                }
            }
        }
        let phases =
            Convolution::new([stride * outputs, inputs, taps], &phases, bias.repeat(stride), 1, [before, behind])?;
        Ok(Self { stride, outputs, phases })
    }

    pub(crate) fn apply(&self, signal: &Frames) -> Result<Frames, PiperError> {
        let phases = self.phases.apply(signal)?;
        Ok(Frames { width: self.outputs, values: phases.values })
    }
}

/// A convolution of each component alone.
#[derive(Debug)]
pub(crate) struct SeparableConvolution {
    kernel: usize,
    dilation: usize,
    /// kernel × width.
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl SeparableConvolution {
    /// `weights` are width × kernel. The output is as long as the input.
    pub(crate) fn new([width, kernel]: [usize; 2], weights: &[f32], bias: Vec<f32>, dilation: usize) -> Self {
        let at = |tap: usize| (0..width).map(move |component| weights[component * kernel + tap]);
        Self { kernel, dilation, weights: (0..kernel).flat_map(at).collect(), bias }
    }

    pub(crate) fn apply(&self, signal: &Frames) -> Frames {
        let (length, width, before) = (signal.len(), signal.width, self.dilation * (self.kernel - 1) / 2);
        let mut outputs = Frames::zeros(length, width);
        outputs.values.par_chunks_exact_mut(width).with_min_len(32).enumerate().for_each(|(step, row)| {
            row.copy_from_slice(&self.bias);
            for (tap, weights) in self.weights.chunks_exact(width).enumerate() {
                let at = (step + tap * self.dilation).checked_sub(before).filter(|at| *at < length);
                let Some(at) = at else { continue };
                let values = row.iter_mut().zip(signal.row(at)).zip(weights);
                values.for_each(|((output, input), weight)| *output += input * weight);
            }
        });
        outputs
    }
}
