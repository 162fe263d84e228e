//! What a volume file tells of its world frame: the patient's sides along its axes, and the length unit.

/// The patient's sides that x, y and z of the world point to. Both frames are right-handed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatientFrame {
    /// Left, posterior, superior.
    Lps,
    /// Right, anterior, superior.
    Ras,
}

/// The length unit of the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Metre.
    Metre,
    /// Millimetre.
    Millimetre,
    /// Micrometre.
    Micrometre,
}

impl LengthUnit {
    /// The unit of a symbol or word in a header.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        match name.trim().to_lowercase().as_str() {
            "m" | "meter" | "metre" | "meters" | "metres" => Some(Self::Metre),
            "mm" | "millimeter" | "millimetre" | "millimeters" | "millimetres" => Some(Self::Millimetre),
            "um" | "µm" | "μm" | "micron" | "microns" | "micrometer" | "micrometre" | "micrometers" | "micrometres" => {
                Some(Self::Micrometre)
            }
            _ => None,
        }
    }
}

/// The world frame of a volume, as far as its file tells it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WorldFrame {
    /// The patient's sides, where the file gives them.
    pub patient: Option<PatientFrame>,
    /// The length unit, where the file gives it.
    pub unit: Option<LengthUnit>,
}
