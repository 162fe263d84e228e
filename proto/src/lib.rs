//! The contract: messages, keys, limits.
//!
//! Every message type that crosses a process boundary stands in `supergaussian/<domain>/v1/*.proto` and is compiled into
//! the module of its domain here. [`keys`] is the one table of key expressions, their message types and who may send.
//! Pure data: nothing here does input or output.

pub mod golden;
pub mod keys;
pub mod limits;
pub mod released;
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
    domain!(language, "supergaussian.language.v1");
    domain!(launch, "supergaussian.launch.v1");
}

pub use generated::backend::v1 as backend;
pub use generated::bus::v1 as bus;
pub use generated::language::v1 as language;
pub use generated::launch::v1 as launch;
pub use generated::render::v1 as render;
pub use generated::scene::v1 as scene;
pub use generated::selection::v1 as selection;

/// The compiled schema, a serialized `google.protobuf.FileDescriptorSet` with comments.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.binpb"));

/// Full names of all messages of the contract, in the order of their files.
#[must_use]
pub fn message_names() -> Vec<&'static str> {
    macro_rules! names {
        ($($name:literal => $type:ty,)*) => { vec![$($name),*] };
    }
    for_each_message!(names)
}

/// Decodes a message by its full name and encodes it again, as every service does on receipt.
///
/// # Errors
/// `None` if there is no such message; `Some(Err)` if the bytes are not one.
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
