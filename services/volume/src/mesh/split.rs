//! Splitting of VTK's cells into tetrahedra.
//!
//! Each cell becomes a fan around its point of least index, and each of its faces a fan around the face's point of least index. The
//! method is that of Dompierre et al. 1999, "How to subdivide pyramids, prisms and hexahedra into tetrahedra". Two cells with a common face
//! therefore split it in the same way, so that the tetrahedra fit without gaps.

/// What a cell is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CellShape {
    /// It has a volume, and is split.
    Solid,
    /// A point, a line or a surface.
    Flat,
    /// A shape that cannot be split here, or with too few points.
    Unknown,
}

/// Faces of the cell with the type number of VTK, by places in its list of points. Cells of higher order have the faces of
/// their corners.
fn faces(kind: u8) -> Option<&'static [&'static [usize]]> {
    Some(match kind {
        // Tetrahedra.
        10 => &[&[0, 1, 2], &[0, 1, 3], &[1, 2, 3], &[0, 2, 3]],
        // Voxels count x first, also in each face.
        11 => &[&[0, 1, 3, 2], &[4, 5, 7, 6], &[0, 1, 5, 4], &[2, 3, 7, 6], &[0, 2, 6, 4], &[1, 3, 7, 5]],
        // Hexahedra.
        12 | 25 | 29 | 33 => {
            &[&[0, 1, 2, 3], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]]
        }
        // Wedges.
        13 | 26 | 31 | 32 => &[&[0, 1, 2], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]],
        // Pyramids.
        14 | 27 | 37 => &[&[0, 1, 2, 3], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]],
        // Prisms of five and six sides.
        15 => &[
            &[0, 1, 2, 3, 4],
            &[5, 6, 7, 8, 9],
            &[0, 1, 6, 5],
            &[1, 2, 7, 6],
            &[2, 3, 8, 7],
            &[3, 4, 9, 8],
            &[4, 0, 5, 9],
        ],
        16 => &[
            &[0, 1, 2, 3, 4, 5],
            &[6, 7, 8, 9, 10, 11],
            &[0, 1, 7, 6],
            &[1, 2, 8, 7],
            &[2, 3, 9, 8],
            &[3, 4, 10, 9],
            &[4, 5, 11, 10],
            &[5, 0, 6, 11],
        ],
        _ => return None,
    })
}

/// The eight tetrahedra of a quadratic one: corners 0 to 3, then the middles of the edges 01, 12, 02, 03, 13 and 23. Four are at
/// the corners. The octahedron between them has four around its diagonal.
const QUADRATIC: [[usize; 4]; 8] =
    [[0, 4, 6, 7], [1, 4, 5, 8], [2, 5, 6, 9], [3, 7, 8, 9], [4, 9, 5, 8], [4, 9, 8, 7], [4, 9, 7, 6], [4, 9, 6, 5]];

/// Adds the tetrahedra of a cell with the type number `kind` of VTK and these points.
pub(crate) fn split_cell(kind: u8, points: &[u32], out: &mut Vec<[u32; 4]>) -> CellShape {
    if kind == 24 {
        let Some(nodes) = points.first_chunk::<10>() else { return CellShape::Unknown };
        out.extend(QUADRATIC.map(|cell| cell.map(|k| nodes[k])));
        return CellShape::Solid;
    }
    let Some(faces) = faces(kind) else {
        // Up to quadrilaterals, and the curves and surfaces of higher order.
        let is_flat = matches!(kind, 0..=9 | 21 | 22 | 23 | 28 | 30 | 34 | 35 | 36 | 68 | 69 | 70 | 75 | 76 | 77);
        return if is_flat { CellShape::Flat } else { CellShape::Unknown };
    };
    let corners = 1 + faces.iter().flat_map(|face| face.iter()).copied().max().unwrap_or(0);
    let Some(points) = points.get(..corners) else { return CellShape::Unknown };
    let Some(&apex) = points.iter().min() else { return CellShape::Unknown };
    for face in faces {
        let ring = || face.iter().filter_map(|&k| points.get(k).copied());
        // Faces with the apex would give tetrahedra without volume. A hexahedron may name a point twice.
        if ring().any(|point| point == apex) {
            continue;
        }
        let Some((first, &k)) = face.iter().enumerate().min_by_key(|(_, k)| points.get(**k)) else { continue };
        let around: Vec<u32> = ring().cycle().skip(first + 1).take(face.len() - 1).collect();
        for pair in around.windows(2) {
            if let (&[a, b], Some(&root)) = (pair, points.get(k)) {
                out.push([apex, root, a, b]);
            }
        }
    }
    CellShape::Solid
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    /// The corners of each shape, and its volume.
    fn shapes() -> Vec<(u8, Vec<[f64; 3]>, f64)> {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let prism = |base: &[[f64; 2]]| -> Vec<[f64; 3]> {
            let at = |z: f64| base.iter().map(move |[x, y]| [*x, *y, z]);
            at(0.0).chain(at(1.0)).collect()
        };
        let polygon = |n: usize| -> Vec<[f64; 2]> {
            (0..n).map(|k| std::f64::consts::TAU * k as f64 / n as f64).map(|a| [a.cos(), a.sin()]).collect()
        };
        let area = |n: f64| 0.5 * n * (std::f64::consts::TAU / n).sin();
        let mut voxel = prism(&square);
        voxel.swap(2, 3);
        voxel.swap(6, 7);
        let mut pyramid = prism(&square)[..4].to_vec();
        pyramid.push([0.5, 0.5, 1.0]);
        let tetrahedron = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut quadratic = tetrahedron.clone();
        for (i, j) in [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)] {
            let (a, b): ([f64; 3], [f64; 3]) = (tetrahedron[i], tetrahedron[j]);
            quadratic.push([0, 1, 2].map(|k| 0.5 * (a[k] + b[k])));
        }
        vec![
            (10, tetrahedron, 1.0 / 6.0),
            (11, voxel, 1.0),
            (12, prism(&square), 1.0),
            (13, prism(&square[..3]), 0.5),
            (14, pyramid, 1.0 / 3.0),
            (15, prism(&polygon(5)), area(5.0)),
            (16, prism(&polygon(6)), area(6.0)),
            (24, quadratic, 1.0 / 6.0),
        ]
    }

    fn volume(cell: [DVec3; 4]) -> f64 {
        ((cell[1] - cell[0]).cross(cell[2] - cell[0]).dot(cell[3] - cell[0]) / 6.0).abs()
    }

    proptest! {
        #[test]
        fn tetrahedra_fill_a_cell_whatever_its_points_are_called(order in Just((0..12_u32).collect::<Vec<_>>()).prop_shuffle()) {
            for (kind, corners, expected) in shapes() {
                let names: Vec<u32> = order.iter().copied().filter(|i| (*i as usize) < corners.len()).collect();
                let place = |name: u32| {
                    DVec3::from_array(corners[names.iter().position(|n| *n == name).unwrap()])
                };
                let mut cells = Vec::new();
                prop_assert_eq!(split_cell(kind, &names, &mut cells), CellShape::Solid);
                let sum: f64 = cells.iter().map(|cell| volume(cell.map(place))).sum();
                prop_assert!((sum - expected).abs() < 1e-9, "{kind}: {sum} for {expected}");
                // Each face between two tetrahedra is shared by two, and all others are on the outside.
                let mut faces: Vec<[u32; 3]> = cells
                    .iter()
                    .flat_map(|c| [[c[0], c[1], c[2]], [c[0], c[1], c[3]], [c[0], c[2], c[3]], [c[1], c[2], c[3]]])
                    .collect();
                faces.iter_mut().for_each(|face| face.sort_unstable());
                faces.sort_unstable();
                prop_assert!(faces.chunk_by(|a, b| a == b).all(|same| same.len() <= 2));
            }
        }

        #[test]
        fn two_cells_split_their_common_face_alike(order in Just((0..12_u32).collect::<Vec<_>>()).prop_shuffle()) {
            // Two hexahedra side by side: points 4 to 7 are common.
            let of = |ring: std::ops::Range<usize>| ring.map(|k| order[k]).collect::<Vec<u32>>();
            let common = of(4..8);
            let triangles = |range: std::ops::Range<usize>| {
                let mut cells = Vec::new();
                split_cell(12, &of(range), &mut cells);
                let mut found: Vec<Vec<u32>> = cells
                    .iter()
                    .filter_map(|c| {
                        let mut on: Vec<u32> = c.iter().copied().filter(|p| common.contains(p)).collect();
                        on.sort_unstable();
                        (on.len() == 3).then_some(on)
                    })
                    .collect();
                found.sort();
                found
            };
            prop_assert_eq!(triangles(0..8), triangles(4..12));
        }
    }

    #[test]
    fn a_hexahedron_with_a_double_edge_is_a_wedge() {
        let mut cells = Vec::new();
        assert_eq!(split_cell(12, &[0, 1, 2, 2, 3, 4, 5, 5], &mut cells), CellShape::Solid);
        let solid = cells.iter().filter(|c| (1..4).all(|k| !c[..k].contains(&c[k]))).count();
        assert_eq!(solid, 3);
    }

    #[test]
    fn surfaces_and_unknown_cells_are_told_apart() {
        let mut cells = Vec::new();
        assert_eq!(split_cell(5, &[0, 1, 2], &mut cells), CellShape::Flat);
        assert_eq!(split_cell(42, &[0, 1, 2, 3], &mut cells), CellShape::Unknown);
        assert_eq!(split_cell(12, &[0, 1, 2], &mut cells), CellShape::Unknown);
        assert_eq!(split_cell(24, &[0, 1, 2, 3], &mut cells), CellShape::Unknown);
        assert!(cells.is_empty());
    }
}
