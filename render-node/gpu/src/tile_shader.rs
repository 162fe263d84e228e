//! Text of the passes over tiles, the same for both projections.

use crate::compose::OVER;
use crate::shader::running_sums;
use crate::textures::PicturePrecision;

/// The passes over tiles of `edge` pixels each way.
pub(super) fn source(edge: u32, pictures: PicturePrecision) -> String {
    let edge = format!("const TILE: u32 = {edge};");
    let [lists, blend] = [include_str!("shaders/tiles.wgsl"), include_str!("shaders/blend_tiles.wgsl")];
    [&edge, pictures.declaration(), OVER, &running_sums("touched_sums"), lists, blend].join("\n")
}
