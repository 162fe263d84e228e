//! The stochastic duration predictor, from noise to durations (Kim et al. 2021, section 2.2.2 and appendix B).
//!
//! In this direction its flows run in reverse. The first flow is left out, as in the published code.

use crate::convolution::{Convolution, SeparableConvolution};
use crate::error::PiperError;
use crate::frames::{Frames, Norm, gelu};
use crate::spline::{Spline, Unnormalized};
use crate::weights::VoiceWeights;

/// The predictor of durations.
pub(crate) struct DurationPredictor {
    before: Convolution,
    of_speaker: Option<Convolution>,
    network: SeparableStack,
    behind: Convolution,
    /// In the order of use.
    flows: Vec<SplineFlow>,
    /// Shift and factor of the last flow, for the component that is the logarithm of the duration.
    last: (f32, f32),
}

/// Dilated depth-separable convolutions.
struct SeparableStack(Vec<SeparableLayer>);

struct SeparableLayer {
    of_components: SeparableConvolution,
    across: Convolution,
    norms: [Norm; 2],
}

/// A coupling whose second component passes a spline that depends on the first one and on the text.
struct SplineFlow {
    before: Convolution,
    network: SeparableStack,
    /// Widths, heights and derivatives of the spline.
    parameters: Convolution,
    bins: usize,
}

impl DurationPredictor {
    pub(crate) fn read(weights: &VoiceWeights, width: usize, speaker: Option<usize>) -> Result<Self, PiperError> {
        if weights.has("/dp/conv_1/Conv") {
            let problem = "the voice predicts durations without noise, which is not supported; take one with a stochastic duration predictor";
            return Err(weights.wrong("/dp/conv_1/Conv", problem));
        }
        let before = weights.convolution("/dp/pre", width)?;
        let inner = before.outputs;
        let flow = |at: &usize| format!("/dp/flows.{at}/pre/Conv");
        let indices: Vec<usize> = (3..=64).step_by(2).take_while(|at| weights.has(&flow(at))).collect();
        if indices.is_empty() {
            return Err(weights.wrong(&flow(&3), "there is no such node; take a voice that Piper's own exporter made"));
        }
        let flows = indices.iter().rev().map(|at| SplineFlow::read(weights, *at, inner)).collect::<Result<_, _>>()?;
        let shift = weights.named("dp.flows.0.m", &[2, 1])?[0];
        // exp(−logs), which exporters compute beforehand.
        let factor = if weights.has_tensor("dp.flows.0.logs") {
            (-weights.named("dp.flows.0.logs", &[2, 1])?[0]).exp()
        } else {
            weights.node_values("/dp/flows.0/Mul", 2)?[0]
        };
        Ok(Self {
            of_speaker: weights.of_speaker("/dp/cond", speaker, inner)?,
            network: SeparableStack::read(weights, "/dp/convs", inner)?,
            behind: weights.convolution_to("/dp/proj", inner, inner)?,
            before,
            flows,
            last: (shift, factor),
        })
    }

    /// The logarithm of each phoneme's duration in frames. `noise` has two numbers for each phoneme.
    pub(crate) fn apply(
        &self,
        hidden: &Frames,
        speaker: Option<&Frames>,
        noise: Frames,
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<Vec<f32>, PiperError> {
        let mut text = self.before.apply(hidden)?;
        if let (Some(layer), Some(speaker)) = (&self.of_speaker, speaker) {
            text.add_row(&layer.apply(speaker)?.values);
        }
        let text = self.behind.apply(&self.network.apply(text, go_on)?)?;
        let mut state = noise;
        let flip = |state: &mut Frames| state.rows_mut().for_each(|row| row.swap(0, 1));
        for flow in &self.flows {
            flip(&mut state);
            flow.apply(&mut state, &text, go_on)?;
        }
        flip(&mut state);
        let (shift, factor) = self.last;
        Ok(state.rows().map(|row| (row[0] - shift) * factor).collect())
    }
}

impl SeparableStack {
    fn read(weights: &VoiceWeights, module: &str, width: usize) -> Result<Self, PiperError> {
        let count = weights.count(|at| format!("{module}/convs_sep.{at}/Conv"))?;
        let layer = |at: usize| -> Result<SeparableLayer, PiperError> {
            let norm = |kind: usize| weights.norm(&format!("{module}/norms_{kind}.{at}"), width);
            Ok(SeparableLayer {
                of_components: weights.separable(&format!("{module}/convs_sep.{at}"), width)?,
                across: weights.convolution_to(&format!("{module}/convs_1x1.{at}"), width, width)?,
                norms: [norm(1)?, norm(2)?],
            })
        };
        (0..count).map(layer).collect::<Result<_, _>>().map(Self)
    }

    fn apply(&self, mut sum: Frames, go_on: &dyn Fn() -> Result<(), PiperError>) -> Result<Frames, PiperError> {
        for layer in &self.0 {
            go_on()?;
            let mut step = layer.of_components.apply(&sum);
            layer.norms[0].apply(&mut step);
            step.each(gelu);
            let mut step = layer.across.apply(&step)?;
            layer.norms[1].apply(&mut step);
            step.each(gelu);
            sum.add(&step);
        }
        Ok(sum)
    }
}

impl SplineFlow {
    fn read(weights: &VoiceWeights, at: usize, width: usize) -> Result<Self, PiperError> {
        let module = format!("/dp/flows.{at}");
        let parameters = weights.convolution(&format!("{module}/proj"), width)?;
        // A spline of n bins has n widths, n heights and n − 1 derivatives.
        let bins = (parameters.outputs + 1) / 3;
        if 3 * bins != parameters.outputs + 1 || !(2..=256).contains(&bins) {
            let problem = format!("{} outputs are no spline; get the voice again", parameters.outputs);
            return Err(weights.wrong(&format!("{module}/proj"), problem));
        }
        let before = weights.convolution_to(&format!("{module}/pre"), 1, width)?;
        let network = SeparableStack::read(weights, &format!("{module}/convs"), width)?;
        Ok(Self { before, network, parameters, bins })
    }

    fn apply(
        &self,
        state: &mut Frames,
        text: &Frames,
        go_on: &dyn Fn() -> Result<(), PiperError>,
    ) -> Result<(), PiperError> {
        let mut inner = self.before.apply(&state.components(0, 1))?;
        inner.add(text);
        let scale = (inner.width as f32).sqrt().recip();
        let mut parameters = self.parameters.apply(&self.network.apply(inner, go_on)?)?;
        for (row, parameters) in state.rows_mut().zip(parameters.rows_mut()) {
            let (shares, derivatives) = parameters.split_at_mut(2 * self.bins);
            shares.iter_mut().for_each(|share| *share *= scale);
            let (widths, heights) = shares.split_at(self.bins);
            row[1] = Spline::new(Unnormalized { widths, heights, derivatives }).inverse(row[1]);
        }
        Ok(())
    }
}
