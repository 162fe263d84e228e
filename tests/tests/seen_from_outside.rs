//! The view of a running stack from outside: visible to an operator, hidden from the rest of the world.

#![allow(clippy::panic, clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::future::Future;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt as _;
use std::pin::Pin;
use std::process::{Child, ChildStdin, Stdio};
use std::sync::{Arc, Mutex, mpsc};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sg_tests::said;
use sg_tests::stack::{SESSION, Stack};
use sg_tests::until::PATIENCE;
use tokio::net::TcpListener;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::body::Body;
use tonic::codegen::http::{Request, Response};
use tonic::server::{NamedService, UnaryService};
use tonic::transport::Server;
use tonic_prost::ProstCodec;

/// The fields of OpenTelemetry's export request that the test reads.
mod otlp {
    #[derive(Clone, PartialEq, prost::Message)]
    pub(crate) struct Export {
        #[prost(message, repeated, tag = "1")]
        pub(crate) resources: Vec<Resource>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    pub(crate) struct Resource {
        #[prost(message, repeated, tag = "2")]
        pub(crate) scopes: Vec<Scope>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    pub(crate) struct Scope {
        #[prost(message, repeated, tag = "2")]
        pub(crate) spans: Vec<Span>,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    pub(crate) struct Span {
        #[prost(bytes = "vec", tag = "1")]
        pub(crate) trace: Vec<u8>,
        #[prost(bytes = "vec", tag = "2")]
        pub(crate) id: Vec<u8>,
        #[prost(bytes = "vec", tag = "4")]
        pub(crate) parent: Vec<u8>,
        #[prost(string, tag = "5")]
        pub(crate) name: String,
    }

    #[derive(Clone, PartialEq, prost::Message)]
    pub(crate) struct Exported {}
}

/// A collector that keeps everything that it receives.
#[derive(Clone, Default)]
struct Collector(Arc<Mutex<Vec<otlp::Span>>>);

impl NamedService for Collector {
    const NAME: &'static str = "opentelemetry.proto.collector.trace.v1.TraceService";
}

impl UnaryService<otlp::Export> for Collector {
    type Response = otlp::Exported;
    type Future = Pin<Box<dyn Future<Output = Result<tonic::Response<otlp::Exported>, tonic::Status>> + Send>>;

    fn call(&mut self, request: tonic::Request<otlp::Export>) -> Self::Future {
        let resources = request.into_inner().resources;
        self.0.lock().unwrap().extend(resources.into_iter().flat_map(|r| r.scopes).flat_map(|s| s.spans));
        Box::pin(std::future::ready(Ok(tonic::Response::new(otlp::Exported {}))))
    }
}

impl tower::Service<Request<Body>> for Collector {
    type Response = Response<Body>;
    type Error = std::convert::Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Self::Error>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Self::Error>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let collector = self.clone();
        Box::pin(async move {
            let mut grpc = tonic::server::Grpc::new(ProstCodec::<otlp::Exported, otlp::Export>::default());
            Ok(grpc.unary(collector, request).await)
        })
    }
}

/// Sockets that wait for connections or datagrams from a network, by inode.
fn open_to_the_network() -> HashSet<String> {
    const LISTEN: &str = "0A";
    let mut inodes = HashSet::new();
    for (table, any_state) in [("tcp", false), ("tcp6", false), ("udp", true), ("udp6", true)] {
        let text = std::fs::read_to_string(format!("/proc/net/{table}")).unwrap_or_default();
        for line in text.lines().skip(1) {
            let fields: Vec<_> = line.split_whitespace().collect();
            if any_state || fields[3] == LISTEN {
                inodes.insert(fields[9].to_owned());
            }
        }
    }
    inodes
}

/// Inodes of the sockets that a process holds.
fn sockets_of(pid: u64) -> HashSet<String> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap();
    let links = entries.flatten().filter_map(|e| std::fs::read_link(e.path()).ok());
    links.filter_map(|l| Some(l.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned())).collect()
}

#[test]
fn nothing_listens_metrics_are_counted_and_one_trace_runs_through_the_loop() {
    // A collector on this machine, as an operator would name it.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let collector = Collector::default();
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
    let endpoint = format!("http://{}", listener.local_addr().unwrap());
    let serving = Server::builder().add_service(collector.clone());
    runtime.spawn(serving.serve_with_incoming(TcpListenerStream::new(listener)));

    let env = [("OTEL_EXPORTER_OTLP_ENDPOINT", endpoint.as_str())];
    let stack = Stack::up_in(&[], &env).unwrap();

    // Nothing is open to the network. Only its user can open the folder of the session.
    let services = stack.ps();
    let open = open_to_the_network();
    let pids = services.iter().map(|s| s["pid"].as_u64().unwrap()).chain([u64::from(stack.supervisor())]);
    for pid in pids {
        let sockets = sockets_of(pid);
        assert!(!sockets.is_empty(), "process {pid} has no sockets at all; it should be on the bus");
        assert!(sockets.is_disjoint(&open), "process {pid} listens to the network");
    }
    let mode = std::fs::metadata(stack.session_folder()).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o700);

    // One utterance through the whole loop.
    let mut say = stack.command().unwrap();
    let output = say.args(["say", "hide everything"]).envs(env).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));

    // Counted, in each process.
    let (_, text, _) = stack.run(&["metrics"]).unwrap();
    let families: BTreeMap<&str, usize> = text
        .lines()
        .filter_map(|l| l.strip_prefix("# TYPE ")?.split(' ').next())
        .fold(BTreeMap::new(), |mut all, f| {
            *all.entry(f).or_default() += 1;
            all
        });
    assert!(families.len() > 6 && families.values().all(|n| *n == 1), "{families:?}");
    for service in &services {
        let role = service["role"].as_str().unwrap();
        let ready = "supergaussian_service_ready{";
        assert!(
            text.lines()
                .any(|l| l.starts_with(ready) && l.contains(&format!("service=\"{role}\"")) && l.ends_with(" 1")),
            "{role}\n{text}"
        );
        assert!(
            text.lines()
                .any(|l| l.starts_with("supergaussian_memory_bytes{") && l.contains(&format!("role=\"{role}\""))),
            "{role}\n{text}"
        );
    }
    let applied = text
        .lines()
        .find(|l| {
            l.starts_with("supergaussian_serve_seconds_count{") && l.contains("cmd/apply") && l.contains("code=\"OK\"")
        })
        .unwrap_or_else(|| panic!("{text}"));
    assert!(applied.contains("role=\"scene\"") && applied.ends_with(" 1"), "{applied}");

    // The same over HTTP, for Prometheus; to this machine alone.
    let (status, _, all) = stack.run(&["metrics", "--listen", "0.0.0.0:0"]).unwrap();
    assert_eq!(status, Some(2), "{all}");
    let mut serving = stack.command().unwrap();
    let mut serving = serving.args(["metrics", "--listen", "127.0.0.1:0"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut url = String::new();
    BufReader::new(serving.stdout.take().unwrap()).read_line(&mut url).unwrap();
    let address = url.trim().trim_start_matches("http://").trim_end_matches("/metrics").to_owned();
    let mut stream = TcpStream::connect(&address).unwrap();
    write!(stream, "GET /metrics HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
    let mut page = String::new();
    stream.read_to_string(&mut page).unwrap();
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("text/plain; version=0.0.4"), "{page}");
    assert!(page.contains("supergaussian_uptime_seconds{"), "{page}");
    serving.kill().unwrap();
    serving.wait().unwrap();

    // A line of a service's log carries the trace.
    let log = std::fs::read_to_string(stack.session_folder().join("logs/scene.log")).unwrap();
    let line = log.lines().find(|l| l.contains("\"command\"")).unwrap_or_else(|| panic!("{log}"));
    let line: Value = serde_json::from_str(line).unwrap();
    let trace = line["span"]["trace_id"].as_str().unwrap().to_owned();
    assert_eq!(trace.len(), 32, "{line}");

    // And the collector has that trace, from the core agent to the scene. Every span but the first has a parent in it.
    let hex = |bytes: &[u8]| bytes.iter().map(|b| format!("{b:02x}")).collect::<String>();
    let wanted = ["serve cmd/utter", "serve cmd/parse", "serve cmd/execute", "serve cmd/apply", "serve cmd/capture"];
    let begun = Instant::now();
    loop {
        let spans: Vec<_> = collector.0.lock().unwrap().iter().filter(|s| hex(&s.trace) == trace).cloned().collect();
        let names: BTreeSet<_> = spans.iter().map(|s| s.name.as_str()).collect();
        if wanted.iter().all(|w| names.contains(w)) && names.contains("ask agent-core cmd/utter") {
            let ids: HashSet<_> = spans.iter().map(|s| s.id.clone()).collect();
            let orphans: Vec<_> =
                spans.iter().filter(|s| !s.parent.is_empty() && !ids.contains(&s.parent)).map(|s| &s.name).collect();
            assert!(orphans.is_empty(), "{orphans:?}");
            assert_eq!(spans.iter().filter(|s| s.parent.is_empty()).count(), 1, "{spans:?}");
            assert_eq!(ids.len(), spans.len(), "a span is told once");
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "{trace}: {names:?}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn an_operator_lists_copies_and_deletes_the_project_of_a_scene() {
    let mut stack = Stack::up().unwrap();
    let run = |stack: &Stack, arguments: &[&str]| stack.run(arguments).unwrap();
    let (status, _, all) = run(&stack, &["say", "make the sac red"]);
    assert_eq!(status, Some(0), "{all}");
    let listed = |stack: &Stack| -> Vec<Value> {
        let (status, text, all) = stack.run(&["projects", "--json"]).unwrap();
        assert_eq!(status, Some(0), "{all}");
        serde_json::from_str(&text).unwrap()
    };
    let projects = listed(&stack);
    assert!(projects.len() == 1 && projects[0]["in_use"] == true && projects[0]["revision"] == 1, "{projects:?}");
    let name = projects[0]["name"].as_str().unwrap();
    let (_, table, _) = run(&stack, &["projects"]);
    assert!(table.contains(name) && table.contains("yes") && table.contains("scene.toml"), "{table}");

    let copy = stack.folder().join("copy.sgproj").display().to_string();
    let (status, _, all) = run(&stack, &["backup", name, &copy]);
    assert_eq!(status, Some(0), "{all}");
    for (arguments, want, said) in [
        (&["backup", name, &copy][..], 2, "exists already"),
        (&["restore", &copy, name], 2, "exists already"),
        (&["projects", "delete", name], 1, "in use"),
        (&["projects", "delete", "none"], 2, "no project `none`"),
        (&["projects", "open", "none"], 2, "no project `none`"),
        (&["projects", "open", name], 1, "DISPLAY is not set"),
    ] {
        let (status, _, all) = run(&stack, arguments);
        assert!(status == Some(want) && all.contains(said), "{arguments:?}: {all}");
    }

    // Another scene under the same launch file: not into a running session, whose other services have loaded this one.
    let other = stack.folder().join("body.ply").display().to_string();
    let (status, _, all) = stack.up_again(&[format!("service.scene.params.scene={other}")]).unwrap();
    assert!(status != Some(0) && all.contains("the session shows another scene"), "{all}");
    let (status, _, all) = run(&stack, &["say", "make the sac blue"]);
    assert_eq!(status, Some(0), "{all}");
    assert!(stack.ps().iter().all(|s| s["state"] == "READY" && s["restarts"] == 0), "{:?}", stack.ps());

    let (status, _, all) = run(&stack, &["down"]);
    assert_eq!(status, Some(0), "{all}");
    assert_eq!(stack.ended(Duration::from_secs(10)), Some(Some(0)));
    let projects = listed(&stack);
    assert!(projects.len() == 1 && projects[0]["in_use"] == false && projects[0]["revision"] == 2, "{projects:?}");
    assert_eq!(run(&stack, &["projects", "delete", name]).0, Some(0));
    assert_eq!(listed(&stack).len(), 0);
    assert_eq!(run(&stack, &["restore", &copy, name]).0, Some(0));
    assert_eq!(listed(&stack)[0]["revision"], 1);
}

/// A client of the Model Context Protocol with `supergaussian mcp` as its child.
struct McpClient {
    child: Child,
    input: Option<ChildStdin>,
    lines: mpsc::Receiver<String>,
    sent: u64,
}

impl McpClient {
    fn start(stack: &Stack) -> Self {
        let mut mcp = stack.command().unwrap();
        let mcp = mcp.args(["mcp", "--session", SESSION]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = mcp.spawn().unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = mpsc::channel();
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        let input = child.stdin.take();
        let mut client = Self { child, input, lines, sent: 0 };
        let hello = json!({
            "protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"},
        });
        let info = client.ask("initialize", &hello);
        assert_eq!(info["serverInfo"]["name"], "supergaussian", "{info}");
        client.send(&json!({"jsonrpc": "2.0", "method": "notifications/initialized"}));
        client
    }

    fn send(&mut self, message: &Value) {
        let input = self.input.as_mut().unwrap();
        writeln!(input, "{message}").unwrap();
        input.flush().unwrap();
    }

    /// Sends a request, and gives its result. Nothing but messages of the protocol may come.
    fn ask(&mut self, method: &str, params: &Value) -> Value {
        self.sent += 1;
        let id = self.sent;
        self.send(&json!({"jsonrpc": "2.0", "id": id, "method": method, "params": params}));
        loop {
            let line = self.lines.recv_timeout(PATIENCE).unwrap();
            let answer: Value = serde_json::from_str(&line).unwrap();
            assert_eq!(answer["jsonrpc"], "2.0", "{line}");
            if answer["id"] == id {
                assert!(answer["error"].is_null(), "{method}: {line}");
                return answer["result"].clone();
            }
        }
    }

    fn call(&mut self, tool: &str, arguments: &Value) -> Value {
        self.ask("tools/call", &json!({"name": tool, "arguments": arguments}))
    }

    /// The content of a call that succeeds.
    fn done(&mut self, tool: &str, arguments: &Value) -> Value {
        let result = self.call(tool, arguments);
        assert_eq!(result["isError"], false, "{tool}: {result}");
        result["structuredContent"].clone()
    }

    /// The line of a call that fails.
    fn failed(&mut self, tool: &str, arguments: &Value) -> String {
        let result = self.call(tool, arguments);
        assert_eq!(result["isError"], true, "{tool}: {result}");
        result["content"][0]["text"].as_str().unwrap().to_owned()
    }

    /// A unit of the scene.
    fn unit(&mut self, name: &str) -> Value {
        let scene = self.done("scene", &json!({}));
        let units = scene["base_units"].as_array().unwrap().clone();
        units.into_iter().find(|unit| unit["name"] == name).unwrap()
    }
}

impl Drop for McpClient {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn colored(unit: &str, red: f64) -> Value {
    json!({"act": "ACT_SET_COLOR", "target": {"names": [unit]}, "color": {"red": red, "green": 0, "blue": 0}})
}

fn hidden(unit: &str) -> Value {
    json!({"act": "ACT_HIDE", "target": {"names": [unit]}})
}

#[test]
fn a_client_of_the_model_context_protocol_edits_and_sees_the_scene() {
    let stack = Stack::up().unwrap();
    let mut client = McpClient::start(&stack);
    let tools = client.ask("tools/list", &json!({}));
    let names: Vec<&str> = tools["tools"].as_array().unwrap().iter().map(|t| t["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["command", "say", "scene", "screenshot", "undo", "redo"]);

    // Two actions are one thing to take back.
    let before = client.unit("sac");
    let done = client.done("command", &json!({"clauses": [colored("sac", 1.0), hidden("body")]}));
    assert_eq!((&done["changed_units"], &done["undo_steps"]), (&json!(["sac", "body"]), &json!(2)), "{done}");
    assert_eq!(client.unit("sac")["color"], json!({"red": 1.0, "green": 0.0, "blue": 0.0}));
    assert_eq!(client.unit("body")["visible"], false);
    let picture = client.call("screenshot", &json!({"width": 64, "height": 48}));
    let image = &picture["content"][1];
    assert_eq!((&image["type"], &image["mimeType"]), (&json!("image"), &json!("image/png")), "{picture}");
    // The signature of PNG in base64.
    assert!(image["data"].as_str().unwrap().starts_with("iVBORw0KGgo"), "{picture}");
    assert!(picture["content"][0]["text"].as_str().unwrap().starts_with("64 x 48 pixels"), "{picture}");
    assert_eq!(client.done("undo", &json!({}))["steps"], 2);
    assert_eq!((client.unit("sac"), &client.unit("body")["visible"]), (before.clone(), &json!(true)));
    assert_eq!(client.done("redo", &json!({}))["steps"], 2);
    assert_eq!(client.unit("body")["visible"], false);
    assert_eq!(client.done("undo", &json!({"steps": 2}))["steps"], 2);

    // All of the actions, or none.
    let line = client.failed("command", &json!({"clauses": [colored("sac", 1.0), hidden("grumpf")]}));
    assert!(line.contains("The actions before it were taken back."), "{line}");
    assert_eq!(client.unit("sac"), before);
    let line = client.failed("command", &json!({"clauses": [colored("sac", 2.0)]}));
    assert!(line.contains("`clauses[0].color.red` is 2; use a number from 0 to 1"), "{line}");

    // Sentences, but none that writes a file.
    let done = client.done("say", &json!({"text": "make the sac blue"}));
    assert!(done["reply"].as_str().unwrap().contains("blue"), "{done}");
    let line = client.failed("say", &json!({"text": "hide the sac and save a picture as front.png"}));
    assert!(line.contains("Files are only saved and opened for a person"), "{line}");
    assert_eq!(client.unit("sac")["visible"], true);
    let line = client.failed("shell", &json!({"text": "ls"}));
    assert!(line.contains("no tool `shell`"), "{line}");

    // The client closes its end, and the server is done.
    client.input = None;
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = client.child.try_wait().unwrap() {
            break status;
        }
        assert!(begun.elapsed() < PATIENCE, "the server goes on without its client");
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(status.success(), "{status}");
}
