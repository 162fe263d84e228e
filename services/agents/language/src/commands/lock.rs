//! Locks of units.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{SetLock, Target};

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use crate::resolution::{Refusal, Step, target_of};
use crate::syntax::phrase::{Input, Outcome};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::target_alone;
use crate::unit_names;

/// The command "lock".
pub(super) const LOCK: Command = Command {
    act: Act::Lock,
    title: "lock",
    constructs: &[Construct::with_ellipsis("lock | protect | freeze", Ellipsis::Verb, target)],
    examples: &["lock the {unit}"],
    fields: &[Field::required("target")],
    effect: Effect::None,
    resolve: |clause, context| resolve(clause, context, true),
};

/// The command "unlock".
pub(super) const UNLOCK: Command = Command {
    act: Act::Unlock,
    title: "unlock",
    constructs: &[Construct::with_ellipsis("unlock | unprotect | unfreeze", Ellipsis::Verb, target)],
    examples: &["unlock the {unit}", "unlock everything"],
    fields: &[Field::required("target")],
    effect: Effect::None,
    resolve: |clause, context| resolve(clause, context, false),
};

fn target(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    Ok(Reading::of(verb.act, target_alone(input)?))
}

fn resolve(clause: &Clause, context: &Context<'_>, locked: bool) -> Result<Step, Refusal> {
    let mut target = target_of(clause, context.state)?;
    if target.complement && !target.selection && !target.units.is_empty() {
        // All other units by their names.
        let mut others = unit_names::addressable(context.state);
        others.retain(|name| target.units.iter().all(|unit| unit != name));
        target = Target { units: others.into_iter().map(str::to_owned).collect(), ..Target::default() };
    }
    if target.selection || target.complement || (target.units.is_empty() && !target.everything) {
        return Err(Refusal::precondition("Only units have a lock. Say their names, or “everything”."));
    }
    let units = target.units.clone();
    Ok(Step::Change { action: Action::SetLock(SetLock { target: Some(target), locked }), units })
}
