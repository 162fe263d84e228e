//! Access rules of the router for other machines, derived from the contract's table.
//!
//! - Processes on this machine connect by a unix socket in a private folder. They may do everything.
//! - Another machine is identified by its certificate. It has the rights of its roles in the table, under their keys and
//!   under its own instances.
//! - The router drops all other messages. A false sender in an envelope gives no additional rights.

use serde_json::{Value, json};
use sg_proto::keys::{self, ANY, Kind, ROOT, Row, role, rows};

use super::link::RemoteMachine;

/// Access rules in the form of zenoh's configuration.
pub(super) fn rules(session: &str, machines: &[RemoteMachine]) -> Value {
    let mut rules = vec![json!({
        "id": "this machine", "permission": "allow", "flows": ["ingress", "egress"],
        "messages": [
            "put", "delete", "declare_subscriber", "query", "declare_queryable", "reply", "liveliness_token",
            "declare_liveliness_subscriber", "liveliness_query",
        ],
        // No wildcard matches a segment that begins with `@`.
        "key_exprs": [
            "**", "@/**", format!("{ROOT}/{session}/@instance/**"), format!("{ROOT}/{session}/@alive/**"),
        ],
    })];
    let mut subjects = vec![json!({ "id": "this machine", "link_protocols": ["unixsock-stream"] })];
    let mut policies = vec![json!({ "rules": ["this machine"], "subjects": ["this machine"] })];
    for machine in machines {
        let ids: Vec<String> = grants(session, machine)
            .into_iter()
            .map(|grant| {
                let Grant { name, flow, messages, keys } = grant;
                let id = format!("{}: {name}", machine.name);
                rules.push(json!({
                    "id": id, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys,
                }));
                id
            })
            .collect();
        subjects.push(json!({
            "id": machine.name, "link_protocols": ["tls"], "cert_common_names": [machine.name],
        }));
        policies.push(json!({ "rules": ids, "subjects": [machine.name] }));
    }
    json!({
        "enabled": true, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies,
    })
}

/// Permission for some kinds of messages under some keys, in one direction as seen from the router.
#[derive(Debug, PartialEq, Eq)]
struct Grant {
    name: &'static str,
    flow: &'static str,
    messages: &'static [&'static str],
    keys: Vec<String>,
}

fn grants(session: &str, machine: &RemoteMachine) -> Vec<Grant> {
    let serves = |row: &Row| machine.roles.iter().any(|r| row.belongs_to(r));
    let instance_keys = |name: &str| -> Vec<String> {
        let own = machine.instances.iter().map(|i| keys::key(session, &keys::instance(&format!("{i}$*")), name));
        let node = keys::key(session, &keys::instance(&keys::node_instance(&machine.name)), name);
        own.chain([node]).collect()
    };
    // Keys of a served row: under the roles and under the instances of the machine.
    let served_keys = |row: &Row| -> Vec<String> {
        let roles = machine.roles.iter().filter(|r| row.belongs_to(r)).map(|r| keys::key(session, r, row.name));
        roles.chain(instance_keys(row.name)).collect()
    };
    let may_send =
        |row: &Row| !row.local_only && (row.may_ask(role::NODE) || machine.roles.iter().any(|r| row.may_ask(r)));
    let role_key = |row: &Row| keys::key(session, if row.role == ANY { "*" } else { row.role }, row.name);
    let table = rows();
    let collect = |keep: &dyn Fn(&Row) -> bool, keys: &dyn Fn(&Row) -> Vec<String>| -> Vec<String> {
        let mut all: Vec<String> = table.iter().filter(|r| keep(r)).flat_map(keys).collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    let is_stream = |row: &Row| matches!(row.kind, Kind::Stream { .. });
    let answered = collect(&|r| !is_stream(r) && (serves(r) || r.belongs_to(role::NODE)), &served_keys);
    let published =
        collect(&|r| !matches!(r.kind, Kind::Request { .. }) && (serves(r) || r.belongs_to(role::NODE)), &served_keys);
    let requested = collect(&may_send, &|r| vec![role_key(r)]);
    // Every connected machine may read every stream.
    let subscribed = collect(&|r| !matches!(r.kind, Kind::Request { .. }), &|r| vec![role_key(r)]);
    let newest = collect(&|r| matches!(r.kind, Kind::Retained { .. }), &|r| vec![role_key(r)]);
    let alive = machine.roles.iter().map(|r| keys::alive(session, r, "*")).collect();
    let grants = vec![
        Grant {
            name: "answer: declare and reply",
            flow: "ingress",
            messages: &["declare_queryable", "reply"],
            keys: answered.clone(),
        },
        Grant { name: "answer: receive requests", flow: "egress", messages: &["query"], keys: answered },
        Grant { name: "publish", flow: "ingress", messages: &["put"], keys: published },
        Grant { name: "request: send", flow: "ingress", messages: &["query"], keys: requested.clone() },
        Grant { name: "request: receive replies", flow: "egress", messages: &["reply"], keys: requested },
        Grant { name: "retained: query", flow: "ingress", messages: &["query"], keys: newest.clone() },
        Grant { name: "retained: receive", flow: "egress", messages: &["reply"], keys: newest },
        Grant {
            name: "subscribe: declare",
            flow: "ingress",
            messages: &["declare_subscriber"],
            keys: subscribed.clone(),
        },
        Grant { name: "subscribe: receive", flow: "egress", messages: &["put"], keys: subscribed },
        Grant {
            name: "liveliness: query",
            flow: "ingress",
            messages: &["declare_liveliness_subscriber", "liveliness_query"],
            keys: vec![keys::alive(session, "*", "*")],
        },
        Grant {
            name: "liveliness: receive",
            flow: "egress",
            messages: &["liveliness_token"],
            keys: vec![keys::alive(session, "*", "*")],
        },
        Grant { name: "liveliness: declare", flow: "ingress", messages: &["liveliness_token"], keys: alive },
    ];
    grants.into_iter().filter(|g| !g.keys.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine() -> RemoteMachine {
        RemoteMachine {
            name: "gpu1".into(),
            roles: vec![role::RENDER_VIEW.into(), role::SELECTION.into()],
            instances: vec!["view-".into(), "selection-".into()],
        }
    }

    fn keys_of(name: &str) -> Vec<String> {
        grants("s", &machine()).into_iter().find(|g| g.name == name).unwrap().keys
    }

    #[test]
    fn another_machine_has_the_rights_of_its_roles_only() {
        let requests = keys_of("request: send");
        for allowed in
            ["sg/s/scene/cmd/apply", "sg/s/scene/cmd/changes", "sg/s/*/cmd/status", "sg/s/supervisor/cmd/join"]
        {
            assert!(requests.iter().any(|k| k == allowed), "{allowed} in {requests:?}");
        }
        // `cmd/open` names a file of the supervisor's machine.
        for denied in [
            "cmd/capture",
            "cmd/execute",
            "cmd/down",
            "cmd/restart",
            "cmd/swap",
            "cmd/promote",
            "cmd/start",
            "cmd/open",
        ] {
            assert!(!requests.iter().any(|k| k.ends_with(denied)), "{denied} in {requests:?}");
        }
        let answers = keys_of("answer: declare and reply");
        for allowed in
            ["sg/s/selection/cmd/strokes", "sg/s/@instance/view-$*/cmd/status", "sg/s/@instance/node.gpu1/cmd/start"]
        {
            assert!(answers.iter().any(|k| k == allowed), "{allowed} in {answers:?}");
        }
        for denied in ["sg/s/scene/", "sg/s/agent-", "sg/s/supervisor/", "sg/s/render-capture/"] {
            assert!(!answers.iter().any(|k| k.starts_with(denied)), "{denied} in {answers:?}");
        }
        let publishes = keys_of("publish");
        assert!(publishes.iter().any(|k| k == "sg/s/render-view/event/frame"));
        assert!(!publishes.iter().any(|k| k.contains("/cmd/") || k.starts_with("sg/s/scene")), "{publishes:?}");
        assert_eq!(keys_of("liveliness: declare"), ["sg/s/@alive/render-view/*", "sg/s/@alive/selection/*"]);
    }

    #[test]
    fn zenoh_accepts_the_rules() {
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &rules("s", &[machine()]).to_string()).unwrap();
    }
}
