//! The contract between the processes: messages, keys, limits.
//!
//! Each module of a domain, such as [`scene`], holds the messages of `supergaussian/<domain>/v1/*.proto`. [`keys`] is the
//! table of key expressions with their message types and permitted senders. This package does no input or output.
//!
//! # Example
//!
//! ```
//! use prost::Message as _;
//! use sg_proto::keys::{self, role};
//! use sg_proto::prost;
//! use sg_proto::scene::Command;
//!
//! let command = Command { id: "first".to_owned(), ..Command::default() };
//! let bytes = command.encode_to_vec();
//! assert_eq!(Command::decode(bytes.as_slice())?, command);
//!
//! // The row of the key `sg/demo/scene/cmd/apply`.
//! let rows = keys::rows();
//! let apply = rows.iter().find(|row| row.role == role::SCENE && row.name == keys::SCENE_APPLY.name);
//! assert!(apply.is_some_and(|row| row.may_ask(role::AGENT_FUNCTION) && !row.may_ask(role::AGENT_INTENT)));
//! assert_eq!(keys::key("demo", role::SCENE, keys::SCENE_APPLY.name), "sg/demo/scene/cmd/apply");
//! # Ok::<(), prost::DecodeError>(())
//! ```

pub mod golden;
pub mod keys;
pub mod light_presets;
pub mod limits;
pub mod released;
pub mod replica;
pub mod stroke_file;

pub use prost;

include!(concat!(env!("OUT_DIR"), "/messages.rs"));

/// The packages as the generated code names them: `<domain>::v1`.
mod generated {
    macro_rules! domain {
        ($name:ident, $file:literal) => {
            #[allow(unreachable_pub, reason = "reachable through the re-exports below")]
            pub mod $name {
                #[allow(
                    clippy::all,
                    clippy::pedantic,
                    missing_docs,
                    unused_qualifications,
                    reason = "generated code is as its generator writes it"
                )]
                pub mod v1 {
                    include!(concat!(env!("OUT_DIR"), "/", $file, ".rs"));
                }
            }
        };
    }
    domain!(backend, "supergaussian.backend.v1");
    domain!(bus, "supergaussian.bus.v1");
    domain!(scene, "supergaussian.scene.v1");
    domain!(selection, "supergaussian.selection.v1");
    domain!(render, "supergaussian.render.v1");
    domain!(labeling, "supergaussian.labeling.v1");
    domain!(language, "supergaussian.language.v1");
    domain!(launch, "supergaussian.launch.v1");
    domain!(speech, "supergaussian.speech.v1");
}

pub use generated::backend::v1 as backend;
pub use generated::bus::v1 as bus;
pub use generated::labeling::v1 as labeling;
pub use generated::language::v1 as language;
pub use generated::launch::v1 as launch;
pub use generated::render::v1 as render;
pub use generated::scene::v1 as scene;
pub use generated::selection::v1 as selection;
pub use generated::speech::v1 as speech;

/// The compiled schema, a serialized `google.protobuf.FileDescriptorSet` with comments.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.binpb"));

/// Full names of all messages, in the order of their files.
#[must_use]
pub fn message_names() -> Vec<&'static str> {
    macro_rules! names {
        ($($name:literal => $type:ty,)*) => { vec![$($name),*] };
    }
    for_each_message!(names)
}

/// Decodes a message by its full name and encodes it again.
///
/// Returns `None` if the contract has no such message.
///
/// # Errors
/// `Some(Err)` if the bytes are not a message of this type.
#[must_use]
pub fn recode(full_name: &str, bytes: &[u8]) -> Option<Result<Vec<u8>, prost::DecodeError>> {
    use prost::Message as _;
    macro_rules! dispatch {
        ($($name:literal => $type:ty,)*) => {
            match full_name {
                $($name => Some(<$type>::decode(bytes).map(|m| m.encode_to_vec())),)*
                _ => None,
            }
        };
    }
    for_each_message!(dispatch)
}
