//! The JSON schema of an intent, and the manual of its fields.

use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor};
use serde_json::{Map, Value, json};

use super::contract::{Bound, MAX_CLAUSES, MAX_ITEMS, WORDS, bound, is_left_out, may_be_absent};
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
                .ok_or_else(|| SchemaError(format!("a clause has no {name}")))?;
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
    for field in contract.intent.fields().filter(|f| !is_left_out(f)) {
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

/// The form in words: each act with its fields, then what the fields mean, as the contract documents them.
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
    let mut told = Vec::new();
    let used = |f: &FieldDescriptor| {
        contract.act_fields().any(|(_, fields)| fields.iter().any(|field| field.name == f.name()))
    };
    describe(&contract.clause, &|f| f.name() == "words" || used(f), &mut told, &mut text);
    text
}

fn or_null(schema: &Value) -> Value {
    json!({"anyOf": [schema, {"type": "null"}]})
}

/// An object with these properties, all of them and no others.
fn closed(properties: &Map<String, Value>) -> Value {
    let required: Vec<Value> = properties.keys().map(|name| json!(name)).collect();
    json!({"type": "object", "properties": properties, "required": required, "additionalProperties": false})
}

fn field_schema(field: &FieldDescriptor, definitions: &mut Map<String, Value>) -> Result<Value, SchemaError> {
    let unbounded = || SchemaError(format!("{} has no bound", field.full_name()));
    let one = match (field.kind(), bound(field)) {
        (Kind::Bool, _) => json!({"type": "boolean"}),
        (Kind::Float | Kind::Double, Some(Bound::Number(least, most))) => {
            json!({"type": "number", "minimum": least, "maximum": most})
        }
        (Kind::String, Some(Bound::Letters(letters))) => json!({"type": "string", "maxLength": letters}),
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

/// A message: each of its fields, and of alternatives one.
fn message_schema(message: &MessageDescriptor, definitions: &mut Map<String, Value>) -> Result<Value, SchemaError> {
    let is_alternative = |f: &FieldDescriptor| f.containing_oneof().is_some_and(|o| !o.is_synthetic());
    let (alternatives, plain): (Vec<_>, Vec<_>) =
        message.fields().filter(|f| !is_left_out(f)).partition(is_alternative);
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

/// Describes the fields of a message and of the messages in them, each message once.
fn describe(
    message: &MessageDescriptor,
    wanted: &dyn Fn(&FieldDescriptor) -> bool,
    told: &mut Vec<String>,
    text: &mut String,
) {
    told.push(message.full_name().to_owned());
    let mut within = Vec::new();
    for field in message.fields().filter(|f| !is_left_out(f) && wanted(f)) {
        let about = comment(message.parent_file().file_descriptor_proto(), field.path());
        text.push_str(&format!("{}.{}: {about}\n", message.name(), field.name()));
        if let Kind::Message(of) = field.kind() {
            within.push(of);
        }
    }
    for of in within {
        if !told.iter().any(|name| name == of.full_name()) {
            describe(&of, &|_| true, told, text);
        }
    }
}

/// The comment before an item of a `.proto` file, on one line.
fn comment(file: &prost_reflect::prost_types::FileDescriptorProto, path: &[i32]) -> String {
    let locations = file.source_code_info.iter().flat_map(|info| &info.location);
    let found = locations.into_iter().find(|l| l.path == path).and_then(|l| l.leading_comments.as_deref());
    found.unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
}
