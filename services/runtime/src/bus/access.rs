//! Access rules of the router for other machines, derived from the contract's table.
//!
//! - Processes on this machine connect by a unix socket in a private folder. They may do everything.
//! - Another machine is identified by its certificate. It sends only under keys that carry its name, and the role and the
//!   instance of one of its services ([`Identity`]). Each of these senders has the rights of its role in the table.
//! - The router drops all other messages. Receivers compare envelopes and payloads with the identity in the key.

use serde_json::{Value, json};
use sg_proto::keys::{self, ANY, Identity, Kind, ROOT, Row, role, rows};

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
            keys::all_from_nodes(session), keys::from_nodes(session, "@instance/**"),
            keys::from_nodes(session, "@alive/**"),
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

/// A process that may send: its role, and a pattern of its instance.
struct Speaker<'a> {
    role: &'a str,
    instance: String,
}

fn grants(session: &str, machine: &RemoteMachine) -> Vec<Grant> {
    let services: Vec<_> = machine
        .services
        .iter()
        .map(|s| Speaker { role: &s.role, instance: format!("{}$*", keys::instance_prefix(&s.name)) })
        .collect();
    let node = Speaker { role: role::NODE, instance: keys::node_instance(&machine.name) };
    let speakers: Vec<&Speaker<'_>> = services.iter().chain([&node]).collect();
    let table = rows();
    let is_request = |row: &Row| matches!(row.kind, Kind::Request { .. });
    let is_stream = |row: &Row| matches!(row.kind, Kind::Stream { .. });
    let is_retained = |row: &Row| matches!(row.kind, Kind::Retained { .. });
    let of = |keep: &dyn Fn(&Row) -> bool, keys: &dyn Fn(&Row) -> Vec<String>| -> Vec<String> {
        let mut all: Vec<String> = table.iter().filter(|r| keep(r)).flat_map(keys).collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    // Parts of the keys of a row that a speaker serves or publishes: under its role and under its instance. A node has no
    // role to serve, so it has an instance only.
    let own = |speaker: &Speaker<'_>, row: &Row| -> Vec<String> {
        let serves = match speaker.role {
            role::NODE => row.role == role::NODE,
            role => row.belongs_to(role),
        };
        let under_role = (speaker.role != role::NODE).then(|| format!("{}/{}", speaker.role, row.name));
        let under_instance = format!("{}/{}", keys::instance(&speaker.instance), row.name);
        if serves { under_role.into_iter().chain([under_instance]).collect() } else { Vec::new() }
    };
    let sent_by = |speaker: &Speaker<'_>, rest: &str| {
        let (node, role, instance) = (machine.name.clone(), speaker.role.to_owned(), speaker.instance.clone());
        Identity { node, role, instance }.key(session, rest)
    };
    // Keys of rows that this machine answers, for requests from home and from nodes.
    let answered_keys = |row: &Row| -> Vec<String> {
        let parts = speakers.iter().flat_map(|s| own(s, row));
        parts.flat_map(|rest| [format!("{ROOT}/{session}/{rest}"), keys::from_nodes(session, &rest)]).collect()
    };
    let own_keys = |row: &Row| -> Vec<String> {
        speakers.iter().flat_map(|s| own(s, row).into_iter().map(|rest| sent_by(s, &rest))).collect()
    };
    let anywhere = |row: &Row| format!("{}/{}", if row.role == ANY { "*" } else { row.role }, row.name);
    let requested_keys = |row: &Row| -> Vec<String> {
        let may_send = |s: &&&Speaker<'_>| is_retained(row) || (!row.local_only && row.may_ask(s.role));
        speakers.iter().filter(may_send).map(|s| sent_by(s, &anywhere(row))).collect()
    };
    let received_keys = |row: &Row| -> Vec<String> {
        vec![format!("{ROOT}/{session}/{}", anywhere(row)), keys::from_nodes(session, &anywhere(row))]
    };
    let answered = of(&|r| !is_stream(r), &answered_keys);
    let sent = of(&|r| !is_request(r), &own_keys);
    let replied = of(&|r| !is_stream(r), &own_keys);
    let requested = of(&|r| !is_stream(r), &requested_keys);
    let heard = of(&|r| !is_request(r), &received_keys);
    let replies =
        of(&|r| !is_stream(r) && !requested_keys(r).is_empty(), &|r| vec![keys::from_nodes(session, &anywhere(r))]);
    let alive = services.iter().map(|s| sent_by(s, &format!("@alive/{}/{}", s.role, s.instance))).collect();
    let all_alive = vec![keys::alive(session, "*", "*"), keys::from_nodes(session, "@alive/*/*")];
    let grants = vec![
        Grant { name: "answer: declare", flow: "ingress", messages: &["declare_queryable"], keys: answered.clone() },
        Grant { name: "answer: receive requests", flow: "egress", messages: &["query"], keys: answered },
        Grant { name: "answer: reply", flow: "ingress", messages: &["reply"], keys: replied },
        Grant { name: "publish", flow: "ingress", messages: &["put"], keys: sent },
        Grant { name: "request: send", flow: "ingress", messages: &["query"], keys: requested },
        Grant { name: "request: receive replies", flow: "egress", messages: &["reply"], keys: replies },
        Grant { name: "subscribe: declare", flow: "ingress", messages: &["declare_subscriber"], keys: heard.clone() },
        // Every connected machine may read every stream.
        Grant { name: "subscribe: receive", flow: "egress", messages: &["put"], keys: heard },
        Grant {
            name: "liveliness: query",
            flow: "ingress",
            messages: &["declare_liveliness_subscriber", "liveliness_query"],
            keys: all_alive.clone(),
        },
        Grant { name: "liveliness: receive", flow: "egress", messages: &["liveliness_token"], keys: all_alive },
        Grant { name: "liveliness: declare", flow: "ingress", messages: &["liveliness_token"], keys: alive },
    ];
    grants.into_iter().filter(|g| !g.keys.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::RemoteService;

    fn machine() -> RemoteMachine {
        let service = |name: &str, role: &str| RemoteService { name: name.into(), role: role.into() };
        RemoteMachine {
            name: "gpu1".into(),
            services: vec![service("view", role::RENDER_VIEW), service("selection", role::SELECTION)],
        }
    }

    fn keys_of(name: &str) -> Vec<String> {
        grants("s", &machine()).into_iter().find(|g| g.name == name).unwrap().keys
    }

    #[test]
    fn another_machine_has_the_rights_of_its_roles_only() {
        let requests = keys_of("request: send");
        for allowed in [
            "sg/s/@node/gpu1/selection/selection.$*/scene/cmd/apply",
            "sg/s/@node/gpu1/render-view/view.$*/scene/cmd/changes",
            "sg/s/@node/gpu1/render-view/view.$*/*/cmd/status",
            "sg/s/@node/gpu1/node/node:gpu1/supervisor/cmd/join",
        ] {
            assert!(requests.iter().any(|k| k == allowed), "{allowed} in {requests:?}");
        }
        // `cmd/open` and `cmd/save` name files of the supervisor's machine.
        for denied in [
            "cmd/capture",
            "cmd/execute",
            "cmd/down",
            "cmd/restart",
            "cmd/swap",
            "cmd/promote",
            "cmd/start",
            "cmd/open",
            "cmd/save",
        ] {
            assert!(!requests.iter().any(|k| k.ends_with(denied)), "{denied} in {requests:?}");
        }
        // Each role has its own rights, not those of the other roles of the machine.
        assert!(!requests.iter().any(|k| k.contains("/selection/selection.$*/selection/cmd/strokes")), "{requests:?}");
        let answers = keys_of("answer: declare");
        for allowed in [
            "sg/s/selection/cmd/strokes",
            "sg/s/@node/*/*/*/selection/cmd/strokes",
            "sg/s/@instance/view.$*/cmd/status",
            "sg/s/@instance/node:gpu1/cmd/start",
        ] {
            assert!(answers.iter().any(|k| k == allowed), "{allowed} in {answers:?}");
        }
        for denied in ["sg/s/scene/", "sg/s/agent-", "sg/s/supervisor/", "sg/s/render-capture/"] {
            assert!(!answers.iter().any(|k| k.starts_with(denied)), "{denied} in {answers:?}");
        }
    }

    #[test]
    fn another_machine_sends_under_its_own_name_only() {
        for name in ["answer: reply", "publish", "request: send", "liveliness: declare"] {
            for key in keys_of(name) {
                assert!(key.starts_with("sg/s/@node/gpu1/"), "{name}: {key}");
            }
        }
        let publishes = keys_of("publish");
        assert!(publishes.iter().any(|k| k == "sg/s/@node/gpu1/render-view/view.$*/render-view/event/frame"));
        assert!(publishes.iter().any(|k| k == "sg/s/@node/gpu1/node/node:gpu1/@instance/node:gpu1/event/log"));
        assert!(!publishes.iter().any(|k| k.contains("/cmd/") || k.contains("/scene/")), "{publishes:?}");
        assert_eq!(
            keys_of("liveliness: declare"),
            [
                "sg/s/@node/gpu1/render-view/view.$*/@alive/render-view/view.$*",
                "sg/s/@node/gpu1/selection/selection.$*/@alive/selection/selection.$*",
            ]
        );
    }

    #[test]
    fn zenoh_accepts_the_rules() {
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &rules("s", &[machine()]).to_string()).unwrap();
    }
}
