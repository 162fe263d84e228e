//! The orientation of a scene from the world frame of its volume. The scene keeps the volume's world coordinates.

use sg_scene::orientation::{LengthUnit, Orientation, PatientFrame};
use sg_volume::{WorldFrame, world_frame};

/// What the file of a volume tells of the directions and lengths of its scene.
#[must_use]
pub fn orientation_of(frame: WorldFrame) -> Orientation {
    Orientation {
        patient: frame.patient.map(|patient| match patient {
            world_frame::PatientFrame::Lps => PatientFrame::Lps,
            world_frame::PatientFrame::Ras => PatientFrame::Ras,
        }),
        unit: frame.unit.map(|unit| match unit {
            world_frame::LengthUnit::Metre => LengthUnit::Metre,
            world_frame::LengthUnit::Millimetre => LengthUnit::Millimetre,
            world_frame::LengthUnit::Micrometre => LengthUnit::Micrometre,
        }),
        up: None,
    }
}
