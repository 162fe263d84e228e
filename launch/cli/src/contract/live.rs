//! Checks of a running stack: the identity of every process, the rows that it serves, and their message types.

use std::collections::BTreeMap;
use std::time::Duration;

use sg_proto::bus::StatusRequest;
use sg_proto::keys::{self, Kind, Row, role};
use sg_proto::launch::{Service, ServiceState};
use sg_runtime::bus::{Bus, DeclaredKey, RawMessage, RawReply};
use sg_runtime::context::Context;

use super::findings::Findings;
use crate::supervisor_client;
use crate::terminal::CommandResult;

/// Longest time for an answer.
const ANSWER: Duration = Duration::from_secs(5);

/// Checks every process of a session that serves a role.
pub(super) async fn check_stack(session: &str, rows: &[Row], findings: &mut Findings) -> CommandResult {
    let (_, bus) = supervisor_client::join(Some(session)).await?;
    let ready = supervisor_client::services(&bus).await?.services;
    let ready: Vec<_> = ready.into_iter().filter(|s| s.state() == ServiceState::Ready).collect();
    identities(&bus, &ready, findings).await;
    types(&bus, &ready, rows, findings).await;
    let declared = bus.declared_keys().await;
    bus.close().await;
    let what = format!("rows of `{session}`");
    if declared.is_empty() {
        findings.skip(what, "the router of this session does not list the declared keys");
    } else {
        let problems = unexpected_rows(session, &ready, rows, &declared);
        findings.add_result(
            what,
            problems,
            format!("{} keys are served by the processes of the table", declared.len()),
        );
    }
    Ok(())
}

async fn identities(bus: &Bus, ready: &[Service], findings: &mut Findings) {
    let mut problems = Vec::new();
    let mut schemas: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for service in ready {
        let context = Context::root().deadline_in(ANSWER);
        match bus.ask_role(&keys::STATUS, &service.role, &StatusRequest {}, &context).await {
            Err(fault) => problems.push(format!("{}: {fault}", service.name)),
            Ok(health) => {
                if (health.role.as_str(), health.instance.as_str()) != (&service.role, &service.instance) {
                    let (is, meant) = (&health.instance, &service.instance);
                    problems.push(format!(
                        "{}: `{is}` of role `{}` answers instead of `{meant}`",
                        service.name, health.role
                    ));
                }
                let schema = match health.schema_hash.get(..8) {
                    Some(hash) => format!("schema {hash}"),
                    None => "an unknown schema".to_owned(),
                };
                schemas.entry(schema).or_default().push(&service.name);
            }
        }
    }
    let by_schema: Vec<_> = schemas.iter().map(|(schema, names)| format!("{} of {schema}", names.join(", "))).collect();
    findings.add_result(format!("processes of `{}`", bus.session()), problems, by_schema.join("; "));
}

/// Newest values have the types of the table. A process of another major version would have others.
async fn types(bus: &Bus, ready: &[Service], rows: &[Row], findings: &mut Findings) {
    let (mut problems, mut checked) = (Vec::new(), 0);
    for service in ready {
        for row in rows.iter().filter(|r| r.role == service.role) {
            let Kind::Retained { message } = &row.kind else { continue };
            checked += 1;
            let wanted = format!("application/protobuf;{message}");
            match bus.ask_raw(&service.role, row.name, &RawMessage::default(), ANSWER).await {
                RawReply::Reply { encoding, .. } if encoding == wanted => (),
                RawReply::Reply { encoding, .. } | RawReply::Refusal { encoding, .. } => {
                    problems.push(format!("{}/{}: `{encoding}` instead of `{wanted}`", row.role, row.name));
                }
                RawReply::Nothing => problems.push(format!("{}/{}: no answer", row.role, row.name)),
            }
        }
    }
    let what = format!("types of `{}`", bus.session());
    findings.add_result(what, problems, format!("{checked} newest values have the types of the table"));
}

/// Rows that do not belong to their role, have two processes, belong to another role's process, or have none. The
/// process of a role serves its `cmd/status`.
fn unexpected_rows(session: &str, ready: &[Service], rows: &[Row], declared: &[DeclaredKey]) -> Vec<String> {
    let mut problems = Vec::new();
    let root = format!("{}/{session}/", keys::ROOT);
    let places: Vec<_> = declared
        .iter()
        .filter_map(|d| d.key.strip_prefix(&root)?.split_once('/').map(|(role, name)| (d, role, name)))
        .collect();
    let processes: BTreeMap<&str, &str> = places
        .iter()
        // The supervisor serves no status. The process behind its rows is the supervisor.
        .filter(|(_, role, name)| *name == keys::STATUS.name || *role == role::SUPERVISOR)
        .filter_map(|(d, role, _)| Some((d.clients.first()?.as_str(), *role)))
        .collect();
    let answered = |row: &Row| !matches!(row.kind, Kind::Stream { .. });
    for (DeclaredKey { key, clients }, role, name) in places {
        if !rows.iter().any(|r| r.name == name && r.belongs_to(role) && answered(r)) {
            problems.push(format!("{key} is not a row of `{role}`"));
        }
        if clients.len() > 1 {
            problems.push(format!("{key} is served by {} processes", clients.len()));
        }
        for client in clients {
            match processes.get(client.as_str()) {
                Some(of) if *of != role => problems.push(format!("{key} is served by the process of `{of}`")),
                Some(_) => (),
                None => problems.push(format!("{key} is served by a process without a role")),
            }
        }
    }
    for service in ready {
        for row in rows.iter().filter(|r| r.role == service.role && answered(r)) {
            let key = keys::key(session, &service.role, row.name);
            if !declared.iter().any(|d| d.key == key) {
                problems.push(format!("{key} has no process"));
            }
        }
    }
    problems
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(key: &str, clients: &[&str]) -> DeclaredKey {
        DeclaredKey { key: format!("sg/s/{key}"), clients: clients.iter().map(|c| (*c).to_owned()).collect() }
    }

    #[test]
    fn unexpected_rows_are_found() {
        let rows = keys::rows();
        let intent = Service { name: "i".into(), role: role::AGENT_INTENT.into(), ..Service::default() };
        let fine = vec![
            at("agent-intent/cmd/status", &["a"]),
            at("agent-intent/cmd/parse", &["a"]),
            at("agent-intent/state", &["a"]),
            at("scene/cmd/status", &["b"]),
            at("scene/cmd/apply", &["b"]),
            at("supervisor/cmd/ps", &["s"]),
        ];
        let found =
            |declared: &[DeclaredKey]| unexpected_rows("s", std::slice::from_ref(&intent), &rows, declared).join("\n");
        assert_eq!(found(&fine), "");
        assert_eq!(found(&fine[..2]), "sg/s/agent-intent/state has no process");
        for (strange, problem) in [
            (at("scene/cmd/changes", &["a"]), "served by the process of `agent-intent`"),
            (at("scene/cmd/apply", &["b", "c"]), "served by 2 processes"),
            (at("supervisor/cmd/down", &["s", "a"]), "served by the process of `agent-intent`"),
            (at("agent-intent/cmd/apply", &["a"]), "not a row of `agent-intent`"),
            (at("agent-core/cmd/utter", &["c"]), "served by a process without a role"),
        ] {
            let found = found(&[fine.clone(), vec![strange]].concat());
            assert!(found.contains(problem), "{problem}: {found}");
        }
    }
}
