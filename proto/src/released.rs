//! The last release of the contract. The current contract must stay compatible with it.
//!
//! `proto/released/` holds two files for every release; the newest release is compiled in.
//!
//! - `v<version>.binpb`: the compiled schema without comments, a serialized `google.protobuf.FileDescriptorSet`.
//! - `v<version>.golden`: length and hash of each golden file.

include!(concat!(env!("OUT_DIR"), "/released.rs"));

/// The released part of a golden file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GoldenPart {
    /// Package of the golden file, such as `supergaussian.bus.v1`.
    pub package: &'static str,
    /// Length of the file at the release, bytes.
    pub bytes: usize,
    /// BLAKE3 of the file at the release, hexadecimal.
    pub hash: &'static str,
}

/// A damaged list of golden files.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReleaseError {
    /// This line is not `<package> <bytes> <hash>`.
    #[error("released/v{VERSION}.golden: not `<package> <bytes> <hash>`: `{0}`")]
    Line(String),
}

/// Lists the released parts of the golden files. Lines added after the release are not part of them.
///
/// # Errors
/// [`ReleaseError`] for a damaged list.
pub fn golden_parts() -> Result<Vec<GoldenPart>, ReleaseError> {
    let part = |line: &'static str| {
        let mut words = line.split_whitespace();
        let (Some(package), Some(bytes), Some(hash), None) = (words.next(), words.next(), words.next(), words.next())
        else {
            return Err(ReleaseError::Line(line.to_owned()));
        };
        let bytes = bytes.parse().map_err(|_| ReleaseError::Line(line.to_owned()))?;
        Ok(GoldenPart { package, bytes, hash })
    };
    GOLDEN_PARTS.lines().map(part).collect()
}
