//! Three agents that close the visualization-perception-action loop.
//!
//! The library is what they know: a [`grammar`] from text to an intent, [`resolve`] from an intent to scene commands and
//! answers, [`account`] and [`answer`] for telling a person, [`reply`] for closing the loop with what was seen. Where a
//! launch file chooses a language model ([`backend`]), [`understand`], [`choose`] and [`retell`] make its prompts and say
//! which of its answers hold.
//! It names neither the bus nor time; the three processes under `bin/` do.

pub mod account;
pub mod answer;
pub mod backend;
pub mod choose;
pub mod color;
pub mod endpoint;
pub mod form;
pub mod grammar;
pub mod identity;
pub mod names;
pub mod openai;
pub mod prompt;
pub mod recent;
pub mod reply;
pub mod resolve;
pub mod retell;
pub mod understand;
mod wording;
mod words;
