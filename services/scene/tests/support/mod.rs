//! Scene files for tests that start processes.

use std::fmt::Write as _;
use std::path::Path;

/// Writes a 3DGS file of `n` Gaussians on a spiral; its only base unit is called after the file.
pub(crate) fn write_ply(path: &Path, n: usize) {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
    for name in "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(' ') {
        writeln!(text, "property float {name}").unwrap();
    }
    text.push_str("end_header\n");
    for i in 0..n {
        let t = i as f64 / n as f64;
        let (x, y, z) = ((40.0 * t).cos(), (40.0 * t).sin(), 3.0 * t);
        writeln!(text, "{x} {y} {z} {t} 0.5 0.1 1.5 -3 -3 -3 1 0 0 0").unwrap();
    }
    std::fs::write(path, text).unwrap();
}
