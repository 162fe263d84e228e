//! Intents to JSON.

use prost::Message as _;
use prost_reflect::{DynamicMessage, FieldDescriptor, Kind, ReflectMessage as _, Value as Reflected};
use serde_json::{Map, Value, json};
use sg_proto::language::{Act, Intent};

use super::contract::{ACT, WORDS, is_excluded, may_be_absent};
use super::descriptors::Descriptors;
use crate::commands::table::fields;
use crate::prompt::InvalidAnswer;

/// Encodes an intent.
///
/// # Errors
/// [`InvalidAnswer`]: the intent holds a field that the schema lacks.
pub(super) fn encode(contract: &Descriptors, intent: &Intent) -> Result<Value, InvalidAnswer> {
    let message = DynamicMessage::decode(contract.intent.clone(), intent.encode_to_vec().as_slice())
        .map_err(|e| InvalidAnswer::new(e.to_string()))?;
    let mut properties = Map::new();
    for field in contract.intent.fields().filter(|f| !is_excluded(f)) {
        let value = message.get_field(&field);
        let items = value.as_list().unwrap_or_default();
        let written = if field.name() == "clauses" {
            items.iter().map(|clause| encode_clause(contract, clause)).collect()
        } else {
            items.iter().map(encode_value).collect()
        };
        properties.insert(field.name().to_owned(), written);
    }
    Ok(Value::Object(properties))
}

fn encode_clause(contract: &Descriptors, clause: &Reflected) -> Value {
    let Some(clause) = clause.as_message() else { return Value::Null };
    let act = clause.get_field_by_name("act").and_then(|a| a.as_enum_number()).unwrap_or_default();
    let fields = Act::try_from(act).ok().and_then(fields).unwrap_or_default();
    let mut properties = Map::new();
    for field in [ACT].iter().chain(fields).chain(&[WORDS]) {
        let Some(descriptor) = contract.clause.get_field_by_name(field.name) else { continue };
        let absent = field.is_optional() && !clause.has_field(&descriptor);
        let value = if absent { Value::Null } else { encode_field(&descriptor, &clause.get_field(&descriptor)) };
        properties.insert(field.name.to_owned(), value);
    }
    Value::Object(properties)
}

fn encode_value(value: &Reflected) -> Value {
    match value {
        Reflected::Bool(b) => json!(b),
        Reflected::F32(v) => json!(f64::from(*v)),
        Reflected::F64(v) => json!(v),
        Reflected::String(text) => json!(text),
        Reflected::List(items) => items.iter().map(encode_value).collect(),
        Reflected::Message(message) => {
            let mut properties = Map::new();
            for field in message.descriptor().fields().filter(|f| !is_excluded(f)) {
                let is_alternative = field.containing_oneof().is_some_and(|o| !o.is_synthetic());
                let has = message.has_field(&field);
                if has || !is_alternative {
                    let absent = !has && may_be_absent(&field);
                    let value = if absent { Value::Null } else { encode_field(&field, &message.get_field(&field)) };
                    properties.insert(field.name().to_owned(), value);
                }
            }
            Value::Object(properties)
        }
        // `field_schema` refuses other kinds.
        _ => Value::Null,
    }
}

fn encode_field(field: &FieldDescriptor, value: &Reflected) -> Value {
    match (field.kind(), value) {
        (Kind::Enum(of), Reflected::EnumNumber(number)) => {
            of.get_value(*number).map_or(Value::Null, |known| json!(known.name()))
        }
        _ => encode_value(value),
    }
}
