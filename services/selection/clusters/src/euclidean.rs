//! Assignment by straight-line distance to mean positions, for ablations of the geodesic distance.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::assignment::{Assignment, Centre, Metric};
use crate::features::Row;
use crate::neighbours::GraphError;
use crate::vertices::distance_squared;

/// The centre of smallest D for each vertex, with straight-line distance. Ties go to the smaller index.
///
/// Centres farther than `window` count only if they are the nearest.
///
/// # Errors
/// [`GraphError::Tree`] if the search tree rejects the centres.
pub fn assign_straight(
    positions: &[[f64; 3]],
    rows: &[Row],
    metric: Metric,
    window: f64,
    centres: &[Centre],
) -> Result<Assignment, GraphError> {
    if centres.is_empty() || positions.is_empty() {
        let label = vec![crate::shortest::NONE; positions.len()];
        return Ok(Assignment { label, cost: vec![f64::INFINITY; positions.len()] });
    }
    let at: Vec<[f64; 3]> = centres.iter().map(|c| c.position).collect();
    let tree: ImmutableKdTree<f64, 3> =
        ImmutableKdTree::new_from_slice(&at).map_err(|e| GraphError::Tree(e.to_string()))?;
    let (label, cost) = positions
        .par_iter()
        .zip(rows)
        .map(|(p, row)| {
            let cost_of = |j: u32| {
                let c = &centres[j as usize];
                metric.cost(distance_squared(p, &c.position).sqrt(), row, &c.feature)
            };
            let nearest = tree.query(p).nearest_one::<SquaredEuclidean<f64>>().execute();
            let mut best = (cost_of(nearest.item), nearest.item);
            // No centre beyond this radius can win. The margin covers the rounding of the tree.
            let radius = metric.radius(best.0).min(window) * (1.0 + 1e-9);
            for found in tree.query(p).within::<SquaredEuclidean<f64>>(radius * radius).unsorted().execute() {
                let candidate = (cost_of(found.item), found.item);
                if candidate < best {
                    best = candidate;
                }
            }
            (best.1, best.0)
        })
        .unzip();
    Ok(Assignment { label, cost })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::WIDTH;
    use sg_scene::synthetic::random_points_f64;

    #[test]
    fn equals_the_full_scan() {
        let positions = random_points_f64(2000, 1);
        let rows: Vec<Row> = (0..2000).map(|i| [((i * 37) % 11) as f32 * 0.1; WIDTH]).collect();
        let centres: Vec<Centre> = (0..90)
            .map(|j| Centre { source: j, position: positions[j as usize / 2 * 17], feature: rows[j as usize] })
            .collect();
        for weight in [0.0, 0.25, 9.0] {
            let metric = Metric { cell: 0.2, feature_weight: weight };
            let got = assign_straight(&positions, &rows, metric, f64::INFINITY, &centres).unwrap();
            for (i, p) in positions.iter().enumerate() {
                let want = (0..)
                    .zip(&centres)
                    .map(|(j, c)| (metric.cost(distance_squared(p, &c.position).sqrt(), &rows[i], &c.feature), j))
                    .min_by(|a, b| a.partial_cmp(b).unwrap());
                assert_eq!(Some((got.cost[i], got.label[i])), want);
            }
        }
    }
}
