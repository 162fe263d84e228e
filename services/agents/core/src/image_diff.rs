//! Comparison of two captured frames.

use sg_proto::render::Frame;

/// Whether two frames differ in 8-bit colours. Equal hashes mean equal frames; otherwise the PNG files decide. `None`: a PNG
/// file cannot be read.
pub(crate) fn images_differ(before: &Frame, after: &Frame) -> Option<bool> {
    if !before.hash.is_empty() && before.hash == after.hash {
        return Some(false);
    }
    if !before.png_hash.is_empty() && !after.png_hash.is_empty() {
        return Some(before.png_hash != after.png_hash);
    }
    // Without hashes of the PNG files the files themselves are compared, if they are on this machine.
    let read = |frame: &Frame| {
        let small = std::fs::metadata(&frame.png_path).is_ok_and(|m| m.len() <= MAX_PNG_BYTES);
        if small { std::fs::read(&frame.png_path).ok() } else { None }
    };
    Some(read(before)? != read(after)?)
}

/// Largest PNG file that is compared, bytes.
const MAX_PNG_BYTES: u64 = 16 << 20;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_compared_by_hash_or_png() {
        let frame = |hash: &str, png: &str| Frame { hash: hash.into(), png_path: png.into(), ..Frame::default() };
        assert_eq!(images_differ(&frame("a", ""), &frame("a", "")), Some(false));
        assert_eq!(images_differ(&frame("a", ""), &frame("b", "")), None);
        let hashed = |hash: &str, png: &str| Frame { png_hash: png.into(), ..frame(hash, "") };
        assert_eq!(images_differ(&hashed("a", "1"), &hashed("b", "1")), Some(false));
        assert_eq!(images_differ(&hashed("a", "1"), &hashed("b", "2")), Some(true));
        let folder = std::env::temp_dir().join(format!("sg-image-diff-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = |name: &str, bytes: &[u8]| {
            let path = folder.join(name);
            std::fs::write(&path, bytes).unwrap();
            path.display().to_string()
        };
        let (one, same, other) = (path("one", b"1"), path("same", b"1"), path("other", b"2"));
        assert_eq!(images_differ(&frame("a", &one), &frame("b", &same)), Some(false));
        assert_eq!(images_differ(&frame("a", &one), &frame("b", &other)), Some(true));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
