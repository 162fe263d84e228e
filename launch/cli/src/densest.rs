//! A stroke through the densest point of a point cloud, for scenes without drawn strokes.

/// Counting cells along the longest edge of the box.
const CELLS: usize = 48;
/// Half the length of the stroke, as a fraction of the box's longest edge.
const REACH: f64 = 0.04;

/// A PLY that [`positions`] cannot read.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum PlyError {
    #[error("the header is missing")]
    Header,
    #[error("the format is not binary little endian")]
    Format,
    #[error("property {0} is not a float")]
    Type(String),
    #[error("float property {0} is missing")]
    Property(&'static str),
    #[error("the file holds {found} of {wanted} Gaussians")]
    Count { found: usize, wanted: usize },
}

/// Reads the positions of the first `count` vertices of a binary little-endian PLY with float properties only.
/// `supergaussian scene convert --format 3dgs` writes this form.
///
/// # Errors
/// [`PlyError`] for the first mismatch.
pub(crate) fn positions(ply: &[u8], count: usize) -> Result<Vec<[f64; 3]>, PlyError> {
    const END: &[u8] = b"end_header\n";
    let end = ply.windows(END.len()).position(|w| w == END).ok_or(PlyError::Header)? + END.len();
    let header = String::from_utf8_lossy(ply.get(..end).unwrap_or_default()).into_owned();
    if !header.contains("\nformat binary_little_endian 1.0\n") {
        return Err(PlyError::Format);
    }
    let properties: Vec<_> = header.lines().filter_map(|l| l.strip_prefix("property ")).collect();
    let column = |name: &'static str| {
        properties.iter().position(|p| p.strip_prefix("float ") == Some(name)).ok_or(PlyError::Property(name))
    };
    if let Some(other) = properties.iter().find(|p| !p.starts_with("float ")) {
        return Err(PlyError::Type((*other).to_owned()));
    }
    let columns = [column("x")?, column("y")?, column("z")?];
    let rows: Vec<_> = ply.get(end..).unwrap_or_default().chunks_exact(4 * properties.len()).take(count).collect();
    if rows.len() < count {
        return Err(PlyError::Count { found: rows.len(), wanted: count });
    }
    let number = |row: &[u8], c: usize| {
        let bytes = row.get(4 * c..4 * c + 4).and_then(|b| b.try_into().ok()).unwrap_or([0; 4]);
        f64::from(f32::from_le_bytes(bytes))
    };
    Ok(rows.into_iter().map(|row| columns.map(|c| number(row, c))).collect())
}

/// Points of a stroke through the densest point, normalized to the box. The densest point is the one nearest to the
/// mean of the fullest 3×3×3 block of cells. The stroke follows the axis along which the points of the block spread
/// most. `None` without finite points or without a box.
#[must_use]
pub(crate) fn stroke(points: &[[f64; 3]], min: [f64; 3], max: [f64; 3]) -> Option<Vec<[f64; 3]>> {
    let edge = |c: usize| max[c] - min[c];
    let longest = (0..3).map(edge).fold(0.0, f64::max);
    if !(longest > 0.0 && longest.is_finite()) {
        return None;
    }
    let finite: Vec<[f64; 3]> = points.iter().copied().filter(|p| p.iter().all(|x| x.is_finite())).collect();
    let cell_of = |p: [f64; 3]| -> [usize; 3] {
        // Points outside the box count into its outermost cells.
        std::array::from_fn(|c| (((p[c] - min[c]) / longest * CELLS as f64).max(0.0) as usize).min(CELLS - 1))
    };
    let mut counts = vec![0_u64; CELLS * CELLS * CELLS];
    let index = |[x, y, z]: [usize; 3]| (z * CELLS + y) * CELLS + x;
    for p in &finite {
        if let Some(count) = counts.get_mut(index(cell_of(*p))) {
            *count += 1;
        }
    }
    let near = |a: usize| a.saturating_sub(1)..=(a + 1).min(CELLS - 1);
    let around = |[x, y, z]: [usize; 3]| -> u64 {
        let mut sum = 0;
        for k in near(z) {
            for j in near(y) {
                for i in near(x) {
                    sum += counts.get(index([i, j, k])).copied().unwrap_or(0);
                }
            }
        }
        sum
    };
    // Ties go to the first cell, so that the order of the points does not matter.
    let mut cells: Vec<[usize; 3]> = finite.iter().map(|p| cell_of(*p)).collect();
    cells.sort_unstable_by_key(|c| index(*c));
    cells.dedup();
    let densest = cells.into_iter().max_by_key(|c| (around(*c), std::cmp::Reverse(index(*c))))?;
    let inside: Vec<[f64; 3]> =
        finite.into_iter().filter(|p| cell_of(*p).iter().zip(&densest).all(|(a, b)| a.abs_diff(*b) <= 1)).collect();
    let mean: [f64; 3] = std::array::from_fn(|c| inside.iter().map(|p| p[c]).sum::<f64>() / inside.len() as f64);
    let squared = |a: [f64; 3], b: [f64; 3]| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>();
    let center = inside.iter().copied().min_by(|a, b| squared(*a, mean).total_cmp(&squared(*b, mean)))?;
    let spread = |c: usize| inside.iter().map(|p| (p[c] - mean[c]).powi(2)).sum::<f64>();
    let axis = (0..3).max_by(|a, b| spread(*a).total_cmp(&spread(*b)))?;
    Some(
        [-1.0, 0.0, 1.0]
            .into_iter()
            .map(|side| {
                std::array::from_fn(|c| {
                    let offset = if c == axis { side * REACH * longest } else { 0.0 };
                    let normalized = if edge(c) > 0.0 { (center[c] + offset - min[c]) / edge(c) } else { 0.5 };
                    normalized.clamp(0.0, 1.0)
                })
            })
            .collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ply(properties: &[&str], rows: &[&[f32]]) -> Vec<u8> {
        let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", rows.len()).into_bytes();
        for p in properties {
            bytes.extend(format!("property {p}\n").bytes());
        }
        bytes.extend(b"end_header\n");
        bytes.extend(rows.iter().flat_map(|r| r.iter()).flat_map(|x| x.to_le_bytes()));
        bytes
    }

    #[test]
    fn positions_are_read_by_name() {
        let bytes =
            ply(&["float opacity", "float z", "float x", "float y"], &[&[9.0, 3.0, 1.0, 2.0], &[9.0, 6.0, 4.0, 5.0]]);
        assert_eq!(positions(&bytes, 2).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(positions(&bytes, 1).unwrap(), [[1.0, 2.0, 3.0]]);
        assert_eq!(positions(&bytes, 3).unwrap_err(), PlyError::Count { found: 2, wanted: 3 });
        assert_eq!(positions(&bytes[..bytes.len() - 1], 2).unwrap_err(), PlyError::Count { found: 1, wanted: 2 });
        assert_eq!(positions(&ply(&["float x"], &[]), 0).unwrap_err(), PlyError::Property("y"));
        assert_eq!(positions(&ply(&["uchar x"], &[]), 0).unwrap_err(), PlyError::Type("uchar x".to_owned()));
        assert_eq!(positions(b"solid", 0).unwrap_err(), PlyError::Header);
    }

    #[test]
    fn the_stroke_runs_through_the_densest_place_along_it() {
        let mut points = vec![[f64::NAN, 0.0, 0.0]];
        // Sparse points everywhere, and a rod along z at (3, 7) between 10 and 12.
        for i in 0..1000 {
            let t = f64::from(i);
            points.push([(t * 0.37) % 10.0, (t * 0.61) % 10.0, (t * 0.83) % 20.0]);
        }
        for i in 0..200 {
            points.push([3.0, 7.0, 10.0 + f64::from(i) * 0.01]);
        }
        let stroke = stroke(&points, [0.0; 3], [10.0, 10.0, 20.0]).unwrap();
        let [a, b, c] = stroke.as_slice() else { panic!("{stroke:?}") };
        assert!((b[0] - 0.3).abs() < 0.03 && (b[1] - 0.7).abs() < 0.03 && (0.48..0.62).contains(&b[2]), "{b:?}");
        assert!((c[2] - a[2] - 2.0 * REACH).abs() < 1e-9 && a[0] == b[0] && c[1] == b[1], "{stroke:?}");
        points.reverse();
        assert_eq!(super::stroke(&points, [0.0; 3], [10.0, 10.0, 20.0]).unwrap()[1], *b);
    }

    #[test]
    fn no_points_have_no_densest_place() {
        assert_eq!(stroke(&[], [0.0; 3], [1.0; 3]), None);
        assert_eq!(stroke(&[[0.0; 3]], [0.0; 3], [0.0; 3]), None);
        assert!(stroke(&[[5.0; 3]], [0.0; 3], [1.0; 3]).unwrap().iter().flatten().all(|x| (0.0..=1.0).contains(x)));
    }
}
