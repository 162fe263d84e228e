//! Splatting: the shading model, the CPU renderer, the render process.
