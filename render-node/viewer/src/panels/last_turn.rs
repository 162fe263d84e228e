//! The newest turn of the conversation as a panel last showed it.

use crate::display::Turn;

/// State of the newest turn: when it differs, there is something new to read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct LastTurn {
    id: String,
    entries: usize,
    answered: bool,
}

impl LastTurn {
    pub(super) fn of(turn: &Turn) -> Self {
        Self { id: turn.id.clone(), entries: turn.entries.len(), answered: turn.answer.is_some() }
    }
}
