//! Convolutions beside those of the tensor library.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use candle_core::{Device, Tensor};
use proptest::prelude::*;

use crate::convolution::{Convolution, SeparableConvolution, Upsampling};
use crate::frames::Frames;
use crate::noise::Noise;

/// A signal as the tensor library has it: 1 × width × steps.
fn tensor(frames: &Frames) -> Tensor {
    let steps = Tensor::from_slice(&frames.values, (1, frames.len(), frames.width), &Device::Cpu).unwrap();
    steps.transpose(1, 2).unwrap().contiguous().unwrap()
}

fn assert_close(found: &Frames, exact: &Tensor, bias: &[f32]) {
    let exact = exact.transpose(1, 2).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap();
    assert_eq!(found.values.len(), exact.len());
    for ((found, exact), bias) in found.values.iter().zip(exact).zip(bias.iter().cycle()) {
        assert!((found - exact - bias).abs() < 1e-4, "{found} {exact} {bias}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn convolutions_are_those_of_the_tensor_library(
        (steps, inputs, outputs) in (1_usize..600, 1_usize..40, 1_usize..20),
        (kernel, dilation) in (1_usize..8, 1_usize..13),
    ) {
        let all = dilation * (kernel - 1);
        let padding = all / 2;
        prop_assume!(steps + 2 * padding > all);
        let mut noise = Noise::new(5);
        let signal = Frames { width: inputs, values: noise.numbers(steps * inputs, 1.0) };
        let weights = noise.numbers(outputs * inputs * kernel, 0.2);
        let bias = noise.numbers(outputs, 1.0);
        let shape = [outputs, inputs, kernel];
        let own = Convolution::new(shape, &weights, bias.clone(), dilation, [padding; 2]).unwrap();
        let exact = Tensor::from_slice(&weights, (outputs, inputs, kernel), &Device::Cpu).unwrap();
        let exact = tensor(&signal).conv1d(&exact, padding, 1, dilation, 1).unwrap();
        let mut found = own.apply(&signal).unwrap();
        assert_close(&found, &exact, &bias);
        // Added to itself, it is twice as much.
        let once = found.clone();
        own.add_to(&signal, &mut found).unwrap();
        for (twice, once) in found.values.iter().zip(&once.values) {
            prop_assert!((twice - 2.0 * once).abs() < 1e-4);
        }
    }

    #[test]
    fn upsamplings_are_those_of_the_tensor_library(
        (steps, inputs, outputs) in (1_usize..200, 1_usize..20, 1_usize..12),
        (stride, padding) in (1_usize..9, 0_usize..9),
    ) {
        let kernel = stride + 2 * padding;
        let mut noise = Noise::new(6);
        let signal = Frames { width: inputs, values: noise.numbers(steps * inputs, 1.0) };
        let weights = noise.numbers(inputs * outputs * kernel, 0.2);
        let bias = noise.numbers(outputs, 1.0);
        let own = Upsampling::new([inputs, outputs, kernel], &weights, &bias, stride, padding).unwrap();
        let exact = Tensor::from_slice(&weights, (inputs, outputs, kernel), &Device::Cpu).unwrap();
        let exact = tensor(&signal).conv_transpose1d(&exact, padding, 0, stride, 1, 1).unwrap();
        let found = own.apply(&signal).unwrap();
        prop_assert_eq!((found.len(), found.width), (stride * steps, outputs));
        assert_close(&found, &exact, &bias);
    }

    #[test]
    fn separable_convolutions_are_those_of_the_tensor_library(
        (steps, width, kernel, dilation) in (1_usize..200, 1_usize..20, 0_usize..4, 1_usize..10),
    ) {
        let kernel = 2 * kernel + 1;
        let mut noise = Noise::new(7);
        let signal = Frames { width, values: noise.numbers(steps * width, 1.0) };
        let (weights, bias) = (noise.numbers(width * kernel, 0.2), noise.numbers(width, 1.0));
        let own = SeparableConvolution::new([width, kernel], &weights, bias.clone(), dilation);
        let exact = Tensor::from_slice(&weights, (width, 1, kernel), &Device::Cpu).unwrap();
        let exact = tensor(&signal).conv1d(&exact, dilation * (kernel - 1) / 2, 1, dilation, width).unwrap();
        assert_close(&own.apply(&signal), &exact, &bias);
    }
}
