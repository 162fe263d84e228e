//! Limits on what a file may take. One variable of the environment raises all of them.
//!
//! | content | limit |
//! | --- | --- |
//! | [`SMALL_TEXT_BYTES`] | launch file, script, camera, certificate |
//! | [`TEXT_BYTES`] | other TOML and JSON |
//! | [`DATA_BYTES`] | Gaussians, voxels, arrays, graphs |
//! | [`expanded`] | decoded content of a compressed file, or apparent length of a file with holes |

use std::ffi::OsStr;

/// Variable of the environment with the least value of every limit, in MiB.
pub const RAISED: &str = "SUPERGAUSSIAN_READ_MIB";

/// Most bytes of a short text.
pub const SMALL_TEXT_BYTES: u64 = 1 << 20;

/// Most bytes of a text. Parsed text takes up to thirty times its length.
pub const TEXT_BYTES: u64 = 8 << 20;

/// Most bytes of a file of numbers. Its content takes up to ten times its length.
pub const DATA_BYTES: u64 = 16 << 30;

/// Decoded bytes that every file may have: label volumes of 300³ voxels of a byte compress more than a hundredfold.
const EXPANDED_FREE: u64 = 32 << 20;
/// Decoded bytes for each stored byte beyond that. Voxels of real scans take 2 to 20. Large label volumes can take more, and
/// then need [`RAISED`].
const EXPANDED_RATIO: u64 = 64;
/// Most parts of a text in TOML.
const MAX_PARTS: usize = 250_000;

/// Refuses TOML of very many tables, lists, keys and items. Its parsed form takes up to 650 bytes for each of them, so the
/// length of the text alone says little.
///
/// # Errors
/// One line with the number and the limit.
pub fn check_toml_parts(text: &str) -> Result<(), String> {
    let parts = text.bytes().filter(|b| matches!(b, b'[' | b'{' | b'=' | b',')).count();
    if parts as u64 > at_least(MAX_PARTS as u64) {
        return Err(format!("{parts} keys, items, lists and tables; the limit is {MAX_PARTS}"));
    }
    Ok(())
}

/// Most decoded bytes of a file with this many stored bytes: 32 MiB and 64 for each stored byte.
#[must_use]
pub fn expanded(stored: u64) -> u64 {
    at_least(EXPANDED_FREE.saturating_add(stored.saturating_mul(EXPANDED_RATIO)))
}

/// The limit `most`, or the one of [`RAISED`] if that is higher.
#[must_use]
pub fn at_least(most: u64) -> u64 {
    raised(std::env::var_os(RAISED).as_deref()).max(most)
}

/// The remedy for a file that would take `bytes`: a value of [`RAISED`] that allows it.
#[must_use]
pub fn remedy(bytes: u64) -> String {
    format!("{RAISED}={} in the environment allows it", bytes.div_ceil(1 << 20))
}

fn raised(value: Option<&OsStr>) -> u64 {
    let mib = value.and_then(OsStr::to_str).and_then(|v| v.trim().parse::<u64>().ok());
    mib.unwrap_or(0).saturating_mul(1 << 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_raises_limits_and_never_lowers_them() {
        let of = |text: &str| raised(Some(text.as_ref()));
        assert_eq!([of("3"), of(" 3 "), of("-3"), of("many"), of("")], [3 << 20, 3 << 20, 0, 0, 0]);
        assert_eq!((raised(None), of("99999999999999999")), (0, u64::MAX));
    }

    #[test]
    fn parts_of_toml_are_counted() {
        assert_eq!(check_toml_parts("[a]\nb = [1, 2]\n"), Ok(()));
        let error = check_toml_parts(&"{a=".repeat(200_000)).unwrap_err();
        assert!(error.starts_with("400000 keys"), "{error}");
    }

    #[test]
    fn small_files_may_expand_and_large_ones_by_the_ratio() {
        assert_eq!((expanded(0), expanded(1 << 20)), (32 << 20, (32 + 64) << 20));
        assert_eq!(expanded(u64::MAX), u64::MAX);
        assert!(remedy((5 << 20) + 1).starts_with("SUPERGAUSSIAN_READ_MIB=6 "));
    }
}
