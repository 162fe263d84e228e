//! Conversion between messages of the contract and steps of a selection.

use sg_edit::wire::{decode_mask, encode_mask};
use sg_proto::limits::MAX_STROKE_POINTS;
use sg_proto::scene as proto;
use sg_proto::scene::selection_operation::Operation as Kind;
use sg_proto::scene::selection_step::Step as Sent;
use sg_proto::scene::{StrokeKind, StrokeMode};
use sg_proto::selection::{self, AnswerStep};
use sg_runtime::fault::Fault;
use sg_scene::camera::Camera;
use sg_selection::answers::{Answer, AnswerChange, Answers};
use sg_selection::operations::{Attribute, Combine, Operation};
use sg_selection::session::Proposal;
use sg_selection::steps::Step;
use sg_selection::strokes::{self, Depth, Mode, Stroke};
use sg_selection::tuning::Tuning;

/// A message that is no step of a selection.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum DecodeError {
    /// A stroke has too many points.
    #[error("a stroke of {found} points is over the limit of {max_points}; send it in parts")]
    TooManyPoints {
        /// Number of points.
        found: usize,
        /// Largest number.
        max_points: usize,
    },
    /// A value is missing or impossible.
    #[error("{0}")]
    Invalid(String),
}

impl From<DecodeError> for Fault {
    fn from(error: DecodeError) -> Self {
        match error {
            DecodeError::TooManyPoints { .. } => Self::exhausted(error.to_string()),
            DecodeError::Invalid(text) => Self::invalid(text),
        }
    }
}

#[allow(clippy::needless_pass_by_value, reason = "map_err hands its error over")]
fn invalid(problem: impl ToString) -> DecodeError {
    DecodeError::Invalid(problem.to_string())
}

/// Decodes a step of the bus. `gaussians` is the length of its masks.
pub(crate) fn decode(step: &proto::SelectionStep, gaussians: usize) -> Result<Step, DecodeError> {
    decode_limited(step, gaussians, MAX_STROKE_POINTS)
}

/// Decodes a step with another limit on the points of a stroke.
pub(crate) fn decode_limited(
    step: &proto::SelectionStep,
    gaussians: usize,
    max_points: usize,
) -> Result<Step, DecodeError> {
    match &step.step {
        Some(Sent::Stroke(stroke)) => decode_stroke_limited(stroke, max_points).map(Step::Stroke),
        Some(Sent::Operation(operation)) => decode_operation(operation).map(Step::Operation),
        Some(Sent::Mask(mask)) => Ok(Step::FixedMask(decode_mask(mask, gaussians, "mask").map_err(invalid)?)),
        Some(Sent::Exclude(mask)) => Ok(Step::Exclude(decode_mask(mask, gaussians, "exclude").map_err(invalid)?)),
        Some(Sent::Tuning(tuning)) => decode_tuning(tuning).map(Step::Tuning),
        None => Err(invalid("a step is neither a stroke nor an operation")),
    }
}

/// Encodes a step for the scene.
pub(crate) fn encode(step: &Step) -> proto::SelectionStep {
    let step = match step {
        Step::Stroke(stroke) => Sent::Stroke(encode_stroke(stroke)),
        Step::Operation(operation) => Sent::Operation(encode_operation(operation)),
        Step::FixedMask(mask) => Sent::Mask(encode_mask(mask)),
        Step::Exclude(mask) => Sent::Exclude(encode_mask(mask)),
        Step::Tuning(tuning) => Sent::Tuning(encode_tuning(*tuning)),
    };
    proto::SelectionStep { step: Some(step) }
}

/// Decodes and checks walk parameters.
pub(crate) fn decode_tuning(tuning: &proto::WalkTuning) -> Result<Tuning, DecodeError> {
    let proto::WalkTuning { leak, threshold } = *tuning;
    let tuning = Tuning { leak, threshold };
    tuning.check().map_err(invalid)?;
    Ok(tuning)
}

/// Encodes walk parameters.
pub(crate) fn encode_tuning(tuning: Tuning) -> proto::WalkTuning {
    let Tuning { leak, threshold } = tuning;
    proto::WalkTuning { leak, threshold }
}

/// Encodes a proposed place of the next stroke.
pub(crate) fn encode_proposal(proposal: &Proposal) -> selection::Proposal {
    let Proposal { cluster, point, gaussians, p, q, uncertainty, expected_shift, expected_change } = *proposal;
    selection::Proposal {
        cluster: u32::try_from(cluster).unwrap_or(u32::MAX),
        point: point.to_vec(),
        gaussians: gaussians as u64,
        p,
        q,
        uncertainty,
        expected_shift,
        expected_change,
    }
}

/// The clear steps of the answers to the strokes of a selection with this tuning.
pub(crate) fn encode_answers(answers: &Answers, tuning: Tuning) -> selection::Answers {
    let place = |step: usize| u32::try_from(step).unwrap_or(u32::MAX);
    let encode = |step: &usize| {
        let Answer { leak, gaussians, conductance } = answers.family[*step];
        selection::Answer { leak, gaussians: gaussians as u64, conductance }
    };
    selection::Answers {
        steps: answers.steps.iter().map(encode).collect(),
        first: place(answers.first),
        taken: place(answers.step_at(tuning.leak)),
        tuning: Some(encode_tuning(tuning)),
    }
}

/// Decodes the request for another answer. `None` if it asks for none.
///
/// # Errors
/// [`DecodeError::Invalid`] for a value that this service does not know.
pub(crate) fn decode_answer(step: i32) -> Result<Option<AnswerChange>, DecodeError> {
    Ok(match AnswerStep::try_from(step) {
        Ok(AnswerStep::Unspecified) => None,
        Ok(AnswerStep::Narrower) => Some(AnswerChange::Narrower),
        Ok(AnswerStep::Wider) => Some(AnswerChange::Wider),
        Ok(AnswerStep::Narrowest) => Some(AnswerChange::Narrowest),
        Ok(AnswerStep::Widest) => Some(AnswerChange::Widest),
        Ok(AnswerStep::First) => Some(AnswerChange::First),
        Err(_) => {
            return Err(invalid(format!("{step} names no other answer: narrower, wider, narrowest, widest or first")));
        }
    })
}

/// Decodes and checks a stroke of the bus.
pub(crate) fn decode_stroke(stroke: &proto::Stroke) -> Result<Stroke, DecodeError> {
    decode_stroke_limited(stroke, MAX_STROKE_POINTS)
}

fn decode_stroke_limited(stroke: &proto::Stroke, max_points: usize) -> Result<Stroke, DecodeError> {
    let mode = match stroke.mode() {
        StrokeMode::Walk => Mode::Walk,
        StrokeMode::Cluster => Mode::Cluster,
        StrokeMode::Point => Mode::Point,
        StrokeMode::Unspecified => return Err(invalid("a stroke names no mode: walk, cluster or point")),
    };
    let kind = match stroke.kind() {
        StrokeKind::Foreground => strokes::Kind::Foreground,
        StrokeKind::Background => strokes::Kind::Background,
        StrokeKind::Toggle => strokes::Kind::Toggle,
        StrokeKind::Unspecified => {
            return Err(invalid("a stroke names no kind: foreground, background or toggle"));
        }
    };
    let (points, []) = stroke.points.as_chunks::<3>() else {
        return Err(invalid("a stroke's points are not triples of x, y and z"));
    };
    if points.len() > max_points {
        return Err(DecodeError::TooManyPoints { found: points.len(), max_points });
    }
    let (points, pressure) = (points.to_vec(), stroke.pressure.clone());
    let depth = stroke.depth.as_ref().map(|depth| {
        let eye = depth.eye.as_slice().try_into();
        let eye = eye.map_err(|_| invalid(format!("an eye has {} coordinates; it takes 3", depth.eye.len())))?;
        Ok::<_, DecodeError>(Depth { eye, reach: depth.reach })
    });
    let stroke = Stroke { mode, kind, radius: stroke.radius, points, pressure, depth: depth.transpose()? };
    stroke.check().map_err(invalid)?;
    Ok(stroke)
}

fn encode_stroke(stroke: &Stroke) -> proto::Stroke {
    let mode = match stroke.mode {
        Mode::Walk => StrokeMode::Walk,
        Mode::Cluster => StrokeMode::Cluster,
        Mode::Point => StrokeMode::Point,
    };
    let kind = match stroke.kind {
        strokes::Kind::Foreground => StrokeKind::Foreground,
        strokes::Kind::Background => StrokeKind::Background,
        strokes::Kind::Toggle => StrokeKind::Toggle,
    };
    let points = stroke.points.as_flattened().to_vec();
    let pressure = stroke.pressure.clone();
    let depth = stroke.depth.map(|Depth { eye, reach }| proto::StrokeDepth { eye: eye.to_vec(), reach });
    proto::Stroke { mode: mode.into(), kind: kind.into(), radius: stroke.radius, points, pressure, depth }
}

fn decode_operation(operation: &proto::SelectionOperation) -> Result<Operation, DecodeError> {
    let combine = match operation.combine() {
        proto::Combine::Unspecified | proto::Combine::Add => Combine::Add,
        proto::Combine::Remove => Combine::Remove,
        proto::Combine::Intersect => Combine::Intersect,
        proto::Combine::Replace => Combine::Replace,
    };
    let place = |p: &[f64], name: &str| -> Result<[f64; 3], DecodeError> {
        p.try_into().map_err(|_| invalid(format!("`{name}` has {} coordinates; a place has 3", p.len())))
    };
    let kind = operation.operation.as_ref().ok_or_else(|| invalid("the operation is missing; set one"))?;
    let operation = match kind {
        Kind::Invert(_) => Operation::Invert,
        Kind::Grow(grow) => Operation::Grow { distance: grow.distance },
        Kind::Shrink(shrink) => Operation::Shrink { distance: shrink.distance },
        Kind::FillHoles(holes) => Operation::FillHoles { most: usize::try_from(holes.most).unwrap_or(usize::MAX) },
        Kind::LargestPieces(pieces) => Operation::LargestPieces { keep: pieces.keep as usize },
        Kind::PieceAt(piece) => Operation::PieceAt { at: place(&piece.at, "at")? },
        Kind::Similar(similar) => Operation::Similar { threshold: similar.threshold, combine },
        Kind::Box(region) => {
            Operation::Box { min: place(&region.min, "min")?, max: place(&region.max, "max")?, combine }
        }
        Kind::Sphere(sphere) => {
            Operation::Sphere { centre: place(&sphere.centre, "centre")?, radius: sphere.radius, combine }
        }
        Kind::Plane(plane) => {
            Operation::Plane { point: place(&plane.point, "point")?, normal: place(&plane.normal, "normal")?, combine }
        }
        Kind::Lasso(lasso) => decode_lasso(lasso, combine)?,
        Kind::Range(range) => {
            let attribute = match range.attribute() {
                proto::Attribute::Opacity => Attribute::Opacity,
                proto::Attribute::Scale => Attribute::Scale,
                proto::Attribute::Red => Attribute::Red,
                proto::Attribute::Green => Attribute::Green,
                proto::Attribute::Blue => Attribute::Blue,
                proto::Attribute::Unspecified => return Err(invalid("a range names no attribute")),
            };
            Operation::Range { attribute, min: range.min, max: range.max, combine }
        }
    };
    operation.check().map_err(invalid)?;
    Ok(operation)
}

fn decode_lasso(lasso: &proto::InLasso, combine: Combine) -> Result<Operation, DecodeError> {
    let world_to_camera = <[f64; 16]>::try_from(lasso.world_to_camera.as_slice());
    let world_to_camera = world_to_camera
        .map_err(|_| invalid(format!("`world_to_camera` has {} numbers; it has 16", lasso.world_to_camera.len())))?;
    let (polygon, []) = lasso.polygon.as_chunks::<2>() else {
        return Err(invalid(format!("{} coordinates of corners; they come in twos", lasso.polygon.len())));
    };
    let camera = Camera {
        width: lasso.width,
        height: lasso.height,
        fx: lasso.fx,
        fy: lasso.fy,
        cx: lasso.cx,
        cy: lasso.cy,
        world_to_camera,
        background: [0.0; 3],
        light: sg_scene::camera::Light::default(),
        near: 0.0,
        preview_scale: 1.0,
    };
    let far = if lasso.far == 0.0 { f64::MAX } else { lasso.far };
    Ok(Operation::Lasso { camera: Box::new(camera), polygon: polygon.to_vec(), near: lasso.near, far, combine })
}

fn encode_operation(operation: &Operation) -> proto::SelectionOperation {
    let (kind, combine) = match operation {
        Operation::Invert => (Kind::Invert(proto::Invert {}), None),
        Operation::Grow { distance } => (Kind::Grow(proto::Grow { distance: *distance }), None),
        Operation::Shrink { distance } => (Kind::Shrink(proto::Shrink { distance: *distance }), None),
        Operation::FillHoles { most } => (Kind::FillHoles(proto::FillHoles { most: *most as u64 }), None),
        Operation::LargestPieces { keep } => {
            let keep = u32::try_from(*keep).unwrap_or(u32::MAX);
            (Kind::LargestPieces(proto::LargestPieces { keep }), None)
        }
        Operation::PieceAt { at } => (Kind::PieceAt(proto::PieceAt { at: at.to_vec() }), None),
        Operation::Similar { threshold, combine } => {
            (Kind::Similar(proto::Similar { threshold: *threshold }), Some(*combine))
        }
        Operation::Box { min, max, combine } => {
            (Kind::Box(proto::InBox { min: min.to_vec(), max: max.to_vec() }), Some(*combine))
        }
        Operation::Sphere { centre, radius, combine } => {
            (Kind::Sphere(proto::InSphere { centre: centre.to_vec(), radius: *radius }), Some(*combine))
        }
        Operation::Plane { point, normal, combine } => {
            (Kind::Plane(proto::BeforePlane { point: point.to_vec(), normal: normal.to_vec() }), Some(*combine))
        }
        Operation::Lasso { camera, polygon, near, far, combine } => {
            let lasso = proto::InLasso {
                width: camera.width,
                height: camera.height,
                fx: camera.fx,
                fy: camera.fy,
                cx: camera.cx,
                cy: camera.cy,
                world_to_camera: camera.world_to_camera.to_vec(),
                polygon: polygon.as_flattened().to_vec(),
                near: *near,
                far: *far,
            };
            (Kind::Lasso(lasso), Some(*combine))
        }
        Operation::Range { attribute, min, max, combine } => {
            let attribute = match attribute {
                Attribute::Opacity => proto::Attribute::Opacity,
                Attribute::Scale => proto::Attribute::Scale,
                Attribute::Red => proto::Attribute::Red,
                Attribute::Green => proto::Attribute::Green,
                Attribute::Blue => proto::Attribute::Blue,
            };
            (Kind::Range(proto::InRange { attribute: attribute.into(), min: *min, max: *max }), Some(*combine))
        }
    };
    let combine = match combine {
        None => proto::Combine::Unspecified,
        Some(Combine::Add) => proto::Combine::Add,
        Some(Combine::Remove) => proto::Combine::Remove,
        Some(Combine::Intersect) => proto::Combine::Intersect,
        Some(Combine::Replace) => proto::Combine::Replace,
    };
    proto::SelectionOperation { operation: Some(kind), combine: combine.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use sg_scene::mask::Mask;

    #[test]
    fn steps_round_trip_through_messages() {
        let combine = Combine::Intersect;
        let camera = Box::new(Camera::look_at(DVec3::splat(3.0), DVec3::ZERO, DVec3::Y, 40.0, 64, 48));
        let mut mask = Mask::empty(10);
        mask.set(3, true);
        let steps = [
            Step::Stroke(Stroke {
                mode: Mode::Cluster,
                kind: strokes::Kind::Toggle,
                radius: 0.1,
                points: vec![[0.1, 0.2, 0.3]],
                pressure: Vec::new(),
                depth: None,
            }),
            Step::Stroke(Stroke {
                mode: Mode::Walk,
                kind: strokes::Kind::Background,
                radius: 0.1,
                points: vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]],
                pressure: vec![0.5, 2.0],
                depth: Some(Depth { eye: [0.5, -3.0, 0.5], reach: 0.01 }),
            }),
            Step::FixedMask(mask.clone()),
            Step::Exclude(mask),
            Step::Tuning(Tuning { leak: 0.003, threshold: -0.25 }),
            Step::Operation(Operation::Invert),
            Step::Operation(Operation::Grow { distance: 0.1 }),
            Step::Operation(Operation::Shrink { distance: 0.1 }),
            Step::Operation(Operation::FillHoles { most: 7 }),
            Step::Operation(Operation::LargestPieces { keep: 2 }),
            Step::Operation(Operation::PieceAt { at: [0.1, 0.2, 0.3] }),
            Step::Operation(Operation::Similar { threshold: 2.0, combine }),
            Step::Operation(Operation::Box { min: [0.0; 3], max: [1.0; 3], combine }),
            Step::Operation(Operation::Sphere { centre: [0.5; 3], radius: 0.2, combine }),
            Step::Operation(Operation::Plane { point: [0.5; 3], normal: [0.0, 0.0, 1.0], combine }),
            Step::Operation(Operation::Lasso {
                camera,
                polygon: vec![[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]],
                near: 0.5,
                far: f64::MAX,
                combine,
            }),
            Step::Operation(Operation::Range { attribute: Attribute::Green, min: 0.1, max: 0.2, combine }),
        ];
        for step in steps {
            assert_eq!(decode(&encode(&step), 10).unwrap(), step);
        }
    }

    #[test]
    fn answers_have_their_places_and_the_tuning() {
        let answer = |leak, gaussians| Answer { leak, gaussians, conductance: 0.1 };
        let family = vec![answer(1.0, 10), answer(0.1, 100), answer(0.05, 110), answer(0.01, 1000)];
        let answers = Answers { family, steps: vec![0, 1, 3], first: 1 };
        let encoded = encode_answers(&answers, Tuning { leak: 0.012, threshold: 0.25 });
        let leaks: Vec<f64> = encoded.steps.iter().map(|s| s.leak).collect();
        assert_eq!((leaks, encoded.first, encoded.taken), (vec![1.0, 0.1, 0.01], 1, 2));
        assert_eq!(encoded.steps[2].gaussians, 1000);
        assert_eq!(encoded.tuning, Some(proto::WalkTuning { leak: 0.012, threshold: 0.25 }));
        assert_eq!(decode_answer(0), Ok(None));
        assert_eq!(decode_answer(AnswerStep::Widest.into()), Ok(Some(AnswerChange::Widest)));
        assert!(decode_answer(99).is_err());
    }

    #[test]
    fn invalid_steps_are_rejected() {
        assert!(decode(&proto::SelectionStep::default(), 10).is_err());
        let operation = |operation| proto::SelectionStep {
            step: Some(Sent::Operation(proto::SelectionOperation { operation, ..Default::default() })),
        };
        for bad in [
            None,
            Some(Kind::Grow(proto::Grow { distance: f64::NAN })),
            Some(Kind::PieceAt(proto::PieceAt { at: vec![0.0; 2] })),
            Some(Kind::Lasso(proto::InLasso { polygon: vec![0.0; 7], ..Default::default() })),
            Some(Kind::Range(proto::InRange::default())),
        ] {
            assert!(decode(&operation(bad.clone()), 10).is_err(), "{bad:?}");
        }
        for pressure in [vec![1.0; 2], vec![-1.0], vec![f64::NAN], vec![f64::INFINITY]] {
            let (mode, kind) = (StrokeMode::Walk.into(), StrokeKind::Foreground.into());
            let stroke = proto::Stroke { mode, kind, radius: 0.1, points: vec![0.0; 3], pressure, depth: None };
            assert!(decode_stroke(&stroke).is_err(), "{stroke:?}");
        }
        for (eye, reach) in [(vec![0.0; 2], 0.1), (vec![f64::NAN; 3], 0.1), (vec![0.0; 3], -0.1)] {
            let (mode, kind) = (StrokeMode::Walk.into(), StrokeKind::Foreground.into());
            let depth = Some(proto::StrokeDepth { eye, reach });
            let stroke = proto::Stroke { mode, kind, radius: 0.1, points: vec![0.0; 3], pressure: Vec::new(), depth };
            assert!(decode_stroke(&stroke).is_err(), "{stroke:?}");
        }
        for (leak, threshold) in [(-1.0, 0.0), (f64::NAN, 0.0), (2000.0, 0.0), (0.1, 1.0), (0.1, f64::NAN)] {
            let step = proto::SelectionStep { step: Some(Sent::Tuning(proto::WalkTuning { leak, threshold })) };
            assert!(decode(&step, 10).is_err(), "{step:?}");
        }
        let short = proto::SelectionStep { step: Some(Sent::Mask(encode_mask(&Mask::empty(9)))) };
        assert!(decode(&short, 10).is_err());
    }

    #[test]
    fn a_stroke_file_decodes_into_steps() {
        use sg_proto::stroke_file::{self, Limits};
        let text = r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.02,"points":[[0.1,0.2,0.3]]},
            {"operation":"similar","threshold":2,"combine":"intersect"},
            {"operation":"lasso","polygon":[[0,0],[9,0],[9,9]],
             "camera":{"width":64,"height":64,"fx":64,"fy":64,"cx":32,"cy":32,
                       "world_to_camera":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}},
            {"leak":0.1,"threshold":-0.25}]}"#;
        let steps = stroke_file::parse(text, &Limits::BUS).unwrap();
        let steps: Vec<Step> = steps.iter().map(|step| decode(step, 0).unwrap()).collect();
        assert_eq!(steps[0].stroke().unwrap().points, [[0.1, 0.2, 0.3]]);
        assert_eq!(steps[1], Step::Operation(Operation::Similar { threshold: 2.0, combine: Combine::Intersect }));
        assert!(matches!(&steps[2], Step::Operation(Operation::Lasso { near, far, polygon, .. })
            if (*near, *far, polygon.len()) == (0.0, f64::MAX, 3)));
        assert_eq!(steps[3], Step::Tuning(Tuning { leak: 0.1, threshold: -0.25 }));
        let long = proto::Stroke {
            mode: StrokeMode::Walk.into(),
            kind: StrokeKind::Foreground.into(),
            radius: 0.1,
            points: vec![0.0; 6],
            ..Default::default()
        };
        let step = proto::SelectionStep { step: Some(Sent::Stroke(long)) };
        assert_eq!(decode_limited(&step, 0, 1), Err(DecodeError::TooManyPoints { found: 2, max_points: 1 }));
    }
}
