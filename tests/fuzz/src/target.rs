//! A target: one reader, and the limits that hold for it.

use crate::memory;
use crate::stage::Stage;

/// Most memory of a reader for an input of `n` bytes: `free` + `n` × `each` bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// Bytes for an input of any length.
    pub free: usize,
    /// Bytes for each byte of the input.
    pub each: usize,
}

impl Memory {
    /// For numbers in binary or text.
    pub const NUMBERS: Self = Self { free: 4 << 20, each: 64 };
    /// For text whose parts become tables, and for messages: a part of one or two bytes takes hundreds.
    pub const PARTS: Self = Self { free: 4 << 20, each: 1024 };
    /// For compressed content. It may expand to 32 MiB (`sg_input::limits::expanded`), whose numbers take ten times that.
    pub const EXPANDED: Self = Self { free: 352 << 20, each: 1024 };

    fn of(self, bytes: usize) -> usize {
        self.free.saturating_add(self.each.saturating_mul(bytes))
    }
}

/// One reader under test.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Name on the command line and of its corpus.
    pub name: &'static str,
    /// The reader.
    pub about: &'static str,
    /// Longest input that the engine makes, bytes.
    pub longest: usize,
    /// Most memory.
    pub memory: Memory,
    /// Reads the input, checks the result, and says whether the input was accepted.
    pub(crate) read: fn(&Stage, &[u8]) -> bool,
}

impl Target {
    /// Reads one input and returns whether the reader accepted it.
    ///
    /// # Panics
    /// If the reader panics, breaks its promise or takes more memory than it may: a finding.
    pub fn check(&self, stage: &Stage, input: &[u8]) -> bool {
        let before = memory::start();
        let accepted = (self.read)(stage, input);
        let (taken, most) = (memory::peak_since(before), self.memory.of(input.len()));
        assert!(
            taken <= most,
            "{}: {} bytes of input took {taken} bytes of memory, over {most}",
            self.name,
            input.len()
        );
        accepted
    }
}
