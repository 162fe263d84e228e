//! The JSON schema of an intent, and the manual of its fields.

use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor};
use serde_json::{Map, Value, json};

use super::contract::{Bound, MAX_CLAUSES, MAX_ITEMS, WORDS, bound, is_excluded, may_be_absent};
use super::descriptors::{Descriptors, SchemaError};
use crate::commands::command::{Field, Presence};

pub(super) fn build(contract: &Descriptors) -> Result<Value, SchemaError> {
    let mut definitions = Map::new();
    let mut clauses = Vec::new();
    for (act, fields) in contract.act_fields() {
        let mut properties = Map::new();
        properties.insert("act".to_owned(), json!({"type": "string", "enum": [act.as_str_name()]}));
        for &Field { name, presence } in fields.iter().chain(&[WORDS]) {
            let field = contract
                .clause
                .get_field_by_name(name)
                .ok_or_else(|| SchemaError(format!("the clause has no {name}")))?;
            let schema = match presence {
                Presence::OptionalCount => json!({"type": "integer", "minimum": 1, "maximum": 1000}),
                Presence::Required | Presence::Optional => field_schema(&field, &mut definitions)?,
            };
            let schema = if presence == Presence::Required { schema } else { or_null(&schema) };
            properties.insert(name.to_owned(), schema);
        }
        clauses.push(closed(&properties));
    }
    let mut properties = Map::new();
    for field in contract.intent.fields().filter(|f| !is_excluded(f)) {
        let schema = if field.name() == "clauses" {
            json!({"type": "array", "items": {"anyOf": clauses}, "maxItems": MAX_CLAUSES})
        } else {
            field_schema(&field, &mut definitions)?
        };
        properties.insert(field.name().to_owned(), schema);
    }
    let mut schema = closed(&properties);
    if let Value::Object(root) = &mut schema {
        root.insert("$defs".to_owned(), Value::Object(definitions));
    }
    Ok(schema)
}

/// Each act with its fields, then each field with its comment in the contract.
pub(super) fn manual(contract: &Descriptors) -> String {
    let mut text = String::from("Acts, each with the fields of its clause (a field with ? may be null):\n");
    for (act, fields) in contract.act_fields() {
        let fields: Vec<String> =
            fields.iter().map(|f| format!("{}{}", f.name, if f.is_optional() { "?" } else { "" })).collect();
        let value = contract.acts.get_value(act.into());
        let comment = value
            .map_or_else(String::new, |v| comment(v.parent_enum().parent_file().file_descriptor_proto(), v.path()));
        text.push_str(&format!("{} {{{}}}: {comment}\n", act.as_str_name(), fields.join(", ")));
    }
    text.push_str("Fields:\n");
    let mut visited = Vec::new();
    let used = |f: &FieldDescriptor| {
        contract.act_fields().any(|(_, fields)| fields.iter().any(|field| field.name == f.name()))
    };
    describe(&contract.clause, &|f| f.name() == "words" || used(f), &mut visited, &mut text);
    text
}

fn or_null(schema: &Value) -> Value {
    json!({"anyOf": [schema, {"type": "null"}]})
}

/// An object with exactly these properties.
fn closed(properties: &Map<String, Value>) -> Value {
    let required: Vec<Value> = properties.keys().map(|name| json!(name)).collect();
    json!({"type": "object", "properties": properties, "required": required, "additionalProperties": false})
}

fn field_schema(field: &FieldDescriptor, definitions: &mut Map<String, Value>) -> Result<Value, SchemaError> {
    let unbounded = || SchemaError(format!("{} has no bound", field.full_name()));
    let one = match (field.kind(), bound(field)) {
        (Kind::Bool, _) => json!({"type": "boolean"}),
        (Kind::Float | Kind::Double, Some(Bound::Number(min, max))) => {
            json!({"type": "number", "minimum": min, "maximum": max})
        }
        (Kind::String, Some(Bound::MaxChars(chars))) => json!({"type": "string", "maxLength": chars}),
        (Kind::Enum(of), _) => {
            let names: Vec<Value> = of.values().filter(|v| v.number() != 0).map(|v| json!(v.name())).collect();
            json!({"type": "string", "enum": names})
        }
        (Kind::Message(of), _) => {
            if !definitions.contains_key(of.name()) {
                let schema = message_schema(&of, definitions)?;
                definitions.insert(of.name().to_owned(), schema);
            }
            json!({"$ref": format!("#/$defs/{}", of.name())})
        }
        _ => return Err(unbounded()),
    };
    Ok(if field.is_list() { json!({"type": "array", "items": one, "maxItems": MAX_ITEMS}) } else { one })
}

/// The schema of a message. Of alternatives exactly one is present.
fn message_schema(message: &MessageDescriptor, definitions: &mut Map<String, Value>) -> Result<Value, SchemaError> {
    let is_alternative = |f: &FieldDescriptor| f.containing_oneof().is_some_and(|o| !o.is_synthetic());
    let (alternatives, plain): (Vec<_>, Vec<_>) =
        message.fields().filter(|f| !is_excluded(f)).partition(is_alternative);
    let mut properties = Map::new();
    for field in plain {
        let schema = field_schema(&field, definitions)?;
        let schema = if may_be_absent(&field) { or_null(&schema) } else { schema };
        properties.insert(field.name().to_owned(), schema);
    }
    if alternatives.is_empty() {
        return Ok(closed(&properties));
    }
    let mut choices = Vec::new();
    for field in alternatives {
        let mut with = properties.clone();
        with.insert(field.name().to_owned(), field_schema(&field, definitions)?);
        choices.push(closed(&with));
    }
    Ok(json!({"anyOf": choices}))
}

/// Describes the fields of a message and of the messages in it, each message once.
fn describe(
    message: &MessageDescriptor,
    include: &dyn Fn(&FieldDescriptor) -> bool,
    visited: &mut Vec<String>,
    text: &mut String,
) {
    visited.push(message.full_name().to_owned());
    let mut within = Vec::new();
    for field in message.fields().filter(|f| !is_excluded(f) && include(f)) {
        let about = comment(message.parent_file().file_descriptor_proto(), field.path());
        text.push_str(&format!("{}.{}: {about}\n", message.name(), field.name()));
        if let Kind::Message(of) = field.kind() {
            within.push(of);
        }
    }
    for of in within {
        if !visited.iter().any(|name| name == of.full_name()) {
            describe(&of, &|_| true, visited, text);
        }
    }
}

/// The comment of an item of a `.proto` file, on one line.
fn comment(file: &prost_reflect::prost_types::FileDescriptorProto, path: &[i32]) -> String {
    let locations = file.source_code_info.iter().flat_map(|info| &info.location);
    let found = locations.into_iter().find(|l| l.path == path).and_then(|l| l.leading_comments.as_deref());
    found.unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
}
