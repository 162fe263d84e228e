//! The subject of an evaluation: a scene, the part that each Gaussian belongs to, and the parts to select.

use glam::{DMat3, DQuat, DVec3, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use sg_scene::model::Scene;

/// The origin of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// Made by [`super::shapes`].
    Made,
    /// Fitted to a measured volume whose label map is the truth.
    Measured,
}

/// How the Gaussians are written down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Parametrisation {
    /// Neighbours have their axes in the same order and direction.
    Coherent,
    /// Each Gaussian has any of the 24 orders and directions of its axes, either sign of its quaternion and of its normal.
    Scrambled,
}

/// A scene with its truth.
#[derive(Debug, Clone)]
pub struct Subject {
    /// Its name in tables.
    pub name: String,
    /// Its origin.
    pub origin: Origin,
    /// How it is written down.
    pub parametrisation: Parametrisation,
    /// The Gaussians.
    pub scene: Scene,
    /// The part of each Gaussian.
    pub part: Vec<i32>,
    /// Whether each Gaussian is to be selected.
    pub target: Vec<bool>,
}

impl Subject {
    /// The same ellipsoids with a random one of their parametrisations each.
    #[must_use]
    pub fn scrambled(&self, seed: u64) -> Self {
        let mut r = ChaCha8Rng::seed_from_u64(seed);
        r.set_stream(99);
        let turns = turns();
        let mut out = self.clone();
        out.parametrisation = Parametrisation::Scrambled;
        for unit in &mut out.scene.units {
            unit.oriented_normals = false;
            let g = &mut unit.gaussians;
            for i in 0..g.len() {
                let (m, place) = &turns[r.random_range(0..turns.len())];
                let mut q = g.unit_rotation(i) * DQuat::from_mat3(m);
                if r.random_bool(0.5) {
                    q = -q;
                }
                g.rotation[i] = [q.w, q.x, q.y, q.z].map(|x| x as f32);
                let s = g.log_scale[i].to_array();
                g.log_scale[i] = Vec3::from_array(place.map(|k| s[k]));
                if let Some(shading) = g.shading.as_mut().filter(|_| r.random_bool(0.5)) {
                    shading.normal[i] = -shading.normal[i];
                }
            }
        }
        out
    }

    /// Number of Gaussians that are to be selected.
    #[must_use]
    pub fn wanted(&self) -> usize {
        self.target.iter().filter(|t| **t).count()
    }
}

/// The 24 rotations that carry the axes onto themselves, and for each column the axis it came from.
fn turns() -> Vec<(DMat3, [usize; 3])> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let mut out = Vec::new();
    for order in orders {
        for signs in 0..8_u8 {
            let column = |k: usize| axes[order[k]] * if signs >> k & 1 == 1 { -1.0 } else { 1.0 };
            let m = DMat3::from_cols(column(0), column(1), column(2));
            if m.determinant() > 0.0 {
                out.push((m, order));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::shapes::shape;

    #[test]
    fn scrambling_changes_numbers_but_no_ellipsoid() {
        assert_eq!(turns().len(), 24);
        let made = shape("lobster", 300, 1).unwrap();
        let scrambled = made.scrambled(2);
        let (a, b) = (&made.scene.units[0].gaussians, &scrambled.scene.units[0].gaussians);
        let mut same = 0;
        for i in 0..a.len() {
            let off = (a.covariance(i) - b.covariance(i)).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            assert!(off < 1e-6 * a.covariance(i).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs())));
            same += usize::from(a.rotation[i] == b.rotation[i]);
        }
        assert!(same < a.len() / 8, "{same} unchanged");
        assert_eq!(a.position, b.position);
    }
}
