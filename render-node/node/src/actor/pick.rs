//! Answers queries over the bus for the frontmost surface.

use glam::DVec2;
use sg_edit::EditState;
use sg_edit::wire::{decode_vector, encode_vector};
use sg_proto::render as proto;
use sg_raster::pick::{Hit, SURFACE, pick as pick_at, pick_ray};
use sg_raster::structure::NO_CLUSTER;
use sg_runtime::fault::Fault;
use sg_scene::appearance::Appearance;
use sg_scene::model::Scene;
use sg_scene::view::View;

use super::decode;

/// Picks the first Gaussian at the pixel or along the ray of a request. `view` is that of requests without a camera,
/// `near` the near distance.
pub(super) fn pick(
    scene: &Scene,
    (state, view, near): (&EditState, View, f64),
    request: &proto::PickRequest,
) -> Result<Option<Hit>, Fault> {
    let look = Appearance { clips: decode::clips(&request.clips)?, ..state.appearance() };
    let level = if request.level == 0.0 { SURFACE } else { request.level };
    let hit = match &request.ray {
        Some(proto::Ray { origin: Some(origin), direction: Some(direction), spread }) => {
            pick_ray(scene, &look, decode_vector(origin), decode_vector(direction), *spread, level)
        }
        Some(_) => return Err(Fault::invalid("a ray takes an origin and a direction")),
        None => {
            let camera = decode::camera(request.camera.as_ref(), (view, near), [request.width, request.height])?;
            let at = DVec2::new(request.x, request.y);
            if !at.is_finite() {
                return Err(Fault::invalid("the place in the picture has to be two finite numbers"));
            }
            pick_at(scene, &look, &camera, decode::projection(request.projection()), at, level)
        }
    };
    hit.map_err(|e| Fault::invalid(e.to_string()))
}

/// The reply for a hit.
pub(super) fn reply(state: &EditState, hit: Option<Hit>, labels: Option<&[u32]>) -> proto::PickReply {
    let Some(Hit { gaussian, depth, point }) = hit else {
        return proto::PickReply { revision: state.revision(), cluster: -1, ..proto::PickReply::default() };
    };
    let i = gaussian as usize;
    let base = state.base_units().iter().filter(|b| b.range().contains(&i)).map(|b| b.name.clone());
    let units = state.units().filter(|u| !u.derived && u.mask.get(i)).map(|u| u.name.clone());
    let cluster = labels.and_then(|l| l.get(i)).filter(|l| **l != NO_CLUSTER).and_then(|l| i32::try_from(*l).ok());
    proto::PickReply {
        hit: true,
        gaussian: gaussian.into(),
        depth,
        point: Some(encode_vector(point)),
        units: base.chain(units).collect(),
        cluster: cluster.unwrap_or(-1),
        selected: state.selection().mask().get(i),
        revision: state.revision(),
    }
}
