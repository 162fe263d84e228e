//! The flow from the text's prior to what the decoder takes, in reverse (Kim et al. 2021, section 2.1.2).
//!
//! It is a row of couplings that keep the volume. Each has a network with gates as WaveNet's (Prenger et al. 2019).

use rayon::prelude::*;

use crate::convolution::Convolution;
use crate::error::PiperError;
use crate::frames::Frames;
use crate::weights::VoiceWeights;

/// Fewest steps that are worth another thread.
const MIN_STEPS: usize = 32;

/// The flow.
pub(crate) struct Flow {
    /// In the order of use.
    couplings: Vec<Coupling>,
}

struct Coupling {
    before: Convolution,
    layers: Vec<GatedLayer>,
    of_speaker: Option<Convolution>,
    behind: Convolution,
}

struct GatedLayer {
    /// Both halves of the gate.
    gate: Convolution,
    /// First what the signal gets more, then what the output gets. The last layer has the output alone.
    residual_and_skip: Convolution,
}

impl Flow {
    pub(crate) fn read(weights: &VoiceWeights, width: usize, speaker: Option<usize>) -> Result<Self, PiperError> {
        if !width.is_multiple_of(2) {
            return Err(weights.wrong("/enc_p/proj", format!("a prior of {width} components has no halves")));
        }
        // Every other module turns the components around.
        let count = weights.count(|at| format!("/flow/flows.{}/pre/Conv", 2 * at))?;
        let couplings = (0..count).rev().map(|at| Coupling::read(weights, 2 * at, width / 2, speaker));
        Ok(Self { couplings: couplings.collect::<Result<_, _>>()? })
    }

    pub(crate) fn apply(
        &self,
        mut state: Frames,
        speaker: Option<&Frames>,
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<Frames, PiperError> {
        for coupling in &self.couplings {
            state.rows_mut().for_each(<[f32]>::reverse);
            coupling.apply(&mut state, speaker, go_on)?;
        }
        Ok(state)
    }
}

impl Coupling {
    fn read(weights: &VoiceWeights, at: usize, half: usize, speaker: Option<usize>) -> Result<Self, PiperError> {
        let module = format!("/flow/flows.{at}");
        let before = weights.convolution(&format!("{module}/pre"), half)?;
        let width = before.outputs;
        let count = weights.count(|at| format!("{module}/enc/in_layers.{at}/Conv"))?;
        let layer = |at: usize| -> Result<GatedLayer, PiperError> {
            let outputs = if at + 1 < count { 2 * width } else { width };
            Ok(GatedLayer {
                gate: weights.convolution_to(&format!("{module}/enc/in_layers.{at}"), width, 2 * width)?,
                residual_and_skip: weights.convolution_to(
                    &format!("{module}/enc/res_skip_layers.{at}"),
                    width,
                    outputs,
                )?,
            })
        };
        Ok(Self {
            layers: (0..count).map(layer).collect::<Result<_, _>>()?,
            of_speaker: weights.of_speaker(&format!("{module}/enc/cond_layer"), speaker, 2 * width * count)?,
            behind: weights.convolution_to(&format!("{module}/post"), width, half)?,
            before,
        })
    }

    fn apply(
        &self,
        state: &mut Frames,
        speaker: Option<&Frames>,
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<(), PiperError> {
        let half = state.width / 2;
        let mut signal = self.before.apply(&state.components(0, half))?;
        let width = signal.width;
        let of_speaker = match (&self.of_speaker, speaker) {
            (Some(layer), Some(speaker)) => layer.apply(speaker)?.values,
            _ => Vec::new(),
        };
        let mut output = Frames::zeros(signal.len(), width);
        for (at, layer) in self.layers.iter().enumerate() {
            go_on()?;
            let mut gates = layer.gate.apply(&signal)?;
            if let Some(row) = of_speaker.get(2 * width * at..2 * width * (at + 1)) {
                gates.add_row(row);
            }
            let both = layer.residual_and_skip.apply(&gated(&gates))?;
            if both.width == width {
                output.add(&both);
                continue;
            }
            let rows = signal.rows_mut().zip(output.rows_mut()).zip(both.rows());
            for ((signal, output), both) in rows {
                let (residual, skip) = both.split_at(width);
                signal.iter_mut().zip(residual).for_each(|(value, more)| *value += more);
                output.iter_mut().zip(skip).for_each(|(value, more)| *value += more);
            }
        }
        let means = self.behind.apply(&output)?;
        for (row, means) in state.rows_mut().zip(means.rows()) {
            row[half..].iter_mut().zip(means).for_each(|(value, mean)| *value -= mean);
        }
        Ok(())
    }
}

/// tanh of the first half times the logistic function of the second one.
fn gated(gates: &Frames) -> Frames {
    let width = gates.width / 2;
    let mut all = Frames::zeros(gates.len(), width);
    let rows = all.values.par_chunks_exact_mut(width).zip(gates.values.par_chunks_exact(gates.width));
    rows.with_min_len(MIN_STEPS).for_each(|(to, from)| {
        let (signal, gate) = from.split_at(width);
        for ((to, signal), gate) in to.iter_mut().zip(signal).zip(gate) {
            *to = signal.tanh() / (1.0 + (-gate).exp());
        }
    });
    all
}
