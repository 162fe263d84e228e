//! Classes of graphics devices.

/// A class of devices to choose from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum DeviceClass {
    /// A graphics card if there is one, else any device.
    #[default]
    Any,
    /// A graphics card.
    Hardware,
    /// A software device (such as lavapipe).
    Software,
}
