//! From a document to a launch file. Every mistake carries its place.

use std::collections::HashSet;
use std::path::Path;

use sg_proto::keys::role;

use super::executables::ExecutableSearch;
use super::model::{self, Confinement, LaunchFile, Policy, Restart, Service, Start};
use super::names::{MAX_SERVICE_NAME, is_name};
use super::nodes;
use super::order::{self, Edge};
use crate::document::{self, MAX_PROBLEMS, Node, Problem, Problems, Reader, Table, Value};
use crate::suggestion::suggestion;

/// Version of the language.
const SCHEMA: i64 = 1;
/// Largest limit on a service's memory, mebibytes: 16 TiB.
const MAX_MEMORY_MIB: i64 = 16 << 20;
/// Most paths in a list of a service.
const MAX_PATHS: usize = 64;
/// Most services of one file.
const MAX_SERVICES: usize = 256;

/// Text of a launch file, with overrides.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The file as the user named it, for messages and relative executables.
    pub path: &'a Path,
    /// Its text.
    pub text: &'a str,
    /// Overrides `a.b=c`, in order.
    pub overrides: &'a [String],
}

/// Policy and environment from `[defaults]`.
#[derive(Debug, Clone, Default)]
struct Defaults {
    policy: Policy,
    env: Vec<(String, String)>,
}

/// Reads and checks a launch file.
///
/// # Errors
/// All mistakes: syntax, unknown keys, wrong values, unknown names, duplicate roles, cycles, missing executables.
pub fn read(source: Source<'_>, search: &ExecutableSearch) -> Result<LaunchFile, Problems> {
    let mut problems = Vec::new();
    let file = match parse(source) {
        Err(problem) => {
            problems.push(problem);
            None
        }
        Ok(table) => Some(launch_file(&table, source.path, search, &mut problems)),
    };
    match file {
        Some(file) if problems.is_empty() => Ok(file),
        _ => Err(document::in_order(source.path, problems)),
    }
}

fn parse(source: Source<'_>) -> Result<Table, Problem> {
    let mut table = document::parse(source.text)?;
    for set in source.overrides {
        document::override_with(&mut table, set)?;
    }
    Ok(table)
}

fn launch_file(table: &Table, path: &Path, search: &ExecutableSearch, problems: &mut Vec<Problem>) -> LaunchFile {
    let start = document::Place::File { line: 1, column: 1 };
    let mut top = Reader::new("the file", table, problems);
    match top.node("schema") {
        None => top.problem(&start, format!("`schema` is missing; begin the file with `schema = {SCHEMA}`")),
        Some(Node { value: Value::Integer(SCHEMA), .. }) => {}
        Some(node) => top.problem(&node.place, format!("this version reads schema {SCHEMA} only")),
    }
    let name = top.string("name").map(str::to_owned);
    if let Some(name) = &name
        && let Err(error) = sg_runtime::session::SessionDir::named(name)
        && let Some(place) = top.node("name").map(|n| n.place.clone())
    {
        top.problem(&place, error.to_string());
    }
    let defaults = top.table("defaults");
    let services = top.table("service");
    let (bus, nodes) = (top.table("bus"), top.table("node"));
    if services.is_none_or(|t| t.entries.is_empty()) {
        top.problem(&start, "no service; add a table such as `[service.scene]`");
    }
    top.finish();
    let listen = nodes::listening(bus, path, problems);
    let nodes = nodes::read_nodes(nodes, listen.is_some(), problems);

    let mut base = Defaults::default();
    if let Some(defaults) = defaults {
        let mut reader = Reader::new("[defaults]", defaults, problems);
        read_policy(&mut reader, &mut base);
        reader.finish();
    }
    let entries = services.map_or(&[][..], |t| &t.entries);
    if let Some(extra) = entries.get(MAX_SERVICES) {
        let text = format!("more than {MAX_SERVICES} services");
        problems.push(Problem { place: extra.place.clone(), text });
    }
    let mut edges = Vec::new();
    let mut read = Vec::new();
    for entry in entries.iter().take(MAX_SERVICES) {
        let Value::Table(table) = &entry.node.value else {
            let text = format!("`{}` must be a table; write `[service.{}]`", entry.key, entry.key);
            problems.push(Problem { place: entry.place.clone(), text });
            continue;
        };
        if !is_name(&entry.key) {
            let text = format!("service `{}`: use 1 to {MAX_SERVICE_NAME} letters, digits, `-` or `_`", entry.key);
            problems.push(Problem { place: entry.place.clone(), text });
        }
        if entry.key == role::SUPERVISOR {
            let text = "service `supervisor`: the supervisor's own log has this name; choose another one";
            problems.push(Problem { place: entry.place.clone(), text: text.to_owned() });
        }
        read.push(service(entry, table, &base, &nodes, &mut edges, path, search, problems));
    }
    duplicate_roles(&read, problems);
    let names: Vec<_> = entries.iter().take(MAX_SERVICES).map(|e| e.key.as_str()).collect();
    edges.retain(|edge| {
        let known = names.contains(&edge.on.as_str());
        if !known {
            // Suggestions take time, and only the first mistakes are reported.
            let is_reported = problems.len() < MAX_PROBLEMS;
            let text = format!("`{}` comes after `{}`, which is no service{}", edge.from, edge.on, {
                suggestion(&edge.on, names.iter().copied().filter(|n| is_reported && *n != edge.from))
            });
            problems.push(Problem { place: edge.place.clone(), text });
        }
        known
    });
    problems.extend(order::cycles(&names, &edges));
    order::sort(&mut read);
    LaunchFile { name, services: read, listen, nodes }
}

#[allow(clippy::too_many_arguments, reason = "what one table may refer to")]
fn service(
    entry: &document::Entry,
    table: &Table,
    base: &Defaults,
    nodes: &[model::Node],
    edges: &mut Vec<Edge>,
    path: &Path,
    search: &ExecutableSearch,
    problems: &mut Vec<Problem>,
) -> Service {
    let mut reader = Reader::new(format!("[service.{}]", entry.key), table, problems);
    let exec = reader.string("exec");
    let on = nodes::node_of(&mut reader, nodes);
    let mut executable = None;
    match exec {
        Some(name) if on.is_some() => {
            if name.contains('/')
                && let Some(place) = reader.node("exec").map(|n| n.place.clone())
            {
                let text = format!(
                    "`{name}`: a service on another machine needs a name without a path, because the node looks it up"
                );
                reader.problem(&place, text);
            }
            executable = Some(name.into());
        }
        None if reader.node("exec").is_none() => {
            reader.problem(&entry.place, format!("service `{}` has no `exec`", entry.key));
        }
        None => {}
        Some(exec) => match search.find(exec, path) {
            Ok(found) => executable = Some(found),
            Err(error) => {
                if let Some(place) = reader.node("exec").map(|n| n.place.clone()) {
                    reader.problem(&place, error.to_string());
                }
            }
        },
    }
    let role = reader.string("role").unwrap_or(&entry.key).to_owned();
    if !is_name(&role) || role::NON_SERVICES.contains(&role.as_str()) {
        let place = reader.node("role").map_or_else(|| entry.place.clone(), |n| n.place.clone());
        let text = format!("role `{role}`: use letters, digits, `-` or `_`, and none of `supervisor`, `cli`, `node`");
        reader.problem(&place, text);
    }
    let params = reader.table("params").map(Table::to_json).unwrap_or_default();
    let mut after = Vec::new();
    let conditions = reader.table("after").map_or(&[][..], |t| &t.entries);
    if let Some(extra) = conditions.get(MAX_SERVICES) {
        reader.problem(&extra.place, format!("`after` names more than {MAX_SERVICES} services"));
    }
    for condition in conditions.iter().take(MAX_SERVICES) {
        match &condition.node.value {
            Value::String(s) if s == "ready" => {}
            Value::String(s) => {
                let hint = suggestion(s, ["ready"]);
                reader.problem(&condition.node.place, format!("unknown condition `{s}`{hint}"));
            }
            _ => reader.problem(&condition.node.place, format!("write `{} = \"ready\"`", condition.key)),
        }
        after.push(condition.key.clone());
        edges.push(Edge { from: entry.key.clone(), on: condition.key.clone(), place: condition.place.clone() });
    }
    let mut own = base.clone();
    read_policy(&mut reader, &mut own);
    let confinement = confinement(&mut reader, path, on.as_deref());
    reader.finish();
    let exec = exec.unwrap_or_default().to_owned();
    Service {
        name: entry.key.clone(),
        role,
        start: Start { exec, executable: executable.unwrap_or_default(), params, env: own.env, node: on, confinement },
        after,
        policy: own.policy,
        place: entry.place.clone(),
    }
}

/// Reads the keys of the confinement. On a node they are the node's matter.
fn confinement(reader: &mut Reader<'_, '_>, file: &Path, on: Option<&str>) -> Confinement {
    let mut own = Confinement::default();
    if let Some(confined) = reader.boolean("confined") {
        own.confined = confined;
    }
    for (key, paths) in [("read", &mut own.read), ("write", &mut own.write)] {
        let Some(node) = reader.node(key) else { continue };
        let Value::Array(items) = &node.value else {
            reader.problem(&node.place, format!("`{key}` must be a list of paths"));
            continue;
        };
        if items.len() > MAX_PATHS {
            reader.problem(&node.place, format!("`{key}` has more than {MAX_PATHS} paths"));
        }
        for item in items.iter().take(MAX_PATHS) {
            let Value::String(text) = &item.value else {
                reader.problem(&item.place, format!("`{key}` must be a list of paths, each a string"));
                continue;
            };
            match std::path::absolute(file.parent().unwrap_or(Path::new("")).join(text)) {
                Ok(path) => paths.push(path),
                Err(error) => reader.problem(&item.place, format!("`{key}`: `{text}`: {error}")),
            }
        }
    }
    if let Some(on) = on
        && own != Confinement::default()
        && let Some(place) =
            ["confined", "read", "write"].into_iter().find_map(|key| Some(reader.node(key)?.place.clone()))
    {
        let text =
            format!("`read`, `write` and `confined` of a service on `{on}` are options of `supergaussian join` there");
        reader.problem(&place, text);
    }
    own
}

/// Reads the policy keys of a table over the defaults.
fn read_policy(reader: &mut Reader<'_, '_>, base: &mut Defaults) {
    let Defaults { policy, env: variables } = base;
    const RESTART: [(&str, Restart); 3] =
        [("always", Restart::Always), ("on-failure", Restart::OnFailure), ("never", Restart::Never)];
    if let Some(text) = reader.string("restart") {
        match RESTART.iter().find(|(name, _)| *name == text) {
            Some((_, restart)) => policy.restart = *restart,
            None => {
                let hint = suggestion(text, RESTART.map(|(name, _)| name));
                if let Some(place) = reader.node("restart").map(|n| n.place.clone()) {
                    reader.problem(&place, format!("`restart` is `{text}`{hint}"));
                }
            }
        }
    }
    // The inner tables need readers of their own, with the same list of problems.
    let (backoff, intensity, env) = (reader.table("backoff"), reader.table("intensity"), reader.table("env"));
    if let Some(time) = reader.time("ready", "seconds", 1.0) {
        policy.ready = time;
    }
    if let Some(time) = reader.time("liveness", "seconds", 1.0) {
        policy.liveness = time;
    }
    if let Some(time) = reader.time("progress", "seconds", 1.0) {
        policy.progress = time;
    }
    if let Some(time) = reader.time("stop", "seconds", 1.0) {
        policy.stop = time;
    }
    if let Some(critical) = reader.boolean("critical") {
        policy.critical = critical;
    }
    if let Some(mib) = reader.integer("memory_mib", 1, MAX_MEMORY_MIB) {
        policy.memory_bytes = u64::try_from(mib).ok().map(|mib| mib << 20);
    }
    if let Some(table) = backoff {
        let mut inner = reader.inner("`backoff`", table);
        if let Some(time) = inner.time("initial_ms", "milliseconds", 1e-3) {
            policy.backoff_initial = time;
        }
        if let Some(time) = inner.time("max_ms", "milliseconds", 1e-3) {
            policy.backoff_max = time;
        }
        inner.finish();
        if policy.backoff_initial > policy.backoff_max
            && let Some(place) = reader.node("backoff").map(|n| n.place.clone())
        {
            reader.problem(&place, "`initial_ms` is above `max_ms`");
        }
    }
    if let Some(table) = intensity {
        let mut inner = reader.inner("`intensity`", table);
        if let Some(n) = inner.integer("restarts", 0, 1000) {
            policy.restarts = u32::try_from(n).unwrap_or(u32::MAX);
        }
        if let Some(time) = inner.time("within_s", "seconds", 1.0) {
            policy.within = time;
        }
        inner.finish();
    }
    let entries = env.map_or(&[][..], |t| &t.entries);
    let replaced: HashSet<&str> = entries.iter().map(|e| e.key.as_str()).collect();
    variables.retain(|(name, _)| !replaced.contains(name.as_str()));
    for entry in entries {
        match &entry.node.value {
            Value::String(value) => variables.push((entry.key.clone(), value.clone())),
            _ => reader.problem(&entry.node.place, format!("environment variable `{}` must be a string", entry.key)),
        }
    }
}

fn duplicate_roles(services: &[Service], problems: &mut Vec<Problem>) {
    for (i, service) in services.iter().enumerate() {
        if let Some(first) = services.iter().take(i).find(|s| s.role == service.role) {
            let text = format!(
                "services `{}` and `{}` both serve role `{}`; only one service may hold a role",
                first.name, service.name, service.role
            );
            problems.push(Problem { place: service.place.clone(), text });
        }
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
