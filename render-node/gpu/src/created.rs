//! Counts what this crate creates on a device, thread by thread.

use std::cell::Cell;

/// Numbers of created objects.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Created {
    /// Buffers.
    pub buffers: u64,
    /// Textures.
    pub textures: u64,
    /// Pipelines.
    pub pipelines: u64,
    /// Bind groups.
    pub bind_groups: u64,
    /// Writes to buffers for which wgpu made staging memory.
    pub uploads: u64,
}

thread_local! {
    static CREATED: Cell<Created> =
        const { Cell::new(Created { buffers: 0, textures: 0, pipelines: 0, bind_groups: 0, uploads: 0 }) };
}

/// Objects that this crate has created on the calling thread, on all devices. A loop that draws creates none in its frames.
#[must_use]
pub fn created_on_this_thread() -> Created {
    CREATED.get()
}

/// Counts a created object.
pub(super) fn count_created(count: impl FnOnce(&mut Created)) {
    let mut created = CREATED.get();
    count(&mut created);
    CREATED.set(created);
}
