//! The right way up: the side of a scene that is up, the patient's sides along its axes, and its length unit.

use glam::{DMat3, DVec3};

/// Sides of the scene's box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// From -y towards +y.
    Front,
    /// From +y.
    Back,
    /// From -x.
    Left,
    /// From +x.
    Right,
    /// From +z, with +y up in the picture.
    Top,
    /// From -z, with -y up in the picture.
    Bottom,
}

impl Side {
    /// All sides.
    pub const ALL: [Self; 6] = [Self::Front, Self::Back, Self::Left, Self::Right, Self::Top, Self::Bottom];

    /// Direction from the eye to the scene, and the direction up in the picture, where +z is up. From front, top and bottom,
    /// +x is to the right. [`Orientation::direction_and_up`] gives those of any scene.
    #[must_use]
    pub fn direction_and_up(self) -> (DVec3, DVec3) {
        match self {
            Self::Front => (DVec3::Y, DVec3::Z),
            Self::Back => (DVec3::NEG_Y, DVec3::Z),
            Self::Left => (DVec3::X, DVec3::Z),
            Self::Right => (DVec3::NEG_X, DVec3::Z),
            Self::Top => (DVec3::NEG_Z, DVec3::Y),
            Self::Bottom => (DVec3::Z, DVec3::NEG_Y),
        }
    }
}

/// A direction along one axis of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "each variant is named after its axis")]
pub enum Axis {
    PlusX,
    MinusX,
    PlusY,
    MinusY,
    PlusZ,
    MinusZ,
}

impl Axis {
    /// All, each beside its opposite.
    pub const ALL: [Self; 6] = [Self::PlusZ, Self::MinusZ, Self::PlusY, Self::MinusY, Self::PlusX, Self::MinusX];

    /// The unit vector, scene coordinates.
    #[must_use]
    pub fn vector(self) -> DVec3 {
        match self {
            Self::PlusX => DVec3::X,
            Self::MinusX => DVec3::NEG_X,
            Self::PlusY => DVec3::Y,
            Self::MinusY => DVec3::NEG_Y,
            Self::PlusZ => DVec3::Z,
            Self::MinusZ => DVec3::NEG_Z,
        }
    }

    /// The other direction of the same axis.
    #[must_use]
    pub fn opposite(self) -> Self {
        match self {
            Self::PlusX => Self::MinusX,
            Self::MinusX => Self::PlusX,
            Self::PlusY => Self::MinusY,
            Self::MinusY => Self::PlusY,
            Self::PlusZ => Self::MinusZ,
            Self::MinusZ => Self::PlusZ,
        }
    }

    /// The next one that can be up, in the order of [`Axis::ALL`].
    #[must_use]
    pub fn next(self) -> Self {
        let at = Self::ALL.iter().position(|axis| *axis == self).unwrap_or(0);
        Self::ALL.get(at + 1).copied().unwrap_or(Self::PlusZ)
    }

    /// Sign and letter, such as `+Z`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::PlusX => "+X",
            Self::MinusX => "-X",
            Self::PlusY => "+Y",
            Self::MinusY => "-Y",
            Self::PlusZ => "+Z",
            Self::MinusZ => "-Z",
        }
    }

    /// The axis of a [name](Axis::name), in either case.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|axis| axis.name().eq_ignore_ascii_case(name))
    }
}

/// The frame of a scene of a patient. The letters name the sides that x, y and z point to. Both frames are right-handed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatientFrame {
    /// Left, posterior, superior: DICOM, and NRRD files of 3D Slicer.
    Lps,
    /// Right, anterior, superior: NIfTI.
    Ras,
}

impl PatientFrame {
    /// The three letters.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lps => "LPS",
            Self::Ras => "RAS",
        }
    }

    /// The frame of a [name](PatientFrame::name).
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        [Self::Lps, Self::Ras].into_iter().find(|frame| frame.name() == name)
    }

    /// The letter of the patient's side that an axis points to: A, P, L, R, S or I.
    #[must_use]
    pub fn letter(self, axis: Axis) -> &'static str {
        match (self, axis) {
            (Self::Lps, Axis::PlusX) | (Self::Ras, Axis::MinusX) => "L",
            (Self::Lps, Axis::MinusX) | (Self::Ras, Axis::PlusX) => "R",
            (Self::Lps, Axis::PlusY) | (Self::Ras, Axis::MinusY) => "P",
            (Self::Lps, Axis::MinusY) | (Self::Ras, Axis::PlusY) => "A",
            (_, Axis::PlusZ) => "S",
            (_, Axis::MinusZ) => "I",
        }
    }
}

/// The length unit of scene coordinates.
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
    const ALL: [Self; 3] = [Self::Metre, Self::Millimetre, Self::Micrometre];

    /// The symbol in files: `m`, `mm` or `um`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Millimetre => "mm",
            Self::Micrometre => "um",
        }
    }

    /// The unit of a [name](LengthUnit::name).
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|unit| unit.name() == name)
    }

    /// Millimetres of one unit.
    #[must_use]
    pub fn millimetres(self) -> f64 {
        match self {
            Self::Metre => 1000.0,
            Self::Millimetre => 1.0,
            Self::Micrometre => 0.001,
        }
    }
}

/// What a file tells of the directions and lengths of its scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Orientation {
    /// The patient's sides, where the file gives them. Superior is then up.
    pub patient: Option<PatientFrame>,
    /// The length unit, where the file gives it.
    pub unit: Option<LengthUnit>,
    /// The direction that is up, where the file gives it; see [`Orientation::up`].
    pub up: Option<Axis>,
}

impl Orientation {
    /// That of trained splats whose file says nothing: −y is up. Their y axis points down, like that of the cameras that COLMAP finds
    /// for the training.
    pub const OF_TRAINED: Self = Self { patient: None, unit: None, up: Some(Axis::MinusY) };

    /// The known parts, by their keys in files.
    pub fn names(self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let Self { patient, unit, up } = self;
        let names = [
            ("patient", patient.map(PatientFrame::name)),
            ("unit", unit.map(LengthUnit::name)),
            ("up", up.map(Axis::name)),
        ];
        names.into_iter().filter_map(|(key, name)| Some((key, name?)))
    }

    /// The direction that is up: the file's, else +Z. Superior is +Z in both frames of a patient.
    #[must_use]
    pub fn up(self) -> Axis {
        self.up.unwrap_or(Axis::PlusZ)
    }

    /// The same with another direction up; `None` keeps the file's.
    #[must_use]
    pub fn with_up(self, up: Option<Axis>) -> Self {
        Self { up: up.or(self.up), ..self }
    }

    /// The patient's frame, where superior is up. Another direction that somebody chose outweighs the file's sides.
    #[must_use]
    pub fn upright_patient(self) -> Option<PatientFrame> {
        self.patient.filter(|_| self.up() == Axis::PlusZ)
    }

    /// The directions that are right, away from the eye, and up as seen from the front, as columns. The frame is right-handed.
    ///
    /// The front of a patient is anterior. Else +X is to the right, and +Y where X is up or down.
    #[must_use]
    pub fn front_frame(self) -> DMat3 {
        let up = self.up().vector();
        let right = match self.upright_patient() {
            Some(PatientFrame::Ras) => DVec3::NEG_X,
            Some(PatientFrame::Lps) => DVec3::X,
            None if up.x != 0.0 => DVec3::Y,
            None => DVec3::X,
        };
        DMat3::from_cols(right, up.cross(right), up)
    }

    /// Direction from the eye to the scene, and the direction up in the picture, for a view of a side.
    ///
    /// A patient's left and right are the patient's own, and from top and bottom anterior is up, as radiologists read pictures.
    #[must_use]
    pub fn direction_and_up(self, side: Side) -> (DVec3, DVec3) {
        let (direction, up) = match (self.upright_patient(), side) {
            (Some(_), Side::Left) => Side::Right.direction_and_up(),
            (Some(_), Side::Right) => Side::Left.direction_and_up(),
            (Some(_), Side::Top) => (DVec3::NEG_Z, DVec3::NEG_Y),
            _ => side.direction_and_up(),
        };
        let frame = self.front_frame();
        (frame * direction, frame * up)
    }

    /// The side that an axis points to: the eye of that side's view is there.
    #[must_use]
    pub fn side(self, axis: Axis) -> Side {
        let faces = |side: &Side| self.direction_and_up(*side).0.dot(axis.vector()) < -0.5;
        Side::ALL.into_iter().find(faces).unwrap_or(Side::Front)
    }

    /// The label of the side that an axis points to: a patient's letter, else the axis.
    #[must_use]
    pub fn label(self, axis: Axis) -> &'static str {
        self.patient.map_or(axis.name(), |frame| frame.letter(axis))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patient(frame: PatientFrame) -> Orientation {
        Orientation { patient: Some(frame), unit: Some(LengthUnit::Millimetre), up: None }
    }

    /// The letter at which a direction points.
    fn letter(frame: PatientFrame, direction: DVec3) -> &'static str {
        let axis = Axis::ALL.into_iter().find(|axis| (axis.vector() - direction).length() < 1e-12);
        frame.letter(axis.unwrap())
    }

    #[test]
    fn both_frames_of_a_patient_show_the_same_sides() {
        // Side, where the eye is, what is up, what is at the right of the picture.
        let views = [
            (Side::Front, "A", "S", "L"),
            (Side::Back, "P", "S", "R"),
            (Side::Left, "L", "S", "P"),
            (Side::Right, "R", "S", "A"),
            (Side::Top, "S", "A", "R"),
            (Side::Bottom, "I", "A", "L"),
        ];
        for frame in [PatientFrame::Lps, PatientFrame::Ras] {
            for (side, eye, above, beside) in views {
                let (direction, up) = patient(frame).direction_and_up(side);
                let right = direction.cross(up);
                let found = [-direction, up, right].map(|d| letter(frame, d));
                assert_eq!(found, [eye, above, beside], "{frame:?} {side:?}");
            }
        }
    }

    #[test]
    fn without_a_patient_the_axis_that_is_up_is_up() {
        assert_eq!(Orientation::default().front_frame(), DMat3::IDENTITY);
        for axis in Axis::ALL {
            let orientation = Orientation { up: Some(axis), ..Orientation::default() };
            let frame = orientation.front_frame();
            assert!((frame.determinant() - 1.0).abs() < 1e-12, "{axis:?} mirrors nothing");
            assert_eq!(frame.z_axis, axis.vector());
            let (direction, up) = orientation.direction_and_up(Side::Front);
            assert_eq!((direction.dot(up), up), (0.0, axis.vector()));
            assert_eq!(orientation.direction_and_up(Side::Top).0, -axis.vector());
            assert_eq!(Axis::of_name(&axis.name().to_lowercase()), Some(axis));
            assert_eq!(axis.opposite().vector(), -axis.vector());
        }
        // A trained scene whose cameras have y down is seen from their side.
        let trained = Orientation { up: Some(Axis::MinusY), ..Orientation::default() };
        assert_eq!(trained.direction_and_up(Side::Front), (DVec3::Z, DVec3::NEG_Y));
    }

    #[test]
    fn every_axis_has_one_side_and_the_eye_of_its_view() {
        let all = [None, Some(PatientFrame::Lps), Some(PatientFrame::Ras)];
        for (patient, up) in all.into_iter().flat_map(|p| Axis::ALL.map(|up| (p, up))) {
            let orientation = Orientation { patient, unit: None, up: Some(up) };
            for axis in Axis::ALL {
                let (direction, above) = orientation.direction_and_up(orientation.side(axis));
                assert_eq!(-direction, axis.vector(), "{orientation:?}");
                assert_eq!(direction.dot(above), 0.0);
            }
        }
        assert_eq!(patient(PatientFrame::Ras).side(Axis::PlusY), Side::Front);
        assert_eq!(patient(PatientFrame::Lps).side(Axis::PlusX), Side::Left);
        assert_eq!(Orientation::default().side(Axis::PlusX), Side::Right);
    }

    #[test]
    fn the_axes_that_can_be_up_follow_one_another_in_a_ring() {
        let mut axis = Axis::PlusZ;
        let ring = Axis::ALL.map(|_| {
            let here = axis;
            axis = axis.next();
            here
        });
        assert_eq!((ring, axis), (Axis::ALL, Axis::PlusZ));
    }

    #[test]
    fn a_chosen_direction_outweighs_the_sides_of_the_file() {
        let turned = patient(PatientFrame::Ras).with_up(Some(Axis::MinusZ));
        assert_eq!(turned.upright_patient(), None);
        assert_eq!(turned.direction_and_up(Side::Front).1, DVec3::NEG_Z);
        assert_eq!(turned.label(Axis::MinusZ), "I", "the letters stay the file's");
        assert_eq!(turned.with_up(None), turned);
    }
}
