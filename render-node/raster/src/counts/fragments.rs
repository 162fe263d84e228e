//! Fragments of a quadrilateral: the pixels whose centers it covers.

use glam::DVec2;

use crate::project::Ellipse;

/// Half a quadrilateral's size in pixels beyond which a device draws the picture's part of its bounding box: `FAR` of `quads.wgsl`.
const FAR: f64 = 8192.0;

/// Pixels `[from, to)` along one axis whose centers lie between two coordinates.
fn between(low: f64, high: f64, size: u32) -> u64 {
    // Saturating casts: places outside the picture become its edge.
    let from = (low - 0.5).ceil().max(0.0) as u64;
    let to = ((high - 0.5).floor() + 1.0).max(0.0) as u64;
    let size = u64::from(size);
    to.min(size).saturating_sub(from.min(size))
}

/// Pixels in a picture of this size that the parallelogram around a level of an ellipse covers. The picture is `scale` times the one
/// that the ellipse is in.
pub(super) fn fragments(ellipse: &Ellipse, radius: f64, [width, height]: [u32; 2], scale: DVec2) -> u64 {
    let Ellipse { center, slope, along_row, .. } = *ellipse;
    let half = ellipse.half_size(radius);
    let (low, high) = ((center - half) * scale, (center + half) * scale);
    if half.max_element() > FAR {
        return between(low.x, high.x, width) * between(low.y, high.y, height);
    }
    let wide = radius * along_row;
    let first = (low.y - 0.5).ceil().max(0.0) as u64;
    let end = first + between(low.y, high.y, height);
    (first..end)
        .map(|row| {
            let dy = (row as f64 + 0.5) / scale.y - center.y;
            let middle = center.x + slope * dy;
            between((middle - wide) * scale.x, (middle + wide) * scale.x, width)
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parallelogram_covers_its_area_and_no_more_than_the_picture() {
        let sheared = Ellipse { center: DVec2::new(100.0, 80.0), slope: 0.7, along_row: 5.0, over_rows: 4.0 };
        assert_eq!(fragments(&sheared, 3.0, [300, 200], DVec2::ONE), 30 * 24);
        let quarter = fragments(&sheared, 3.0, [75, 50], DVec2::splat(0.25));
        assert!((40..=50).contains(&quarter), "{quarter}");
        let beside = Ellipse { center: DVec2::new(-100.0, 80.0), ..sheared };
        assert_eq!(fragments(&beside, 3.0, [300, 200], DVec2::ONE), 0);
        let everywhere = Ellipse { along_row: 1e12, over_rows: 1e12, ..sheared };
        assert_eq!(fragments(&everywhere, 1.0, [300, 200], DVec2::ONE), 300 * 200);
        let upright = Ellipse { center: DVec2::new(1.0, 100.0), slope: 0.0, along_row: 5.0, over_rows: 400.0 };
        assert_eq!(fragments(&upright, 1.0, [300, 200], DVec2::ONE), 6 * 200);
    }
}
