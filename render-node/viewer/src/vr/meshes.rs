//! Meshes for the room: a ball, a rod and a square, and their placements.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, Vec3};
use sg_gpu::{MeshCorner, MeshLook, PlacedMesh};

use crate::hands::Rectangle;

/// Numbers of the meshes of [`all`].
const BALL: usize = 0;
const ROD: usize = 1;
const SQUARE: usize = 2;

/// Segments around a ball or a rod, and rings of a ball from pole to pole.
const AROUND: usize = 18;
const RINGS: usize = 10;

/// All meshes, each a list of triangles: a ball of radius 1; a rod of radius 1 from z = 0 to 1 without ends; the square from −½
/// to ½ in x and y, facing +z.
pub(super) fn all() -> Vec<Vec<MeshCorner>> {
    vec![ball(), rod(), square()]
}

/// Two triangles of a quadrilateral, its corners in order around it.
fn quadrilateral(corners: [MeshCorner; 4]) -> [MeshCorner; 6] {
    let [a, b, c, d] = corners;
    [a, b, c, a, c, d]
}

fn ball() -> Vec<MeshCorner> {
    let corner = |ring: usize, around: usize| {
        let (down, turn) = (
            std::f64::consts::PI * ring as f64 / RINGS as f64,
            std::f64::consts::TAU * (around % AROUND) as f64 / AROUND as f64,
        );
        let at = DVec3::new(down.sin() * turn.cos(), down.cos(), down.sin() * turn.sin()).as_vec3();
        MeshCorner { position: at, normal: at }
    };
    let patches = (0..RINGS).flat_map(|ring| (0..AROUND).map(move |around| (ring, around)));
    let patch = |(ring, around)| {
        quadrilateral([
            corner(ring, around),
            corner(ring, around + 1),
            corner(ring + 1, around + 1),
            corner(ring + 1, around),
        ])
    };
    patches.flat_map(patch).collect()
}

fn rod() -> Vec<MeshCorner> {
    let corner = |z: f32, around: usize| {
        let turn = std::f64::consts::TAU * (around % AROUND) as f64 / AROUND as f64;
        let normal = DVec3::new(turn.cos(), turn.sin(), 0.0).as_vec3();
        MeshCorner { position: normal.with_z(z), normal }
    };
    let patch = |around| {
        quadrilateral([corner(0.0, around), corner(0.0, around + 1), corner(1.0, around + 1), corner(1.0, around)])
    };
    (0..AROUND).flat_map(patch).collect()
}

fn square() -> Vec<MeshCorner> {
    let corner = |x: f32, y: f32| MeshCorner { position: Vec3::new(x, y, 0.0), normal: Vec3::Z };
    quadrilateral([corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)]).to_vec()
}

/// A look with its colour and the way it meets the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Paint {
    pub(super) look: MeshLook,
    /// Red, green, blue, opacity.
    pub(super) color: [f32; 4],
    /// Half the depth in metres around the scene's front over which it fades out.
    pub(super) softness: f64,
    /// Least share that is seen through the scene.
    pub(super) ghost: f32,
}

impl Paint {
    /// A lit surface of a hand: it shines through the scene faintly, so that a hand inside it is not lost.
    pub(super) fn solid(rgb: [f32; 3]) -> Self {
        let [r, g, b] = rgb;
        Self { look: MeshLook::Solid, color: [r, g, b, 1.0], softness: 0.003, ghost: 0.25 }
    }

    /// A bright beam.
    pub(super) fn beam(rgb: [f32; 3], opacity: f32) -> Self {
        let [r, g, b] = rgb;
        Self { look: MeshLook::Beam, color: [r, g, b, opacity], softness: 0.005, ghost: 0.15 }
    }

    fn placed(self, mesh: usize, to_room: DMat4, size: DVec2) -> PlacedMesh {
        let Self { look, color, softness, ghost } = self;
        let [width, height] = size.as_vec2().to_array();
        PlacedMesh { mesh, look, to_room, color, size: [width, height], softness: softness as f32, ghost, corner: 0.0 }
    }

    /// A ball with these half axes, metres.
    pub(super) fn ball(self, at: DVec3, turn: DQuat, axes: DVec3) -> PlacedMesh {
        let to_room = DMat4::from_scale_rotation_translation(axes, turn, at);
        self.placed(BALL, to_room, 2.0 * axes.truncate())
    }

    /// A rod from one place to another. Without length it is not finite, so it is not drawn.
    pub(super) fn rod(self, from: DVec3, to: DVec3, radius: f64) -> PlacedMesh {
        let along = to - from;
        let (across, up) = along.normalize().any_orthonormal_pair();
        let axes = DMat3::from_cols(radius * across, radius * up, along);
        self.placed(ROD, DMat4::from_mat3_translation(axes, from), DVec2::splat(2.0 * radius))
    }

    /// A rectangle with rounded corners.
    pub(super) fn rectangle(self, place: &Rectangle, corner: f64) -> PlacedMesh {
        let scale = place.size.extend(1.0);
        let to_room = DMat4::from_scale_rotation_translation(scale, place.pose.orientation, place.pose.position);
        PlacedMesh { corner: corner as f32, ..self.placed(SQUARE, to_room, place.size) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hands::Pose;

    fn triangles(mesh: &[MeshCorner]) -> impl Iterator<Item = [MeshCorner; 3]> + '_ {
        mesh.as_chunks::<3>().0.iter().copied()
    }

    #[test]
    fn meshes_are_closed_outward_and_of_unit_size() {
        let [ball, rod, square] = all().try_into().unwrap();
        assert!([&ball, &rod, &square].iter().all(|mesh| mesh.len() % 3 == 0 && !mesh.is_empty()));
        for c in &ball {
            assert!((c.position.length() - 1.0).abs() < 1e-6 && c.normal == c.position);
        }
        // The signed volume of a closed surface does not depend on the origin: nearly that of a ball.
        let volume = |shift: Vec3| -> f32 {
            triangles(&ball).map(|t| t.map(|c| c.position - shift)).map(|[a, b, c]| a.cross(b).dot(c) / 6.0).sum()
        };
        let whole = volume(Vec3::ZERO).abs();
        assert!((0.9..1.0).contains(&(whole / (4.0 / 3.0 * std::f32::consts::PI))), "{whole}");
        assert!((volume(Vec3::new(3.0, -2.0, 1.0)).abs() - whole).abs() < 1e-3);
        assert!(rod.iter().all(|c| (c.position.truncate().length() - 1.0).abs() < 1e-6 && c.normal.z == 0.0));
        assert!(rod.iter().any(|c| c.position.z == 0.0) && rod.iter().any(|c| c.position.z == 1.0));
        let area: f32 =
            triangles(&square).map(|t| t.map(|c| c.position)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).z).sum();
        assert!((area - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_rod_reaches_from_one_place_to_the_other() {
        let (from, to) = (DVec3::new(0.1, 1.0, -0.4), DVec3::new(-0.3, 1.2, -2.0));
        let rod = Paint::beam([1.0; 3], 0.5).rod(from, to, 0.01);
        assert!(rod.to_room.transform_point3(DVec3::ZERO).distance(from) < 1e-12);
        assert!(rod.to_room.transform_point3(DVec3::Z).distance(to) < 1e-12);
        let side = rod.to_room.transform_vector3(DVec3::X);
        assert!((side.length() - 0.01).abs() < 1e-12 && side.dot(to - from).abs() < 1e-12);
        assert!(!Paint::beam([1.0; 3], 0.5).rod(from, from, 0.01).to_room.is_finite());
    }

    #[test]
    fn a_rectangle_covers_its_place() {
        let pose = Pose { position: DVec3::new(0.5, 1.0, -1.0), orientation: DQuat::from_rotation_y(0.4) };
        let place = Rectangle { pose, size: DVec2::new(0.6, 0.4) };
        let placed = Paint::solid([0.5; 3]).rectangle(&place, 0.01);
        for (x, y) in [(0.0, 0.0), (1.0, 1.0), (1.0, 0.0)] {
            let corner = placed.to_room.transform_point3(DVec3::new(x - 0.5, 0.5 - y, 0.0));
            assert!(corner.distance(place.point(DVec2::new(x, y))) < 1e-12);
        }
    }
}
