//! A set of Gaussians as a bit mask over scene-wide indices.

/// One bit per Gaussian; bit `i` of the whole is bit `i mod 64` of word `i / 64`. Bits past the length are zero.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Mask {
    len: usize,
    words: Vec<u64>,
}

/// Bytes that are no mask of the stated length.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a mask of {len} Gaussians takes {expected} bytes with zero bits past the end; found {found} bytes")]
pub struct MaskBytesError {
    /// Stated number of Gaussians.
    pub len: usize,
    /// Bytes needed.
    pub expected: usize,
    /// Bytes given.
    pub found: usize,
}

impl Mask {
    /// The empty selection over `len` Gaussians.
    #[must_use]
    pub fn empty(len: usize) -> Self {
        Self { len, words: vec![0; len.div_ceil(64)] }
    }

    /// The mask whose bit `i` is `f(i)`.
    #[must_use]
    pub fn from_fn(len: usize, mut f: impl FnMut(usize) -> bool) -> Self {
        let mut mask = Self::empty(len);
        for i in 0..len {
            if f(i) {
                mask.words[i / 64] |= 1 << (i % 64);
            }
        }
        mask
    }

    /// The selection of all of `len` Gaussians.
    #[must_use]
    pub fn full(len: usize) -> Self {
        let mut mask = Self { len, words: vec![u64::MAX; len.div_ceil(64)] };
        mask.clear_tail();
        mask
    }

    /// The same mask over `len` Gaussians: those that are new are not selected.
    #[must_use]
    pub fn resized(&self, len: usize) -> Self {
        let mut words = self.words.clone();
        words.resize(len.div_ceil(64), 0);
        let mut mask = Self { len, words };
        mask.clear_tail();
        mask
    }

    /// Number of Gaussians it covers, selected or not.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it covers no Gaussian at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Words of 64 Gaussians each, the first Gaussian in the least significant bit; bits past the end are zero.
    #[must_use]
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// Whether Gaussian `i` is selected; false past the end.
    #[must_use]
    pub fn get(&self, i: usize) -> bool {
        i < self.len && self.words[i / 64] >> (i % 64) & 1 == 1
    }

    /// Selects or deselects Gaussian `i`; past the end nothing happens.
    pub fn set(&mut self, i: usize, selected: bool) {
        if i < self.len {
            let bit = 1 << (i % 64);
            if selected {
                self.words[i / 64] |= bit;
            } else {
                self.words[i / 64] &= !bit;
            }
        }
    }

    /// Number of selected Gaussians.
    #[must_use]
    pub fn count(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// Whether no Gaussian is selected.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.words.iter().all(|&w| w == 0)
    }

    /// The selected indices, ascending.
    pub fn ones(&self) -> impl Iterator<Item = usize> + '_ {
        self.words.iter().enumerate().flat_map(|(k, &word)| {
            std::iter::successors((word != 0).then_some(word), |w| {
                let rest = w & (w - 1);
                (rest != 0).then_some(rest)
            })
            .map(move |w| k * 64 + w.trailing_zeros() as usize)
        })
    }

    /// At most `most` selected indices at even distances among the selected ones, ascending. Its cost does not grow with their number.
    #[must_use]
    pub fn samples(&self, most: usize) -> Vec<usize> {
        let step = self.count().div_ceil(most.max(1)).max(1);
        let (mut samples, mut before, mut next) = (Vec::new(), 0, 0);
        for (k, &word) in self.words.iter().enumerate() {
            let here = word.count_ones() as usize;
            while next < before + here {
                let rest = (before..next).fold(word, |rest, _| rest & (rest - 1));
                samples.push(k * 64 + rest.trailing_zeros() as usize);
                next += step;
            }
            before += here;
        }
        samples
    }

    /// Selects a range of Gaussians, clamped to the mask's length.
    pub fn select_range(&mut self, range: std::ops::Range<usize>) {
        let (start, end) = (range.start, range.end.min(self.len));
        for (k, word) in self.words.iter_mut().enumerate().take(end.div_ceil(64)).skip(start / 64) {
            let low = start.saturating_sub(k * 64).min(64);
            let high = (end - k * 64).min(64);
            if low < high {
                *word |= (u64::MAX >> (64 - (high - low))) << low;
            }
        }
    }

    /// Whether some Gaussian is in both.
    #[must_use]
    pub fn intersects(&self, other: &Self) -> bool {
        self.words.iter().zip(&other.words).any(|(a, b)| a & b != 0)
    }

    /// Whether `other` has every Gaussian of this mask.
    #[must_use]
    pub fn is_subset_of(&self, other: &Self) -> bool {
        self.words.iter().enumerate().all(|(k, a)| a & !other.words.get(k).copied().unwrap_or(0) == 0)
    }

    /// Adds all of `other`; masks of different lengths are combined over the shorter one.
    pub fn union_with(&mut self, other: &Self) {
        for (a, b) in self.words.iter_mut().zip(&other.words) {
            *a |= b;
        }
        self.clear_tail();
    }

    /// Removes all of `other`.
    pub fn subtract(&mut self, other: &Self) {
        for (a, b) in self.words.iter_mut().zip(&other.words) {
            *a &= !b;
        }
    }

    /// Keeps only the Gaussians that `other` has too.
    pub fn intersect_with(&mut self, other: &Self) {
        for (k, a) in self.words.iter_mut().enumerate() {
            *a &= other.words.get(k).copied().unwrap_or(0);
        }
    }

    /// Inverts the mask.
    pub fn invert(&mut self) {
        for a in &mut self.words {
            *a = !*a;
        }
        self.clear_tail();
    }

    /// Packed bits, least significant first, `len.div_ceil(8)` bytes: the layout on the bus.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = self.words.iter().flat_map(|w| w.to_le_bytes()).collect();
        bytes.truncate(self.len.div_ceil(8));
        bytes
    }

    /// The mask of packed bits.
    ///
    /// # Errors
    /// [`MaskBytesError`] if the number of bytes is not `len.div_ceil(8)` or a bit past the end is set.
    pub fn from_bytes(len: usize, bytes: &[u8]) -> Result<Self, MaskBytesError> {
        let wrong = MaskBytesError { len, expected: len.div_ceil(8), found: bytes.len() };
        if bytes.len() != len.div_ceil(8) {
            return Err(wrong);
        }
        let mut mask = Self::empty(len);
        for (k, chunk) in bytes.chunks(8).enumerate() {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            mask.words[k] = u64::from_le_bytes(word);
        }
        let before = mask.clone();
        mask.clear_tail();
        if before == mask { Ok(mask) } else { Err(wrong) }
    }

    fn clear_tail(&mut self) {
        if let Some(last) = self.words.last_mut()
            && !self.len.is_multiple_of(64)
        {
            *last &= (1 << (self.len % 64)) - 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Mask;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_resized_mask_keeps_what_it_can_and_selects_nothing_else(
            bits in proptest::collection::vec(any::<bool>(), 0..300), len in 0_usize..300,
        ) {
            let mask = Mask::from_fn(bits.len(), |i| bits[i]);
            prop_assert_eq!(mask.resized(len), Mask::from_fn(len, |i| bits.get(i) == Some(&true)));
        }

        #[test]
        fn bytes_round_trip(bits in proptest::collection::vec(any::<bool>(), 0..300)) {
            let mask = Mask::from_fn(bits.len(), |i| bits[i]);
            prop_assert_eq!(mask.count(), bits.iter().filter(|b| **b).count());
            prop_assert_eq!(mask.ones().collect::<Vec<_>>(), (0..bits.len()).filter(|&i| bits[i]).collect::<Vec<_>>());
            prop_assert_eq!(Mask::from_bytes(bits.len(), &mask.to_bytes()), Ok(mask));
        }

        #[test]
        fn ranges_and_relations_are_those_of_sets(len in 0_usize..300, a in 0_usize..320, n in 0_usize..320, bits in any::<u64>()) {
            let mut range = Mask::empty(len);
            range.select_range(a..a + n);
            prop_assert_eq!(&range, &Mask::from_fn(len, |i| (a..a + n).contains(&i)));
            let other = Mask::from_fn(len, |i| bits >> (i % 64) & 1 == 1);
            prop_assert_eq!(range.intersects(&other), range.ones().any(|i| other.get(i)));
            prop_assert_eq!(range.is_subset_of(&other), range.ones().all(|i| other.get(i)));
            prop_assert_eq!(Mask::full(len).count(), len);
            prop_assert!(range.is_subset_of(&Mask::full(len)));
        }

        #[test]
        fn samples_are_at_even_distances(bits in proptest::collection::vec(any::<bool>(), 0..400), most in 1_usize..50) {
            let mask = Mask::from_fn(bits.len(), |i| bits[i]);
            let step = mask.count().div_ceil(most).max(1);
            prop_assert_eq!(mask.samples(most), mask.ones().step_by(step).collect::<Vec<_>>());
            prop_assert!(mask.samples(most).len() <= most);
        }

        #[test]
        fn inverse_is_the_complement(bits in proptest::collection::vec(any::<bool>(), 0..200)) {
            let mask = Mask::from_fn(bits.len(), |i| bits[i]);
            let mut inverse = mask.clone();
            inverse.invert();
            prop_assert_eq!(inverse.count() + mask.count(), bits.len());
            inverse.intersect_with(&mask);
            prop_assert!(inverse.is_none());
        }
    }

    #[test]
    fn a_set_bit_past_the_end_is_refused() {
        assert!(Mask::from_bytes(3, &[0b1000]).is_err());
        assert!(Mask::from_bytes(3, &[0, 0]).is_err());
    }
}
