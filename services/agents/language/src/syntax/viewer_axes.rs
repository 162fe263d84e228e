//! Directions as the viewer sees them: "the upper left".

use sg_proto::language::Way;
use sg_proto::light_presets::{LightPreset, ViewerAxes};
use sg_proto::scene::{LightMode, SetLight, Vector, View};
use winnow::Parser;
use winnow::combinator::{alt, opt, repeat};
use winnow::error::EmptyError;

use super::phrase::{Input, Outcome, article, exactly, one_of, skip};

/// Sides of the current picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
    Above,
    Below,
    Front,
    Behind,
}

/// Parses the origin of light: one or more sides ("the upper left"), or the camera.
pub(crate) fn light_source(input: &mut Input<'_>) -> Outcome<SetLight> {
    article(input)?;
    let eye = opt(one_of("eye | eyes | camera | viewer | viewpoint | me | here | where i am")).parse_next(input)?;
    if eye.is_some() {
        return Ok(SetLight { mode: LightMode::Headlight.into(), ..SetLight::default() });
    }
    let side = |input: &mut Input<'_>| {
        skip("and | and from | and the | and from the | the").parse_next(input)?;
        alt((
            exactly("left").map(|_| Side::Left),
            exactly("right").map(|_| Side::Right),
            exactly("above | top | upper | overhead | over").map(|_| Side::Above),
            exactly("below | bottom | underneath | beneath | lower | under").map(|_| Side::Below),
            exactly("front").map(|_| Side::Front),
            exactly("behind | back | rear").map(|_| Side::Behind),
        ))
        .parse_next(input)
    };
    let sides: Vec<Side> = repeat(1..=3, side).parse_next(input)?;
    opt((opt(exactly("hand")), exactly("side | corner | edge"))).parse_next(input)?;
    skip("of the picture | of the scene | of the image | of it").parse_next(input)?;
    let axes = CameraAxes::of(input.state.view);
    let mut sum = [0.0; 3];
    for side in sides {
        let axis = axes.direction(side);
        for (s, a) in sum.iter_mut().zip(axis) {
            *s += a;
        }
    }
    let direction = unit(sum).ok_or(EmptyError)?;
    let [x, y, z] = direction;
    Ok(SetLight { mode: LightMode::Direction.into(), direction: Some(Vector { x, y, z }), ..SetLight::default() })
}

/// Parses a named light: "studio lighting", "rim light".
pub(crate) fn light_preset(input: &mut Input<'_>) -> Outcome<SetLight> {
    article(input)?;
    let preset = alt((
        exactly("studio | key").map(|_| LightPreset::Studio),
        exactly("rim | edge").map(|_| LightPreset::Rim),
        exactly("flat | even").map(|_| LightPreset::Flat),
    ))
    .parse_next(input)?;
    exactly("light | lights | lighting | illumination").parse_next(input)?;
    let CameraAxes(axes) = CameraAxes::of(input.state.view);
    Ok(preset.set_light(&axes))
}

/// Axes of the camera in the scene frame.
pub(crate) struct CameraAxes(ViewerAxes);

impl CameraAxes {
    /// The axes of a view. Without a view: the front view (camera at -y, z up).
    pub(crate) fn of(view: Option<&View>) -> Self {
        let front = ViewerAxes { right: [1.0, 0.0, 0.0], up: [0.0, 0.0, 1.0], backward: [0.0, -1.0, 0.0] };
        view.and_then(Self::from_view).unwrap_or(Self(front))
    }

    fn from_view(view: &View) -> Option<Self> {
        let [eye, target, up] = [view.eye?, view.target?, view.up?].map(|v| [v.x, v.y, v.z]);
        let backward = unit([eye[0] - target[0], eye[1] - target[1], eye[2] - target[2]])?;
        let up = unit(up)?;
        let right = unit(cross(up, backward))?;
        Some(Self(ViewerAxes { right, up, backward }))
    }

    /// The direction of a movement in the picture, of unit length. `None` for the patient's directions.
    pub(crate) fn way(&self, way: Way) -> Option<[f64; 3]> {
        let ViewerAxes { right, backward, .. } = self.0;
        // The up direction of a view may lean; that of its picture is across its axis.
        let up = cross(backward, right);
        let against = |v: [f64; 3]| v.map(|c| -c);
        match way {
            Way::Right => Some(right),
            Way::Left => Some(against(right)),
            Way::Up => Some(up),
            Way::Down => Some(against(up)),
            Way::Nearer => Some(backward),
            Way::Farther => Some(against(backward)),
            _ => None,
        }
    }

    /// The axis of a rotation, right-handed, that moves the near side this way.
    pub(crate) fn turning(&self, way: Way) -> Option<[f64; 3]> {
        let ViewerAxes { right, backward, .. } = self.0;
        let up = cross(backward, right);
        match way {
            Way::Right => Some(up),
            Way::Left => Some(up.map(|c| -c)),
            Way::Up => Some(right.map(|c| -c)),
            Way::Down => Some(right),
            _ => None,
        }
    }

    fn direction(&self, side: Side) -> [f64; 3] {
        let ViewerAxes { right, up, backward } = self.0;
        match side {
            Side::Right => right,
            Side::Left => right.map(|c| -c),
            Side::Above => up,
            Side::Below => up.map(|c| -c),
            Side::Front => backward,
            Side::Behind => backward.map(|c| -c),
        }
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    (length.is_finite() && length > 1e-9).then(|| v.map(|c| c / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_left_is_the_viewers_left() {
        let vector = |x, y, z| Some(Vector { x, y, z });
        let front = View {
            eye: vector(0.0, -5.0, 0.0),
            target: vector(0.0, 0.0, 0.0),
            up: vector(0.0, 0.0, 1.0),
            fov_y_degrees: 45.0,
        };
        assert_eq!(CameraAxes::of(Some(&front)).direction(Side::Left), [-1.0, 0.0, 0.0]);
        let back = View { eye: vector(0.0, 5.0, 0.0), ..front };
        assert_eq!(CameraAxes::of(Some(&back)).direction(Side::Left), [1.0, 0.0, 0.0]);
        assert_eq!(CameraAxes::of(Some(&back)).direction(Side::Front), [0.0, 1.0, 0.0]);
    }

    #[test]
    fn ways_are_those_of_the_picture_also_for_a_view_that_leans() {
        let vector = |x, y, z| Some(Vector { x, y, z });
        // From in front and above; the up direction of the view is that of the scene.
        let view = View {
            eye: vector(0.0, -5.0, 5.0),
            target: vector(0.0, 0.0, 0.0),
            up: vector(0.0, 0.0, 1.0),
            fov_y_degrees: 45.0,
        };
        let axes = CameraAxes::of(Some(&view));
        let near = |a: Option<[f64; 3]>, b: [f64; 3]| {
            assert!(a.unwrap().iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
        };
        let half = std::f64::consts::FRAC_1_SQRT_2;
        near(axes.way(Way::Right), [1.0, 0.0, 0.0]);
        near(axes.way(Way::Up), [0.0, half, half]);
        near(axes.way(Way::Nearer), [0.0, -half, half]);
        // The near side at (0, -1, 1) moves right by a turn about the picture's up direction.
        let turned = |axis: Option<[f64; 3]>| cross(axis.unwrap(), [0.0, -half, half]);
        near(Some(turned(axes.turning(Way::Right))), axes.way(Way::Right).unwrap());
        near(Some(turned(axes.turning(Way::Up))), axes.way(Way::Up).unwrap());
        near(Some(turned(axes.turning(Way::Left))), axes.way(Way::Left).unwrap());
        assert_eq!((axes.way(Way::Anterior), axes.turning(Way::Nearer)), (None, None));
    }

    #[test]
    fn a_view_along_its_up_vector_uses_the_front_view() {
        let vector = |x, y, z| Some(Vector { x, y, z });
        let view = View {
            eye: vector(0.0, 0.0, 5.0),
            target: vector(0.0, 0.0, 0.0),
            up: vector(0.0, 0.0, 1.0),
            fov_y_degrees: 45.0,
        };
        assert_eq!(CameraAxes::of(Some(&view)).direction(Side::Right), [1.0, 0.0, 0.0]);
    }
}
