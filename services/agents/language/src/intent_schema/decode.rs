//! JSON to intents, with every check of the schema.

use prost_reflect::{DeserializeOptions, DynamicMessage, FieldDescriptor, Kind, Value as Reflected};
use sg_proto::language::{Act, Clause, Intent, Reference};

use super::contract::{ACT, Bound, MAX_CLAUSES, MAX_ITEMS, WORDS, bound, is_excluded};
use super::descriptors::Descriptors;
use crate::commands::command::Field;
use crate::commands::table::fields;
use crate::prompt::{InvalidAnswer, MAX_ANSWER_BYTES, single_line};

/// Decodes an answer. It checks fields, numbers, lengths of texts and what each act requires.
///
/// # Errors
/// [`InvalidAnswer`] with the place.
pub(super) fn decode(contract: &Descriptors, answer: &str) -> Result<Intent, InvalidAnswer> {
    if answer.len() > MAX_ANSWER_BYTES {
        return Err(InvalidAnswer::new(format!("it has {} bytes; the limit is {MAX_ANSWER_BYTES}", answer.len())));
    }
    let malformed = |e: serde_json::Error| {
        InvalidAnswer::new(format!("it does not match the schema: {}", single_line(&e.to_string())))
    };
    let mut reader = serde_json::Deserializer::from_str(answer);
    let strict = DeserializeOptions::new().deny_unknown_fields(true);
    let message =
        DynamicMessage::deserialize_with_options(contract.intent.clone(), &mut reader, &strict).map_err(malformed)?;
    reader.end().map_err(malformed)?;
    check(&message, "")?;
    let mut intent: Intent = message.transcode_to().map_err(|e| InvalidAnswer::new(e.to_string()))?;
    if intent.clauses.len() > MAX_CLAUSES {
        return Err(InvalidAnswer::new(format!("it has {} clauses; the limit is {MAX_CLAUSES}", intent.clauses.len())));
    }
    let clauses = message.get_field_by_name("clauses");
    let clauses = clauses.as_deref().and_then(Reflected::as_list).unwrap_or_default();
    for (at, (clause, reflected)) in intent.clauses.iter().zip(clauses).enumerate() {
        check_clause(clause, reflected, at)?;
    }
    // A label always names the selection, so the schema has no target for it.
    for clause in intent.clauses.iter_mut().filter(|c| c.act() == Act::Label) {
        clause.target = Some(Reference { selection: true, ..Reference::default() });
    }
    Ok(intent)
}

/// Checks all fields of a message.
fn check(message: &DynamicMessage, place: &str) -> Result<(), InvalidAnswer> {
    for (field, value) in message.fields() {
        let place = if place.is_empty() { field.name().to_owned() } else { format!("{place}.{}", field.name()) };
        if is_excluded(&field) {
            return Err(InvalidAnswer::new(format!("`{place}` is not in the schema")));
        }
        match value.as_list() {
            Some(items) if items.len() > MAX_ITEMS => {
                return Err(InvalidAnswer::new(format!(
                    "`{place}` has {} items; the limit is {MAX_ITEMS}",
                    items.len()
                )));
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
        Some(Bound::Number(min, max)) if !(min..=max).contains(&v) => {
            Err(InvalidAnswer::new(format!("`{place}` is {v}; use a number from {min} to {max}")))
        }
        _ => Ok(()),
    };
    match value {
        Reflected::F32(v) => number(f64::from(*v)),
        Reflected::F64(v) => number(*v),
        Reflected::String(text) => match bound(field) {
            Some(Bound::MaxChars(max)) if text.chars().count() > max => {
                Err(InvalidAnswer::new(format!("`{place}` has more than {max} characters")))
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

/// Checks that a clause has exactly the fields of its act.
fn check_clause(clause: &Clause, reflected: &Reflected, at: usize) -> Result<(), InvalidAnswer> {
    let act = clause.act();
    let Some(fields) = fields(act) else {
        return Err(InvalidAnswer::new(format!("`clauses[{at}]` has no act")));
    };
    let present = reflected.as_message().into_iter().flat_map(DynamicMessage::fields);
    let present: Vec<String> = present.map(|(field, _)| field.name().to_owned()).collect();
    for name in &present {
        if ![ACT, WORDS].iter().chain(fields).any(|field| field.name == name) {
            return Err(InvalidAnswer::new(format!("`clauses[{at}]`: {} has no field `{name}`", act.as_str_name())));
        }
    }
    // A false `relative` cannot be told from an absent one.
    for Field { name, .. } in fields.iter().filter(|f| !f.is_optional() && f.name != "relative") {
        if !present.iter().any(|known| known == name) {
            return Err(InvalidAnswer::new(format!("`clauses[{at}]`: {} needs `{name}`", act.as_str_name())));
        }
    }
    if let Some(amount) = clause.amount.filter(|_| fields.contains(&Field::optional_count("amount")))
        && (amount.fract() != 0.0 || amount < 1.0)
    {
        return Err(InvalidAnswer::new(format!("`clauses[{at}].amount` is {amount}; use a whole number from 1")));
    }
    let empty = |v: &sg_proto::scene::SetView| v.change.is_none();
    if clause.view.as_ref().is_some_and(empty) {
        return Err(InvalidAnswer::new(format!("`clauses[{at}].view` is empty")));
    }
    if clause.movement.as_ref().is_some_and(|m| m.kind.is_none()) {
        return Err(InvalidAnswer::new(format!("`clauses[{at}].movement` is empty")));
    }
    Ok(())
}
