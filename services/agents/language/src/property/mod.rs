//! Properties that a clause assigns: colour, opacity, visibility, light, size.

pub(crate) mod assignment;
pub(crate) mod light;
pub(crate) mod opacity;
pub(crate) mod size;
pub(crate) mod tone;
pub(crate) mod value;
pub(crate) mod values;
