//! Messages as JSON, decoded with the compiled schema instead of Rust types.

use prost_reflect::{DescriptorPool, DynamicMessage, SerializeOptions};
use serde_json::Value;
use sg_proto::prost::{Message, Name};
use sg_runtime::bus::WatchedMessage;

use crate::terminal::Failure;

/// Longest list that is printed whole.
const MAX_LIST: usize = 24;

/// Decodes any message of the contract.
#[derive(Debug, Clone)]
pub(crate) struct Decoder(DescriptorPool);

impl Decoder {
    pub(crate) fn new() -> Result<Self, Failure> {
        let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS);
        Ok(Self(pool.map_err(|e| Failure::Work(format!("the compiled schema cannot be read: {e}")))?))
    }

    /// A message as JSON with the field names of the schema. Undecodable payloads become a description.
    pub(crate) fn json(&self, full_name: &str, payload: &[u8]) -> Value {
        let Some(descriptor) = self.0.get_message_by_name(full_name) else {
            return format!("{} bytes of unknown type `{full_name}`", payload.len()).into();
        };
        let options = SerializeOptions::new().use_proto_field_name(true).stringify_64_bit_integers(false);
        let decoded = DynamicMessage::decode(descriptor, payload)
            .map_err(|e| e.to_string())
            .and_then(|m| m.serialize_with_options(serde_json::value::Serializer, &options).map_err(|e| e.to_string()));
        decoded.unwrap_or_else(|e| format!("{} bytes that are not a {full_name}: {e}", payload.len()).into())
    }

    /// A typed message as JSON.
    pub(crate) fn json_of<M: Message + Name>(&self, message: &M) -> Value {
        self.json(&M::full_name(), &message.encode_to_vec())
    }
}

/// Replaces masks by their number of bytes.
pub(crate) fn hide_masks(value: &mut Value) {
    match value {
        Value::Object(object) => {
            for (key, value) in object {
                match value {
                    // Base64: four characters for three bytes.
                    Value::String(bits) if key == "bits" => {
                        let padding = bits.chars().rev().take_while(|c| *c == '=').count();
                        *value = format!("<{} bytes>", bits.len() / 4 * 3 - padding.min(2)).into();
                    }
                    other => hide_masks(other),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(hide_masks),
        _ => {}
    }
}

/// Truncates long lists and adds the number of omitted items.
pub(crate) fn shorten_lists(value: &mut Value) {
    match value {
        Value::Object(object) => object.values_mut().for_each(shorten_lists),
        Value::Array(items) => {
            let left_out = items.len().saturating_sub(MAX_LIST);
            items.truncate(MAX_LIST);
            items.iter_mut().for_each(shorten_lists);
            if left_out > 0 {
                items.push(format!("<{left_out} more>").into());
            }
        }
        _ => {}
    }
}

/// The pipeline stage of a key: its last part.
pub(crate) fn stage(key: &str) -> &str {
    key.rsplit('/').next().unwrap_or(key)
}

/// Whether a message is a health message, sent every second by each service.
pub(crate) fn is_health(seen: &WatchedMessage) -> bool {
    seen.key.ends_with(sg_proto::keys::HEALTH.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::scene::{CommitSelection, Mask, Stroke};

    #[test]
    fn masks_and_long_lists_are_shortened() {
        let decoder = Decoder::new().unwrap();
        for bytes in [0, 1, 2, 3, 7500] {
            let mask = Mask { length: 60_000, bits: vec![7; bytes] };
            let stroke =
                Stroke { points: vec![0.5; 300], radius: 0.02, mode: 1, kind: 1, pressure: vec![], depth: None };
            let commit = CommitSelection { mask: Some(mask), strokes: vec![stroke], ..CommitSelection::default() };
            let mut json = decoder.json_of(&commit);
            hide_masks(&mut json);
            shorten_lists(&mut json);
            assert_eq!(json["mask"]["length"], 60_000);
            let expected = if bytes > 0 { format!("<{bytes} bytes>").into() } else { Value::Null };
            assert_eq!(json["mask"]["bits"], expected);
            assert_eq!(json["strokes"][0]["points"].as_array().unwrap().len(), MAX_LIST + 1);
            assert_eq!(json["strokes"][0]["points"][MAX_LIST], "<276 more>");
            assert_eq!(json["strokes"][0]["mode"], "STROKE_MODE_WALK");
        }
    }

    #[test]
    fn undecodable_payloads_are_described() {
        let decoder = Decoder::new().unwrap();
        assert_eq!(decoder.json("a.B", &[1, 2]), "2 bytes of unknown type `a.B`");
        let text = decoder.json("supergaussian.scene.v1.Event", &[0xff]);
        assert!(text.as_str().unwrap().starts_with("1 bytes that are not a supergaussian.scene.v1.Event"), "{text}");
    }
}
