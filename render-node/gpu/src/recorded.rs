//! Records the commands of a frame: what the passes encode, with the buffers that each command uses.
//!
//! Nothing is recorded outside of [`record_commands`], and then nothing is allocated.

use std::cell::RefCell;
use std::sync::Arc;

use crate::barriers::{Access, Commands, Kind, Use};

/// A buffer that a command uses.
#[derive(Debug, Clone)]
pub(super) struct BoundBuffer {
    /// Name of the shader's variable.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests compare it with the table of passes"))]
    pub(super) variable: Arc<str>,
    pub(super) access: Access,
    pub(super) buffer: wgpu::Buffer,
}

/// A recorded command.
#[derive(Debug, Clone)]
pub(super) struct RecordedCommand {
    /// Whether it is the first one of a pass.
    pub(super) opens_pass: bool,
    #[cfg_attr(not(test), expect(dead_code, reason = "tests compare it with the table of passes"))]
    pub(super) entry: &'static str,
    pub(super) kind: Kind,
    pub(super) buffers: Vec<BoundBuffer>,
}

#[derive(Default)]
struct Recording {
    commands: Vec<RecordedCommand>,
    opens_pass: bool,
}

thread_local! {
    static RECORDING: RefCell<Option<Recording>> = const { RefCell::new(None) };
}

/// A pass begins.
pub(super) fn open_pass() {
    RECORDING.with_borrow_mut(|recording| {
        if let Some(recording) = recording {
            recording.opens_pass = true;
        }
    });
}

/// A command is encoded. Indirect commands have their arguments in a buffer.
pub(super) fn command(entry: &'static str, kind: Kind, bound: &[BoundBuffer], arguments: Option<&wgpu::Buffer>) {
    RECORDING.with_borrow_mut(|recording| {
        let Some(Recording { commands, opens_pass }) = recording else { return };
        let arguments = arguments.map(|buffer| BoundBuffer {
            variable: Arc::default(),
            access: Access::Indirect,
            buffer: buffer.clone(),
        });
        commands.push(RecordedCommand {
            opens_pass: std::mem::take(opens_pass),
            entry,
            kind,
            buffers: bound.iter().cloned().chain(arguments).collect(),
        });
    });
}

/// A buffer is cleared.
pub(super) fn clear(buffer: &wgpu::Buffer) {
    RECORDING.with_borrow_mut(|recording| {
        if let Some(Recording { commands, .. }) = recording {
            let buffer = buffer.clone();
            let cleared = BoundBuffer { variable: Arc::default(), access: Access::CopyTarget, buffer };
            commands.push(RecordedCommand {
                opens_pass: false,
                entry: "clear",
                kind: Kind::Clear,
                buffers: vec![cleared],
            });
        }
    });
}

/// The commands that `work` encodes on this thread.
pub(super) fn recorded<T>(work: impl FnOnce() -> T) -> (T, Vec<RecordedCommand>) {
    RECORDING.set(Some(Recording::default()));
    let outcome = work();
    (outcome, RECORDING.take().unwrap_or_default().commands)
}

/// Counts the commands that this crate encodes on this thread during `work`, and the barriers between buffers that wgpu adds to them
/// by the rules of the module `barriers`. Barriers of textures are left out. `validates` says whether wgpu validates indirect calls.
pub fn record_commands<T>(validates: bool, work: impl FnOnce() -> T) -> (T, Commands) {
    let (outcome, commands) = recorded(work);
    let uses = commands.iter().map(|command| {
        let buffers = command.buffers.iter().map(|b| Use { resource: b.buffer.clone(), access: b.access });
        (command.opens_pass, command.kind, buffers.collect())
    });
    (outcome, Commands::count(uses.collect(), validates).into_iter().fold(Commands::default(), |a, b| a.plus(&b)))
}
