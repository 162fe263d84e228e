//! `mcp`: the commands and the picture of a running session for programs that speak the Model Context Protocol.
//!
//! | module | content |
//! | --- | --- |
//! | `tools` | the tools with their schemas |
//! | `call` | a tool with its arguments, checked |
//! | `server` | the protocol: lists the tools, has calls carried out within limits |
//! | `client` | carries calls out over the bus |
//! | `undo_steps` | how many steps of the history a call made |
//! | `scene_json` | the state of the scene as JSON |
//! | `results` | results and errors of tools, bounded |
//!
//! The server joins the session for each call. So it outlives restarts of the session, and can start before it.

mod call;
mod client;
mod results;
mod scene_json;
mod server;
mod tools;
mod undo_steps;

use std::io::IsTerminal as _;

use rmcp::transport::async_rw::AsyncRwTransport;
use rmcp::transport::stdio_pipes;
use sg_language::prompt::{MAX_ANSWER_BYTES, single_line};
use sg_runtime::session::SessionDir;

use crate::terminal::{CommandResult, Failure};
use server::Server;

/// Longest message of a client, bytes. Clauses of the largest size fit.
const MAX_MESSAGE_BYTES: usize = 4 * MAX_ANSWER_BYTES;

/// Example of the help.
pub(crate) const HELP: &str = r#"Example: supergaussian mcp --session headless

An MCP client starts the command itself. Its configuration, for example:

  {
    "mcpServers": {
      "supergaussian": { "command": "supergaussian", "args": ["mcp", "--session", "headless"] }
    }
  }"#;

/// Serves the tools on standard input and output until the client closes them.
pub(crate) async fn serve(session: Option<&str>) -> CommandResult {
    if let Some(name) = session {
        SessionDir::named(name)?;
    }
    if std::io::stdin().is_terminal() {
        let remedy = "`supergaussian mcp --help` shows its configuration";
        return Err(Failure::Input(format!("an MCP client starts this command, not a terminal; {remedy}")));
    }
    let server = Server::new(session)?;
    let (input, output) = stdio_pipes();
    let transport = AsyncRwTransport::new_server(input, output).with_max_line_length(MAX_MESSAGE_BYTES);
    let running = rmcp::serve_server(server, transport)
        .await
        .map_err(|e| Failure::Work(format!("no MCP client on standard input: {}", single_line(&e.to_string()))))?;
    let ended = running.waiting().await;
    ended.map(|_| ()).map_err(|e| Failure::Work(format!("the MCP server ended: {e}")))
}
