//! Comparison of two captured frames.

use sg_proto::render::Frame;

/// Whether two frames differ in 8-bit colours, by their hashes. `None`: a frame has no hash of its PNG file.
///
/// The files are not opened: a path in a message may name a file of another machine, or one that is no picture.
pub(crate) fn images_differ(before: &Frame, after: &Frame) -> Option<bool> {
    if !before.hash.is_empty() && before.hash == after.hash {
        return Some(false);
    }
    let are_known = !before.png_hash.is_empty() && !after.png_hash.is_empty();
    are_known.then(|| before.png_hash != after.png_hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_compared_by_hash() {
        let frame = |hash: &str, png: &str| Frame { hash: hash.into(), png_hash: png.into(), ..Frame::default() };
        assert_eq!(images_differ(&frame("a", ""), &frame("a", "")), Some(false));
        assert_eq!(images_differ(&frame("a", ""), &frame("b", "")), None);
        assert_eq!(images_differ(&frame("a", "1"), &frame("b", "1")), Some(false));
        assert_eq!(images_differ(&frame("a", "1"), &frame("b", "2")), Some(true));
    }
}
