//! Language of the agents: utterances to intents, intents to scene commands, results to sentences.

pub mod color;
pub mod commands;
pub mod grammar;
pub mod intent_prompt;
pub mod intent_schema;
pub mod paraphrase;
pub mod prompt;
mod property;
pub mod query;
pub mod reply;
pub mod report;
pub mod request_ids;
pub mod resolution;
mod syntax;
mod text;
pub mod unit_choice;
pub mod unit_names;
