//! Confinement of a process by the kernel's Landlock: the files, TCP ports and sockets that it may use.
//!
//! A process gives up all rights but those in [`Rights`], for itself and all processes that it starts. Nothing gives them back.
//! Rules follow the kernel: a kernel without Landlock confines nothing, and an older one less ([`support`]). Files that are open
//! already stay usable.
//!
//! The kernel's documentation (`userspace-api/landlock`) defines the rights and their versions.

mod enforce;
mod rights;

pub use enforce::{ConfinementError, Enforcement, Support, confine, support};
pub use rights::Rights;
