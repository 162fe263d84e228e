//! A scene with its project: applies each command once, stores it, and serves missed changes.

use std::path::Path;
use std::sync::Arc;

use prost::Message as _;
use sg_proto::bus::Code;
use sg_proto::limits::MAX_MESSAGE_BYTES;
use sg_proto::scene::{Changes, ChangesRequest, Command, CommandResult, Event};

use crate::journal::{Journal, JournalError};
use sg_edit::{EditError, EditState, Editor, check_id};
use sg_reclassify::VolumeOfScene;
use sg_scene::model::Scene;

/// Most events of one answer; a reader that is further behind gets a snapshot.
const MAX_EVENTS: usize = 256;
/// Most bytes of events in one answer, with room for the rest of the message.
const MAX_EVENT_BYTES: usize = MAX_MESSAGE_BYTES - 4096;

/// An open scene: its state and its journal.
#[derive(Debug)]
pub struct Project {
    editor: Editor,
    journal: Journal,
}

/// A command that was not carried out; the scene is as it was.
#[derive(Debug, thiserror::Error)]
pub enum ProjectError {
    /// It does not fit the scene or makes no sense.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// It could not be made durable, or the stored data could not be read.
    #[error(transparent)]
    Journal(#[from] JournalError),
}

impl ProjectError {
    /// Its canonical code on the wire.
    #[must_use]
    pub fn code(&self) -> Code {
        match self {
            Self::Edit(error) => error.code(),
            Self::Journal(error) => error.code(),
        }
    }

    /// Facts for a program.
    #[must_use]
    pub fn details(&self) -> Vec<String> {
        match self {
            Self::Edit(error) => error.details(),
            Self::Journal(_) => Vec::new(),
        }
    }
}

/// An accepted command.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result for the sender.
    pub result: CommandResult,
    /// The event to publish; `None` for a repeated command.
    pub event: Option<Event>,
}

impl Project {
    /// Opens the project of a scene, or makes it if there is no file. Readers find the geometry at `scene_path`.
    ///
    /// # Errors
    /// [`JournalError`]; a file that is there is left as it is.
    pub fn open(path: &Path, scene: Arc<Scene>, scene_path: &str) -> Result<Self, JournalError> {
        let hash = scene.content_hash().to_hex().to_string();
        // Without a readable function the scene is edited all the same; the command that needs it says so.
        let volume = VolumeOfScene::of(&scene, &sg_reclassify::functions(&scene, Path::new(scene_path)).0);
        let opened = EditState::of_scene(&scene, scene_path, hash).with_volume(volume);
        let (journal, editor) = Journal::open(path, scene, opened)?;
        Ok(Self { editor, journal })
    }

    /// The present state and history.
    #[must_use]
    pub fn editor(&self) -> &Editor {
        &self.editor
    }

    #[cfg(test)]
    pub(crate) fn journal(&self) -> &Journal {
        &self.journal
    }

    /// Applies a command at most once: the same command again returns the stored result, also after a restart. A command
    /// without an action asks for the stored result of its id. When this returns an outcome, it survives a crash.
    ///
    /// The results of the last 20,000 accepted commands are kept.
    ///
    /// # Errors
    /// [`ProjectError`]; nothing has changed, and the same id may be tried again. [`EditError::IdTaken`] for an accepted
    /// command's id with other content.
    pub fn apply(&mut self, command: &Command) -> Result<Outcome, ProjectError> {
        check_id(&command.id)?;
        if let Some(stored) = self.journal.find(&command.id)? {
            if command.action.is_some() && !stored.is_of(command) {
                return Err(EditError::IdTaken(command.id.clone()).into());
            }
            return Ok(Outcome { result: stored.result, event: None });
        }
        let journal = &mut self.journal;
        let applied =
            self.editor.apply_with(command, |applied| journal.append(command, applied).map_err(ProjectError::from))?;
        Ok(Outcome { result: applied.result, event: Some(applied.event) })
    }

    /// Stores the whole state now and then, so that the next start is fast. Call it after commands, outside of a
    /// request.
    ///
    /// # Errors
    /// [`JournalError`]; nothing is lost by that but the next start's speed.
    pub fn checkpoint_if_due(&mut self) -> Result<(), JournalError> {
        self.journal.checkpoint_if_due(&self.editor)
    }

    /// Stores the whole state now, and removes what nobody can ask for any more.
    ///
    /// # Errors
    /// As [`Project::checkpoint_if_due`].
    pub fn checkpoint(&mut self) -> Result<(), JournalError> {
        self.journal.checkpoint(&self.editor)
    }

    /// The changes since revision `request.from`: all events if they are kept and fit one message, else the whole
    /// state.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn changes(&self, request: &ChangesRequest) -> Result<Changes, JournalError> {
        let revision = self.editor.state().revision();
        if !request.snapshot {
            let (events, all) = self.journal.events(request.from, MAX_EVENTS, MAX_EVENT_BYTES)?;
            if all {
                return Ok(Changes { revision, events, snapshot: None });
            }
            let snapshot = self.editor.message(true);
            if let Some(last) = events.last().filter(|_| snapshot.encoded_len() > MAX_EVENT_BYTES) {
                let revision = last.revision;
                return Ok(Changes { revision, events, snapshot: None });
            }
            return Ok(Changes { revision, events: Vec::new(), snapshot: Some(snapshot) });
        }
        Ok(Changes { revision, events: Vec::new(), snapshot: Some(self.editor.message(true)) })
    }

    /// The last event. Start-up republishes it: a crash may have come before its publication.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn last_event(&self) -> Result<Option<Event>, JournalError> {
        self.journal.last_event()
    }
}
