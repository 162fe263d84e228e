//! Panels: what each control asks for, how text can be read, and how they look.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::panic,
    reason = "a test fails by panicking and says what it measured"
)]

mod appearance;
mod asking;
mod curves;
mod desk;
mod legends;
mod monkey;
mod pace;
mod picture;
mod prompting;
mod stage;
mod typing;
