//! The identity of a scene's geometry. Caches and projects refer to the geometry by it.

use glam::Vec3;

use crate::model::{ExtraValues, Gaussians, Scene};

// The columns' bytes are hashed as they lie in memory.
const _: () = assert!(cfg!(target_endian = "little"), "content hashes are those of little-endian columns");

impl Scene {
    /// BLAKE3 over the columns, bit for bit, and over how units divide and place them.
    ///
    /// It leaves out edited values and names: paths, palettes, opacity factors, shading models, the box.
    #[must_use]
    pub fn content_hash(&self) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new_derive_key("supergaussian scene content 1");
        put_length(&mut hasher, self.units.len());
        for unit in &self.units {
            hasher.update(bytemuck::cast_slice(&unit.transform.to_cols_array()));
            hasher.update(&[u8::from(unit.oriented_normals)]);
            put_gaussians(&mut hasher, &unit.gaussians);
        }
        hasher.finalize()
    }
}

fn put_gaussians(hasher: &mut blake3::Hasher, g: &Gaussians) {
    let vec3 = |hasher: &mut blake3::Hasher, v: &[Vec3]| put(hasher, bytemuck::cast_slice(v));
    put_length(hasher, g.len());
    vec3(hasher, &g.position);
    put(hasher, bytemuck::cast_slice(&g.rotation));
    vec3(hasher, &g.log_scale);
    put(hasher, bytemuck::cast_slice(&g.opacity_logit));
    hasher.update(&[u8::from(g.shading.is_some()), u8::from(g.harmonics.is_some())]);
    if let Some(s) = &g.shading {
        vec3(hasher, &s.offset_color);
        vec3(hasher, &s.normal);
        for column in [&s.ambient, &s.diffuse, &s.specular, &s.shininess] {
            put(hasher, bytemuck::cast_slice(column));
        }
    }
    if let Some(h) = &g.harmonics {
        hasher.update(&[h.degree]);
        put(hasher, bytemuck::cast_slice(&h.dc));
        put(hasher, bytemuck::cast_slice(&h.rest));
    }
    put_length(hasher, g.extra.len());
    for column in &g.extra {
        put(hasher, column.name.as_bytes());
        let (kind, bytes): (u8, &[u8]) = match &column.values {
            ExtraValues::I8(v) => (0, bytemuck::cast_slice(v)),
            ExtraValues::U8(v) => (1, v),
            ExtraValues::I16(v) => (2, bytemuck::cast_slice(v)),
            ExtraValues::U16(v) => (3, bytemuck::cast_slice(v)),
            ExtraValues::I32(v) => (4, bytemuck::cast_slice(v)),
            ExtraValues::U32(v) => (5, bytemuck::cast_slice(v)),
            ExtraValues::F32(v) => (6, bytemuck::cast_slice(v)),
            ExtraValues::F64(v) => (7, bytemuck::cast_slice(v)),
        };
        hasher.update(&[kind]);
        put(hasher, bytes);
    }
}

/// Bytes behind their number, so that no two different scenes are the same stream.
fn put(hasher: &mut blake3::Hasher, bytes: &[u8]) {
    put_length(hasher, bytes.len());
    hasher.update(bytes);
}

fn put_length(hasher: &mut blake3::Hasher, n: usize) {
    hasher.update(&(n as u64).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use crate::model::Scene;
    use crate::synthetic::samples;

    #[test]
    fn the_hash_follows_every_bit_of_the_columns_and_nothing_else() {
        let scene = samples::editable(100, 3);
        let hash = scene.content_hash();
        assert_eq!(hash, samples::editable(100, 3).content_hash());
        let changed = |change: &dyn Fn(&mut Scene)| {
            let mut scene = scene.clone();
            change(&mut scene);
            scene.content_hash() != hash
        };
        assert!(changed(&|s| s.units[0].gaussians.opacity_logit[99] =
            f32::from_bits(s.units[0].gaussians.opacity_logit[99].to_bits() ^ 1)));
        assert!(changed(&|s| s.units[0].transform.w_axis.x += 1.0));
        assert!(changed(&|s| s.units[0].gaussians.extra[0].name.push('x')));
        assert!(!changed(&|s| s.units[0].palette.x = 0.125));
        assert!(!changed(&|s| s.units[0].name.push('x')));
        assert!(!changed(&|s| s.bounds.max.x += 1.0));
    }

    #[test]
    fn the_hash_depends_on_the_division_into_units() {
        let two = samples::two_units(10);
        let mut joined = two.clone();
        let second = joined.units.remove(1);
        let moved = second.gaussians.position[0];
        joined.units[0].gaussians.position.push(moved);
        assert_ne!(two.content_hash(), joined.content_hash());
    }
}
