//! The form of an intent as JSON: a schema for models, made from the contract's descriptors, and the check of an answer
//! against the same rules.
//!
//! A field is described by its type in the contract and, where that says too little, by a line of `BOUNDS`; which fields a
//! clause has follows from its act (`ACTS`). Enums go by name. Every field of an object is required, with null for one
//! that may be absent: the strictest of the providers ask for that, and it leaves a model nothing to forget.

use prost::{Message as _, Name as _};
use prost_reflect::{
    DescriptorPool, DeserializeOptions, DynamicMessage, EnumDescriptor, FieldDescriptor, Kind, MessageDescriptor,
    ReflectMessage as _, Value as Reflected,
};
use serde_json::{Map, Value, json};
use sg_proto::language::{Act, Clause, Intent, Reference};
use sg_proto::limits::{MAX_NAME_BYTES, MAX_UTTERANCE_BYTES};

use crate::prompt::{InvalidAnswer, MAX_ANSWER_BYTES, single_line};

/// How far a field goes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Bound {
    /// A number from, to.
    Number(f64, f64),
    /// Letters of a text, of each one in a list.
    Letters(usize),
}

/// Most clauses of one answer.
const MAX_CLAUSES: usize = 16;
/// Most entries of any other list.
const MAX_ITEMS: usize = 16;

/// Fields by full name without `supergaussian.` and their bounds: those that the contract documents, or that keep a
/// slip of a model from wiping a picture out. A number or text without a line here does not go into the form.
const BOUNDS: &[(&str, Bound)] = &[
    ("language.v1.Intent.not_understood", Bound::Letters(MAX_UTTERANCE_BYTES)),
    ("language.v1.Clause.words", Bound::Letters(MAX_UTTERANCE_BYTES)),
    ("language.v1.Clause.color_name", Bound::Letters(40)),
    ("language.v1.Clause.name", Bound::Letters(MAX_NAME_BYTES)),
    ("language.v1.Clause.amount", Bound::Number(0.0, 1000.0)),
    ("language.v1.Reference.names", Bound::Letters(MAX_NAME_BYTES)),
    ("scene.v1.Color.red", Bound::Number(0.0, 1.0)),
    ("scene.v1.Color.green", Bound::Number(0.0, 1.0)),
    ("scene.v1.Color.blue", Bound::Number(0.0, 1.0)),
    ("scene.v1.Vector.x", Bound::Number(-1e6, 1e6)),
    ("scene.v1.Vector.y", Bound::Number(-1e6, 1e6)),
    ("scene.v1.Vector.z", Bound::Number(-1e6, 1e6)),
    ("scene.v1.SetLight.ambient", Bound::Number(0.0, 100.0)),
    ("scene.v1.SetLight.diffuse", Bound::Number(0.0, 100.0)),
    ("scene.v1.SetLight.specular", Bound::Number(0.0, 100.0)),
    ("scene.v1.SetLight.shininess", Bound::Number(0.0, 1000.0)),
    ("scene.v1.Orbit.azimuth_degrees", Bound::Number(-3600.0, 3600.0)),
    ("scene.v1.Orbit.elevation_degrees", Bound::Number(-3600.0, 3600.0)),
    ("scene.v1.SetView.zoom", Bound::Number(0.01, 100.0)),
];

/// What no utterance says in this form: an exact viewpoint, and the target of a view, which stands in the clause.
const LEFT_OUT: &[&str] = &[
    "language.v1.Intent.suggestions",
    "language.v1.Intent.backend",
    "language.v1.Intent.model",
    "language.v1.Intent.fallback",
    "scene.v1.SetView.view",
    "scene.v1.Target.units",
    "scene.v1.Target.selection",
    "scene.v1.Target.everything",
    "scene.v1.Target.complement",
];

/// Whether a clause's field has to be there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Need {
    Must,
    May,
}

/// What a clause of an act has beside `act` and `words`.
const ACTS: &[(Act, &[(&str, Need)])] = &[
    (Act::SetColor, &[("target", Need::Must), ("color", Need::May), ("color_name", Need::May)]),
    (Act::SetOpacity, &[("target", Need::Must), ("amount", Need::Must), ("relative", Need::Must)]),
    (Act::Show, &[("target", Need::Must)]),
    (Act::Hide, &[("target", Need::Must)]),
    (Act::ShowOnly, &[("target", Need::Must)]),
    (Act::SetLight, &[("light", Need::Must)]),
    (Act::SetBackground, &[("color", Need::Must), ("color_name", Need::May)]),
    (Act::SetView, &[("view", Need::Must), ("target", Need::May)]),
    (Act::Select, &[("target", Need::Must), ("operation", Need::May)]),
    (Act::ClearSelection, &[]),
    (Act::Label, &[("name", Need::Must), ("operation", Need::May)]),
    (Act::Rename, &[("target", Need::Must), ("name", Need::Must)]),
    (Act::Delete, &[("target", Need::Must)]),
    (Act::List, &[]),
    (Act::Describe, &[("target", Need::May)]),
    (Act::QuerySelection, &[]),
    (Act::Undo, &[("amount", Need::May)]),
    (Act::Redo, &[("amount", Need::May)]),
    (Act::Reset, &[]),
    (Act::Help, &[]),
    (Act::SetTerm, &[("term", Need::Must)]),
];

/// The contract's descriptors do not hold what this form is made of.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the form of an intent cannot be made from the contract: {0}")]
pub struct SchemaError(String);

/// The form of an intent.
#[derive(Debug, Clone)]
pub struct IntentSchema {
    intent: MessageDescriptor,
    clause: MessageDescriptor,
    acts: EnumDescriptor,
    schema: Value,
}

impl IntentSchema {
    /// Makes the form from the contract.
    ///
    /// # Errors
    /// [`SchemaError`]: a field of the form is not in the contract.
    pub fn new() -> Result<Self, SchemaError> {
        let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).map_err(|e| SchemaError(e.to_string()))?;
        let message = |name: String| pool.get_message_by_name(&name).ok_or(SchemaError(format!("no message {name}")));
        let (intent, clause) = (message(Intent::full_name())?, message(Clause::full_name())?);
        let act = clause.get_field_by_name("act").map(|f| f.kind());
        let acts =
            act.as_ref().and_then(Kind::as_enum).cloned().ok_or(SchemaError("a clause has no act".to_owned()))?;
        let mut form = Self { intent, clause, acts, schema: Value::Null };
        form.schema = form.make_schema()?;
        Ok(form)
    }

    /// The JSON schema.
    #[must_use]
    pub fn schema(&self) -> &Value {
        &self.schema
    }

    fn make_schema(&self) -> Result<Value, SchemaError> {
        let mut definitions = Map::new();
        let mut clauses = Vec::new();
        for (act, needs) in ACTS {
            let mut properties = Map::new();
            properties.insert("act".to_owned(), json!({"type": "string", "enum": [act.as_str_name()]}));
            for (name, need) in needs.iter().chain(&[("words", Need::Must)]) {
                let field =
                    self.clause.get_field_by_name(name).ok_or(SchemaError(format!("a clause has no {name}")))?;
                let mut schema = field_schema(&field, &mut definitions)?;
                if is_count(*act, name) {
                    schema = json!({"type": "integer", "minimum": 1, "maximum": 1000});
                }
                properties.insert((*name).to_owned(), if *need == Need::May { or_null(&schema) } else { schema });
            }
            clauses.push(closed(&properties));
        }
        let mut properties = Map::new();
        for field in self.intent.fields().filter(|f| !is_left_out(f)) {
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
    #[must_use]
    pub fn manual(&self) -> String {
        let mut text = String::from("Acts, each with the fields of its clause (a field with ? may be null):\n");
        for (act, needs) in ACTS {
            let fields: Vec<String> = needs
                .iter()
                .map(|(name, need)| format!("{name}{}", if *need == Need::May { "?" } else { "" }))
                .collect();
            let value = self.acts.get_value((*act).into());
            let comment = value
                .map_or_else(String::new, |v| comment(v.parent_enum().parent_file().file_descriptor_proto(), v.path()));
            text.push_str(&format!("{} {{{}}}: {comment}\n", act.as_str_name(), fields.join(", ")));
        }
        text.push_str("Fields:\n");
        let mut told = Vec::new();
        let used = |f: &FieldDescriptor| ACTS.iter().any(|(_, needs)| needs.iter().any(|(name, _)| *name == f.name()));
        describe(&self.clause, &|f| f.name() == "words" || used(f), &mut told, &mut text);
        text
    }

    /// An intent in this form.
    ///
    /// # Errors
    /// [`InvalidAnswer`]: it holds what this form does not have.
    pub fn write(&self, intent: &Intent) -> Result<Value, InvalidAnswer> {
        let message = DynamicMessage::decode(self.intent.clone(), intent.encode_to_vec().as_slice())
            .map_err(|e| InvalidAnswer::new(e.to_string()))?;
        let mut properties = Map::new();
        for field in self.intent.fields().filter(|f| !is_left_out(f)) {
            let value = message.get_field(&field);
            let items = value.as_list().unwrap_or_default();
            let written = if field.name() == "clauses" {
                items.iter().map(|clause| self.write_clause(clause)).collect()
            } else {
                items.iter().map(write).collect()
            };
            properties.insert(field.name().to_owned(), written);
        }
        Ok(Value::Object(properties))
    }

    fn write_clause(&self, clause: &Reflected) -> Value {
        let Some(clause) = clause.as_message() else { return Value::Null };
        let act = clause.get_field_by_name("act").and_then(|a| a.as_enum_number()).unwrap_or_default();
        let needs = ACTS.iter().find(|(known, _)| i32::from(*known) == act).map_or(&[][..], |(_, needs)| needs);
        let mut properties = Map::new();
        for name in ["act"].iter().chain(needs.iter().map(|(name, _)| name)).chain(&["words"]) {
            let Some(field) = self.clause.get_field_by_name(name) else { continue };
            let may = needs.contains(&(name, Need::May));
            let absent = may && !clause.has_field(&field);
            let value = if absent { Value::Null } else { write_field(&field, &clause.get_field(&field)) };
            properties.insert((*name).to_owned(), value);
        }
        Value::Object(properties)
    }

    /// Reads an answer in this form and checks it: nothing the form does not have, every number finite and within its
    /// bounds, every text short enough and free of control characters, every clause with what its act needs.
    ///
    /// # Errors
    /// [`InvalidAnswer`] with the place.
    pub fn read(&self, answer: &str) -> Result<Intent, InvalidAnswer> {
        if answer.len() > MAX_ANSWER_BYTES {
            return Err(InvalidAnswer::new(format!("it has {} bytes, over {MAX_ANSWER_BYTES}", answer.len())));
        }
        let malformed = |e: serde_json::Error| {
            InvalidAnswer::new(format!("it is not the JSON asked for: {}", single_line(&e.to_string())))
        };
        let mut reader = serde_json::Deserializer::from_str(answer);
        let strict = DeserializeOptions::new().deny_unknown_fields(true);
        let message =
            DynamicMessage::deserialize_with_options(self.intent.clone(), &mut reader, &strict).map_err(malformed)?;
        reader.end().map_err(malformed)?;
        check(&message, "")?;
        let mut intent: Intent = message.transcode_to().map_err(|e| InvalidAnswer::new(e.to_string()))?;
        if intent.clauses.len() > MAX_CLAUSES {
            return Err(InvalidAnswer::new(format!("it has {} clauses, over {MAX_CLAUSES}", intent.clauses.len())));
        }
        let clauses = message.get_field_by_name("clauses");
        let clauses = clauses.as_deref().and_then(Reflected::as_list).unwrap_or_default();
        for (at, (clause, reflected)) in intent.clauses.iter().zip(clauses).enumerate() {
            check_clause(clause, reflected, at)?;
        }
        // What is given a name is always the selection, so the form does not ask for it.
        for clause in intent.clauses.iter_mut().filter(|c| c.act() == Act::Label) {
            clause.target = Some(Reference { selection: true, ..Reference::default() });
        }
        Ok(intent)
    }
}

/// Steps of the history are counted, so their amount is whole.
fn is_count(act: Act, field: &str) -> bool {
    field == "amount" && matches!(act, Act::Undo | Act::Redo)
}

fn short(name: &str) -> &str {
    name.strip_prefix("supergaussian.").unwrap_or(name)
}

fn is_left_out(field: &FieldDescriptor) -> bool {
    LEFT_OUT.contains(&short(field.full_name()))
}

fn bound(field: &FieldDescriptor) -> Option<Bound> {
    BOUNDS.iter().find(|(name, _)| *name == short(field.full_name())).map(|(_, bound)| *bound)
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

/// Whether a field of a message within a clause may be null: what the contract can tell from its default, and an enum,
/// whose default says that nothing was said.
fn may_be_absent(field: &FieldDescriptor) -> bool {
    field.supports_presence() || (matches!(field.kind(), Kind::Enum(_)) && !field.is_list())
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

fn write(value: &Reflected) -> Value {
    match value {
        Reflected::Bool(b) => json!(b),
        Reflected::F32(v) => json!(f64::from(*v)),
        Reflected::F64(v) => json!(v),
        Reflected::String(text) => json!(text),
        Reflected::List(items) => items.iter().map(write).collect(),
        Reflected::Message(message) => {
            let mut properties = Map::new();
            for field in message.descriptor().fields().filter(|f| !is_left_out(f)) {
                let is_alternative = field.containing_oneof().is_some_and(|o| !o.is_synthetic());
                let has = message.has_field(&field);
                if has || !is_alternative {
                    let absent = !has && may_be_absent(&field);
                    let value = if absent { Value::Null } else { write_field(&field, &message.get_field(&field)) };
                    properties.insert(field.name().to_owned(), value);
                }
            }
            Value::Object(properties)
        }
        // The form has no other kinds: `field_schema` refuses them.
        _ => Value::Null,
    }
}

fn write_field(field: &FieldDescriptor, value: &Reflected) -> Value {
    match (field.kind(), value) {
        (Kind::Enum(of), Reflected::EnumNumber(number)) => {
            of.get_value(*number).map_or(Value::Null, |known| json!(known.name()))
        }
        _ => write(value),
    }
}

/// Checks everything that is set in a message, and what is set in it.
fn check(message: &DynamicMessage, place: &str) -> Result<(), InvalidAnswer> {
    for (field, value) in message.fields() {
        let place = if place.is_empty() { field.name().to_owned() } else { format!("{place}.{}", field.name()) };
        if is_left_out(&field) {
            return Err(InvalidAnswer::new(format!("`{place}` is not asked for")));
        }
        match value.as_list() {
            Some(items) if items.len() > MAX_ITEMS => {
                return Err(InvalidAnswer::new(format!("`{place}` has {} entries, over {MAX_ITEMS}", items.len())));
            }
            Some(items) => {
                for (at, item) in items.iter().enumerate() {
                    check_value(&field, item, &format!("{place}[{at}]"))?;
                }
            }
            None => check_value(&field, value, &place)?,
        }
    }
    Ok(())
}

fn check_value(field: &FieldDescriptor, value: &Reflected, place: &str) -> Result<(), InvalidAnswer> {
    let number = |v: f64| match bound(field) {
        Some(Bound::Number(least, most)) if !(least..=most).contains(&v) => {
            Err(InvalidAnswer::new(format!("`{place}` is {v}; it goes from {least} to {most}")))
        }
        _ => Ok(()),
    };
    match value {
        Reflected::F32(v) => number(f64::from(*v)),
        Reflected::F64(v) => number(*v),
        Reflected::String(text) => match bound(field) {
            Some(Bound::Letters(letters)) if text.chars().count() > letters => {
                Err(InvalidAnswer::new(format!("`{place}` has over {letters} letters")))
            }
            _ if text.chars().any(char::is_control) => {
                Err(InvalidAnswer::new(format!("`{place}` has control characters")))
            }
            _ => Ok(()),
        },
        Reflected::EnumNumber(number) => match field.kind() {
            Kind::Enum(of) if *number == 0 || of.get_value(*number).is_none() => {
                Err(InvalidAnswer::new(format!("`{place}` has no value {number}")))
            }
            _ => Ok(()),
        },
        Reflected::Message(message) => check(message, place),
        _ => Ok(()),
    }
}

/// Checks that a clause has what its act needs and nothing else.
fn check_clause(clause: &Clause, reflected: &Reflected, at: usize) -> Result<(), InvalidAnswer> {
    let act = clause.act();
    let Some((_, needs)) = ACTS.iter().find(|(known, _)| *known == act) else {
        return Err(InvalidAnswer::new(format!("`clauses[{at}]` has no act")));
    };
    let fields = reflected.as_message().into_iter().flat_map(DynamicMessage::fields);
    let set: Vec<String> = fields.map(|(field, _)| field.name().to_owned()).collect();
    for name in &set {
        if !matches!(name.as_str(), "act" | "words") && !needs.iter().any(|(known, _)| known == name) {
            return Err(InvalidAnswer::new(format!("`clauses[{at}]` is {} and carries `{name}`", act.as_str_name())));
        }
    }
    for (name, _) in needs.iter().filter(|(name, need)| *need == Need::Must && *name != "relative") {
        if !set.iter().any(|known| known == name) {
            return Err(InvalidAnswer::new(format!("`clauses[{at}]` is {} without `{name}`", act.as_str_name())));
        }
    }
    if let Some(amount) = clause.amount.filter(|_| is_count(act, "amount"))
        && (amount.fract() != 0.0 || amount < 1.0)
    {
        return Err(InvalidAnswer::new(format!("`clauses[{at}].amount` is {amount}; steps are counted from 1")));
    }
    let empty = |v: &sg_proto::scene::SetView| v.change.is_none();
    if clause.view.as_ref().is_some_and(empty) {
        return Err(InvalidAnswer::new(format!("`clauses[{at}].view` changes nothing")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn form() -> IntentSchema {
        IntentSchema::new().unwrap()
    }

    fn refused(answer: &str, part: &str) {
        let reason = form().read(answer).unwrap_err().to_string();
        assert!(reason.contains(part), "{answer}: {reason}");
    }

    fn clause(fields: &str) -> String {
        format!(r#"{{"clauses": [{{"words": "w", {fields}}}], "not_understood": []}}"#)
    }

    #[test]
    fn every_act_of_the_contract_has_its_fields() {
        for act in 1..=21 {
            let act = Act::try_from(act).unwrap();
            assert_eq!(ACTS.iter().filter(|(known, _)| *known == act).count(), 1, "{act:?}");
        }
        assert_eq!(ACTS.len(), 21);
    }

    #[test]
    fn every_line_of_the_tables_speaks_of_a_field_of_the_contract() {
        let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).unwrap();
        for name in BOUNDS.iter().map(|(name, _)| name).chain(LEFT_OUT) {
            let (message, field) = name.rsplit_once('.').unwrap();
            let message = pool.get_message_by_name(&format!("supergaussian.{message}"));
            assert!(message.unwrap().get_field_by_name(field).is_some(), "{name}");
        }
    }

    #[test]
    fn the_schema_closes_every_object_and_bounds_every_value() {
        fn walk(schema: &Value, place: &str) {
            match schema {
                Value::Object(map) => {
                    match map.get("type").and_then(Value::as_str) {
                        Some("object") => {
                            assert_eq!(map["additionalProperties"], false, "{place}");
                            let required = map["required"].as_array().unwrap().len();
                            assert_eq!(required, map["properties"].as_object().unwrap().len(), "{place}");
                        }
                        Some("array") => assert!(map.contains_key("maxItems"), "{place}"),
                        Some("string") => assert!(map.contains_key("maxLength") || map.contains_key("enum"), "{place}"),
                        Some("number" | "integer") => {
                            assert!(map.contains_key("minimum") && map.contains_key("maximum"), "{place}");
                        }
                        _ => (),
                    }
                    map.iter().for_each(|(key, inner)| walk(inner, &format!("{place}/{key}")));
                }
                Value::Array(items) => items.iter().for_each(|inner| walk(inner, place)),
                _ => (),
            }
        }
        let form = form();
        walk(form.schema(), "");
        let text = form.schema().to_string();
        for absent in ["UNSPECIFIED", "suggestions", "fallback", "eye"] {
            assert!(!text.contains(absent), "{absent}");
        }
        for there in ["ACT_SET_COLOR", "SHADING_TERM_NORMAL", "not_understood", "azimuth_degrees"] {
            assert!(text.contains(there), "{there}");
        }
        assert!(text.len() < 16 << 10, "{} bytes", text.len());
    }

    #[test]
    fn the_manual_says_what_the_contract_says() {
        let manual = form().manual();
        assert!(manual.contains("ACT_SET_COLOR {target, color?, color_name?}: Give a colour.\n"), "{manual}");
        assert!(manual.contains("Reference.complement: All that is not named;"), "{manual}");
        assert!(manual.contains("Orbit.azimuth_degrees: Degrees about the up direction"), "{manual}");
        assert!(
            manual.lines().all(|l| !l.trim_end().ends_with(':') || l.starts_with("Acts") || l == "Fields:"),
            "{manual}"
        );
    }

    #[test]
    fn what_is_no_json_or_not_this_form_is_refused() {
        for (answer, part) in [
            ("", "not the JSON"),
            ("make it red", "not the JSON"),
            (r#"{"clauses": ["#, "not the JSON"),
            (r#"{"clauses": []} and more"#, "not the JSON"),
            (r#"{"clauses": {}}"#, "not the JSON"),
            (r#"{"clauses": [], "note": "hello"}"#, "note"),
            (r#"{"clauses": [], "backend": "grammar"}"#, "`backend` is not asked for"),
            (&clause(r#""act": "ACT_FLY""#), "not the JSON"),
            (&clause(r#""act": "ACT_UNSPECIFIED""#), "no act"),
            (&clause(r#""act": 99"#), "no value 99"),
            (&clause(r#""act": "ACT_HIDE", "target": {"names": ["sac"], "colour": 1}"#), "colour"),
            (&clause(r#""act": "ACT_HIDE""#), "ACT_HIDE without `target`"),
            (&clause(r#""act": "ACT_HIDE", "target": {"names": ["sac"]}, "amount": 1"#), "carries `amount`"),
            (&clause(r#""act": "ACT_SET_VIEW", "view": {"view": {}}"#), "`clauses[0].view.view` is not asked for"),
            (&clause(r#""act": "ACT_SET_VIEW", "view": {}"#), "changes nothing"),
            (&clause(r#""act": "ACT_SET_TERM", "term": "SHADING_TERM_UNSPECIFIED""#), "without `term`"),
        ] {
            refused(answer, part);
        }
        refused(&format!("{}[]{}", "[".repeat(5000), "]".repeat(5000)), "not the JSON");
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        let color = |red: &str| {
            clause(&format!(
                r#""act": "ACT_SET_BACKGROUND", "color": {{"red": {red}, "green": 0, "blue": 0}}, "color_name": null"#
            ))
        };
        assert!(form().read(&color("0.5")).is_ok());
        for red in ["1.5", "-0.1", "1e300", "1e999", "NaN", "\"NaN\"", "\"Infinity\"", "\"-Infinity\""] {
            assert!(form().read(&color(red)).is_err(), "{red}");
        }
        refused(&color("2"), "`clauses[0].color.red` is 2; it goes from 0 to 1");
        refused(&color("\"NaN\""), "NaN");
        let opacity = |amount: &str| {
            clause(&format!(
                r#""act": "ACT_SET_OPACITY", "target": {{"everything": true}}, "amount": {amount}, "relative": false"#
            ))
        };
        assert!(form().read(&opacity("0.2")).is_ok());
        for amount in ["-1", "1e6", "\"NaN\"", "null"] {
            assert!(form().read(&opacity(amount)).is_err(), "{amount}");
        }
        refused(&clause(r#""act": "ACT_UNDO", "amount": 1.5"#), "steps are counted from 1");
        refused(&clause(r#""act": "ACT_SET_VIEW", "view": {"zoom": 0}"#), "`clauses[0].view.zoom` is 0");
    }

    #[test]
    fn huge_answers_are_refused_before_they_are_read() {
        refused(&" ".repeat(MAX_ANSWER_BYTES + 1), "bytes");
        let name = format!(r#""act": "ACT_HIDE", "target": {{"names": ["{}"]}}"#, "a".repeat(129));
        refused(&clause(&name), "`clauses[0].target.names[0]` has over 128 letters");
        refused(&clause(r#""act": "ACT_HIDE", "target": {"names": ["a\u0007b"]}"#), "control characters");
        let many = vec![r#"{"act": "ACT_RESET", "words": "w"}"#; 17].join(",");
        refused(&format!(r#"{{"clauses": [{many}]}}"#), "17");
        let names = vec!["\"a\""; 17].join(",");
        refused(&clause(&format!(r#""act": "ACT_HIDE", "target": {{"names": [{names}]}}"#)), "17 entries");
    }
}
