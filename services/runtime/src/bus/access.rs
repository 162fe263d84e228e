//! What other machines may do on a session's bus, made from the contract's table.
//!
//! This machine's own processes come by the unix socket of a folder that is theirs alone, and may do everything. A guest
//! is known by its certificate and may do what the table allows the roles that it runs, under their keys and under its own
//! instances; whatever is not allowed is dropped by the router before anybody sees it. The roles in the table are thereby
//! the only names that a guest can act under, whatever it writes into an envelope.

use serde_json::{Value, json};
use sg_proto::keys::{self, ANY, Kind, ROOT, Row, role, rows};

use super::link::Guest;

/// The router's rules, as its configuration has them.
pub(super) fn rules(session: &str, guests: &[Guest]) -> Value {
    let mut rules = vec![json!({
        "id": "this machine", "permission": "allow", "flows": ["ingress", "egress"],
        "messages": [
            "put", "delete", "declare_subscriber", "query", "declare_queryable", "reply", "liveliness_token",
            "declare_liveliness_subscriber", "liveliness_query",
        ],
        // Chunks that begin with `@` are reached by no wildcard.
        "key_exprs": [
            "**", "@/**", format!("{ROOT}/{session}/@instance/**"), format!("{ROOT}/{session}/@alive/**"),
        ],
    })];
    let mut subjects = vec![json!({ "id": "this machine", "link_protocols": ["unixsock-stream"] })];
    let mut policies = vec![json!({ "rules": ["this machine"], "subjects": ["this machine"] })];
    for guest in guests {
        let ids: Vec<String> = grants(session, guest)
            .into_iter()
            .map(|grant| {
                let Grant { what, flow, messages, keys } = grant;
                let id = format!("{}: {what}", guest.name);
                rules.push(json!({
                    "id": id, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys,
                }));
                id
            })
            .collect();
        subjects.push(json!({
            "id": guest.name, "link_protocols": ["tls"], "cert_common_names": [guest.name],
        }));
        policies.push(json!({ "rules": ids, "subjects": [guest.name] }));
    }
    json!({
        "enabled": true, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies,
    })
}

/// Keys under which messages of some kinds pass in one direction, as the router sees it.
#[derive(Debug, PartialEq, Eq)]
struct Grant {
    what: &'static str,
    flow: &'static str,
    messages: &'static [&'static str],
    keys: Vec<String>,
}

fn grants(session: &str, guest: &Guest) -> Vec<Grant> {
    // A node is one of the roles that a guest has, under its instance only.
    let serves = |row: &Row| guest.roles.iter().any(|r| row.is_of(r));
    let under = |name: &str| -> Vec<String> {
        let own = guest.instances.iter().map(|i| keys::key(session, &keys::instance(&format!("{i}$*")), name));
        let node = keys::key(session, &keys::instance(&keys::node_instance(&guest.name)), name);
        own.chain([node]).collect()
    };
    // Where what the guest serves is heard: under its roles and under its instances.
    let places = |row: &Row| -> Vec<String> {
        let roles = guest.roles.iter().filter(|r| row.is_of(r)).map(|r| keys::key(session, r, row.name));
        roles.chain(under(row.name)).collect()
    };
    let may_ask = |row: &Row| !row.at_home && (row.may_ask(role::NODE) || guest.roles.iter().any(|r| row.may_ask(r)));
    let asked = |row: &Row| keys::key(session, if row.role == ANY { "*" } else { row.role }, row.name);
    let table = rows();
    let collect = |keep: &dyn Fn(&Row) -> bool, keys: &dyn Fn(&Row) -> Vec<String>| -> Vec<String> {
        let mut all: Vec<String> = table.iter().filter(|r| keep(r)).flat_map(keys).collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    let is_stream = |row: &Row| matches!(row.kind, Kind::Stream { .. });
    let answered = collect(&|r| !is_stream(r) && (serves(r) || r.is_of(role::NODE)), &places);
    let published = collect(&|r| !matches!(r.kind, Kind::Ask { .. }) && (serves(r) || r.is_of(role::NODE)), &places);
    let asks = collect(&may_ask, &|r| vec![asked(r)]);
    // What is published to everybody may be read by everybody who is in.
    let heard = collect(&|r| !matches!(r.kind, Kind::Ask { .. }), &|r| vec![asked(r)]);
    let newest = collect(&|r| matches!(r.kind, Kind::Slot { .. }), &|r| vec![asked(r)]);
    let alive = guest.roles.iter().map(|r| keys::alive(session, r, "*")).collect();
    let grants = vec![
        Grant { what: "answers", flow: "ingress", messages: &["declare_queryable", "reply"], keys: answered.clone() },
        Grant { what: "is asked", flow: "egress", messages: &["query"], keys: answered },
        Grant { what: "publishes", flow: "ingress", messages: &["put"], keys: published },
        Grant { what: "asks", flow: "ingress", messages: &["query"], keys: asks.clone() },
        Grant { what: "is answered", flow: "egress", messages: &["reply"], keys: asks },
        Grant { what: "looks", flow: "ingress", messages: &["query"], keys: newest.clone() },
        Grant { what: "is told", flow: "egress", messages: &["reply"], keys: newest },
        Grant { what: "follows", flow: "ingress", messages: &["declare_subscriber"], keys: heard.clone() },
        Grant { what: "hears", flow: "egress", messages: &["put"], keys: heard },
        Grant {
            what: "watches",
            flow: "ingress",
            messages: &["declare_liveliness_subscriber", "liveliness_query"],
            keys: vec![keys::alive(session, "*", "*")],
        },
        Grant {
            what: "sees",
            flow: "egress",
            messages: &["liveliness_token"],
            keys: vec![keys::alive(session, "*", "*")],
        },
        Grant { what: "lives", flow: "ingress", messages: &["liveliness_token"], keys: alive },
    ];
    grants.into_iter().filter(|g| !g.keys.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guest() -> Guest {
        Guest {
            name: "gpu1".into(),
            roles: vec![role::RENDER_VIEW.into(), role::SELECTION.into()],
            instances: vec!["view-".into(), "selection-".into()],
        }
    }

    fn keys_of(what: &str) -> Vec<String> {
        grants("s", &guest()).into_iter().find(|g| g.what == what).unwrap().keys
    }

    #[test]
    fn a_guest_may_do_what_the_table_allows_its_roles_and_no_more() {
        let asks = keys_of("asks");
        for allowed in
            ["sg/s/scene/cmd/apply", "sg/s/scene/cmd/changes", "sg/s/*/cmd/status", "sg/s/supervisor/cmd/join"]
        {
            assert!(asks.iter().any(|k| k == allowed), "{allowed} in {asks:?}");
        }
        // A view may have files of its own machine opened, and this one is not its own.
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
            assert!(!asks.iter().any(|k| k.ends_with(denied)), "{denied} in {asks:?}");
        }
        let answers = keys_of("answers");
        for allowed in
            ["sg/s/selection/cmd/strokes", "sg/s/@instance/view-$*/cmd/status", "sg/s/@instance/node.gpu1/cmd/start"]
        {
            assert!(answers.iter().any(|k| k == allowed), "{allowed} in {answers:?}");
        }
        for denied in ["sg/s/scene/", "sg/s/agent-", "sg/s/supervisor/", "sg/s/render-capture/"] {
            assert!(!answers.iter().any(|k| k.starts_with(denied)), "{denied} in {answers:?}");
        }
        let publishes = keys_of("publishes");
        assert!(publishes.iter().any(|k| k == "sg/s/render-view/event/frame"));
        assert!(!publishes.iter().any(|k| k.contains("/cmd/") || k.starts_with("sg/s/scene")), "{publishes:?}");
        assert_eq!(keys_of("lives"), ["sg/s/@alive/render-view/*", "sg/s/@alive/selection/*"]);
    }

    #[test]
    fn the_router_takes_the_rules() {
        let mut config = zenoh::Config::default();
        config.insert_json5("access_control", &rules("s", &[guest()]).to_string()).unwrap();
    }
}
