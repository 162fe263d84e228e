//! The one table of key expressions: `sg/<session>/<role>/<name>` ↔ message types ↔ who may send.
//!
//! A row is a typed constant, so that a service cannot ask or publish with a type that its row does not name; [`rows`]
//! lists them all for tools and tests. `*` as a role stands for every role.

use std::marker::PhantomData;

use prost::Name;

use crate::{bus, language, launch, render, scene, selection};

/// First segment of every key expression.
pub const ROOT: &str = "sg";

/// Any role: the row exists for each.
pub const ANY: &str = "*";

/// Roles of the stack.
pub mod role {
    /// Owns the scene.
    pub const SCENE: &str = "scene";
    /// Turns strokes into selections.
    pub const SELECTION: &str = "selection";
    /// Draws the shared viewpoint whenever the scene changes.
    pub const RENDER_VIEW: &str = "render-view";
    /// Draws pictures on request.
    pub const RENDER_CAPTURE: &str = "render-capture";
    /// Hears utterances and answers.
    pub const AGENT_CORE: &str = "agent-core";
    /// Understands utterances.
    pub const AGENT_INTENT: &str = "agent-intent";
    /// Carries out plans.
    pub const AGENT_FUNCTION: &str = "agent-function";
    /// Starts and watches the others.
    pub const SUPERVISOR: &str = "supervisor";
    /// A person at a terminal, or a script.
    pub const CLI: &str = "cli";
    /// Another machine that has joined and runs services for the supervisor; it serves under its instance alone.
    pub const NODE: &str = "node";

    /// Those that are no services: nobody starts them from a launch file, and the rows of every service are not theirs.
    pub const NO_SERVICES: [&str; 3] = [SUPERVISOR, CLI, NODE];

    /// All of them.
    pub const ALL: [&str; 10] = [
        SCENE,
        SELECTION,
        RENDER_VIEW,
        RENDER_CAPTURE,
        AGENT_CORE,
        AGENT_INTENT,
        AGENT_FUNCTION,
        SUPERVISOR,
        CLI,
        NODE,
    ];
}

/// What goes first where messages wait for one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Urgency {
    /// A person's hand waits for it.
    Interactive,
    /// The rest.
    #[default]
    Ordinary,
    /// Whatever can wait: large, or for statistics.
    Background,
}

/// A request that a role answers.
#[derive(Debug)]
pub struct Ask<Q, R> {
    /// Role that answers, or [`ANY`].
    pub role: &'static str,
    /// Last part of the key, `cmd/…`.
    pub name: &'static str,
    /// Roles that may ask.
    pub senders: &'static [&'static str],
    /// Whether other machines may not ask, whatever roles they run.
    pub at_home: bool,
    /// What goes first.
    pub urgency: Urgency,
    /// What it is for.
    pub doc: &'static str,
    types: PhantomData<fn(Q) -> R>,
}

/// A stream of messages that a role publishes.
#[derive(Debug)]
pub struct Stream<M> {
    /// Role that publishes, or [`ANY`].
    pub role: &'static str,
    /// Last part of the key, `event/…`.
    pub name: &'static str,
    /// What goes first.
    pub urgency: Urgency,
    /// What it is for.
    pub doc: &'static str,
    types: PhantomData<fn() -> M>,
}

/// The newest value of something that a role owns.
#[derive(Debug)]
pub struct Slot<M> {
    /// Role that owns it.
    pub role: &'static str,
    /// Last part of the key, `state`.
    pub name: &'static str,
    /// What it is for.
    pub doc: &'static str,
    types: PhantomData<fn() -> M>,
}

// Written out because a derive would ask the message types to be `Copy` too.
impl<Q, R> Clone for Ask<Q, R> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<Q, R> Copy for Ask<Q, R> {}
impl<M> Clone for Stream<M> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<M> Copy for Stream<M> {}
impl<M> Clone for Slot<M> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<M> Copy for Slot<M> {}

impl<Q: Name, R: Name> Ask<Q, R> {
    const fn new(role: &'static str, name: &'static str, senders: &'static [&'static str], doc: &'static str) -> Self {
        Self { role, name, senders, at_home: false, urgency: Urgency::Ordinary, doc, types: PhantomData }
    }

    const fn at(self, urgency: Urgency) -> Self {
        Self { urgency, ..self }
    }

    const fn at_home(self) -> Self {
        Self { at_home: true, ..self }
    }

    fn row(&self) -> Row {
        Row {
            role: self.role,
            name: self.name,
            kind: Kind::Ask { request: Q::full_name(), reply: R::full_name() },
            senders: self.senders,
            at_home: self.at_home,
            doc: self.doc,
        }
    }
}

impl<M: Name> Stream<M> {
    const fn new(role: &'static str, name: &'static str, doc: &'static str) -> Self {
        Self { role, name, urgency: Urgency::Ordinary, doc, types: PhantomData }
    }

    const fn at(self, urgency: Urgency) -> Self {
        Self { urgency, ..self }
    }

    fn row(&self) -> Row {
        Row {
            role: self.role,
            name: self.name,
            kind: Kind::Stream { message: M::full_name() },
            senders: &[],
            at_home: false,
            doc: self.doc,
        }
    }
}

impl<M: Name> Slot<M> {
    const fn new(role: &'static str, name: &'static str, doc: &'static str) -> Self {
        Self { role, name, doc, types: PhantomData }
    }

    fn row(&self) -> Row {
        Row {
            role: self.role,
            name: self.name,
            kind: Kind::Slot { message: M::full_name() },
            senders: &[],
            at_home: false,
            doc: self.doc,
        }
    }
}

/// How messages travel under a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind {
    /// Request and reply, or a typed error.
    Ask {
        /// Full name of the request.
        request: String,
        /// Full name of the reply.
        reply: String,
    },
    /// A stream; a slow reader loses the oldest messages, counted.
    Stream {
        /// Full name of the message.
        message: String,
    },
    /// The newest value; a late reader gets it when it asks.
    Slot {
        /// Full name of the message.
        message: String,
    },
}

/// One row of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// Role that answers, publishes or owns.
    pub role: &'static str,
    /// Last part of the key.
    pub name: &'static str,
    /// How messages travel, and which.
    pub kind: Kind,
    /// For requests: who may ask. The answering, publishing or owning side is always the role itself.
    pub senders: &'static [&'static str],
    /// For requests: whether other machines may not ask, whatever roles they run.
    pub at_home: bool,
    /// What it is for.
    pub doc: &'static str,
}

impl Row {
    /// Whether the row belongs to this role.
    #[must_use]
    pub fn is_of(&self, role: &str) -> bool {
        self.role == ANY || self.role == role
    }

    /// Whether this role may send requests under this row.
    #[must_use]
    pub fn may_ask(&self, role: &str) -> bool {
        matches!(self.kind, Kind::Ask { .. }) && self.senders.iter().any(|s| *s == ANY || *s == role)
    }
}

const CLIENTS: &[&str] = &[role::CLI, role::AGENT_CORE, role::AGENT_FUNCTION];
const SCENE_READERS: &[&str] =
    &[role::CLI, role::SELECTION, role::RENDER_VIEW, role::RENDER_CAPTURE, role::AGENT_CORE, role::AGENT_FUNCTION];

macro_rules! table {
    ($($(#[doc = $doc:literal])+ $ident:ident: $type:ident<$($message:ty),+> = ($role:expr, $name:literal $(, $senders:expr)?)$( at $urgency:ident)?$( only $place:ident)?;)*) => {
        $(
            $(#[doc = $doc])+
            pub const $ident: $type<$($message),+> = $type::new($role, $name, $($senders,)? concat!($($doc),+))$(.at(Urgency::$urgency))?$(.$place())?;
        )*

        /// Every row of the table.
        #[must_use]
        pub fn rows() -> Vec<Row> {
            vec![$($ident.row()),*]
        }
    };
}

table! {
    /// How an instance is.
    STATUS: Ask<bus::StatusRequest, bus::Health> = (ANY, "cmd/status", &[ANY]);
    /// An instance begins to serve.
    READY: Stream<bus::Ready> = (ANY, "event/ready");
    /// How an instance is, every second.
    HEALTH: Stream<bus::Health> = (ANY, "event/health") at Background;
    /// An instance that stands by takes its role; asked under the instance.
    PROMOTE: Ask<bus::PromoteRequest, bus::PromoteReply> = (ANY, "cmd/promote", &[role::SUPERVISOR]);
    /// Withdraws a request.
    CANCEL: Ask<bus::CancelRequest, bus::CancelReply> = (ANY, "cmd/cancel", &[ANY]) at Interactive;
    /// What a process has counted.
    METRICS: Ask<bus::MetricsRequest, bus::MetricsReply> = (ANY, "cmd/metrics", &[ANY]) at Background;

    /// Changes the scene; at most once for an id.
    SCENE_APPLY: Ask<scene::Command, scene::CommandResult> = (role::SCENE, "cmd/apply", &[role::CLI, role::SELECTION, role::RENDER_VIEW, role::AGENT_FUNCTION]);
    /// What a reader missed.
    SCENE_CHANGES: Ask<scene::ChangesRequest, scene::Changes> = (role::SCENE, "cmd/changes", SCENE_READERS);
    /// An accepted change, after it is durable.
    SCENE_EVENT: Stream<scene::Event> = (role::SCENE, "event/change") at Interactive;
    /// Which files the geometry is read from.
    SCENE_FILES: Ask<scene::FilesRequest, scene::Files> = (role::SCENE, "cmd/files", SCENE_READERS);
    /// A part of one of those files.
    SCENE_CONTENT: Ask<bus::ContentRequest, bus::ContentReply> = (role::SCENE, "cmd/content", SCENE_READERS) at Background;
    /// The newest state, without masks.
    SCENE_STATE: Slot<scene::State> = (role::SCENE, "state");

    /// Adds strokes and commits what they select.
    SELECTION_STROKES: Ask<selection::StrokesRequest, selection::StrokesReply> = (role::SELECTION, "cmd/strokes", &[role::CLI, role::RENDER_VIEW]) at Interactive;
    /// A stroke is being drawn: what it would select so far.
    SELECTION_SAMPLE: Ask<selection::SampleRequest, selection::SampleReply> = (role::SELECTION, "cmd/sample", &[role::CLI, role::RENDER_VIEW]) at Interactive;
    /// What another leak or threshold of the last walk would select.
    SELECTION_TUNE: Ask<selection::TuneRequest, selection::TuneReply> = (role::SELECTION, "cmd/tune", &[role::CLI, role::RENDER_VIEW]) at Interactive;
    /// Where a next stroke would tell most.
    SELECTION_PROPOSALS: Ask<selection::ProposalsRequest, selection::ProposalsReply> = (role::SELECTION, "cmd/proposals", &[role::CLI, role::RENDER_VIEW]);
    /// What strokes select that are being committed, ahead of the scene's own word.
    SELECTION_PREVIEW: Stream<selection::Preview> = (role::SELECTION, "event/preview") at Interactive;
    /// A part of what the selection process has made, such as the Super-Gaussian of each Gaussian.
    SELECTION_CONTENT: Ask<bus::ContentRequest, bus::ContentReply> = (role::SELECTION, "cmd/content", &[role::CLI, role::RENDER_VIEW, role::RENDER_CAPTURE]) at Background;
    /// What is clustered.
    SELECTION_STATE: Slot<selection::State> = (role::SELECTION, "state");

    /// One picture.
    CAPTURE: Ask<render::CaptureRequest, render::Frame> = (role::RENDER_CAPTURE, "cmd/capture", CLIENTS) at Background;
    /// What is in front.
    PICK: Ask<render::PickRequest, render::PickReply> = (role::RENDER_CAPTURE, "cmd/pick", CLIENTS);
    /// A part of a picture that the capture process has drawn.
    CAPTURE_CONTENT: Ask<bus::ContentRequest, bus::ContentReply> = (role::RENDER_CAPTURE, "cmd/content", CLIENTS) at Background;
    /// What the capture process has drawn.
    CAPTURE_STATE: Slot<render::State> = (role::RENDER_CAPTURE, "state");
    /// A new picture of the shared viewpoint.
    VIEW_FRAME: Stream<render::Frame> = (role::RENDER_VIEW, "event/frame");
    /// A part of a picture that the view process has drawn.
    VIEW_CONTENT: Ask<bus::ContentRequest, bus::ContentReply> = (role::RENDER_VIEW, "cmd/content", CLIENTS) at Background;
    /// What the view process has drawn.
    VIEW_STATE: Slot<render::State> = (role::RENDER_VIEW, "state");

    /// Says something to the stack.
    UTTER: Ask<language::Utterance, language::Reply> = (role::AGENT_CORE, "cmd/utter", &[role::CLI, role::RENDER_VIEW]);
    /// Something was said.
    UTTERANCE: Stream<language::Utterance> = (role::AGENT_CORE, "event/utterance");
    /// The core agent looks.
    PERCEIVE: Stream<language::Perceive> = (role::AGENT_CORE, "event/perceive");
    /// What the core agent saw.
    OBSERVATION: Stream<language::Observation> = (role::AGENT_CORE, "event/observation");
    /// What the core agent wants done.
    PLAN: Stream<language::Plan> = (role::AGENT_CORE, "event/plan");
    /// What the core agent answered.
    REPLY: Stream<language::Reply> = (role::AGENT_CORE, "event/reply");
    /// The core agent.
    CORE_STATE: Slot<language::AgentState> = (role::AGENT_CORE, "state");

    /// What an utterance means.
    PARSE: Ask<language::IntentRequest, language::Intent> = (role::AGENT_INTENT, "cmd/parse", &[role::AGENT_CORE, role::SUPERVISOR, role::CLI]);
    /// What was understood.
    INTENT: Stream<language::Intent> = (role::AGENT_INTENT, "event/intent");
    /// The intent agent.
    INTENT_STATE: Slot<language::AgentState> = (role::AGENT_INTENT, "state");

    /// Carries out a plan.
    EXECUTE: Ask<language::Plan, language::PlanResult> = (role::AGENT_FUNCTION, "cmd/execute", &[role::AGENT_CORE]);
    /// The outcome of one clause.
    ACTION: Stream<language::ActionResult> = (role::AGENT_FUNCTION, "event/action");
    /// The function agent.
    FUNCTION_STATE: Slot<language::AgentState> = (role::AGENT_FUNCTION, "state");

    /// How the services are.
    PS: Ask<launch::PsRequest, launch::PsReply> = (role::SUPERVISOR, "cmd/ps", &[role::CLI]);
    /// Restarts one service.
    RESTART: Ask<launch::RestartRequest, launch::RestartReply> = (role::SUPERVISOR, "cmd/restart", &[role::CLI]);
    /// Replaces one service by another process.
    SWAP: Ask<launch::SwapRequest, launch::SwapReply> = (role::SUPERVISOR, "cmd/swap", &[role::CLI]);
    /// Reads the launch file again.
    RELOAD: Ask<launch::ReloadRequest, launch::ReloadReply> = (role::SUPERVISOR, "cmd/reload", &[role::CLI]);
    /// Opens a scene or volume in a window and a session of their own.
    OPEN: Ask<launch::OpenRequest, launch::OpenReply> = (role::SUPERVISOR, "cmd/open", &[role::CLI, role::RENDER_VIEW]) only at_home;
    /// A session that was opened from this one failed.
    OPEN_FAILED: Stream<launch::OpenFailed> = (role::SUPERVISOR, "event/open-failed");
    /// Stops the stack.
    DOWN: Ask<launch::DownRequest, launch::DownReply> = (role::SUPERVISOR, "cmd/down", &[role::CLI]);
    /// A machine that joined is there.
    JOIN: Ask<launch::JoinRequest, launch::JoinReply> = (role::SUPERVISOR, "cmd/join", &[role::NODE]);
    /// A service changed its state.
    SERVICE: Stream<launch::ServiceEvent> = (role::SUPERVISOR, "event/service");

    /// Starts a process on a node; asked under its instance, as the others.
    NODE_START: Ask<launch::StartRequest, launch::StartReply> = (role::NODE, "cmd/start", &[role::SUPERVISOR]);
    /// Asks a process on a node to stop, or ends it.
    NODE_SIGNAL: Ask<launch::SignalRequest, launch::SignalReply> = (role::NODE, "cmd/signal", &[role::SUPERVISOR]);
    /// What processes on a node log.
    NODE_LOG: Stream<launch::LogLines> = (role::NODE, "event/log") at Background;
}

/// The key expression of a row for one role of one session.
#[must_use]
pub fn key(session: &str, role: &str, name: &str) -> String {
    format!("{ROOT}/{session}/{role}/{name}")
}

/// What stands in place of the role in the keys of one instance, whether or not it has its role: `@instance/<instance>`.
#[must_use]
pub fn instance(instance: &str) -> String {
    format!("@instance/{instance}")
}

/// Instance of a machine that has joined; no service's can be equal, since their names have no `.`.
#[must_use]
pub fn node_instance(node: &str) -> String {
    format!("node.{node}")
}

/// The key expression of an instance's liveliness token.
#[must_use]
pub fn alive(session: &str, role: &str, instance: &str) -> String {
    format!("{ROOT}/{session}/@alive/{role}/{instance}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_row_names_messages_of_the_contract_and_known_roles() {
        let messages: HashSet<_> = crate::message_names().into_iter().collect();
        let mut seen = HashSet::new();
        for row in rows() {
            assert!(row.role == ANY || role::ALL.contains(&row.role), "{row:?}");
            assert!(row.senders.iter().all(|s| *s == ANY || role::ALL.contains(s)), "{row:?}");
            assert!(seen.insert((row.role, row.name)), "{} {} stands twice", row.role, row.name);
            let (types, prefix) = match &row.kind {
                Kind::Ask { request, reply } => (vec![request, reply], "cmd/"),
                Kind::Stream { message } => (vec![message], "event/"),
                Kind::Slot { message } => (vec![message], "state"),
            };
            assert!(row.name.starts_with(prefix), "{row:?}");
            for name in types {
                assert!(messages.contains(name.as_str()), "{name} is not in the contract");
            }
        }
    }

    #[test]
    fn only_listed_roles_may_ask() {
        let rows = rows();
        let apply = rows.iter().find(|r| r.role == role::SCENE && r.name == "cmd/apply").unwrap();
        assert!(apply.may_ask(role::AGENT_FUNCTION));
        assert!(!apply.may_ask(role::AGENT_INTENT), "the intent agent understands, it does not act");
    }
}
