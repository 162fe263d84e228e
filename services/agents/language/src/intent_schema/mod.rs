//! Intents as JSON: a schema for language models, and the decoder that checks an answer against it.
//!
//! The schema follows from the descriptors of the contract, the fields of each command and a table of bounds. Enums go by
//! name. Every field of an object is required and may be null where it is optional: the strictest providers ask for that.

mod contract;
mod decode;
mod descriptors;
mod encode;
mod json_schema;

use serde_json::Value;
use sg_proto::language::Intent;

use crate::prompt::InvalidAnswer;
use descriptors::Descriptors;

pub use descriptors::SchemaError;

/// The JSON schema of intents.
#[derive(Debug, Clone)]
pub struct IntentSchema {
    contract: Descriptors,
    schema: Value,
}

impl IntentSchema {
    /// Builds the schema from the contract.
    ///
    /// # Errors
    /// [`SchemaError`]: the contract lacks a field.
    pub fn new() -> Result<Self, SchemaError> {
        let contract = Descriptors::new()?;
        let schema = json_schema::build(&contract)?;
        Ok(Self { contract, schema })
    }

    /// The JSON schema.
    #[must_use]
    pub fn schema(&self) -> &Value {
        &self.schema
    }

    /// Each act with its fields, then each field with its comment in the contract.
    #[must_use]
    pub fn manual(&self) -> String {
        json_schema::manual(&self.contract)
    }

    /// Encodes an intent.
    ///
    /// # Errors
    /// [`InvalidAnswer`]: the intent holds a field that the schema lacks.
    pub fn encode(&self, intent: &Intent) -> Result<Value, InvalidAnswer> {
        encode::encode(&self.contract, intent)
    }

    /// Decodes an answer. It checks fields, numbers, lengths of texts and what each act requires.
    ///
    /// # Errors
    /// [`InvalidAnswer`] with the place.
    pub fn decode(&self, answer: &str) -> Result<Intent, InvalidAnswer> {
        decode::decode(&self.contract, answer)
    }
}

#[cfg(test)]
mod tests {
    use super::contract::{BOUNDS, EXCLUDED};
    use super::*;
    use crate::prompt::MAX_ANSWER_BYTES;
    use prost_reflect::DescriptorPool;
    use sg_proto::language::Act;

    fn intent_schema() -> IntentSchema {
        IntentSchema::new().unwrap()
    }

    fn refused(answer: &str, part: &str) {
        let reason = intent_schema().decode(answer).unwrap_err().to_string();
        assert!(reason.contains(part), "{answer}: {reason}");
    }

    fn clause(fields: &str) -> String {
        format!(r#"{{"clauses": [{{"words": "w", {fields}}}], "not_understood": []}}"#)
    }

    #[test]
    fn every_act_of_the_contract_has_its_fields() {
        let schema = intent_schema();
        let acts: Vec<Act> = schema.contract.act_fields().map(|(act, _)| act).collect();
        let contract: Vec<Act> = (1..).map_while(|act| Act::try_from(act).ok()).collect();
        assert_eq!(acts, contract);
    }

    #[test]
    fn every_bound_belongs_to_a_field_of_the_contract() {
        let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).unwrap();
        for name in BOUNDS.iter().map(|(name, _)| name).chain(EXCLUDED) {
            let (message, field) = name.rsplit_once('.').unwrap();
            let message = pool.get_message_by_name(&format!("supergaussian.{message}"));
            assert!(message.unwrap().get_field_by_name(field).is_some(), "{name}");
        }
    }

    #[test]
    fn every_object_is_closed_and_every_value_bounded() {
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
        let schema = intent_schema();
        walk(schema.schema(), "");
        let text = schema.schema().to_string();
        for absent in ["UNSPECIFIED", "suggestions", "fallback", "eye"] {
            assert!(!text.contains(absent), "{absent}");
        }
        for there in ["ACT_SET_COLOR", "SHADING_TERM_NORMAL", "not_understood", "azimuth_degrees"] {
            assert!(text.contains(there), "{there}");
        }
        assert!(text.len() < 18 << 10, "{} bytes", text.len());
    }

    #[test]
    fn the_manual_quotes_the_contract() {
        let manual = intent_schema().manual();
        assert!(manual.contains("ACT_SET_COLOR {target, color?, color_name?}: Set a colour.\n"), "{manual}");
        assert!(manual.contains("Reference.complement: Whether the target is the complement"), "{manual}");
        assert!(manual.contains("Orbit.azimuth_degrees: Degrees about the up direction; positive"), "{manual}");
        assert!(
            manual.lines().all(|l| !l.trim_end().ends_with(':') || l.starts_with("Acts") || l == "Fields:"),
            "{manual}"
        );
    }

    #[test]
    fn answers_that_do_not_match_are_refused() {
        for (answer, part) in [
            ("", "does not match the schema"),
            ("make it red", "does not match the schema"),
            (r#"{"clauses": ["#, "does not match the schema"),
            (r#"{"clauses": []} and more"#, "does not match the schema"),
            (r#"{"clauses": {}}"#, "does not match the schema"),
            (r#"{"clauses": [], "note": "hello"}"#, "note"),
            (r#"{"clauses": [], "backend": "grammar"}"#, "`backend` is not in the schema"),
            (&clause(r#""act": "ACT_FLY""#), "does not match the schema"),
            (&clause(r#""act": "ACT_UNSPECIFIED""#), "no act"),
            (&clause(r#""act": 99"#), "no value 99"),
            (&clause(r#""act": "ACT_HIDE", "target": {"names": ["sac"], "colour": 1}"#), "colour"),
            (&clause(r#""act": "ACT_HIDE""#), "ACT_HIDE needs `target`"),
            (
                &clause(r#""act": "ACT_HIDE", "target": {"names": ["sac"]}, "amount": 1"#),
                "ACT_HIDE has no field `amount`",
            ),
            (&clause(r#""act": "ACT_SET_VIEW", "view": {"view": {}}"#), "`clauses[0].view.view` is not in the schema"),
            (&clause(r#""act": "ACT_SET_VIEW", "view": {}"#), "is empty"),
            (&clause(r#""act": "ACT_SET_TERM", "term": "SHADING_TERM_UNSPECIFIED""#), "needs `term`"),
        ] {
            refused(answer, part);
        }
        refused(&format!("{}[]{}", "[".repeat(5000), "]".repeat(5000)), "does not match the schema");
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        let color = |red: &str| {
            clause(&format!(
                r#""act": "ACT_SET_BACKGROUND", "color": {{"red": {red}, "green": 0, "blue": 0}}, "color_name": null"#
            ))
        };
        assert!(intent_schema().decode(&color("0.5")).is_ok());
        for red in ["1.5", "-0.1", "1e300", "1e999", "NaN", "\"NaN\"", "\"Infinity\"", "\"-Infinity\""] {
            assert!(intent_schema().decode(&color(red)).is_err(), "{red}");
        }
        refused(&color("2"), "`clauses[0].color.red` is 2; use a number from 0 to 1");
        refused(&color("\"NaN\""), "NaN");
        let opacity = |amount: &str| {
            clause(&format!(
                r#""act": "ACT_SET_OPACITY", "target": {{"everything": true}}, "amount": {amount}, "relative": false"#
            ))
        };
        assert!(intent_schema().decode(&opacity("0.2")).is_ok());
        for amount in ["-1", "1e6", "\"NaN\"", "null"] {
            assert!(intent_schema().decode(&opacity(amount)).is_err(), "{amount}");
        }
        refused(&clause(r#""act": "ACT_UNDO", "amount": 1.5"#), "use a whole number from 1");
        refused(&clause(r#""act": "ACT_SET_VIEW", "view": {"zoom": 0}"#), "`clauses[0].view.zoom` is 0");
    }

    #[test]
    fn large_answers_are_refused() {
        refused(&" ".repeat(MAX_ANSWER_BYTES + 1), "bytes");
        let name = format!(r#""act": "ACT_HIDE", "target": {{"names": ["{}"]}}"#, "a".repeat(129));
        refused(&clause(&name), "`clauses[0].target.names[0]` has more than 128 characters");
        refused(&clause(r#""act": "ACT_HIDE", "target": {"names": ["a\u0007b"]}"#), "control characters");
        let many = vec![r#"{"act": "ACT_RESET", "words": "w"}"#; 17].join(",");
        refused(&format!(r#"{{"clauses": [{many}]}}"#), "17");
        let names = vec!["\"a\""; 17].join(",");
        refused(&clause(&format!(r#""act": "ACT_HIDE", "target": {{"names": [{names}]}}"#)), "17 items");
    }
}
