//! Clients of large language models: OpenAI-style HTTP and gRPC, with deadlines, retries and a fallback.
//!
//! - [`Parameters`]: the table of the model in a launch file.
//! - [`LlmClient`]: sends a [`Prompt`](sg_language::prompt::Prompt) until an answer is accepted.
//! - [`Interpreter`]: turns an utterance into an intent, with the model or the grammar.
//!
//! API keys come from environment variables and never appear in logs. Prompts leave this machine only encrypted.
//!
//! # Example
//!
//! Without a model the grammar serves:
//!
//! ```
//! use std::time::{Duration, Instant};
//!
//! use sg_language::grammar::sample_observation;
//! use sg_llm::{Interpreter, Parameters};
//! use sg_proto::language::{Act, IntentRequest};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let runtime = tokio::runtime::Builder::new_multi_thread().build()?;
//! let request = IntentRequest {
//!     text: "hide the sac".to_owned(),
//!     observation: Some(sample_observation(&["sac", "vessel"])),
//!     ..IntentRequest::default()
//! };
//! let intent = runtime.block_on(async {
//!     let mut interpreter = Interpreter::new(&Parameters::default())?;
//!     let mut state = interpreter.initial_state();
//!     let deadline = Instant::now() + Duration::from_secs(5);
//!     Ok::<_, Box<dyn std::error::Error>>(interpreter.interpret(&request, "request-1", deadline, &mut state).await?)
//! })?;
//! assert_eq!(intent.clauses[0].act(), Act::Hide);
//! # Ok(())
//! # }
//! ```

mod chat_completion;
mod client;
mod config;
mod error;
mod grpc;
mod interpreter;
mod model;
mod openai;

pub use chat_completion::completion_text;
pub use client::{Answer, LlmClient};
pub use config::{Backend, ConfigError, Fallback, ModelConfig, Parameters, UnknownBackend};
pub use error::LlmError;
pub use interpreter::{InterpretError, Interpreter};
