//! Shader text that several passes assemble.

use sg_raster::pick::SURFACE;

/// Text of the passes over tiles of `edge` × `edge` pixels.
pub(super) fn tile_source(edge: u32) -> String {
    format!("const TILE: u32 = {edge}u;\n{}{}", surface_source(), include_str!("shaders/tiles.wgsl"))
}

/// Declaration of the accumulated opacity at which a pixel has a surface.
pub(super) fn surface_source() -> String {
    format!("const SURFACE: f32 = {SURFACE:?};\n")
}
