//! The area of each eye hidden by a headset's lenses, as reported by the runtime.

use glam::DVec2;
use openxr as xr;

use super::space::STEREO;

/// A triangle in the plane one unit ahead of an eye: right and up.
pub type Triangle = [DVec2; 3];

/// Hidden triangles of both eyes.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct VisibilityMask {
    /// Counts the changes.
    pub(super) version: u64,
    /// Left and right; empty without a known hidden area.
    pub(super) eyes: [Vec<Triangle>; 2],
}

impl VisibilityMask {
    /// Requests one eye's mesh again. A runtime without one hides nothing.
    pub(super) fn query(&mut self, session: &xr::Session<xr::Vulkan>, eye: usize) {
        let Some(known) = self.eyes.get_mut(eye) else { return };
        let hidden = xr::VisibilityMaskTypeKHR::HIDDEN_TRIANGLE_MESH;
        let told = match session.get_visibility_mask_khr(STEREO, eye as u32, hidden) {
            Ok(mesh) => triangles(&mesh.vertices, &mesh.indices),
            Err(error) => {
                tracing::info!(eye, %error, "what lenses hide is not known");
                Vec::new()
            }
        };
        if *known != told {
            *known = told;
            self.version += 1;
        }
    }
}

/// The triangles of a mesh; those with a corner that is not there are left out.
fn triangles(corners: &[xr::Vector2f], indices: &[u32]) -> Vec<Triangle> {
    let corner = |index: u32| {
        let xr::Vector2f { x, y } = *corners.get(index as usize)?;
        let at = DVec2::new(x.into(), y.into());
        at.is_finite().then_some(at)
    };
    let (all, _) = indices.as_chunks::<3>();
    all.iter().filter_map(|[a, b, c]| Some([corner(*a)?, corner(*b)?, corner(*c)?])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_is_triangles_and_nothing_of_it_is_made_up() {
        let corners = [(-1.0, 1.0), (0.0, 1.0), (-1.0, 0.0), (f32::NAN, 0.0)].map(|(x, y)| xr::Vector2f { x, y });
        let sound = [[-1.0, 1.0], [0.0, 1.0], [-1.0, 0.0]].map(DVec2::from);
        assert_eq!(triangles(&corners, &[0, 1, 2, 1, 2, 9, 0, 1, 3, 2, 0]), [sound]);
        assert!(triangles(&[], &[]).is_empty());
    }
}
