//! Input from outside: regular files within limits, and text of such files on its way to a terminal or a log.
//!
//! Every reader of this project opens its files with [`file`](mod@file). Only regular files are opened, and opening never waits. A
//! reader takes memory and time in proportion to the file; [`limits`] states the factors. [`printable()`] escapes names and
//! other text of files, and [`print`](mod@print) writes such text to a terminal. [`unreadable`] names formats without a reader.
//! [`number_format`] and [`short_path()`] write numbers and paths for
//! people.

pub mod file;
pub mod limits;
pub mod number_format;
pub mod print;
mod printable;
mod short_path;
pub mod unreadable;

pub use printable::{printable, printable_lines};
pub use short_path::short_path;
