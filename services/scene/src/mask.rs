//! A set of Gaussians as a bit mask over scene-wide indices.

/// One bit per Gaussian; bit `i` of the whole is bit `i mod 64` of word `i / 64`. Bits past the length are zero.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Mask {
    len: usize,
    words: Vec<u64>,
}

/// Bytes that are no mask of the stated length.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a mask of {len} Gaussians takes {expected} bytes with zero bits past the end, not these {found}")]
pub struct MaskBytes {
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

    /// Number of Gaussians it speaks about, selected or not.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it speaks about no Gaussian at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
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

    /// How many Gaussians are selected.
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

    /// Keeps only what `other` has too.
    pub fn intersect_with(&mut self, other: &Self) {
        for (k, a) in self.words.iter_mut().enumerate() {
            *a &= other.words.get(k).copied().unwrap_or(0);
        }
    }

    /// Selects what was not selected and the reverse.
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
    /// [`MaskBytes`] if the number of bytes is not `len.div_ceil(8)` or a bit past the end is set.
    pub fn from_bytes(len: usize, bytes: &[u8]) -> Result<Self, MaskBytes> {
        let wrong = MaskBytes { len, expected: len.div_ceil(8), found: bytes.len() };
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
        fn bytes_round_trip(bits in proptest::collection::vec(any::<bool>(), 0..300)) {
            let mask = Mask::from_fn(bits.len(), |i| bits[i]);
            prop_assert_eq!(mask.count(), bits.iter().filter(|b| **b).count());
            prop_assert_eq!(mask.ones().collect::<Vec<_>>(), (0..bits.len()).filter(|&i| bits[i]).collect::<Vec<_>>());
            prop_assert_eq!(Mask::from_bytes(bits.len(), &mask.to_bytes()), Ok(mask));
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
