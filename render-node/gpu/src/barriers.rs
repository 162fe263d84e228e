//! The commands and pipeline barriers of an encoder, as wgpu 30 writes them for Vulkan.
//!
//! - A dispatch has one barrier of buffers if one of its buffers was last used otherwise, or is written again, in the same pass.
//!   Reading in one way needs none.
//! - A pass has one more in front of it, for the first uses within it; a draw pass has all its barriers there. Textures have one of
//!   their own.
//! - Where wgpu validates indirect calls, each indirect dispatch gets another dispatch and up to three barriers. A pass with indirect
//!   draws gets one dispatch and three barriers.
//! - A submission begins with one barrier, for what the one before it used.

use std::collections::HashMap;
use std::hash::Hash;

/// The use of a resource by a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Access {
    /// A uniform buffer.
    Uniform,
    /// A storage buffer that a shader reads.
    Read,
    /// A storage buffer that a shader may write.
    Write,
    /// Arguments of an indirect call.
    Indirect,
    /// Target of a copy or a clear.
    CopyTarget,
    /// A texture that a shader reads.
    Sampled,
    /// A color or depth attachment.
    Attachment,
}

impl Access {
    fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// Uses whose order needs no barrier.
fn is_ordered(state: u8) -> bool {
    let exclusive = [Access::Write, Access::CopyTarget, Access::Attachment];
    exclusive.iter().all(|access| state & access.bit() == 0)
}

/// Kind of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A dispatch.
    Dispatch,
    /// An indirect dispatch.
    DispatchIndirect,
    /// A draw.
    Draw,
    /// An indirect draw.
    DrawIndirect,
    /// A clear of a buffer outside of passes.
    Clear,
}

/// A resource and its use.
#[derive(Debug, Clone)]
pub(super) struct Use<R> {
    pub(super) resource: R,
    pub(super) access: Access,
}

/// Numbers of commands.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Commands {
    /// Passes.
    pub passes: u32,
    /// Dispatches, those of wgpu's validation included.
    pub dispatches: u32,
    /// Those of wgpu's validation.
    pub validations: u32,
    /// Draws.
    pub draws: u32,
    /// Pipeline barriers.
    pub barriers: u32,
}

impl Commands {
    /// Sums.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            passes: self.passes + other.passes,
            dispatches: self.dispatches + other.dispatches,
            validations: self.validations + other.validations,
            draws: self.draws + other.draws,
            barriers: self.barriers + other.barriers,
        }
    }

    /// The numbers of each command of one submission: whether it opens a pass, its kind and what it uses. The barrier in front of
    /// a pass belongs to the pass's first command. `validates` says whether wgpu validates indirect calls.
    pub(super) fn count<R: Clone + Eq + Hash>(commands: Vec<(bool, Kind, Vec<Use<R>>)>, validates: bool) -> Vec<Self> {
        let mut counted: Vec<Self> = Vec::with_capacity(commands.len());
        let mut submission = Tracker::default();
        let mut rest = commands.into_iter().peekable();
        while let Some(first) = rest.next() {
            let mut pass = vec![first];
            while let Some(next) = rest.next_if(|(opens, kind, _)| !opens && *kind != Kind::Clear) {
                pass.push(next);
            }
            let (of_pass, tracker) = count_pass(&pass, validates);
            let barriers = submission.join(&tracker);
            let begin = counted.len();
            counted.extend(of_pass);
            if let Some(first) = counted.get_mut(begin) {
                first.barriers += barriers;
            }
        }
        if let Some(first) = counted.first_mut() {
            first.barriers += 1;
        }
        counted
    }
}

/// First and last states of resources.
struct Tracker<R>(HashMap<R, (u8, u8)>);

impl<R> Default for Tracker<R> {
    fn default() -> Self {
        Self(HashMap::new())
    }
}

impl<R: Clone + Eq + Hash> Tracker<R> {
    /// Brings a resource into a state. Whether that needs a barrier; the first use needs none.
    fn set(&mut self, resource: &R, state: u8) -> bool {
        self.enter(resource, (state, state))
    }

    fn enter(&mut self, resource: &R, (first, last): (u8, u8)) -> bool {
        match self.0.get_mut(resource) {
            Some((_, before)) => {
                let ordered = *before == first && is_ordered(first);
                *before = last;
                !ordered
            }
            None => {
                self.0.insert(resource.clone(), (first, last));
                false
            }
        }
    }

    /// Appends the states of a pass. Returns the number of barriers in front of it.
    fn join(&mut self, pass: &Self) -> u32 {
        let mut needed = [false; 2];
        for (resource, states) in &pass.0 {
            let is_texture = states.0 & (Access::Sampled.bit() | Access::Attachment.bit()) != 0;
            needed[usize::from(is_texture)] |= self.enter(resource, *states);
        }
        needed.iter().map(|needed| u32::from(*needed)).sum()
    }
}

/// The numbers of a pass's commands without the barrier in front of it, and its states.
fn count_pass<R: Clone + Eq + Hash>(
    commands: &[(bool, Kind, Vec<Use<R>>)],
    validates: bool,
) -> (Vec<Commands>, Tracker<R>) {
    let mut tracker = Tracker::default();
    let draws = commands.iter().any(|(_, kind, _)| matches!(kind, Kind::Draw | Kind::DrawIndirect));
    let mut counted: Vec<Commands> = Vec::with_capacity(commands.len());
    // The uses of a draw pass are one state of each resource.
    let mut scope: HashMap<R, u8> = HashMap::new();
    let mut validates_draws = false;
    for (opens, kind, uses) in commands {
        let mut numbers = Commands { passes: u32::from(*opens), ..Commands::default() };
        let is_validated = validates && matches!(kind, Kind::DispatchIndirect | Kind::DrawIndirect);
        let mut states: HashMap<R, u8> = HashMap::new();
        for Use { resource, access } in uses {
            let access = match (access, is_validated, kind) {
                // The validation copies the arguments to a buffer of its own. A dispatch's own uses do not keep theirs.
                (Access::Indirect, true, Kind::DispatchIndirect) => {
                    numbers.barriers += u32::from(tracker.set(resource, Access::Read.bit()));
                    continue;
                }
                (Access::Indirect, true, _) => Access::Read,
                (access, ..) => *access,
            };
            *states.entry(resource.clone()).or_default() |= access.bit();
        }
        match kind {
            Kind::Dispatch | Kind::DispatchIndirect => {
                numbers.dispatches += 1;
                if is_validated {
                    numbers.dispatches += 1;
                    numbers.validations += 1;
                    numbers.barriers += 2;
                }
            }
            Kind::Draw => numbers.draws += 1,
            Kind::DrawIndirect => {
                numbers.draws += 1;
                if is_validated && !std::mem::replace(&mut validates_draws, true) {
                    numbers.dispatches += 1;
                    numbers.validations += 1;
                    numbers.barriers += 3;
                }
            }
            Kind::Clear => (),
        }
        if draws {
            for (resource, state) in states {
                *scope.entry(resource).or_default() |= state;
            }
        } else {
            let mut needed = false;
            for (resource, state) in &states {
                needed |= tracker.set(resource, *state);
            }
            numbers.barriers += u32::from(needed);
        }
        counted.push(numbers);
    }
    for (resource, state) in &scope {
        tracker.set(resource, *state);
    }
    (counted, tracker)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uses(list: &[(&'static str, Access)]) -> Vec<Use<&'static str>> {
        list.iter().map(|(resource, access)| Use { resource: *resource, access: *access }).collect()
    }

    #[test]
    fn dependent_dispatches_have_barriers_and_independent_ones_none() {
        let dispatch = |opens, list: &[(&'static str, Access)]| (opens, Kind::Dispatch, uses(list));
        let commands = vec![
            dispatch(true, &[("scene", Access::Read), ("a", Access::Write)]),
            dispatch(false, &[("scene", Access::Read), ("b", Access::Write)]),
            dispatch(false, &[("a", Access::Read), ("b", Access::Write)]),
            dispatch(true, &[("a", Access::Read), ("b", Access::Read)]),
            dispatch(true, &[("a", Access::Read), ("b", Access::Read)]),
        ];
        let barriers: Vec<u32> = Commands::count(commands, false).iter().map(|c| c.barriers).collect();
        // The submission's, none, one for both buffers, one in front of the pass, none.
        assert_eq!(barriers, [1, 0, 1, 1, 0]);
    }

    #[test]
    fn validation_adds_dispatches_and_barriers() {
        let first = (true, Kind::Dispatch, uses(&[("arguments", Access::Write)]));
        let indirect = (false, Kind::DispatchIndirect, uses(&[("a", Access::Write), ("arguments", Access::Indirect)]));
        let draw = (true, Kind::DrawIndirect, uses(&[("arguments", Access::Indirect), ("target", Access::Attachment)]));
        let commands = || vec![first.clone(), indirect.clone(), draw.clone()];
        let total =
            |validates| Commands::count(commands(), validates).iter().fold(Commands::default(), |a, b| a.plus(b));
        let plain = Commands { passes: 2, dispatches: 2, validations: 0, draws: 1, barriers: 2 };
        assert_eq!(total(false), plain);
        // 3 with the dispatch, whose own uses are first ones, and 3 with the draw: its arguments are in the state of a read already.
        assert_eq!(total(true), Commands { dispatches: 4, validations: 2, barriers: 7, ..plain });
    }
}
