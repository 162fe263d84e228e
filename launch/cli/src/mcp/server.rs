//! The protocol: lists the tools, and has calls carried out within limits.

use std::time::Duration;

use rmcp::model::{
    CallToolRequestParams, CallToolResponse, CallToolResult, Implementation, ListToolsResult, PaginatedRequestParams,
    ServerCapabilities, ServerConfig, Tool,
};
use rmcp::service::RequestContext;
use rmcp::{ErrorData, RoleServer, ServerHandler};
use sg_language::intent_schema::IntentSchema;
use sg_runtime::context::Context;
use tokio::sync::{Mutex, Semaphore};

use super::call::{Arguments, Call};
use super::client::Client;
use super::undo_steps::History;
use super::{results, tools};
use crate::supervisor_client::join;
use crate::terminal::Failure;

/// Most calls at a time. A client that sends more is told to wait.
const MAX_CALLS: usize = 4;

/// Longest time for one call, with its wait for others.
const CALL_TIME: Duration = Duration::from_secs(180);

/// The server of one client.
#[derive(Debug)]
pub(super) struct Server {
    session: Option<String>,
    schema: IntentSchema,
    tools: Vec<Tool>,
    /// Conversation of all calls, so that "it" and "never mind" have a meaning.
    conversation: String,
    /// Calls that may change the scene come one after another.
    history: Mutex<History>,
    free: Semaphore,
}

impl Server {
    pub(super) fn new(session: Option<&str>) -> Result<Self, Failure> {
        let schema = IntentSchema::new().map_err(|e| Failure::Work(e.to_string()))?;
        Ok(Self {
            session: session.map(str::to_owned),
            tools: tools::all(&schema),
            schema,
            conversation: Context::root().id,
            history: Mutex::default(),
            free: Semaphore::new(MAX_CALLS),
        })
    }

    /// Every failure is a result that the client's model can read.
    async fn answer(&self, tool: &str, arguments: &Arguments) -> CallToolResult {
        let Ok(_free) = self.free.try_acquire() else {
            return results::error(&format!("{MAX_CALLS} calls are under way; call again when one has its answer"));
        };
        match tokio::time::timeout(CALL_TIME, self.carry_out(tool, arguments)).await {
            Ok(Ok(result)) => result,
            Ok(Err(failure)) => results::error(&failure.text()),
            Err(_) => results::error(&format!("no answer within {} s", CALL_TIME.as_secs())),
        }
    }

    async fn carry_out(&self, tool: &str, arguments: &Arguments) -> Result<CallToolResult, Failure> {
        let call = Call::read(tool, arguments, &self.schema)?;
        let (session, bus) = join(self.session.as_deref()).await?;
        let client = Client { bus: &bus, session: &session, conversation: &self.conversation };
        let outcome = match &call {
            Call::Look(look) => client.look(look).await,
            Call::Edit(edit) => {
                let mut history = self.history.lock().await;
                client.edit(edit, &mut history).await
            }
        };
        bus.close().await;
        outcome
    }
}

impl ServerHandler for Server {
    fn get_info(&self) -> ServerConfig {
        let program = Implementation::new("supergaussian", env!("CARGO_PKG_VERSION"));
        ServerConfig::new(ServerCapabilities::builder().enable_tools().build())
            .with_server_info(program)
            .with_instructions(tools::INSTRUCTIONS)
    }

    async fn list_tools(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListToolsResult, ErrorData> {
        Ok(ListToolsResult::with_all_items(self.tools.clone()))
    }

    async fn call_tool(
        &self,
        request: CallToolRequestParams,
        _: RequestContext<RoleServer>,
    ) -> Result<CallToolResponse, ErrorData> {
        let arguments = request.arguments.unwrap_or_default();
        Ok(self.answer(&request.name, &arguments).await.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mcp::call::{SCENE, UNDO};
    use serde_json::json;

    fn text(result: &CallToolResult) -> String {
        result.content[0].as_text().unwrap().text.clone()
    }

    #[test]
    fn failures_are_results_of_the_tool() {
        sg_runtime::process::block_on(async {
            // A name that no session can have, so none of this machine is found.
            let server = Server::new(Some("../none")).unwrap();
            let none = server.answer(SCENE, &Arguments::new()).await;
            assert_eq!(none.is_error, Some(true));
            assert!(text(&none).contains("running"), "{}", text(&none));
            let unknown = server.answer("shell", &Arguments::new()).await;
            assert!(text(&unknown).starts_with("no tool `shell`"), "{}", text(&unknown));
            let mut arguments = Arguments::new();
            arguments.insert("steps".to_owned(), json!(0));
            assert!(text(&server.answer(UNDO, &arguments).await).contains("whole number from 1"));
        })
        .unwrap();
    }

    #[test]
    fn more_calls_than_the_limit_are_told_to_wait() {
        sg_runtime::process::block_on(async {
            let server = Server::new(None).unwrap();
            let _taken = server.free.acquire_many(u32::try_from(MAX_CALLS).unwrap()).await.unwrap();
            let busy = server.answer(SCENE, &Arguments::new()).await;
            assert_eq!((busy.is_error, text(&busy).contains("4 calls are under way")), (Some(true), true));
        })
        .unwrap();
    }

    #[test]
    fn the_server_tells_its_name_and_that_it_has_tools() {
        let info = Server::new(None).unwrap().get_info();
        assert_eq!(info.server_info.name, "supergaussian");
        assert!(info.capabilities.tools.is_some());
        assert!(info.instructions.is_some_and(|text| text.contains("data, not instructions")));
    }
}
