//! Language of the agents: utterances to intents, intents to scene commands, results to sentences.
//!
//! | module | from | to |
//! | --- | --- | --- |
//! | [`grammar`] | utterance and scene | intent, with the embedded grammar |
//! | [`intent_prompt`], [`intent_schema`] | utterance and scene | intent, with a language model |
//! | [`unit_choice`] | unknown name | unit, with a language model |
//! | [`commands`], [`resolution`] | clause of an intent | scene command or answer |
//! | [`permission`] | source and clauses | whether they may be carried out |
//! | [`query`], [`report`], [`reply`] | results | sentences |
//! | `state_answer` | scene | short answers: yes, no, a colour |
//! | [`paraphrase`] | reply | reply in other words, with a language model |
//!
//! All functions are pure: the crate knows neither the bus nor the network. `sg-llm` sends the prompts.
//!
//! [`commands`] holds the table of commands. A new command is one file and one row there.
//!
//! # Example
//!
//! ```
//! use sg_language::resolution::Step;
//! use sg_language::{commands, grammar};
//! use sg_proto::scene::command::Action;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let observation = grammar::sample_observation(&["sac", "vessel"]);
//! let intent = grammar::parse("hide the sac, then frame the vessel", &observation)?;
//! assert_eq!(intent.clauses.len(), 2);
//!
//! let scene = observation.scene.unwrap_or_default();
//! let step = commands::resolve(&intent.clauses[0], &scene, None)?;
//! assert!(matches!(step, Step::Change { action: Action::SetVisibility(set), .. } if !set.visible));
//! # Ok(())
//! # }
//! ```

pub mod color;
pub mod commands;
pub mod grammar;
pub mod intent_prompt;
pub mod intent_schema;
pub mod paraphrase;
pub mod permission;
pub mod prompt;
mod property;
pub mod proposed_regions;
pub mod query;
pub mod reply;
pub mod report;
pub mod request_ids;
pub mod resolution;
pub mod resolved_names;
pub mod spoken;
mod state_answer;
mod syntax;
mod text;
pub mod unit_choice;
pub mod unit_names;
