//! The table of key expressions, `sg/<session>/<role>/<name>`, with their message types and permitted senders.
//!
//! Each row is a typed constant, so the compiler rejects a message of another type. [`rows`] lists all rows for tools and
//! tests. The role `*` stands for every role. A process on a node has keys with its identity in front: see [`Identity`].

use std::marker::PhantomData;

use prost::Name;

use crate::{bus, labeling, language, launch, render, scene, selection, speech};

/// First segment of every key expression.
pub const ROOT: &str = "sg";

/// Stands for every role.
pub const ANY: &str = "*";

/// Roles of the processes in a session.
pub mod role {
    /// Owns the scene.
    pub const SCENE: &str = "scene";
    /// Computes selections from strokes.
    pub const SELECTION: &str = "selection";
    /// Finds the units that a text means, and says how units look.
    pub const LABELING: &str = "labeling";
    /// Recognises speech and speaks replies.
    pub const SPEECH: &str = "speech";
    /// Renders the shared view after each change of the scene.
    pub const RENDER_VIEW: &str = "render-view";
    /// Renders pictures on request.
    pub const RENDER_CAPTURE: &str = "render-capture";
    /// Receives utterances and replies.
    pub const AGENT_CORE: &str = "agent-core";
    /// Parses utterances into intents.
    pub const AGENT_INTENT: &str = "agent-intent";
    /// Executes plans.
    pub const AGENT_FUNCTION: &str = "agent-function";
    /// Starts and supervises the services.
    pub const SUPERVISOR: &str = "supervisor";
    /// Command line: a person at a terminal, or a script.
    pub const CLI: &str = "cli";
    /// Another machine that runs services for the supervisor. It serves under its instance only.
    pub const NODE: &str = "node";

    /// Roles that are not services: a launch file can't start them, and rows of [`ANY`](super::ANY) don't apply to them.
    pub const NON_SERVICES: [&str; 3] = [SUPERVISOR, CLI, NODE];

    /// All roles.
    pub const ALL: [&str; 12] = [
        SCENE,
        SELECTION,
        LABELING,
        SPEECH,
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

/// Priority of a message in the queues of the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Priority {
    /// A person waits for the result.
    Interactive,
    /// Everything else.
    #[default]
    Normal,
    /// Large messages and statistics.
    Background,
}

/// Row of a request that a role answers: request type `Q`, reply type `R`.
#[derive(Debug)]
pub struct Request<Q, R> {
    /// Role that answers, or [`ANY`].
    pub role: &'static str,
    /// Last part of the key, `cmd/…`.
    pub name: &'static str,
    /// Roles that may send the request.
    pub senders: &'static [&'static str],
    /// Whether only processes on the supervisor's machine may send the request.
    pub local_only: bool,
    /// Priority.
    pub priority: Priority,
    /// Purpose, one sentence.
    pub doc: &'static str,
    types: PhantomData<fn(Q) -> R>,
}

/// Row of a stream that a role publishes.
#[derive(Debug)]
pub struct Stream<M> {
    /// Role that publishes, or [`ANY`].
    pub role: &'static str,
    /// Last part of the key, `event/…`.
    pub name: &'static str,
    /// Priority.
    pub priority: Priority,
    /// Purpose, one sentence.
    pub doc: &'static str,
    types: PhantomData<fn() -> M>,
}

/// Row of a retained value: the newest value of something that a role owns.
#[derive(Debug)]
pub struct Retained<M> {
    /// Role that owns it.
    pub role: &'static str,
    /// Last part of the key, `state`.
    pub name: &'static str,
    /// Purpose, one sentence.
    pub doc: &'static str,
    types: PhantomData<fn() -> M>,
}

// Written out because a derive would require the message types to be `Copy`.
impl<Q, R> Clone for Request<Q, R> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<Q, R> Copy for Request<Q, R> {}
impl<M> Clone for Stream<M> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<M> Copy for Stream<M> {}
impl<M> Clone for Retained<M> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<M> Copy for Retained<M> {}

impl<Q: Name, R: Name> Request<Q, R> {
    const fn new(role: &'static str, name: &'static str, senders: &'static [&'static str], doc: &'static str) -> Self {
        Self { role, name, senders, local_only: false, priority: Priority::Normal, doc, types: PhantomData }
    }

    const fn at(self, priority: Priority) -> Self {
        Self { priority, ..self }
    }

    const fn local_only(self) -> Self {
        Self { local_only: true, ..self }
    }

    fn row(&self) -> Row {
        Row {
            role: self.role,
            name: self.name,
            kind: Kind::Request { request: Q::full_name(), reply: R::full_name() },
            senders: self.senders,
            local_only: self.local_only,
            doc: self.doc,
        }
    }
}

impl<M: Name> Stream<M> {
    const fn new(role: &'static str, name: &'static str, doc: &'static str) -> Self {
        Self { role, name, priority: Priority::Normal, doc, types: PhantomData }
    }

    const fn at(self, priority: Priority) -> Self {
        Self { priority, ..self }
    }

    fn row(&self) -> Row {
        Row {
            role: self.role,
            name: self.name,
            kind: Kind::Stream { message: M::full_name() },
            senders: &[],
            local_only: false,
            doc: self.doc,
        }
    }
}

impl<M: Name> Retained<M> {
    const fn new(role: &'static str, name: &'static str, doc: &'static str) -> Self {
        Self { role, name, doc, types: PhantomData }
    }

    fn row(&self) -> Row {
        Row {
            role: self.role,
            name: self.name,
            kind: Kind::Retained { message: M::full_name() },
            senders: &[],
            local_only: false,
            doc: self.doc,
        }
    }
}

/// Delivery of the messages of a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind {
    /// A request with a reply or a typed error.
    Request {
        /// Full name of the request.
        request: String,
        /// Full name of the reply.
        reply: String,
    },
    /// A stream. A slow reader loses the oldest messages, and counts them.
    Stream {
        /// Full name of the message.
        message: String,
    },
    /// A retained value. A late reader asks for the newest one.
    Retained {
        /// Full name of the message.
        message: String,
    },
}

/// One row of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// Role that answers, publishes or owns; [`ANY`] for all.
    pub role: &'static str,
    /// Last part of the key.
    pub name: &'static str,
    /// Delivery, and full names of the message types.
    pub kind: Kind,
    /// For requests, the roles that may send it. The role of the row answers, publishes or owns.
    pub senders: &'static [&'static str],
    /// For requests, whether only processes on the supervisor's machine may send it.
    pub local_only: bool,
    /// Purpose, one sentence.
    pub doc: &'static str,
}

impl Row {
    /// Whether this role answers, publishes or owns the row.
    #[must_use]
    pub fn belongs_to(&self, role: &str) -> bool {
        self.role == ANY || self.role == role
    }

    /// Whether this role may send the request of the row.
    #[must_use]
    pub fn may_ask(&self, role: &str) -> bool {
        matches!(self.kind, Kind::Request { .. }) && self.senders.iter().any(|s| *s == ANY || *s == role)
    }
}

const CLIENTS: &[&str] = &[role::CLI, role::AGENT_CORE, role::AGENT_FUNCTION];
const SCENE_READERS: &[&str] = &[
    role::CLI,
    role::SELECTION,
    role::LABELING,
    role::RENDER_VIEW,
    role::RENDER_CAPTURE,
    role::AGENT_CORE,
    role::AGENT_FUNCTION,
];

macro_rules! table {
    ($($(#[doc = $doc:literal])+ $ident:ident: $type:ident<$($message:ty),+> = ($role:expr, $name:literal $(, $senders:expr)?)$( at $priority:ident)?$( only $place:ident)?;)*) => {
        $(
            $(#[doc = $doc])+
            pub const $ident: $type<$($message),+> = $type::new($role, $name, $($senders,)? concat!($($doc),+))$(.at(Priority::$priority))?$(.$place())?;
        )*

        /// Every row of the table.
        #[must_use]
        pub fn rows() -> Vec<Row> {
            vec![$($ident.row()),*]
        }
    };
}

table! {
    /// Reports the health of an instance.
    STATUS: Request<bus::StatusRequest, bus::Health> = (ANY, "cmd/status", &[ANY]);
    /// An instance is ready or in standby.
    READY: Stream<bus::Ready> = (ANY, "event/ready");
    /// Health of an instance, every second.
    HEALTH: Stream<bus::Health> = (ANY, "event/health") at Background;
    /// Promotes a standby instance to its role; sent to the instance.
    PROMOTE: Request<bus::PromoteRequest, bus::PromoteReply> = (ANY, "cmd/promote", &[role::SUPERVISOR]);
    /// Cancels a request.
    CANCEL: Request<bus::CancelRequest, bus::CancelReply> = (ANY, "cmd/cancel", &[ANY]) at Interactive;
    /// Reports the metrics of a process.
    METRICS: Request<bus::MetricsRequest, bus::MetricsReply> = (ANY, "cmd/metrics", &[ANY]) at Background;

    /// Applies a scene command, at most once per command id.
    SCENE_APPLY: Request<scene::Command, scene::CommandResult> = (role::SCENE, "cmd/apply", &[role::CLI, role::SELECTION, role::RENDER_VIEW, role::AGENT_FUNCTION]);
    /// Returns the changes after a revision.
    SCENE_CHANGES: Request<scene::ChangesRequest, scene::Changes> = (role::SCENE, "cmd/changes", SCENE_READERS);
    /// A change of the scene, after the journal has stored it.
    SCENE_EVENT: Stream<scene::Event> = (role::SCENE, "event/change") at Interactive;
    /// Measures a target.
    SCENE_MEASURE: Request<scene::MeasureRequest, scene::Measure> = (role::SCENE, "cmd/measure", &[role::CLI, role::AGENT_FUNCTION]);
    /// Lists the geometry files of the scene.
    SCENE_FILES: Request<scene::FilesRequest, scene::Files> = (role::SCENE, "cmd/files", SCENE_READERS);
    /// Returns a part of a geometry file.
    SCENE_CONTENT: Request<bus::ContentRequest, bus::ContentReply> = (role::SCENE, "cmd/content", SCENE_READERS) at Background;
    /// State of the scene, without masks.
    SCENE_STATE: Retained<scene::State> = (role::SCENE, "state");

    /// Adds strokes and commits the resulting selection.
    SELECTION_STROKES: Request<selection::StrokesRequest, selection::StrokesReply> = (role::SELECTION, "cmd/strokes", &[role::CLI, role::RENDER_VIEW, role::AGENT_FUNCTION]) at Interactive;
    /// Previews the selection of an unfinished stroke.
    SELECTION_SAMPLE: Request<selection::SampleRequest, selection::SampleReply> = (role::SELECTION, "cmd/sample", &[role::CLI, role::RENDER_VIEW]) at Interactive;
    /// Previews the selection for another leak or threshold of the random walk.
    SELECTION_TUNE: Request<selection::TuneRequest, selection::TuneReply> = (role::SELECTION, "cmd/tune", &[role::CLI, role::RENDER_VIEW]) at Interactive;
    /// Proposes places for the next stroke.
    SELECTION_PROPOSALS: Request<selection::ProposalsRequest, selection::ProposalsReply> = (role::SELECTION, "cmd/proposals", &[role::CLI, role::RENDER_VIEW]);
    /// Regions of whole Super-Gaussians at several scales.
    SELECTION_REGIONS: Request<selection::RegionsRequest, selection::RegionsReply> = (role::SELECTION, "cmd/regions", &[role::CLI, role::LABELING]) at Background;
    /// Selection of strokes before the scene has committed it.
    SELECTION_PREVIEW: Stream<selection::Preview> = (role::SELECTION, "event/preview") at Interactive;
    /// Returns a part of a file of the selection service, such as the cluster labels.
    SELECTION_CONTENT: Request<bus::ContentRequest, bus::ContentReply> = (role::SELECTION, "cmd/content", &[role::CLI, role::RENDER_VIEW, role::RENDER_CAPTURE, role::LABELING]) at Background;
    /// State of the selection service.
    SELECTION_STATE: Retained<selection::State> = (role::SELECTION, "state");

    /// Finds the units that a text means.
    LABELING_FIND: Request<labeling::FindRequest, labeling::FindReply> = (role::LABELING, "cmd/find", &[role::CLI, role::RENDER_VIEW, role::AGENT_FUNCTION]) at Interactive;
    /// Describes how a unit or the selection looks.
    LABELING_DESCRIBE: Request<labeling::DescribeRequest, labeling::DescribeReply> = (role::LABELING, "cmd/describe", &[role::CLI, role::RENDER_VIEW, role::AGENT_FUNCTION]) at Interactive;
    /// Finds the views that show most of a unit or of the selection.
    LABELING_VIEWS: Request<labeling::ViewsRequest, labeling::ViewsReply> = (role::LABELING, "cmd/views", &[role::CLI, role::RENDER_VIEW, role::AGENT_FUNCTION]);
    /// Progress of the embedding of a unit by its pictures.
    LABELING_EMBEDDING: Stream<labeling::Embedding> = (role::LABELING, "event/embedding") at Background;
    /// State of the labeling service.
    LABELING_STATE: Retained<labeling::State> = (role::LABELING, "state");

    /// Changes the microphone or stops the reply.
    SPEECH_CONTROL: Request<speech::ControlRequest, speech::ControlReply> = (role::SPEECH, "cmd/control", &[role::CLI, role::RENDER_VIEW, role::AGENT_CORE]) at Interactive;
    /// Speaks a text.
    SPEECH_SPEAK: Request<speech::SpeakRequest, speech::SpeakReply> = (role::SPEECH, "cmd/speak", &[role::CLI, role::RENDER_VIEW, role::AGENT_CORE]);
    /// What was recognised of an utterance, while it is heard and at its end.
    SPEECH_RECOGNITION: Stream<speech::Recognition> = (role::SPEECH, "event/recognition") at Interactive;
    /// The state of the speech service has changed.
    SPEECH_CHANGE: Stream<speech::State> = (role::SPEECH, "event/state") at Interactive;
    /// State of the speech service.
    SPEECH_STATE: Retained<speech::State> = (role::SPEECH, "state");

    /// Renders one picture.
    CAPTURE: Request<render::CaptureRequest, render::Frame> = (role::RENDER_CAPTURE, "cmd/capture", CLIENTS) at Background;
    /// Finds the nearest surface at a pixel or along a ray.
    PICK: Request<render::PickRequest, render::PickReply> = (role::RENDER_CAPTURE, "cmd/pick", CLIENTS);
    /// Returns a part of a picture of the capture process.
    CAPTURE_CONTENT: Request<bus::ContentRequest, bus::ContentReply> = (role::RENDER_CAPTURE, "cmd/content", CLIENTS) at Background;
    /// State of the capture process.
    CAPTURE_STATE: Retained<render::State> = (role::RENDER_CAPTURE, "state");
    /// A new picture of the shared view.
    VIEW_FRAME: Stream<render::Frame> = (role::RENDER_VIEW, "event/frame");
    /// Returns a part of a picture of the view process.
    VIEW_CONTENT: Request<bus::ContentRequest, bus::ContentReply> = (role::RENDER_VIEW, "cmd/content", CLIENTS) at Background;
    /// State of the view process.
    VIEW_STATE: Retained<render::State> = (role::RENDER_VIEW, "state");

    /// Sends an utterance to the agents.
    UTTER: Request<language::Utterance, language::Reply> = (role::AGENT_CORE, "cmd/utter", &[role::CLI, role::RENDER_VIEW, role::SPEECH]);
    /// An utterance was received.
    UTTERANCE: Stream<language::Utterance> = (role::AGENT_CORE, "event/utterance");
    /// The core agent requests an observation.
    PERCEIVE: Stream<language::Perceive> = (role::AGENT_CORE, "event/perceive");
    /// Observation of the core agent.
    OBSERVATION: Stream<language::Observation> = (role::AGENT_CORE, "event/observation");
    /// Plan of the core agent.
    PLAN: Stream<language::Plan> = (role::AGENT_CORE, "event/plan");
    /// Reply of the core agent.
    REPLY: Stream<language::Reply> = (role::AGENT_CORE, "event/reply");
    /// State of the core agent.
    CORE_STATE: Retained<language::AgentState> = (role::AGENT_CORE, "state");

    /// Parses an utterance into an intent.
    PARSE: Request<language::IntentRequest, language::Intent> = (role::AGENT_INTENT, "cmd/parse", &[role::AGENT_CORE, role::SUPERVISOR, role::CLI]);
    /// Intent of an utterance.
    INTENT: Stream<language::Intent> = (role::AGENT_INTENT, "event/intent");
    /// State of the intent agent.
    INTENT_STATE: Retained<language::AgentState> = (role::AGENT_INTENT, "state");

    /// Executes a plan.
    EXECUTE: Request<language::Plan, language::PlanResult> = (role::AGENT_FUNCTION, "cmd/execute", &[role::AGENT_CORE]);
    /// Result of one clause.
    ACTION: Stream<language::ActionResult> = (role::AGENT_FUNCTION, "event/action");
    /// State of the function agent.
    FUNCTION_STATE: Retained<language::AgentState> = (role::AGENT_FUNCTION, "state");

    /// Lists the services and their states.
    PS: Request<launch::PsRequest, launch::PsReply> = (role::SUPERVISOR, "cmd/ps", &[role::CLI]);
    /// Restarts a service.
    RESTART: Request<launch::RestartRequest, launch::RestartReply> = (role::SUPERVISOR, "cmd/restart", &[role::CLI]);
    /// Replaces a service by another process.
    SWAP: Request<launch::SwapRequest, launch::SwapReply> = (role::SUPERVISOR, "cmd/swap", &[role::CLI]);
    /// Reloads the launch file.
    RELOAD: Request<launch::ReloadRequest, launch::ReloadReply> = (role::SUPERVISOR, "cmd/reload", &[role::CLI]);
    /// Opens a scene or volume in a new window and session.
    OPEN: Request<launch::OpenRequest, launch::OpenReply> = (role::SUPERVISOR, "cmd/open", &[role::CLI, role::RENDER_VIEW, role::AGENT_FUNCTION]) only local_only;
    /// Writes a file under a path that a person has chosen in a window or in words.
    SAVE: Request<launch::SaveRequest, launch::SaveReply> = (role::SUPERVISOR, "cmd/save", &[role::RENDER_VIEW, role::AGENT_FUNCTION]) only local_only;
    /// A session that was opened from this one has failed.
    OPEN_FAILED: Stream<launch::OpenFailed> = (role::SUPERVISOR, "event/open-failed");
    /// Stops the session.
    DOWN: Request<launch::DownRequest, launch::DownReply> = (role::SUPERVISOR, "cmd/down", &[role::CLI]);
    /// Heartbeat of a joined machine.
    JOIN: Request<launch::JoinRequest, launch::JoinReply> = (role::SUPERVISOR, "cmd/join", &[role::NODE]);
    /// State change of a service.
    SERVICE: Stream<launch::ServiceEvent> = (role::SUPERVISOR, "event/service");

    /// Starts a process on a node; sent to its instance.
    NODE_START: Request<launch::StartRequest, launch::StartReply> = (role::NODE, "cmd/start", &[role::SUPERVISOR]);
    /// Stops or kills a process on a node; sent to its instance.
    NODE_SIGNAL: Request<launch::SignalRequest, launch::SignalReply> = (role::NODE, "cmd/signal", &[role::SUPERVISOR]);
    /// Log lines of processes on a node.
    NODE_LOG: Stream<launch::LogLines> = (role::NODE, "event/log") at Background;
}

/// Key expression of a row for one role of one session.
#[must_use]
pub fn key(session: &str, role: &str, name: &str) -> String {
    format!("{ROOT}/{session}/{role}/{name}")
}

/// Segment that replaces the role in the keys of one instance: `@instance/<instance>`. It works in standby too.
#[must_use]
pub fn instance(instance: &str) -> String {
    format!("@instance/{instance}")
}

/// Instance name of a joined machine. Names of services contain no `:`, so none is equal.
#[must_use]
pub fn node_instance(node: &str) -> String {
    format!("node:{node}")
}

/// Prefix of the instance names of a service. Names of services contain no `.`, so no service has the prefix of another.
#[must_use]
pub fn instance_prefix(service: &str) -> String {
    format!("{service}.")
}

/// Key expression of the liveliness token of an instance.
#[must_use]
pub fn alive(session: &str, role: &str, instance: &str) -> String {
    format!("{ROOT}/{session}/@alive/{role}/{instance}")
}

/// A process on a node.
///
/// A node sends under keys that carry its name, `sg/<session>/@node/<node>/<role>/<instance>/<segment>/<name>`. The router
/// compares this name with the node's certificate, and role and instance with the node's services. So a receiver reads
/// the sender of a message from its key, and need not believe the message.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Identity {
    /// Name of the node: the common name of its certificate.
    pub node: String,
    /// Role.
    pub role: String,
    /// Instance.
    pub instance: String,
}

/// Segment in front of the sender in the keys of nodes.
const NODE: &str = "@node";

impl Identity {
    /// Key expression of a message that this process sends. `rest` is the part behind the session in the same key at home.
    #[must_use]
    pub fn key(&self, session: &str, rest: &str) -> String {
        let Self { node, role, instance } = self;
        format!("{ROOT}/{session}/{NODE}/{node}/{role}/{instance}/{rest}")
    }

    /// Whether this process serves and publishes under a segment: its role, or its instance.
    #[must_use]
    pub fn owns(&self, segment: &str) -> bool {
        segment == self.role || segment.strip_prefix("@instance/") == Some(&self.instance)
    }
}

/// Key expression that matches the messages of every process on every node. `rest` is as in [`Identity::key`].
#[must_use]
pub fn from_nodes(session: &str, rest: &str) -> String {
    format!("{ROOT}/{session}/{NODE}/*/*/*/{rest}")
}

/// Key expression that matches every stream and retained value that nodes publish.
#[must_use]
pub fn all_from_nodes(session: &str) -> String {
    format!("{ROOT}/{session}/{NODE}/**")
}

/// Splits the key of a message: its sender if that is a process on a node, and the part behind the session and the sender.
///
/// `None` for a key of another session, and for an incomplete or ambiguous one.
#[must_use]
pub fn split<'a>(session: &str, key: &'a str) -> Option<(Option<Identity>, &'a str)> {
    let rest = key.strip_prefix(ROOT)?.strip_prefix('/')?.strip_prefix(session)?.strip_prefix('/')?;
    let Some(sent) = rest.strip_prefix(NODE).and_then(|r| r.strip_prefix('/')) else { return Some((None, rest)) };
    // A wildcard stands for several senders.
    if key.contains(['*', '$']) {
        return None;
    }
    let mut parts = sent.splitn(4, '/').map(str::to_owned);
    let identity = Identity { node: parts.next()?, role: parts.next()?, instance: parts.next()? };
    let rest = sent.splitn(4, '/').nth(3)?;
    Some((Some(identity), rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn keys_of_nodes_carry_their_sender() {
        let identity = Identity { node: "gpu1".into(), role: "render-view".into(), instance: "view.3".into() };
        let key = identity.key("s", "scene/cmd/apply");
        assert_eq!(key, "sg/s/@node/gpu1/render-view/view.3/scene/cmd/apply");
        assert_eq!(split("s", &key), Some((Some(identity.clone()), "scene/cmd/apply")));
        assert_eq!(split("s", "sg/s/scene/cmd/apply"), Some((None, "scene/cmd/apply")));
        for bad in ["sg/t/scene/cmd/apply", "sg/s", "sg/s/@node/gpu1/scene", "sg/s/@node/gpu1/scene/$*/scene/state"] {
            assert_eq!(split("s", bad), None, "{bad}");
        }
        assert!(identity.owns("render-view") && identity.owns("@instance/view.3"));
        assert!(!identity.owns("scene") && !identity.owns("@instance/view.30") && !identity.owns("view.3"));
    }

    #[test]
    fn rows_name_known_messages_and_roles() {
        let messages: HashSet<_> = crate::message_names().into_iter().collect();
        let mut seen = HashSet::new();
        for row in rows() {
            assert!(row.role == ANY || role::ALL.contains(&row.role), "{row:?}");
            assert!(row.senders.iter().all(|s| *s == ANY || role::ALL.contains(s)), "{row:?}");
            assert!(seen.insert((row.role, row.name)), "duplicate row {} {}", row.role, row.name);
            let (types, prefix) = match &row.kind {
                Kind::Request { request, reply } => (vec![request, reply], "cmd/"),
                Kind::Stream { message } => (vec![message], "event/"),
                Kind::Retained { message } => (vec![message], "state"),
            };
            assert!(row.name.starts_with(prefix), "{row:?}");
            for name in types {
                assert!(messages.contains(name.as_str()), "{name} is not in the contract");
            }
        }
    }

    #[test]
    fn only_listed_senders_may_send_a_request() {
        let rows = rows();
        let apply = rows.iter().find(|r| r.role == role::SCENE && r.name == "cmd/apply").unwrap();
        assert!(apply.may_ask(role::AGENT_FUNCTION));
        assert!(!apply.may_ask(role::AGENT_INTENT), "the intent agent can't change the scene");
    }
}
