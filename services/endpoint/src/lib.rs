//! Connections to models in other programs, on this machine or another one.
//!
//! - [`Endpoint`]: an address. Data to other machines are encrypted, unless the launch file says otherwise.
//! - [`ApiKey`]: a key from an environment variable. It never appears in logs or messages.
//! - [`HttpClient`] and [`GrpcClient`]: requests without proxies and redirections, with answers of a bounded size.
//!
//! The caller gives each request its deadline: it drops the future, or names the time for gRPC.

mod address;
mod api_key;
mod error;
mod grpc;
mod http;

use std::time::Duration;

pub use address::{Endpoint, EndpointError};
pub use api_key::{ApiKey, KeyError};
pub use error::{CallError, ClientError};
pub use grpc::GrpcClient;
pub use http::{HttpClient, Part};

/// Address of OpenAI.
pub const OPENAI: &str = "https://api.openai.com/v1";
/// Longest wait for a connection.
const CONNECT: Duration = Duration::from_secs(5);
