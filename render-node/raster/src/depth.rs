//! The order by depth.

use crate::nearness::order_bits;

/// Indices of `depths` from near to far, ties by index: a stable radix sort of the full 32 bits. Depths are finite.
pub(crate) fn near_to_far(depths: impl ExactSizeIterator<Item = f32>) -> Vec<u32> {
    const BITS: u32 = 11;
    const MASK: u64 = (1 << BITS) - 1;
    let mut keys: Vec<u64> =
        depths.enumerate().map(|(i, depth)| u64::from(order_bits(depth)) << 32 | i as u64).collect();
    let mut sorted = vec![0; keys.len()];
    for pass in 0..3 {
        let shift = 32 + pass * BITS;
        let mut starts = [0_usize; 1 << BITS];
        for key in &keys {
            starts[(key >> shift & MASK) as usize] += 1;
        }
        if starts.contains(&keys.len()) {
            continue;
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        for key in &keys {
            let start = &mut starts[(key >> shift & MASK) as usize];
            sorted[*start] = *key;
            *start += 1;
        }
        std::mem::swap(&mut keys, &mut sorted);
    }
    keys.into_iter().map(|key| key as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::near_to_far;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn is_the_stable_order(depths in proptest::collection::vec(
            prop_oneof![-1e3_f32..0.0, 1e-6_f32..1e-5, 0.9_f32..1.1, Just(1.0_f32), 1e3_f32..1e30, Just(f32::MAX)], 0..300,
        )) {
            let mut want: Vec<u32> = (0..depths.len() as u32).collect();
            want.sort_by(|a, b| depths[*a as usize].total_cmp(&depths[*b as usize]));
            prop_assert_eq!(near_to_far(depths.iter().copied()), want);
        }
    }
}
