//! A small scene of two base units, `body` and `sac`, each a ball of Gaussians that keep values of a volume.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Gaussians of each unit.
pub const GAUSSIANS: usize = 400;
/// Centre of the sac, normalized by the scene's box.
pub const SAC: [f64; 3] = [0.75, 0.5, 0.5];
/// Radius of a stroke that stays within the sac, as a fraction of the box's longest edge.
pub const STROKE: f64 = 0.12;

/// The scene's `scene.toml` in a folder.
#[must_use]
pub fn path(folder: &Path) -> PathBuf {
    folder.join("scene.toml")
}

/// Writes the scene into a folder and gives the path of its `scene.toml`.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path) -> std::io::Result<PathBuf> {
    std::fs::write(folder.join("body.ply"), ball(0.0))?;
    std::fs::write(folder.join("sac.ply"), ball(2.0))?;
    let path = path(folder);
    let units = [("body", "[0.8, 0.7, 0.6]"), ("sac", "[0.5, 0.5, 0.5]")];
    let units: String = units
        .iter()
        .map(|(name, palette)| format!("[[unit]]\nname = \"{name}\"\nfile = \"{name}.ply\"\npalette = {palette}\n"))
        .collect();
    std::fs::write(&path, format!("schema = 1\n[box]\nmin = [-1.0, -1.0, -1.0]\nmax = [3.0, 1.0, 1.0]\n{units}"))?;
    Ok(path)
}

/// A ball of radius 0.8 about a point of the x axis, as a 3DGS file.
fn ball(x: f64) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {GAUSSIANS}\n");
    for name in "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(' ') {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "property float {name}");
    }
    // What fits of volumes keep of them: the value is the place along x, 100 for each length of 1.
    for name in "value spread gradient consistency surfaceness depth".split(' ') {
        let _ = writeln!(text, "property float source_{name}");
    }
    text.push_str("end_header\n");
    for i in 0..GAUSSIANS {
        // Evenly over the volume: the golden angle about the axis, the cube root for the radius.
        let t = (i as f64 + 0.5) / GAUSSIANS as f64;
        let (angle, z) = (i as f64 * 2.399_963, 1.0 - 2.0 * ((i as f64 * 0.618_034).fract()));
        let (radius, ring) = (0.8 * t.cbrt(), (1.0 - z * z).sqrt());
        let (px, py, pz) = (x + radius * ring * angle.cos(), radius * ring * angle.sin(), radius * z);
        let value = 100.0 * px;
        let _ = writeln!(text, "{px} {py} {pz} 0.3 0.2 0.1 1.5 -2.6 -2.6 -2.6 1 0 0 0 {value} 0 0 0 0 2");
    }
    text
}
