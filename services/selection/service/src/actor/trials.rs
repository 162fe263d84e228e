//! Selections that are shown and not committed: unfinished strokes, other walk parameters, places for a next stroke.

use std::sync::Arc;
use std::time::Instant;

use sg_edit::EditState;
use sg_proto::selection;
use sg_runtime::fault::Fault;
use sg_scene::mask::Mask;
use sg_selection::preview::{Preview, differing};
use sg_selection::strokes::Stroke;

use super::{Selector, hidden, refusal, runs};
use crate::wire;

/// The preview of an unfinished stroke.
pub(super) struct OpenStroke {
    name: String,
    /// Hash of the selection below the stroke.
    over: String,
    /// Gaussians that could not be selected then.
    unselectable: Mask,
    /// The state that it was begun in.
    state: Arc<EditState>,
    preview: Preview,
}

impl Selector {
    /// Adds samples to an unfinished stroke and returns the preview.
    ///
    /// No other service is involved, because the user waits for the reply. A sample is cheaper than moving other work off
    /// this thread, so only the first one blocks in place.
    pub(super) fn sample(&mut self, request: &selection::SampleRequest) -> Result<selection::SampleReply, Fault> {
        let start = Instant::now();
        let samples = request.samples.as_ref().ok_or_else(|| Fault::invalid("no samples; send some"))?;
        let stroke = wire::decode_stroke(samples)?;
        let state = self.local_state();
        let over = state.selection().hash();
        let unselectable = state.unselectable();
        let goes_on = self.open.as_ref().is_some_and(|o| {
            o.name == request.stroke && o.over == over && o.unselectable == unselectable && o.state.has_scene_of(&state)
        });
        if !goes_on {
            let session = tokio::task::block_in_place(|| self.present(&state))?;
            // The selection below has changed: replay the stroke over the new one.
            let earlier = self.open.take().filter(|o| o.name == request.stroke);
            let mut preview = Preview::begin(&session, &stroke).map_err(|e| Fault::invalid(e.to_string()))?;
            if let Some(earlier) = earlier {
                let Stroke { points, pressure, .. } = earlier.preview.stroke();
                preview.extend(points, pressure).map_err(|e| Fault::invalid(e.to_string()))?;
            }
            let (name, over) = (request.stroke.clone(), over.to_owned());
            self.open = Some(OpenStroke { name, over, unselectable, state: Arc::clone(&state), preview });
            self.session = session;
        }
        let by_function = self.places.hidden(&state);
        let open = self.open.as_mut().ok_or_else(|| Fault::internal("the stroke was not begun"))?;
        let most = sg_proto::limits::MAX_STROKE_POINTS;
        if open.preview.stroke().points.len() + stroke.points.len() > most {
            return Err(Fault::exhausted(format!("a stroke of more than {most} points; begin another one")));
        }
        let changed =
            open.preview.extend(&stroke.points, &stroke.pressure).map_err(|e| Fault::invalid(e.to_string()))?;
        let mask = open.preview.mask();
        let mut changed = if goes_on {
            changed
        } else {
            // Relative to the committed selection. The client displays that.
            differing(state.selection().mask(), mask)
        };
        let mut selected = mask.count();
        if !request.include_hidden {
            let mut hidden = hidden(&state, &by_function, Some(state.selection().mask()));
            changed.retain(|g| !hidden.get(*g as usize));
            hidden.intersect_with(mask);
            selected -= hidden.count();
        }
        Ok(selection::SampleReply {
            hits: open.preview.hits() as u64,
            selected: selected as u64,
            changed: runs(&changed),
            relative_to_committed: !goes_on,
            selection_hash: over.to_owned(),
            answers: open
                .preview
                .session()
                .known_answers()
                .map(|a| wire::encode_answers(a, open.preview.session().tuning())),
            preview_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }

    /// Previews another leak or threshold, without a change of state.
    ///
    /// Each reply is relative to the committed selection, so a client may skip replies.
    pub(super) fn tune(&mut self, request: &selection::TuneRequest) -> Result<selection::TuneReply, Fault> {
        let start = Instant::now();
        let tuning = request.tuning.as_ref().ok_or_else(|| Fault::invalid("no leak and threshold; send both"))?;
        let tuning = wire::decode_tuning(tuning)?;
        let state = self.local_state();
        let mut session = self.present(&state)?;
        self.session = session.clone();
        session.tune(tuning).map_err(refusal)?;
        let committed = state.selection();
        let answers = session.known_answers().map(|a| wire::encode_answers(a, tuning));
        Ok(selection::TuneReply {
            answers,
            selected: session.mask().count() as u64,
            changed: runs(&differing(committed.mask(), session.mask())),
            selection_hash: committed.hash().to_owned(),
            preview_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }

    /// Proposes places for the next walk stroke.
    pub(super) fn propose(
        &mut self,
        request: &selection::ProposalsRequest,
    ) -> Result<selection::ProposalsReply, Fault> {
        let start = Instant::now();
        let most = sg_proto::limits::MAX_PROPOSALS;
        if !(1..=most).contains(&request.count) {
            return Err(Fault::invalid(format!("{} places; ask for 1 to {most}", request.count)));
        }
        let state = self.local_state();
        self.session = self.present(&state)?;
        if self.session.walk().is_none() {
            return Err(Fault::precondition("the selection has no walk to continue; brush in walk mode first"));
        }
        let proposals = self.session.proposals(request.count as usize);
        Ok(selection::ProposalsReply {
            proposals: proposals.iter().map(wire::encode_proposal).collect(),
            selection_hash: state.selection().hash().to_owned(),
            proposals_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }
}
