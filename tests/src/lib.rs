//! Whatever crosses a process boundary: contract, end to end, benches.
