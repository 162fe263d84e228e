//! Places of Gaussians as messages.

use std::sync::Arc;

use glam::DQuat;
use sg_proto::scene as proto;
use sg_scene::similarity::Similarity;

use super::{WireError, decode_any_mask, decode_vector, encode_mask, encode_vector};
use crate::placement::Placement;

pub(super) fn encode_placements(parts: &[Placement]) -> proto::Placements {
    let part = |part: &Placement| {
        let Similarity { rotation, scale, translation } = part.map;
        let rotation = vec![rotation.w, rotation.x, rotation.y, rotation.z];
        let map = proto::Similarity { rotation, scale, translation: Some(encode_vector(translation)) };
        proto::Placement { map: Some(map), mask: Some(encode_mask(&part.members)) }
    };
    proto::Placements { parts: parts.iter().map(part).collect() }
}

pub(super) fn decode_placements(message: &proto::Placements) -> Result<Arc<[Placement]>, WireError> {
    const MASK: &str = "placements.mask";
    let part = |part: &proto::Placement| {
        let map = decode_similarity(part.map.as_ref().ok_or(WireError::Missing("placements.map"))?)?;
        let mask = part.mask.as_ref().ok_or(WireError::Missing(MASK))?;
        Ok(Placement { map, members: Arc::new(decode_any_mask(mask, MASK)?) })
    };
    message.parts.iter().map(part).collect()
}

fn decode_similarity(map: &proto::Similarity) -> Result<Similarity, WireError> {
    const FIELD: &str = "placements.map";
    let translation = decode_vector(map.translation.as_ref().ok_or(WireError::Missing(FIELD))?);
    let &[w, x, y, z] = map.rotation.as_slice() else { return Err(WireError::Similarity(FIELD)) };
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let is_sound = (rotation.length_squared() - 1.0).abs() < 1e-6
        && map.scale > 0.0
        && map.scale.is_finite()
        && translation.is_finite();
    if is_sound {
        Ok(Similarity { rotation, scale: map.scale, translation })
    } else {
        Err(WireError::Similarity(FIELD))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use sg_scene::mask::Mask;

    use super::*;

    #[test]
    fn places_come_back_and_a_map_that_is_none_is_refused() {
        let map = Similarity::about(DVec3::ONE, DQuat::from_rotation_x(0.3), 2.0, DVec3::new(1.0, -2.0, 3.0));
        let parts = [Placement { map, members: Arc::new(Mask::from_fn(20, |i| i < 5)) }];
        let message = encode_placements(&parts);
        assert_eq!(decode_placements(&message).as_deref(), Ok(parts.as_slice()));
        let spoiled = |spoil: &dyn Fn(&mut proto::Similarity)| {
            let mut message = message.clone();
            spoil(message.parts[0].map.as_mut().unwrap());
            decode_placements(&message)
        };
        let wrong = Err(WireError::Similarity("placements.map"));
        assert_eq!(spoiled(&|m| m.scale = 0.0), wrong);
        assert_eq!(spoiled(&|m| m.scale = f64::NAN), wrong);
        assert_eq!(spoiled(&|m| m.rotation[1] += 0.1), wrong);
        assert_eq!(spoiled(&|m| m.rotation.truncate(3)), wrong);
        assert_eq!(spoiled(&|m| m.translation.as_mut().unwrap().x = f64::INFINITY), wrong);
        assert_eq!(spoiled(&|m| m.translation = None), Err(WireError::Missing("placements.map")));
    }
}
