//! Descriptors of the messages of an intent.

use prost::Name as _;
use prost_reflect::{DescriptorPool, EnumDescriptor, Kind, MessageDescriptor};
use sg_proto::language::{Act, Clause, Intent};

use crate::commands::command::Field;
use crate::commands::table::fields;

/// The contract lacks a message or field of an intent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the schema of intents does not fit the contract: {0}")]
pub struct SchemaError(pub(super) String);

/// Descriptors of the messages of an intent.
#[derive(Debug, Clone)]
pub(super) struct Descriptors {
    /// The intent.
    pub(super) intent: MessageDescriptor,
    /// A clause.
    pub(super) clause: MessageDescriptor,
    /// The acts.
    pub(super) acts: EnumDescriptor,
}

impl Descriptors {
    /// Finds the descriptors in the contract.
    ///
    /// # Errors
    /// [`SchemaError`]: the contract has no such message.
    pub(super) fn new() -> Result<Self, SchemaError> {
        let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).map_err(|e| SchemaError(e.to_string()))?;
        let message = |name: String| pool.get_message_by_name(&name).ok_or(SchemaError(format!("no message {name}")));
        let (intent, clause) = (message(Intent::full_name())?, message(Clause::full_name())?);
        let act = clause.get_field_by_name("act").map(|f| f.kind());
        let acts =
            act.as_ref().and_then(Kind::as_enum).cloned().ok_or(SchemaError("the clause has no act".to_owned()))?;
        Ok(Self { intent, clause, acts })
    }

    /// The acts of the contract in their order, each with its fields.
    pub(super) fn act_fields(&self) -> impl Iterator<Item = (Act, &'static [Field])> {
        self.acts.values().filter_map(|value| {
            let act = Act::try_from(value.number()).ok()?;
            Some((act, fields(act)?))
        })
    }
}
