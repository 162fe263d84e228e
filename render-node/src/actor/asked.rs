//! What a request for a picture says, in the renderer's words.

use glam::DVec3;
use sg_proto::render as proto;
use sg_render_node::render::Projection;
use sg_runtime::fault::Fault;
use sg_scene::appearance::{Clip, HalfSpace};

/// Most clips of a request, and most sides of each.
const MAX_CLIPS: usize = 64;

/// How Gaussians are to be projected.
pub(super) fn projection(request: &proto::CaptureRequest) -> Projection {
    match request.projection() {
        proto::Projection::Unspecified | proto::Projection::Affine => Projection::Affine,
        proto::Projection::PerRay => Projection::PerRay,
    }
}

/// The clips of a request; whether their numbers make sense is the renderer's to say.
pub(super) fn clips(request: &proto::CaptureRequest) -> Result<Vec<Clip>, Fault> {
    if request.clips.len() > MAX_CLIPS || request.clips.iter().any(|clip| clip.sides.len() > MAX_CLIPS) {
        return Err(Fault::invalid(format!("at most {MAX_CLIPS} clips of at most {MAX_CLIPS} sides each")));
    }
    let side = |side: &proto::HalfSpace| match side.normal.as_slice() {
        &[x, y, z] => Ok(HalfSpace { normal: DVec3::new(x, y, z), offset: side.offset }),
        other => Err(Fault::invalid(format!("a clip's normal takes three numbers, not {}", other.len()))),
    };
    let clip = |clip: &proto::Clip| {
        let sides = clip.sides.iter().map(side).collect::<Result<_, _>>()?;
        Ok(Clip { sides, keep_inside: !clip.cut })
    };
    request.clips.iter().map(clip).collect()
}
