//! The contract as it was last released: what this one has to be compatible with.
//!
//! `proto/released/` holds, for every release, the compiled schema without comments (`v<version>.binpb`, a serialized
//! `google.protobuf.FileDescriptorSet`) and how long each golden file was (`v<version>.golden`); the newest is compiled in.

include!(concat!(env!("OUT_DIR"), "/released.rs"));

/// How far a golden file reached at the last release.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GoldenPart {
    /// Package whose golden bytes it holds, such as `supergaussian.bus.v1`.
    pub package: &'static str,
    /// Length of the file then.
    pub bytes: usize,
    /// BLAKE3 of the file then, hexadecimal.
    pub hash: &'static str,
}

/// The golden files of the last release; what was appended since is not part of it.
///
/// # Errors
/// The list is damaged.
pub fn golden_parts() -> Result<Vec<GoldenPart>, String> {
    let part = |line: &'static str| {
        let mut words = line.split_whitespace();
        let (Some(package), Some(bytes), Some(hash), None) = (words.next(), words.next(), words.next(), words.next())
        else {
            return Err(format!("released/v{VERSION}.golden: not `<package> <bytes> <hash>`: `{line}`"));
        };
        let bytes = bytes.parse().map_err(|e| format!("released/v{VERSION}.golden: `{bytes}`: {e}"))?;
        Ok(GoldenPart { package, bytes, hash })
    };
    GOLDEN_PARTS.lines().map(part).collect()
}
