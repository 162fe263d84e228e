//! Tiles that the headset's visibility mask hides whole. They get no list.

use glam::{DVec2, Vec2};

/// Pixels by which the mask's edge is taken to reach less far, so that rounding hides no visible pixel.
const MARGIN: f64 = 0.02;

/// Gap between two triangles up to which they are neighbours, pixels.
const SEAM: f64 = 1e-3;

/// For each row of tiles of both eyes, the number of tiles outside the mask before each column, and in all. The mask is
/// triangles of each eye, in shares of the picture. Tiles have `edge` pixels each way, pictures `size`.
pub(super) fn shown_before(mask: &[Vec<[Vec2; 3]>; 2], size: [u32; 2], edge: u32) -> Vec<u32> {
    let mut table = Vec::new();
    for triangles in mask {
        for row in hidden(triangles, size, edge) {
            let mut shown = 0;
            table.push(shown);
            for hidden in row {
                shown += u32::from(!hidden);
                table.push(shown);
            }
        }
    }
    table
}

/// Whether the triangles cover all middles of a tile's pixels, for each row of tiles.
fn hidden(triangles: &[[Vec2; 3]], [width, height]: [u32; 2], edge: u32) -> Vec<Vec<bool>> {
    let [across, down] = [width, height].map(|pixels| pixels.div_ceil(edge) as usize);
    // Rows of pixels of each tile that are covered from side to side.
    let mut covered = vec![vec![0; across]; down];
    // Above and below the middle of each row of pixels, what the triangles cover.
    let mut lines = vec![Vec::new(); 2 * height as usize];
    let size = DVec2::new(width.into(), height.into());
    for triangle in triangles {
        let corners = triangle.map(|corner| corner.as_dvec2() * size);
        let (top, bottom) = corners.iter().fold((f64::INFINITY, 0.0_f64), |(t, b), c| (t.min(c.y), b.max(c.y)));
        let first = (top - 1.0).clamp(0.0, height.into()) as u32;
        let last = (bottom + 1.0).clamp(0.0, height.into()) as u32;
        for y in first..last {
            for (k, offset) in [-MARGIN, MARGIN].into_iter().enumerate() {
                if let Some(part) = crossing(corners, f64::from(y) + 0.5 + offset)
                    && let Some(line) = lines.get_mut(2 * y as usize + k)
                {
                    line.push(part);
                }
            }
        }
    }
    for (y, pair) in lines.chunks_exact_mut(2).enumerate() {
        let [above, below] = pair else { continue };
        let [above, below] = [above, below].map(|line| joined(line));
        let Some(counts) = covered.get_mut(y / edge as usize) else { continue };
        for (column, count) in counts.iter_mut().enumerate() {
            let left = column as u32 * edge;
            let right = (left + edge).min(width);
            let ends = [f64::from(left) + 0.5 - MARGIN, f64::from(right) - 0.5 + MARGIN];
            let within = |parts: &[[f64; 2]]| parts.iter().any(|[from, to]| *from <= ends[0] && ends[1] <= *to);
            *count += u32::from(within(&above) && within(&below));
        }
    }
    let whole = |(row, counts): (usize, Vec<u32>)| {
        let rows = edge.min(height - row as u32 * edge);
        counts.into_iter().map(|count| count == rows).collect()
    };
    covered.into_iter().enumerate().map(whole).collect()
}

/// The part of a row of the picture at height `y` inside a triangle: from and to, pixels.
fn crossing(corners: [DVec2; 3], y: f64) -> Option<[f64; 2]> {
    let [a, b, c] = corners;
    let mut part: Option<[f64; 2]> = None;
    for (from, to) in [(a, b), (b, c), (c, a)] {
        if (from.y <= y) == (to.y <= y) {
            continue;
        }
        let x = from.x + (to.x - from.x) * ((y - from.y) / (to.y - from.y));
        part = Some(part.map_or([x, x], |[low, high]| [low.min(x), high.max(x)]));
    }
    part
}

/// Parts of a row, those that touch joined.
fn joined(parts: &mut [[f64; 2]]) -> Vec<[f64; 2]> {
    parts.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut all: Vec<[f64; 2]> = Vec::new();
    for [from, to] in parts {
        match all.last_mut() {
            Some(last) if *from <= last[1] + SEAM => last[1] = last[1].max(*to),
            _ => all.push([*from, *to]),
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(from: [f32; 2], to: [f32; 2]) -> Vec<[Vec2; 3]> {
        let [a, b, c, d] = [[from[0], from[1]], [to[0], from[1]], [to[0], to[1]], [from[0], to[1]]].map(Vec2::from);
        vec![[a, b, c], [a, c, d]]
    }

    #[test]
    fn a_tile_is_hidden_where_triangles_cover_all_of_its_pixels() {
        // 50 × 40 pixels: four columns and three rows of tiles, the last ones cut.
        let of = |triangles: &[[Vec2; 3]]| hidden(triangles, [50, 40], 16);
        assert!(of(&[]).iter().flatten().all(|hidden| !hidden));
        assert!(of(&square([-0.1, -0.1], [1.1, 1.1])).iter().flatten().all(|hidden| *hidden));
        // To the middle of the picture, across the seam of two triangles.
        let left = of(&square([-0.1, -0.1], [32.0 / 50.0, 1.1]));
        assert!(left.iter().all(|row| *row == [true, true, false, false]), "{left:?}");
        // One pixel less in both ways.
        let less = of(&square([-0.1, -0.1], [31.0 / 50.0, 31.0 / 40.0]));
        assert_eq!(less, [[true, false, false, false], [false; 4], [false; 4]]);
        // Half of a picture by its diagonal hides no tile on the diagonal.
        let half = of(&[[Vec2::new(0.0, 0.0), Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0)]]);
        assert_eq!(half, [[true, false, false, false], [false; 4], [false; 4]]);
    }

    #[test]
    fn the_table_counts_what_is_left() {
        let triangles = [square([-0.1, -0.1], [0.5, 1.1]), Vec::new()];
        assert_eq!(shown_before(&triangles, [64, 16], 16), [0, 0, 0, 1, 2, 0, 1, 2, 3, 4]);
    }
}
