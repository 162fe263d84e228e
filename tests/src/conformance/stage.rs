//! A session for one candidate: router, scene, the other roles it needs, and its own processes.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use sg_proto::bus::{Health, Ready, StatusRequest};
use sg_proto::keys::{self, role};
use sg_runtime::bus::{Bus, RawReply, Subscription, endpoint_of};
use sg_runtime::context::Context;

use super::process::Process;
use super::question::{ANSWER, Question, soon};
use super::{Candidate, Subject};
use crate::commands::apply;
use crate::small_scene;

const SESSION: &str = "conformance";

/// How long the roles that a candidate needs may take to be ready.
const NEIGHBOUR: Duration = Duration::from_secs(60);

/// The surroundings of a candidate: its session, its scene, its callers and the other roles.
pub(super) struct Stage<'a> {
    pub(super) candidate: &'a Candidate,
    pub(super) subject: &'a Subject,
    folder: tempfile::TempDir,
    scene: PathBuf,
    /// The session's router, in the supervisor's role.
    pub(super) router: Bus,
    /// A person at a terminal.
    pub(super) cli: Bus,
    /// The candidate that serves at present.
    pub(super) serving: Option<Process>,
    neighbours: Vec<Process>,
    epoch: u64,
    started: u32,
    asked: u32,
}

/// The executable of this project that fills a role.
fn ours(role: &str) -> Result<PathBuf, String> {
    let name = match role {
        role::RENDER_VIEW | role::RENDER_CAPTURE => "supergaussian-render-node",
        role::SELECTION => "supergaussian-selection",
        role::LABELING => "supergaussian-labeling",
        role::SPEECH => "supergaussian-speech",
        role::AGENT_CORE => "supergaussian-agent-core",
        role::AGENT_INTENT => "supergaussian-agent-intent",
        role::AGENT_FUNCTION => "supergaussian-agent-function",
        _ => "supergaussian-scene",
    };
    crate::executable(name).map_err(|e| e.to_string())
}

impl<'a> Stage<'a> {
    /// Opens the session and starts the roles that the candidate needs.
    pub(super) async fn open(candidate: &'a Candidate, subject: &'a Subject) -> Result<Self, String> {
        let text = |e: &dyn std::fmt::Display| e.to_string();
        let folder = tempfile::tempdir().map_err(|e| text(&e))?;
        let scene = small_scene::write(folder.path()).map_err(|e| text(&e))?;
        let socket = folder.path().join("bus.sock");
        let router = Bus::open_router(SESSION, role::SUPERVISOR, &socket, None).await.map_err(|e| text(&e))?;
        let cli = Bus::connect(SESSION, role::CLI, &endpoint_of(&socket)).await.map_err(|e| text(&e))?;
        let mut stage = Self {
            candidate,
            subject,
            folder,
            scene,
            router,
            cli,
            serving: None,
            neighbours: Vec::new(),
            epoch: 0,
            started: 0,
            asked: 0,
        };
        for role in subject.needs {
            let mut ready = stage.hear_ready(role).await?;
            let params = stage.params(role, &serde_json::Map::new());
            let command = stage.command(&ours(role)?, role, role, &params, &[])?;
            let process = Process::start(command, role, &stage.log(role))?;
            if next_ready(&mut ready, role, NEIGHBOUR).await.is_none() {
                return Err(format!(
                    "`{role}`, which `{}` needs, did not get ready: {}",
                    subject.role,
                    process.last_words()
                ));
            }
            stage.neighbours.push(process);
        }
        Ok(stage)
    }

    /// A name that no other process of the stage has.
    pub(super) fn new_instance(&mut self) -> String {
        self.started += 1;
        format!("candidate-{}", self.started)
    }

    /// An id that no other question of the stage has.
    pub(super) fn new_id(&mut self) -> String {
        self.asked += 1;
        format!("conformance-{}-{}", std::process::id(), self.asked)
    }

    /// The next epoch of the role.
    pub(super) fn next_epoch(&mut self) -> u64 {
        self.epoch += 1;
        self.epoch
    }

    /// The present epoch of the role.
    pub(super) fn epoch(&self) -> u64 {
        self.epoch
    }

    fn params(&self, role: &str, given: &serde_json::Map<String, serde_json::Value>) -> String {
        let mut params = given.clone();
        if role == role::SCENE {
            params.insert("scene".to_owned(), self.scene.display().to_string().into());
        }
        serde_json::Value::Object(params).to_string()
    }

    fn log(&self, instance: &str) -> PathBuf {
        self.folder.path().join(format!("{instance}.log"))
    }

    fn command(
        &self,
        executable: &Path,
        role: &str,
        instance: &str,
        params: &str,
        more: &[&str],
    ) -> Result<Command, String> {
        let mut command = Command::new(executable);
        command
            .args(self.arguments(role, instance, params)?)
            .args(["--supervisor-pid", &std::process::id().to_string()]);
        command.args(more);
        self.apart(&mut command);
        Ok(command)
    }

    /// A scene that is given no project keeps it here, and not among the user's.
    fn apart(&self, command: &mut Command) {
        command.env("XDG_DATA_HOME", self.folder.path().join("data"));
    }

    fn arguments(&self, role: &str, instance: &str, params: &str) -> Result<Vec<String>, String> {
        let params_file = self.folder.path().join(format!("{instance}.json"));
        std::fs::write(&params_file, params).map_err(|e| format!("{}: {e}", params_file.display()))?;
        let params_file = params_file.display().to_string();
        let run_dir = self.folder.path().display().to_string();
        let connect = endpoint_of(&self.folder.path().join("bus.sock"));
        let words = [
            "serve",
            "--session",
            SESSION,
            "--role",
            role,
            "--instance",
            instance,
            "--connect",
            &connect,
            "--run-dir",
            &run_dir,
            "--params-file",
            &params_file,
        ];
        Ok(words.map(str::to_owned).to_vec())
    }

    /// Starts the candidate with further arguments.
    pub(super) fn start(&mut self, instance: &str, more: &[&str]) -> Result<Process, String> {
        let role = self.subject.role;
        let params = self.params(role, &self.candidate.params);
        self.start_as(instance, role, &params, more)
    }

    /// Starts the candidate in any role, with any parameters.
    pub(super) fn start_as(&self, instance: &str, role: &str, params: &str, more: &[&str]) -> Result<Process, String> {
        let command = self.command(&self.candidate.executable, role, instance, params, more)?;
        Process::start(command, instance, &self.log(instance))
    }

    /// Starts the candidate below another process, its supervisor. Returns the supervisor.
    pub(super) fn start_below_another(&self, instance: &str) -> Result<Process, String> {
        let role = self.subject.role;
        let params = self.params(role, &self.candidate.params);
        let mut command = Command::new("sh");
        // The shell stays the parent as long as it waits.
        command.args(["-c", "\"$@\" --supervisor-pid $$ & wait", "sh"]).arg(&self.candidate.executable);
        command.args(self.arguments(role, instance, &params)?);
        self.apart(&mut command);
        Process::start(command, instance, &self.log(instance))
    }

    /// Starts the candidate under the next epoch and waits until it serves.
    pub(super) async fn serve(&mut self) -> Result<Ready, String> {
        let (instance, epoch) = (self.new_instance(), self.next_epoch().to_string());
        let mut heard = self.hear_ready(self.subject.role).await?;
        let mut process = self.start(&instance, &["--epoch", &epoch])?;
        let ready = next_ready(&mut heard, &instance, self.candidate.ready).await;
        let Some(ready) = ready else {
            let how = match process.end(Duration::ZERO).await {
                Some(ended) => format!("it ended with status {:?}", ended.status),
                None => "it runs".to_owned(),
            };
            let seconds = self.candidate.ready.as_secs_f64();
            return Err(format!("not ready within {seconds} s; {how}; its last words: {}", process.last_words()));
        };
        self.serving = Some(process);
        Ok(ready)
    }

    /// Kills the candidate as `kill -9` does and starts it again.
    pub(super) async fn kill_and_serve(&mut self) -> Result<Ready, String> {
        self.serving.take().ok_or("no candidate serves")?.kill();
        self.serve().await
    }

    /// All announcements of a role from now on; `@instance/*` for those that stand by.
    pub(super) async fn hear_ready(&self, segment: &str) -> Result<Subscription<Ready>, String> {
        self.router.subscribe(&keys::READY, segment, 64).await.map_err(|e| e.to_string())
    }

    /// A bus in the name of a role, for requests that only this role may send.
    pub(super) async fn join(&self, role: &str) -> Result<Bus, String> {
        let endpoint = endpoint_of(&self.folder.path().join("bus.sock"));
        Bus::connect(SESSION, role, &endpoint).await.map_err(|e| e.to_string())
    }

    /// Puts the role's question under an id.
    pub(super) async fn ask(&self, id: &str) -> Result<Vec<u8>, String> {
        let question = (self.subject.question)(id);
        let heard = self.put(&question, id).await;
        question.replied(heard)
    }

    /// Puts any question to the role.
    pub(super) async fn put(&self, question: &Question, id: &str) -> RawReply {
        self.cli.ask_raw(self.subject.role, question.name, &question.raw(id), ANSWER).await
    }

    /// The part of an answer that must stay the same.
    pub(super) async fn essence(&self, id: &str) -> Result<String, String> {
        (self.subject.essence)(&self.ask(id).await?)
    }

    /// How the process in this place is: a role, or an instance.
    pub(super) async fn health(&self, segment: &str) -> Result<Health, String> {
        let health = self.cli.ask_role(&keys::STATUS, segment, &StatusRequest {}, &soon()).await;
        health.map_err(|fault| format!("cmd/status of {segment}: {fault}"))
    }

    /// The newest scene state, from the scene role.
    pub(super) async fn scene_state(&self) -> Result<sg_proto::scene::State, String> {
        self.cli.newest(&keys::SCENE_STATE, &soon()).await.map_err(|f| format!("the scene's state: {f}"))
    }

    /// Changes the scene as a person at a terminal would.
    pub(super) async fn change(
        &mut self,
        action: sg_proto::scene::command::Action,
    ) -> Result<sg_proto::scene::CommandResult, String> {
        let context = soon().with_id(self.new_id());
        apply(&self.cli, action, &context).await.map_err(|f| format!("cmd/apply: {f}"))
    }
}

/// The announcement of an instance.
pub(super) async fn next_ready(heard: &mut Subscription<Ready>, instance: &str, within: Duration) -> Option<Ready> {
    let one = async {
        while let Some((ready, _)) = heard.next().await {
            if ready.instance == instance {
                return Some(ready);
            }
        }
        None
    };
    tokio::time::timeout(within, one).await.ok().flatten()
}

/// The next message of a stream that is the one meant.
pub(super) async fn next_of<M: Clone>(
    heard: &mut Subscription<M>,
    what: &str,
    mut is_meant: impl FnMut(&M, &Context) -> bool,
) -> Result<(M, Context), String> {
    let one = async {
        while let Some((message, context)) = heard.next().await {
            if is_meant(&message, &context) {
                return Some((message, context));
            }
        }
        None
    };
    tokio::time::timeout(ANSWER, one)
        .await
        .ok()
        .flatten()
        .ok_or_else(|| format!("no {what} within {} s", ANSWER.as_secs()))
}

/// Decodes a message that came byte for byte.
pub(super) fn decode<M: prost::Message + Default>(payload: &[u8]) -> Result<M, String> {
    M::decode(payload).map_err(|e| format!("malformed answer: {e}"))
}

/// A message as text that is the same for the same content.
pub(super) fn text_of<M: prost::Message>(message: &M) -> String {
    message.encode_to_vec().iter().map(|b| format!("{b:02x}")).collect()
}
