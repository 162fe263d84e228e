//! Golden bytes: committed encodings of every message, and what each means.
//!
//! A line of a golden file is `<message> <variant> <bytes, hexadecimal> <JSON>`; a file is named after its package. Files
//! are append-only: what a release has held, every later one holds too, at the same place.

use std::fmt::Write as _;

use prost::Message as _;
use prost_reflect::{DescriptorPool, DynamicMessage, ReflectMessage as _, Value};

/// One line of a golden file.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Full name of the message.
    pub message: String,
    /// Name of this encoding among those of its message.
    pub variant: String,
    /// The encoding.
    pub bytes: Vec<u8>,
    /// What it means, in protobuf's JSON mapping.
    pub json: serde_json::Value,
}

fn to_hex(bytes: &[u8]) -> String {
    if bytes.is_empty() {
        return "-".into();
    }
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn from_hex(text: &str) -> Option<Vec<u8>> {
    if text == "-" {
        return Some(Vec::new());
    }
    if !text.is_ascii() || !text.len().is_multiple_of(2) {
        return None;
    }
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(text.get(at..at + 2)?, 16).ok()).collect()
}

impl Line {
    /// The line that pins this message down.
    ///
    /// # Errors
    /// The message has no JSON form.
    pub fn of(message: &DynamicMessage, variant: String) -> Result<Self, String> {
        Ok(Self {
            message: message.descriptor().full_name().to_owned(),
            variant,
            bytes: message.encode_to_vec(),
            json: serde_json::to_value(message).map_err(|e| e.to_string())?,
        })
    }

    /// Reads a line.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut parts = text.splitn(4, ' ');
        let mut part = |what: &str| parts.next().ok_or(format!("no {what} in the line `{text}`"));
        Ok(Self {
            message: part("message")?.to_owned(),
            variant: part("variant")?.to_owned(),
            bytes: from_hex(part("bytes")?).ok_or("the bytes are not hexadecimal")?,
            json: serde_json::from_str(part("JSON")?).map_err(|e| format!("the JSON is damaged: {e}"))?,
        })
    }

    /// The line as it stands in its file, with its end.
    #[must_use]
    pub fn to_text(&self) -> String {
        format!("{} {} {} {}\n", self.message, self.variant, to_hex(&self.bytes), self.json)
    }

    /// Decodes the bytes as a schema reads them and compares with what the line says they mean; the generated types must
    /// write the same bytes again.
    ///
    /// # Errors
    /// What the bytes have become.
    pub fn check(&self, pool: &DescriptorPool) -> Result<DynamicMessage, String> {
        let descriptor = pool.get_message_by_name(&self.message).ok_or("the contract has no such message any more")?;
        let message =
            DynamicMessage::decode(descriptor, &self.bytes[..]).map_err(|e| format!("does not decode: {e}"))?;
        if let Some(place) = unknown_field(&message) {
            return Err(format!("{place} is not a field any more, or has another wire type"));
        }
        let json = serde_json::to_value(&message).map_err(|e| e.to_string())?;
        if json != self.json {
            return Err(format!("means another thing today:\n  then {}\n  now  {json}", self.json));
        }
        if message.encode_to_vec() != self.bytes {
            return Err("is not written with these bytes any more".into());
        }
        match crate::recode(&self.message, &self.bytes) {
            None => Err("has no generated type".into()),
            Some(Err(e)) => Err(format!("the generated type refuses it: {e}")),
            Some(Ok(bytes)) if bytes != self.bytes => Err("the generated type writes other bytes".into()),
            Some(Ok(_)) => Ok(message),
        }
    }
}

/// First field, at any depth, that the schema does not know.
fn unknown_field(message: &DynamicMessage) -> Option<String> {
    fn inside(value: &Value) -> Option<String> {
        match value {
            Value::Message(m) => unknown_field(m),
            Value::List(items) => items.iter().find_map(inside),
            _ => None,
        }
    }
    let name = message.descriptor().full_name().to_owned();
    let own = message.unknown_fields().next().map(|field| format!("number {} of {name}", field.number()));
    own.or_else(|| message.fields().find_map(|(_, value)| inside(value)))
}
