//! Morton (Z-curve) order. It puts near Gaussians near each other in a file.

use glam::{UVec3, Vec3};
use rayon::prelude::*;

use sg_scene::model::{Gaussians, SceneBox};

/// Bits an axis.
const BITS: u32 = 21;

/// The Gaussians along the curve through the box of their finite centres. The sort is stable; Gaussians without a
/// finite centre come last.
pub(crate) fn reorder(g: &Gaussians) -> Gaussians {
    let bounds = SceneBox::of_points(g.position.iter().copied());
    let key = |p: &Vec3| {
        if !p.is_finite() {
            return u64::MAX;
        }
        let cell = (bounds.normalize(p.as_dvec3()) * f64::from((1_u32 << BITS) - 1)).as_uvec3();
        interleave(cell)
    };
    let mut keyed: Vec<(u64, usize)> = g.position.par_iter().enumerate().map(|(i, p)| (key(p), i)).collect();
    keyed.par_sort_unstable();
    let order: Vec<usize> = keyed.into_iter().map(|(_, i)| i).collect();
    g.rows(&order)
}

fn interleave(cell: UVec3) -> u64 {
    fn spread(x: u32) -> u64 {
        let mut x = u64::from(x);
        x = (x | x << 32) & 0x001f_0000_0000_ffff;
        x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    }
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use sg_scene::synthetic::samples;

    proptest! {
        #[test]
        fn bits_interleave(x in 0_u32..1 << 21, y in 0_u32..1 << 21, z in 0_u32..1 << 21) {
            let got = interleave(UVec3::new(x, y, z));
            let want = (0..21).fold(0_u64, |m, k| {
                let bit = |v: u32, at: u32| u64::from(v >> k & 1) << (3 * k + at);
                m | bit(x, 0) | bit(y, 1) | bit(z, 2)
            });
            prop_assert_eq!(got, want);
        }
    }

    #[test]
    fn reordering_moves_whole_gaussians() {
        let mut scene = samples::harmonic(500, 2, 5);
        scene.position[7].x = f32::NAN;
        let moved = reorder(&scene);
        assert!(moved.check_lengths().is_ok());
        assert!(moved.position[499].x.is_nan());
        let row = |g: &Gaussians, i: usize| {
            let h = g.harmonics.as_ref().unwrap();
            (
                g.position[i].to_array().map(f32::to_bits),
                h.dc[i].map(f32::to_bits),
                h.rest[i * 8..][..8].to_vec(),
                g.rotation[i],
            )
        };
        for i in 0..500 {
            let from = (0..500).find(|&k| row(&scene, k) == row(&moved, i));
            assert!(from.is_some(), "row {i} is no row of the original");
        }
        let steps = |g: &Gaussians| {
            (1..499).map(|i| g.position[i].distance(g.position[i - 1]) as f64).filter(|d| d.is_finite()).sum::<f64>()
        };
        assert!(steps(&moved) < 0.5 * steps(&scene));
    }
}
