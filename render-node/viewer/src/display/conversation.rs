//! The conversation: utterances, the actions they caused, and the answers.

/// Most turns kept.
const TURNS: usize = 64;

/// Most lines kept of one turn.
const ENTRIES: usize = 128;

/// A conversation, oldest turn first.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Conversation {
    /// At most 64 turns.
    pub turns: Vec<Turn>,
}

/// One sentence, its plan, results and answer.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Turn {
    /// Id of the conversation's request, the same in every stage.
    pub id: String,
    /// The words.
    pub said: String,
    /// Plan and results, in order of arrival.
    pub entries: Vec<Entry>,
    /// The answer, when there is one, and whether everything was done.
    pub answer: Option<(String, bool)>,
}

/// One entry of a turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Entry {
    /// A planned command of an agent.
    Command(String),
    /// Result of a command or question, and whether it succeeded.
    Result(String, bool),
}

impl Conversation {
    /// Begins a turn.
    pub fn say(&mut self, id: impl Into<String>, said: impl Into<String>) {
        if self.turns.len() >= TURNS {
            self.turns.remove(0);
        }
        self.turns.push(Turn { id: id.into(), said: said.into(), ..Turn::default() });
    }

    /// The turn of this id that was begun last.
    pub fn turn(&mut self, id: &str) -> Option<&mut Turn> {
        self.turns.iter_mut().rev().find(|t| t.id == id)
    }

    /// Whether something said has no answer yet.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.turns.last().is_some_and(|t| t.answer.is_none())
    }
}

impl Turn {
    /// Adds a line; lines beyond the turn's limit are dropped.
    pub fn add(&mut self, entry: Entry) {
        if self.entries.len() < ENTRIES {
            self.entries.push(entry);
        }
    }
}
