//! Golden bytes: committed encodings of every message, with their meaning as JSON.
//!
//! A line of a golden file is `<message> <variant> <bytes, hexadecimal> <JSON>`. The file is named after its package. Files
//! are append-only: later releases keep every released line at its place.

use std::fmt::Write as _;

use prost::Message as _;
use prost_reflect::{DescriptorPool, DynamicMessage, ReflectMessage as _, Value};

/// One line of a golden file.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Full name of the message.
    pub message: String,
    /// Name of this encoding, unique within its message.
    pub variant: String,
    /// The encoding.
    pub bytes: Vec<u8>,
    /// The message in protobuf's JSON mapping.
    pub json: serde_json::Value,
}

/// A damaged golden line, or a line that no longer fits the contract.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GoldenError {
    /// A part of the line is missing.
    #[error("no {part} in the line `{line}`")]
    Missing {
        /// Name of the part.
        part: &'static str,
        /// Text of the line.
        line: String,
    },
    /// The bytes are not hexadecimal.
    #[error("the bytes are not hexadecimal")]
    Hex,
    /// The JSON cannot be parsed or made.
    #[error("JSON: {0}")]
    Json(String),
    /// The contract has no such message.
    #[error("the contract has no such message")]
    UnknownMessage,
    /// The bytes cannot be decoded with the schema.
    #[error("does not decode: {0}")]
    Decode(String),
    /// A field is missing in the schema, or has another wire type there.
    #[error("{0} is not in the schema, or has another wire type")]
    UnknownField(String),
    /// The bytes have another meaning now.
    #[error("the meaning has changed:\n  before {before}\n  now    {now}")]
    Meaning {
        /// JSON of the line.
        before: String,
        /// JSON of the bytes with the current schema.
        now: String,
    },
    /// The schema encodes the message with other bytes.
    #[error("the schema encodes other bytes")]
    Bytes,
    /// The message has no generated type.
    #[error("the message has no generated type")]
    NoType,
    /// The generated type cannot decode the bytes.
    #[error("the generated type does not decode it: {0}")]
    TypeDecode(String),
    /// The generated type encodes other bytes.
    #[error("the generated type encodes other bytes")]
    TypeBytes,
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
    /// Makes the line of a message.
    ///
    /// # Errors
    /// [`GoldenError::Json`] if the message has no JSON form.
    pub fn of(message: &DynamicMessage, variant: String) -> Result<Self, GoldenError> {
        Ok(Self {
            message: message.descriptor().full_name().to_owned(),
            variant,
            bytes: message.encode_to_vec(),
            json: serde_json::to_value(message).map_err(|e| GoldenError::Json(e.to_string()))?,
        })
    }

    /// Parses a line.
    ///
    /// # Errors
    /// [`GoldenError::Missing`], [`GoldenError::Hex`], [`GoldenError::Json`].
    pub fn parse(text: &str) -> Result<Self, GoldenError> {
        let mut parts = text.splitn(4, ' ');
        let mut part = |name| parts.next().ok_or_else(|| GoldenError::Missing { part: name, line: text.to_owned() });
        Ok(Self {
            message: part("message")?.to_owned(),
            variant: part("variant")?.to_owned(),
            bytes: from_hex(part("bytes")?).ok_or(GoldenError::Hex)?,
            json: serde_json::from_str(part("JSON")?).map_err(|e| GoldenError::Json(e.to_string()))?,
        })
    }

    /// The text of the line, with its line feed.
    #[must_use]
    pub fn to_text(&self) -> String {
        format!("{} {} {} {}\n", self.message, self.variant, to_hex(&self.bytes), self.json)
    }

    /// Decodes the bytes with the current schema and compares them with the JSON. The generated type must encode the same
    /// bytes again.
    ///
    /// # Errors
    /// [`GoldenError`] with the difference.
    pub fn check(&self, pool: &DescriptorPool) -> Result<DynamicMessage, GoldenError> {
        let descriptor = pool.get_message_by_name(&self.message).ok_or(GoldenError::UnknownMessage)?;
        let message =
            DynamicMessage::decode(descriptor, &self.bytes[..]).map_err(|e| GoldenError::Decode(e.to_string()))?;
        if let Some(place) = unknown_field(&message) {
            return Err(GoldenError::UnknownField(place));
        }
        let json = serde_json::to_value(&message).map_err(|e| GoldenError::Json(e.to_string()))?;
        if json != self.json {
            return Err(GoldenError::Meaning { before: self.json.to_string(), now: json.to_string() });
        }
        if message.encode_to_vec() != self.bytes {
            return Err(GoldenError::Bytes);
        }
        match crate::recode(&self.message, &self.bytes) {
            None => Err(GoldenError::NoType),
            Some(Err(e)) => Err(GoldenError::TypeDecode(e.to_string())),
            Some(Ok(bytes)) if bytes != self.bytes => Err(GoldenError::TypeBytes),
            Some(Ok(_)) => Ok(message),
        }
    }
}

/// First field, at any depth, that is not in the schema.
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
