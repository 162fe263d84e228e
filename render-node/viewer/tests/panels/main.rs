//! Panels: the requests of each control, the legibility of text, and their look.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::panic,
    reason = "a test fails by panicking and says what it measured"
)]

mod appearance;
mod curves;
mod file_menu;
mod frame_rate;
mod kept_views;
mod labels;
mod legends;
mod microphone;
mod monkey;
mod move_tool;
mod picture;
mod region_tools;
mod scene_requests;
mod select_requests;
mod stage;
mod tours;
mod transfer_function;
mod typing;
mod upright;
mod window_ui;
