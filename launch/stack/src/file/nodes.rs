//! Other machines in a launch file: the tables `[bus]` and `[node.NAME]`, and the key `on`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::model::{ListenSettings, Node};
use super::names::is_name;
use crate::document::{self, Problem, Reader, Table, Value};
use crate::revocation;
use crate::suggestion::suggestion;

/// Most machines of one file.
const MAX_NODES: usize = 64;
/// Lease of a node without `lease`.
const LEASE: Duration = Duration::from_secs(5);
/// Shortest lease. Both sides send once a second.
const SHORTEST_LEASE: Duration = Duration::from_secs(2);

/// `[bus]`.
pub(super) fn listening(table: Option<&Table>, file: &Path, problems: &mut Vec<Problem>) -> Option<ListenSettings> {
    let mut reader = Reader::new("[bus]", table?, problems);
    let endpoint = reader.string("listen").map(str::to_owned);
    if endpoint.is_none() && reader.node("listen").is_none() {
        reader.missing("listen");
    }
    if let Some(endpoint) = &endpoint
        && let Err(text) = check_endpoint(endpoint)
        && let Some(place) = reader.node("listen").map(|n| n.place.clone())
    {
        reader.problem(&place, text);
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    let mut pem = |key: &'static str| -> Option<PathBuf> {
        let Some(name) = reader.string(key) else {
            if reader.node(key).is_none() {
                reader.missing(key);
            }
            return None;
        };
        let path = folder.join(name);
        let path = std::path::absolute(&path).unwrap_or(path);
        if !path.is_file()
            && let Some(place) = reader.node(key).map(|n| n.place.clone())
        {
            let text = format!("{}: no such file; make it with `supergaussian certificates`", path.display());
            reader.problem(&place, text);
        }
        Some(path)
    };
    let files = (pem("authority"), pem("certificate"), pem("key"));
    reader.finish();
    let (endpoint, (Some(authority), Some(certificate), Some(key))) = (endpoint?, files) else { return None };
    let revoked = match revocation::read(&revocation::list_beside(&authority)) {
        Ok(revoked) => revoked,
        Err(error) => {
            let place = table.and_then(|t| t.get("authority")).map(|entry| entry.node.place.clone());
            problems.extend(place.map(|place| Problem { place, text: error.to_string() }));
            BTreeSet::new()
        }
    };
    Some(ListenSettings { endpoint, authority, certificate, key, revoked })
}

/// Checks an endpoint for other machines. The error is the text of the problem.
fn check_endpoint(endpoint: &str) -> Result<(), String> {
    let Some(address) = endpoint.strip_prefix(sg_runtime::bus::TLS_PREFIX) else {
        return Err(format!("`{endpoint}`: other machines connect over TLS only; write `tls/ADDRESS:PORT`"));
    };
    let port = address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
    if port.is_some() {
        Ok(())
    } else {
        Err(format!("`{endpoint}`: write `tls/ADDRESS:PORT`, such as tls/0.0.0.0:7447"))
    }
}

/// Every `[node.NAME]`.
pub(super) fn read_nodes(table: Option<&Table>, listens: bool, problems: &mut Vec<Problem>) -> Vec<Node> {
    let entries = table.map_or(&[][..], |t| &t.entries);
    if let Some(extra) = entries.get(MAX_NODES) {
        problems.push(Problem { place: extra.place.clone(), text: format!("more than {MAX_NODES} nodes") });
    }
    if let Some(first) = entries.first().filter(|_| !listens && problems.is_empty()) {
        let text = format!("node `{}` cannot join without an endpoint; add `[bus]` with `listen`", first.key);
        problems.push(Problem { place: first.place.clone(), text });
    }
    entries.iter().take(MAX_NODES).filter_map(|entry| node(entry, problems)).collect()
}

fn node(entry: &document::Entry, problems: &mut Vec<Problem>) -> Option<Node> {
    let Value::Table(table) = &entry.node.value else {
        let text = format!("`{}` must be a table; write `[node.{}]`", entry.key, entry.key);
        problems.push(Problem { place: entry.place.clone(), text });
        return None;
    };
    if !is_name(&entry.key) {
        let text = format!("node `{}`: use letters, digits, `-` or `_`", entry.key);
        problems.push(Problem { place: entry.place.clone(), text });
    }
    let mut reader = Reader::new(format!("[node.{}]", entry.key), table, problems);
    let lease = reader.time("lease", "seconds", 1.0).unwrap_or(LEASE);
    if lease < SHORTEST_LEASE
        && let Some(place) = reader.node("lease").map(|n| n.place.clone())
    {
        let text = format!("`lease` must be at least {} seconds", SHORTEST_LEASE.as_secs());
        reader.problem(&place, text);
    }
    reader.finish();
    Some(Node { name: entry.key.clone(), lease })
}

/// The key `on` of a service.
pub(super) fn node_of(reader: &mut Reader<'_, '_>, nodes: &[Node]) -> Option<String> {
    let name = reader.string("on")?;
    if !nodes.iter().any(|n| n.name == name)
        && let Some(place) = reader.node("on").map(|n| n.place.clone())
    {
        let hint = suggestion(name, nodes.iter().map(|n| n.name.as_str()));
        reader.problem(&place, format!("`on` names `{name}`; the file has no `[node.{name}]`{hint}"));
    }
    Some(name.to_owned())
}
