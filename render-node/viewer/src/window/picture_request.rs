//! What a requested picture shows.

use std::sync::Arc;

use sg_raster::render::{Projection, Quality};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

/// The input of a requested picture.
pub(super) struct PictureRequest {
    pub(super) scene: Arc<Scene>,
    pub(super) cameras: Vec<Camera>,
    pub(super) appearance: Appearance,
    pub(super) outlines: bool,
    pub(super) gradient: bool,
    /// The quality at rest.
    pub(super) quality: Quality,
    pub(super) projection: Projection,
}

impl PartialEq for PictureRequest {
    fn eq(&self, other: &Self) -> bool {
        let flags = |r: &Self| (r.outlines, r.gradient, r.quality, r.projection);
        Arc::ptr_eq(&self.scene, &other.scene)
            && self.cameras == other.cameras
            && flags(self) == flags(other)
            && same(&self.appearance, &other.appearance)
    }
}

/// Compares looks without reading colours and occlusion, since there is one of each per Gaussian. It compares pointers: a display
/// keeps them.
fn same(a: &Appearance, b: &Appearance) -> bool {
    fn same_column<T>(a: Option<&Arc<[T]>>, b: Option<&Arc<[T]>>) -> bool {
        match (a, b) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        }
    }
    let plain = |appearance: &Appearance| Appearance { colors: None, occlusion: None, ..appearance.clone() };
    same_column(a.colors.as_ref(), b.colors.as_ref())
        && same_column(a.occlusion.as_ref(), b.occlusion.as_ref())
        && plain(a) == plain(b)
}
