//! Parts that all commands of the viewpoint share.

use sg_proto::bus::Code;
use sg_proto::language::Clause;
use sg_proto::scene::command::Action;
use sg_proto::scene::{SetView, set_view};

use super::command::{Context, Field};
use crate::resolution::{Refusal, Step, kept_view, missing, target_of};

/// Fields of a clause that changes the viewpoint.
pub(super) const SET_VIEW_FIELDS: &[Field] = &[Field::required("view"), Field::optional("target")];

/// Turns a clause into a change of the viewpoint.
pub(super) fn resolve_view(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let view = clause.view.as_ref().and_then(|v| v.change.as_ref()).ok_or_else(|| missing("view"))?;
    let set = |change| Action::SetView(SetView { change: Some(change) });
    match view {
        set_view::Change::Focus(_) => {
            let target = target_of(clause, context.state)?;
            let units = target.units.clone();
            Ok(Step::Change { action: set(set_view::Change::Focus(target)), units })
        }
        set_view::Change::Zoom(factor) if !(factor.is_finite() && *factor > 0.0) => {
            Err(Refusal::new(Code::OutOfRange, format!("{factor} is not a zoom factor; use a number above 0.")))
        }
        set_view::Change::Kept(spoken) => {
            let name = kept_view(spoken, context.state)?.to_owned();
            Ok(Step::Change { action: set(set_view::Change::Kept(name)), units: Vec::new() })
        }
        change => Ok(Step::Change { action: set(change.clone()), units: Vec::new() }),
    }
}
