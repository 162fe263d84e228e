//! Occlusion of voxels: the least optical depth over fourteen straight directions out of the volume.

use glam::UVec3;
use rayon::prelude::*;

/// Least optical depth in front of each voxel of a box, over the six face and the eight corner directions. `extinction` is
/// per length, x fastest, for `dims` voxels. `step` gives the length of one step along a voxel direction. A voxel does
/// not hide itself: the near side of an opaque voxel is visible.
pub(crate) fn least_optical_depth(extinction: &[f32], dims: UVec3, step: impl Fn([i32; 3]) -> f32 + Sync) -> Vec<f32> {
    let (nx, ny, nz) = (dims.x as usize, dims.y as usize, dims.z as usize);
    let plane = nx * ny;
    let mut least = vec![f32::INFINITY; extinction.len()];
    // Within a slice: along ±x and ±y. Slices are independent.
    let (step_x, step_y) = (step([1, 0, 0]), step([0, 1, 0]));
    least.par_chunks_mut(plane).zip(extinction.par_chunks(plane)).for_each(|(least, sigma)| {
        for (least, sigma) in least.chunks_mut(nx).zip(sigma.chunks(nx)) {
            along_line(least, sigma, step_x, 0..nx);
            along_line(least, sigma, step_x, (0..nx).rev());
        }
        along_rows(least, sigma, nx, step_y, 0..ny);
        along_rows(least, sigma, nx, step_y, (0..ny).rev());
    });
    // Across slices: ±z and the corners, five directions for each sign of z.
    for dz in [1, -1] {
        let directions = [[0, 0, dz], [1, 1, dz], [-1, 1, dz], [1, -1, dz], [-1, -1, dz]];
        let steps = directions.map(&step);
        let mut before: Vec<Vec<f32>> = vec![vec![0.0; plane]; directions.len()];
        let mut here = before.clone();
        let order: Vec<usize> = if dz > 0 { (0..nz).collect() } else { (0..nz).rev().collect() };
        let mut previous: Option<&[f32]> = None;
        for z in order {
            let sigma = &extinction[z * plane..(z + 1) * plane];
            let least = &mut least[z * plane..(z + 1) * plane];
            for (k, direction) in directions.iter().enumerate() {
                let (source, step) = (&before[k], steps[k]);
                let shift = [direction[0], direction[1]];
                here[k].par_chunks_mut(nx).zip(least.par_chunks_mut(nx)).enumerate().with_min_len(32).for_each(
                    |(y, (out, least))| {
                        let from = y as i32 - shift[1];
                        let upstream = previous
                            .filter(|_| (0..ny as i32).contains(&from))
                            .map(|s| (&s[from as usize * nx..][..nx], &source[from as usize * nx..][..nx]));
                        across_row(out, least, upstream, shift[0], step);
                    },
                );
            }
            std::mem::swap(&mut before, &mut here);
            previous = Some(sigma);
        }
    }
    least
}

/// One row of a sweep across slices. The depth at a voxel is the depth at its upstream neighbour plus that neighbour.
fn across_row(out: &mut [f32], least: &mut [f32], upstream: Option<(&[f32], &[f32])>, shift: i32, step: f32) {
    for (x, (out, least)) in out.iter_mut().zip(least).enumerate() {
        let from = x as i32 - shift;
        let depth = match upstream {
            Some((sigma, depth)) if from >= 0 && (from as usize) < sigma.len() => {
                depth[from as usize] + step * sigma[from as usize]
            }
            _ => 0.0,
        };
        *out = depth;
        *least = least.min(depth);
    }
}

fn along_line(least: &mut [f32], sigma: &[f32], step: f32, order: impl Iterator<Item = usize>) {
    let mut depth = 0.0;
    for x in order {
        least[x] = least[x].min(depth);
        depth += step * sigma[x];
    }
}

fn along_rows(least: &mut [f32], sigma: &[f32], nx: usize, step: f32, order: impl Iterator<Item = usize>) {
    let mut depth = vec![0.0_f32; nx];
    for y in order {
        let (least, sigma) = (&mut least[y * nx..(y + 1) * nx], &sigma[y * nx..(y + 1) * nx]);
        for ((d, l), &s) in depth.iter_mut().zip(least).zip(sigma) {
            *l = l.min(*d);
            *d += step * s;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn length(d: [i32; 3]) -> f32 {
        let spacing = [1.0, 2.0, 0.5];
        (0..3).map(|k| (d[k] as f32 * spacing[k]).powi(2)).sum::<f32>().sqrt()
    }

    /// The reference: walks each of the fourteen rays to the border.
    fn by_walking(extinction: &[f32], dims: UVec3) -> Vec<f32> {
        let n = dims.as_ivec3().to_array();
        let at = |p: [i32; 3]| {
            (0..3).all(|k| (0..n[k]).contains(&p[k])).then(|| extinction[(p[0] + n[0] * (p[1] + n[1] * p[2])) as usize])
        };
        let mut directions = vec![[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
        for c in 0..8 {
            directions.push([1 - 2 * (c & 1), 1 - (c & 2), 1 - (c >> 1 & 2)]);
        }
        (0..extinction.len() as i32)
            .map(|i| {
                let start = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
                directions
                    .iter()
                    .map(|&d| {
                        let step = length(d);
                        let (mut p, mut depth) = (start, 0.0_f32);
                        loop {
                            p = [p[0] - d[0], p[1] - d[1], p[2] - d[2]];
                            match at(p) {
                                None => return depth,
                                Some(next) => depth += step * next,
                            }
                        }
                    })
                    .fold(f32::INFINITY, f32::min)
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn sweeps_equal_walks(
            dims in prop::array::uniform3(1..7_u32),
            values in prop::collection::vec(prop_oneof![Just(0.0_f32), 0.0..2.0_f32], 216),
        ) {
            let dims = UVec3::from_array(dims);
            let extinction = &values[..dims.element_product() as usize];
            let (fast, slow) = (least_optical_depth(extinction, dims, length), by_walking(extinction, dims));
            for (f, s) in fast.iter().zip(&slow) {
                prop_assert!((f - s).abs() < 1e-4, "{f} {s}");
            }
        }
    }
}
