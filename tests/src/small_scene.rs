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
    std::fs::write(folder.join("body.ply"), balls(&[(0.0, GREY)]))?;
    std::fs::write(folder.join("sac.ply"), balls(&[(2.0, GREY)]))?;
    let path = path(folder);
    let units = [("body", "[0.8, 0.7, 0.6]"), ("sac", "[0.5, 0.5, 0.5]")];
    let units: String = units
        .iter()
        .map(|(name, palette)| format!("[[unit]]\nname = \"{name}\"\nfile = \"{name}.ply\"\npalette = {palette}\n"))
        .collect();
    std::fs::write(&path, format!("schema = 1\n[box]\nmin = [-1.0, -1.0, -1.0]\nmax = [3.0, 1.0, 1.0]\n{units}"))?;
    Ok(path)
}

/// Writes a scene of one base unit, `thing`, into a folder and gives its file: a green ball and a red one that nearly touch.
///
/// # Errors
/// The file cannot be written.
pub fn write_two_colored(folder: &Path) -> std::io::Result<PathBuf> {
    let path = folder.join("thing.ply");
    std::fs::write(&path, balls(&[(0.0, GREEN), (1.7, RED)]))?;
    Ok(path)
}

/// Constant terms of the harmonics of a grey, a green and a red.
const GREY: [f64; 3] = [0.3, 0.2, 0.1];
const GREEN: [f64; 3] = [-1.2, 0.4, -1.0];
const RED: [f64; 3] = [1.4, -1.5, -1.5];

/// Balls of radius 0.8 about points of the x axis, each in a colour, as a 3DGS file. The first one's Gaussians come first.
fn balls(balls: &[(f64, [f64; 3])]) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", balls.len() * GAUSSIANS);
    for name in "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(' ') {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "property float {name}");
    }
    // What fits of volumes keep of them: the value is the place along x, 100 for each length of 1.
    for name in "value spread gradient consistency surfaceness depth".split(' ') {
        let _ = writeln!(text, "property float source_{name}");
    }
    text.push_str("end_header\n");
    for (at, (x, [red, green, blue])) in (0..balls.len() * GAUSSIANS).map(|at| (at, balls[at / GAUSSIANS])) {
        let i = at % GAUSSIANS;
        // Evenly over the volume: the golden angle about the axis, the cube root for the radius.
        let t = (i as f64 + 0.5) / GAUSSIANS as f64;
        let (angle, z) = (i as f64 * 2.399_963, 1.0 - 2.0 * ((i as f64 * 0.618_034).fract()));
        let (radius, ring) = (0.8 * t.cbrt(), (1.0 - z * z).sqrt());
        let (px, py, pz) = (x + radius * ring * angle.cos(), radius * ring * angle.sin(), radius * z);
        let value = 100.0 * px;
        let _ = writeln!(text, "{px} {py} {pz} {red} {green} {blue} 1.5 -2.6 -2.6 -2.6 1 0 0 0 {value} 0 0 0 0 2");
    }
    text
}
