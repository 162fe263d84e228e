//! The stored form of a command's values: the event and the values before it, compressed together.
//!
//! The mask after a stroke is nearly the mask before it. Compressed together they take little more than one of them.

use std::io;

use sg_proto::limits::MAX_MESSAGE_BYTES;
use zstd::bulk::{Compressor, decompress};
use zstd::zstd_safe::CParameter;

/// Fast, and near the best ratio for masks.
const LEVEL: i32 = 1;
/// Longest uncompressed form. The event is at most one message. The values before it were events or parts of them.
const MAX_BYTES: usize = 4 * MAX_MESSAGE_BYTES;
/// From this size on the first mask lies outside of the compressor's usual window.
const LONG: usize = 256 << 10;
/// The window then, as a power of two: [`MAX_BYTES`].
const WINDOW: u32 = 24;

/// Length of both together (u64, little endian), then compressed: length of the event (u64), the event, the inverse.
pub(super) fn pack(event: &[u8], inverse: &[u8]) -> io::Result<Vec<u8>> {
    let plain = [&(event.len() as u64).to_le_bytes(), event, inverse].concat();
    let mut compressor = Compressor::new(LEVEL)?;
    if plain.len() > LONG {
        compressor.set_parameter(CParameter::EnableLongDistanceMatching(true))?;
        compressor.set_parameter(CParameter::WindowLog(WINDOW))?;
    }
    let compressed = compressor.compress(&plain)?;
    Ok([&(plain.len() as u64).to_le_bytes()[..], &compressed].concat())
}

/// The event and the inverse, or the damage.
pub(super) fn unpack(packed: &[u8]) -> Result<(Vec<u8>, Vec<u8>), String> {
    let short = || "its values are cut off".to_owned();
    let (length, compressed) = packed.split_first_chunk().ok_or_else(short)?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok().filter(|n| *n <= MAX_BYTES);
    let length = length.ok_or_else(|| "its values are longer than any message".to_owned())?;
    let plain = decompress(compressed, length).map_err(|e| format!("its values cannot be decompressed: {e}"))?;
    let (event, rest) = plain.split_first_chunk().ok_or_else(short)?;
    let event = usize::try_from(u64::from_le_bytes(*event)).map_err(|_| short())?;
    let (event, inverse) = rest.split_at_checked(event).ok_or_else(short)?;
    Ok((event.to_vec(), inverse.to_vec()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_and_two_like_masks_take_the_room_of_one() {
        // Bits without a pattern, so that only the likeness of the two can be used.
        let mut bits = 1_u64;
        let mut byte = || {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (bits >> 56) as u8
        };
        for length in [0, 1, 1000, 125_000, 1 << 20] {
            let before: Vec<u8> = (0..length).map(|_| byte()).collect();
            let mut after = before.clone();
            after.iter_mut().step_by(5000).for_each(|b| *b ^= 1);
            let packed = pack(&after, &before).unwrap();
            assert_eq!(unpack(&packed), Ok((after, before)));
            assert!(packed.len() < length * 11 / 10 + 100, "{length}: {}", packed.len());
        }
    }

    #[test]
    fn torn_values_are_refused() {
        let packed = pack(&[7; 1000], &[8; 500]).unwrap();
        for keep in 0..packed.len() {
            assert!(unpack(&packed[..keep]).is_err(), "{keep}");
        }
        let long = [&u64::MAX.to_le_bytes()[..], &packed[8..]].concat();
        assert!(unpack(&long).unwrap_err().contains("longer"));
    }
}
