//! A volume becomes editable Gaussians.
