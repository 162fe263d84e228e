//! Panels: what a person reads and presses beside the scene, the same in a window and in a headset.
