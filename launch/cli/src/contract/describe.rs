//! `contract describe`: what each service may send and receive.

use serde_json::json;
use sg_proto::keys::{self, Kind, Row, role, rows};
use sg_stack::suggestion::suggestion;

use crate::terminal::{self, CommandResult, Failure};

pub(super) fn describe(service: Option<&str>, json: bool) -> CommandResult {
    let roles: Vec<&str> = match service {
        None => role::ALL.to_vec(),
        Some(service) => match role::ALL.iter().find(|r| **r == service) {
            Some(known) => vec![known],
            None => {
                let hint = suggestion(service, role::ALL);
                return Err(Failure::Input(format!("unknown role `{service}`{hint}")));
            }
        },
    };
    let rows = rows();
    if json {
        let roles: serde_json::Map<_, _> = roles.iter().map(|r| ((*r).to_owned(), as_json(r, &rows))).collect();
        terminal::print_line(&serde_json::Value::Object(roles).to_string());
        return Ok(());
    }
    for (i, role) in roles.iter().enumerate() {
        if i > 0 {
            terminal::print_line("");
        }
        for line in as_text(role, &rows) {
            terminal::print_line(&line);
        }
    }
    Ok(())
}

/// The command line, the supervisor and nodes are not services. They have only the rows that name them.
fn is_of(row: &Row, role: &str) -> bool {
    row.role == role || row.role == keys::ANY && !role::NON_SERVICES.contains(&role)
}

fn short(name: &str) -> &str {
    name.trim_start_matches("supergaussian.")
}

fn as_text(role: &str, rows: &[Row]) -> Vec<String> {
    let mut lines = vec![role.to_owned()];
    for row in rows.iter().filter(|r| is_of(r, role)) {
        let what = match &row.kind {
            Kind::Request { request, reply } => {
                let senders: Vec<_> =
                    row.senders.iter().map(|s| if *s == keys::ANY { "everybody" } else { s }).collect();
                let place = if row.local_only { "; of the supervisor's own machine" } else { "" };
                format!("answers    {} → {}  (from {}{place})", short(request), short(reply), senders.join(", "))
            }
            Kind::Stream { message } => format!("publishes  {}", short(message)),
            Kind::Retained { message } => format!("owns       {}", short(message)),
        };
        lines.push(format!("  {:<17} {what}", row.name));
        lines.push(format!("  {:<17}            {}", "", row.doc.trim()));
    }
    for row in rows.iter().filter(|r| r.may_ask(role) && r.role != role) {
        if let Kind::Request { request, reply } = &row.kind {
            let of = if row.role == keys::ANY { "every service" } else { row.role };
            lines.push(format!("  {:<17} may ask    {of}: {} → {}", row.name, short(request), short(reply)));
        }
    }
    lines
}

fn as_json(role: &str, rows: &[Row]) -> serde_json::Value {
    let own = |row: &Row| match &row.kind {
        Kind::Request { request, reply } => json!({
            "name": row.name, "kind": "ask", "request": request, "reply": reply, "senders": row.senders, "local_only": row.local_only,
            "doc": row.doc.trim(),
        }),
        Kind::Stream { message } => {
            json!({"name": row.name, "kind": "stream", "message": message, "doc": row.doc.trim()})
        }
        Kind::Retained { message } => {
            json!({"name": row.name, "kind": "slot", "message": message, "doc": row.doc.trim()})
        }
    };
    let asks = |row: &Row| match &row.kind {
        Kind::Request { request, reply } => {
            Some(json!({"role": row.role, "name": row.name, "request": request, "reply": reply}))
        }
        _ => None,
    };
    json!({
        "receives_and_publishes": rows.iter().filter(|r| is_of(r, role)).map(own).collect::<Vec<_>>(),
        "may_ask": rows.iter().filter(|r| r.may_ask(role) && r.role != role).filter_map(asks).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_of_a_row_are_listed() {
        let rows = rows();
        let scene = as_text(role::SCENE, &rows).join("\n");
        assert!(scene.contains("cmd/apply") && scene.contains("answers    scene.v1.Command → scene.v1.CommandResult"));
        assert!(scene.contains("event/health"));
        let intent = as_text(role::AGENT_INTENT, &rows).join("\n");
        assert!(!intent.contains("scene.v1.Command "), "the intent agent may not act:\n{intent}");
        let person = as_text(role::CLI, &rows).join("\n");
        assert!(person.contains("cmd/utter         may ask    agent-core") && !person.contains("event/health"));
    }
}
