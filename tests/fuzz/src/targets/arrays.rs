//! NumPy arrays.

use sg_formats::npy::{read_floats, read_indices, read_labels, read_mask};

use super::accepted;
use crate::parts::Parts;
use crate::stage::Stage;

/// Length of the masks, and end of the indices.
pub(crate) const LENGTH: usize = 20;

/// The first byte chooses the kind of array.
pub(crate) fn npy(stage: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let kind = parts.byte();
    let path = stage.write("in.npy", parts.rest());
    match kind % 4 {
        0 => accepted(read_mask(&path, LENGTH), &path).is_some_and(|mask| {
            assert_eq!(mask.len(), LENGTH);
            true
        }),
        1 => accepted(read_labels(&path), &path).is_some(),
        2 => accepted(read_indices(&path, LENGTH), &path).is_some_and(|indices| {
            assert!(indices.iter().all(|i| *i < LENGTH));
            true
        }),
        _ => accepted(read_floats(&path), &path).is_some_and(|(shape, values)| {
            assert_eq!(shape.iter().product::<usize>(), values.len());
            true
        }),
    }
}
