//! A running stack: every process is who the supervisor takes it for, answers the rows of its role and no others, and
//! speaks the types of this contract.

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

/// How long a process may take to answer.
const ANSWER: Duration = Duration::from_secs(5);

/// Looks at every process of a session that serves its role.
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
        findings.skip(what, "the router of this session does not tell what is declared");
    } else {
        let problems = unexpected_rows(session, &ready, rows, &declared);
        findings.add_result(
            what,
            problems,
            format!("{} keys are answered, each by whom the table says", declared.len()),
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
                    problems.push(format!("{}: `{is}` of role `{}` answers for `{meant}`", service.name, health.role));
                }
                let schema = match health.schema_hash.get(..8) {
                    Some(hash) => format!("schema {hash}"),
                    None => "a schema they do not tell".to_owned(),
                };
                schemas.entry(schema).or_default().push(&service.name);
            }
        }
    }
    let by_schema: Vec<_> = schemas.iter().map(|(schema, names)| format!("{} of {schema}", names.join(", "))).collect();
    findings.add_result(format!("processes of `{}`", bus.session()), problems, by_schema.join("; "));
}

/// The newest values travel as the types of the table; a process of another major would name others.
async fn types(bus: &Bus, ready: &[Service], rows: &[Row], findings: &mut Findings) {
    let (mut problems, mut looked_at) = (Vec::new(), 0);
    for service in ready {
        for row in rows.iter().filter(|r| r.role == service.role) {
            let Kind::Retained { message } = &row.kind else { continue };
            looked_at += 1;
            let wanted = format!("application/protobuf;{message}");
            match bus.ask_raw(&service.role, row.name, &RawMessage::default(), ANSWER).await {
                RawReply::Reply { encoding, .. } if encoding == wanted => (),
                RawReply::Reply { encoding, .. } | RawReply::Refusal { encoding, .. } => {
                    problems.push(format!("{}/{}: `{encoding}` instead of `{wanted}`", row.role, row.name));
                }
                RawReply::Nothing => problems.push(format!("{}/{}: nobody answers", row.role, row.name)),
            }
        }
    }
    let what = format!("types of `{}`", bus.session());
    findings.add_result(what, problems, format!("{looked_at} newest values are of the types of the table"));
}

/// Rows that are none of their role, that two processes answer, that the process of another role answers, or that nobody
/// answers. A role's process is the one that answers its `cmd/status`.
fn unexpected_rows(session: &str, ready: &[Service], rows: &[Row], declared: &[DeclaredKey]) -> Vec<String> {
    let mut problems = Vec::new();
    let root = format!("{}/{session}/", keys::ROOT);
    let places: Vec<_> = declared
        .iter()
        .filter_map(|d| d.key.strip_prefix(&root)?.split_once('/').map(|(role, name)| (d, role, name)))
        .collect();
    let processes: BTreeMap<&str, &str> = places
        .iter()
        // The supervisor tells no status: whoever answers its rows is taken for it.
        .filter(|(_, role, name)| *name == keys::STATUS.name || *role == role::SUPERVISOR)
        .filter_map(|(d, role, _)| Some((d.clients.first()?.as_str(), *role)))
        .collect();
    let answered = |row: &Row| !matches!(row.kind, Kind::Stream { .. });
    for (DeclaredKey { key, clients }, role, name) in places {
        if !rows.iter().any(|r| r.name == name && r.belongs_to(role) && answered(r)) {
            problems.push(format!("{key} is no row of `{role}`"));
        }
        if clients.len() > 1 {
            problems.push(format!("{key} is answered by {} processes", clients.len()));
        }
        for client in clients {
            match processes.get(client.as_str()) {
                Some(of) if *of != role => problems.push(format!("{key} is answered by the process of `{of}`")),
                Some(_) => (),
                None => problems.push(format!("{key} is answered by a process that answers for no role")),
            }
        }
    }
    for service in ready {
        for row in rows.iter().filter(|r| r.role == service.role && answered(r)) {
            let key = keys::key(session, &service.role, row.name);
            if !declared.iter().any(|d| d.key == key) {
                problems.push(format!("{key} is answered by nobody"));
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
    fn who_answers_what_he_may_not_is_told() {
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
        let told =
            |declared: &[DeclaredKey]| unexpected_rows("s", std::slice::from_ref(&intent), &rows, declared).join("\n");
        assert_eq!(told(&fine), "");
        assert_eq!(told(&fine[..2]), "sg/s/agent-intent/state is answered by nobody");
        for (strange, complaint) in [
            (at("scene/cmd/changes", &["a"]), "answered by the process of `agent-intent`"),
            (at("scene/cmd/apply", &["b", "c"]), "answered by 2 processes"),
            (at("supervisor/cmd/down", &["s", "a"]), "answered by the process of `agent-intent`"),
            (at("agent-intent/cmd/apply", &["a"]), "no row of `agent-intent`"),
            (at("agent-core/cmd/utter", &["c"]), "answered by a process that answers for no role"),
        ] {
            let told = told(&[fine.clone(), vec![strange]].concat());
            assert!(told.contains(complaint), "{complaint}: {told}");
        }
    }
}
