//! Golden bytes: the encoding of each message when its fields were first committed.
//!
//! `golden/<package>.txt` holds lines `<full name> <variant> <hexadecimal bytes> <JSON>`, `-` for no bytes. The files are
//! append-only. A committed line must decode to the same JSON, and the generated types must encode the same bytes. A field
//! can thus not be renumbered, retyped or renamed unnoticed.
//!
//! After adding a message, a field or an enum value, append the missing lines with
//!
//! ```text
//! SUPERGAUSSIAN_GOLDEN=append cargo test --release -p sg-proto --test golden
//! ```
//!
//! and commit them. Delete a line only by hand, with a reason, and while no release holds it.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::PathBuf;

use prost_reflect::{DescriptorPool, DynamicMessage, FieldDescriptor, Kind, MessageDescriptor, Value};
use sg_proto::golden::{GoldenError, Line};

/// Depth from which nested messages are present but empty. Each message has lines of its own.
const DEPTH: usize = 2;

fn pool() -> DescriptorPool {
    DescriptorPool::decode(sg_proto::DESCRIPTORS).unwrap()
}

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("golden")
}

/// The committed lines by package.
fn committed() -> BTreeMap<String, Vec<Line>> {
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        let package = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let lines = std::fs::read_to_string(&path)
            .unwrap()
            .lines()
            .map(|line| Line::parse(line).unwrap_or_else(|e| panic!("{package}.txt: {e}")))
            .collect();
        files.insert(package, lines);
    }
    files
}

/// A sample value, distinct by field number and too wide for a narrower type.
fn sample(field: &FieldDescriptor, item: u32, variant: usize, depth: usize) -> Value {
    let seed = field.number() * 10 + item;
    match field.kind() {
        Kind::Bool => Value::Bool(true),
        Kind::Int32 | Kind::Sint32 | Kind::Sfixed32 => Value::I32(i32::MIN + i32::try_from(seed).unwrap()),
        Kind::Int64 | Kind::Sint64 | Kind::Sfixed64 => Value::I64(i64::MIN + i64::from(seed)),
        Kind::Uint32 | Kind::Fixed32 => Value::U32(u32::MAX - seed),
        Kind::Uint64 | Kind::Fixed64 => Value::U64(u64::MAX - u64::from(seed)),
        Kind::Float => Value::F32(1.0 + f32::EPSILON * f32::from(u16::try_from(seed).unwrap())),
        Kind::Double => Value::F64(f64::from(seed) + 0.1),
        Kind::String => Value::String(format!("{} {item} é", field.name())),
        Kind::Bytes => Value::Bytes(vec![0xff, 0x00, seed.to_le_bytes()[0], 0x80].into()),
        Kind::Enum(values) => {
            let numbers: Vec<i32> = values.values().map(|v| v.number()).collect();
            Value::EnumNumber(numbers[(variant / alternatives(field).len() + item as usize) % numbers.len()])
        }
        Kind::Message(descriptor) if depth < DEPTH => Value::Message(filled(&descriptor, variant, depth + 1)),
        Kind::Message(descriptor) => Value::Message(DynamicMessage::new(descriptor)),
    }
}

/// Numbers of the fields in the same oneof, with this one.
fn alternatives(field: &FieldDescriptor) -> Vec<u32> {
    field.containing_oneof().map_or(vec![field.number()], |oneof| oneof.fields().map(|f| f.number()).collect())
}

/// Whether the n-th variant of the message sets this field. Each variant sets one field of a oneof.
fn is_in(field: &FieldDescriptor, variant: usize) -> bool {
    let alternatives = alternatives(field);
    alternatives[variant % alternatives.len()] == field.number()
}

/// A message with every field set: the n-th alternative of each oneof, the n-th value of each enum, two items in each list.
fn filled(descriptor: &MessageDescriptor, variant: usize, depth: usize) -> DynamicMessage {
    let mut message = DynamicMessage::new(descriptor.clone());
    for field in descriptor.fields().filter(|field| is_in(field, variant)) {
        assert!(!field.is_map(), "{}: a map has no fixed order on the wire; use a repeated message", field.full_name());
        let value = if field.is_list() {
            Value::List((0..2).map(|item| sample(&field, item, variant, depth)).collect())
        } else {
            sample(&field, 0, variant, depth)
        };
        message.set_field(&field, value);
    }
    message
}

/// A message whose fields with presence hold their defaults.
fn present_defaults(descriptor: &MessageDescriptor, variant: usize) -> DynamicMessage {
    let mut message = DynamicMessage::new(descriptor.clone());
    for field in descriptor.fields().filter(|field| has_visible_default(field) && is_in(field, variant)) {
        message.set_field(&field, field.default_value());
    }
    message
}

fn has_visible_default(field: &FieldDescriptor) -> bool {
    field.supports_presence() && field.kind().as_message().is_none()
}

/// Facts that a line covers: the message, each field, each visible default and each enum value.
fn covered(message: &DynamicMessage) -> BTreeSet<String> {
    let mut facts = BTreeSet::from([String::from("the message")]);
    for (field, value) in message.fields() {
        facts.insert(format!("field {}", field.name()));
        if has_visible_default(&field) && *value == field.default_value() {
            facts.insert(format!("default of {}", field.name()));
        }
        let items = if let Value::List(items) = value { items.iter().collect() } else { vec![value] };
        facts.extend(items.iter().filter_map(|v| v.as_enum_number()).map(|n| format!("{} = {n}", field.name())));
    }
    facts
}

/// Facts that the lines of a message must cover together.
fn to_cover(descriptor: &MessageDescriptor) -> BTreeSet<String> {
    let mut facts = BTreeSet::from([String::from("the message")]);
    for field in descriptor.fields() {
        facts.insert(format!("field {}", field.name()));
        if has_visible_default(&field) {
            facts.insert(format!("default of {}", field.name()));
        }
        if let Kind::Enum(values) = field.kind() {
            let zero_is_written = field.is_list() || field.supports_presence();
            let numbers = values.values().map(|v| v.number()).filter(|n| *n != 0 || zero_is_written);
            facts.extend(numbers.map(|n| format!("{} = {n}", field.name())));
        }
    }
    facts
}

/// Facts that the given lines do not cover, and sample lines that cover them.
fn missing_lines(descriptor: &MessageDescriptor, lines: &[DynamicMessage]) -> (BTreeSet<String>, Vec<Line>) {
    let mut open = to_cover(descriptor);
    for line in lines {
        let facts = covered(line);
        open.retain(|fact| !facts.contains(fact));
    }
    let missing = open.clone();
    let variants = descriptor.fields().map(|field| {
        let values = field.kind().as_enum().map_or(1, |values| values.values().len());
        alternatives(&field).len() * values
    });
    let most = variants.max().unwrap_or(1);
    let candidates =
        (0..most).map(|n| filled(descriptor, n, 0)).chain((0..most).map(|n| present_defaults(descriptor, n)));
    let mut new = Vec::new();
    for candidate in candidates {
        let facts = covered(&candidate);
        if facts.iter().any(|fact| open.contains(fact)) {
            open.retain(|fact| !facts.contains(fact));
            new.push(Line::of(&candidate, (lines.len() + new.len()).to_string()).unwrap());
        }
    }
    assert!(open.is_empty(), "{}: the samples do not reach {open:?}", descriptor.full_name());
    (missing, new)
}

#[test]
fn committed_bytes_keep_their_meaning() {
    let pool = pool();
    let mut broken = String::new();
    let mut seen = BTreeSet::new();
    for (package, lines) in committed() {
        for line in lines {
            assert!(line.message.starts_with(&format!("{package}.")), "{} stands in {package}.txt", line.message);
            let name = format!("{} {}", line.message, line.variant);
            assert!(seen.insert(name.clone()), "duplicate line {name}");
            if let Err(why) = line.check(&pool) {
                writeln!(broken, "{name}: {why}").unwrap();
            }
        }
    }
    assert!(!seen.is_empty(), "no golden line was found");
    assert!(broken.is_empty(), "the wire format changed under messages that others may have stored:\n{broken}");
}

#[test]
fn every_message_field_and_enum_value_has_golden_bytes() {
    let pool = pool();
    let append = std::env::var("SUPERGAUSSIAN_GOLDEN").is_ok_and(|mode| mode == "append");
    let mut files = committed();
    let mut report = String::new();
    for name in sg_proto::message_names() {
        let descriptor = pool.get_message_by_name(name).unwrap();
        let lines = files.entry(descriptor.package_name().to_owned()).or_default();
        let known: Vec<DynamicMessage> = lines
            .iter()
            .filter(|line| line.message == name)
            .map(|line| DynamicMessage::decode(descriptor.clone(), &line.bytes[..]).unwrap())
            .collect();
        let (missing, new) = missing_lines(&descriptor, &known);
        if !missing.is_empty() {
            writeln!(report, "{name}: {missing:?}").unwrap();
        }
        if append {
            // Existing lines stay unchanged.
            let path = folder().join(format!("{}.txt", descriptor.package_name()));
            let old = std::fs::read_to_string(&path).unwrap_or_default();
            let text: String = new.iter().map(Line::to_text).collect();
            std::fs::write(&path, old + &text).unwrap();
        }
        lines.extend(new);
    }
    if !append {
        assert!(report.is_empty(), "no golden bytes for the following (the head of golden.rs says how):\n{report}");
    }
}

/// Verifies that the checks above detect incompatible changes.
#[test]
fn an_incompatible_schema_is_detected() {
    let pool = pool();
    let descriptor = pool.get_message_by_name("supergaussian.bus.v1.ActorHealth").unwrap();
    let line = Line::of(&filled(&descriptor, 0, 0), "0".into()).unwrap();
    line.check(&pool).unwrap();

    let gone = Line { bytes: [&line.bytes[..], &[0xf8, 0x07, 0x01]].concat(), ..line.clone() };
    assert!(gone.check(&pool).unwrap_err().to_string().contains("number 127"));

    let mut json = line.json.clone();
    json["queued"] = serde_json::json!(1);
    let cut_off = Line { json, ..line.clone() };
    assert!(matches!(cut_off.check(&pool), Err(GoldenError::Meaning { .. })));

    let removed = Line { message: "supergaussian.bus.v1.Gone".into(), ..line.clone() };
    assert!(removed.check(&pool) == Err(GoldenError::UnknownMessage));

    let truncated = Line { bytes: line.bytes[..line.bytes.len() - 1].to_vec(), ..line };
    assert!(matches!(truncated.check(&pool), Err(GoldenError::Decode(_))));
}

#[test]
fn a_new_field_needs_a_new_line() {
    let command = pool().get_message_by_name("supergaussian.scene.v1.Command").unwrap();
    let (missing, new) = missing_lines(&command, &[filled(&command, 0, 0)]);
    assert!(missing.contains("field undo"), "{missing:?}");
    assert!(!missing.contains("field set_color"), "{missing:?}");
    let alternatives = command.oneofs().next().unwrap().fields().len();
    assert_eq!(new.len(), alternatives - 1, "one line for each alternative that had none");
}

#[test]
fn lines_survive_their_text_form() {
    let pool = pool();
    for name in sg_proto::message_names() {
        let line = Line::of(&filled(&pool.get_message_by_name(name).unwrap(), 3, 0), "3".into()).unwrap();
        assert_eq!(Line::parse(line.to_text().trim_end()).unwrap(), line);
    }
}
