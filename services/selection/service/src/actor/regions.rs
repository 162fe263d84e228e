//! Regions of whole Super-Gaussians, for services that look for structures nobody has selected yet.

use std::time::Instant;

use sg_clusters::hierarchy::{ClusterLook, diverse_regions};
use sg_edit::EditState;
use sg_proto::selection;
use sg_runtime::fault::Fault;
use sg_scene::model::Scene;

use super::Selector;
use super::prepared::Clustered;

/// Regions where a request names no number.
const USUAL: u32 = 64;
/// Most regions of one reply.
const MOST: u32 = 256;

impl Selector {
    /// The regions of the newest state. Deleted Gaussians belong to none.
    pub(super) fn regions(&mut self, request: &selection::RegionsRequest) -> Result<selection::RegionsReply, Fault> {
        let start = Instant::now();
        let count = if request.count == 0 { USUAL } else { request.count };
        if count > MOST {
            return Err(Fault::invalid(format!("{count} regions; ask for 1 to {MOST}")));
        }
        let state = self.local_state();
        let (scene, clustered, graph) = self.places.contacts(&state);
        let found = diverse_regions(&graph, &looks(&scene, &clustered, &state), count as usize);
        if let Err(error) = self.labels.update(&state, &clustered.clustering.labels) {
            return Err(Fault::internal(format!("the Super-Gaussians could not be written: {error}")));
        }
        let region = |region: sg_clusters::hierarchy::ClusterRegion| selection::ClusterRegion {
            clusters: region.clusters,
            gaussians: region.gaussians,
            prominence: region.prominence,
        };
        Ok(selection::RegionsReply {
            regions: found.into_iter().map(region).collect(),
            labels_hash: self.labels.hash().to_owned(),
            labels_path: self.labels.path().display().to_string(),
            revision: state.revision(),
            regions_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }
}

/// What the clusters of a state look like in the file, without its deleted Gaussians. Colours count by opacity and area.
fn looks(scene: &Scene, clustered: &Clustered, state: &EditState) -> Vec<ClusterLook> {
    let clustering = &clustered.clustering;
    let mut sums = vec![(0_u64, 0.0_f64, [0.0_f64; 3]); clustering.clusters.len()];
    let gaussians = scene.units.iter().flat_map(|unit| (0..unit.gaussians.len()).map(move |i| (unit, i)));
    for ((g, label), (unit, i)) in clustering.labels.iter().enumerate().zip(gaussians) {
        let sum = usize::try_from(*label).ok().and_then(|label| sums.get_mut(label));
        let Some((count, weight, color)) = sum.filter(|_| !state.deleted().get(g)) else { continue };
        *count += 1;
        let seen = f64::from(unit.gaussians.opacity(i)) * unit.gaussians.mean_area(i);
        let own = unit.unlit_color(i);
        if own.is_finite() && seen.is_finite() {
            *weight += seen;
            for (sum, channel) in color.iter_mut().zip(own.to_array()) {
                *sum += seen * channel.clamp(0.0, 1.0);
            }
        }
    }
    let look = |(cluster, (gaussians, weight, color)): (&sg_clusters::clustering::Cluster, &(u64, f64, [f64; 3]))| {
        let mean = color.map(|sum| if *weight > 0.0 { (sum / weight) as f32 } else { 0.0 });
        ClusterLook { unit: cluster.unit, gaussians: *gaussians, color: sg_color::oklab(mean).map(f64::from) }
    };
    clustering.clusters.iter().zip(&sums).map(look).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use sg_edit::PlacedScene;
    use sg_proto::scene::command::Action;
    use sg_proto::scene::{DeleteGaussians, Target};
    use sg_scene::synthetic::test_scene;

    use super::*;
    use crate::actor::prepared::Places;

    #[test]
    fn deleted_gaussians_have_no_look() {
        let scene = Arc::new(test_scene(&[("bone", 300), ("skin", 400)]));
        let mut places = Places::of_scene(&scene, 40);
        let opened = EditState::of_scene(&scene, "", "");
        let mut counts = |state: &EditState| {
            let (scene, clustered, graph) = places.contacts(state);
            let looks = looks(&scene, &clustered, state);
            assert_eq!(looks.len(), graph.clusters);
            let sum = |unit| looks.iter().filter(|look| look.unit == unit).map(|look| look.gaussians).sum::<u64>();
            (sum(0), sum(1), looks)
        };
        let (bone, skin, before) = counts(&opened);
        assert_eq!((bone, skin), (300, 400));
        let unit = &PlacedScene::new(Arc::clone(&scene)).of(&opened).units[0];
        let palette = sg_color::oklab(unit.palette.to_array()).map(f64::from);
        let near = before
            .iter()
            .filter(|look| look.unit == 0)
            .all(|look| look.color.iter().zip(palette).all(|(a, b)| (a - b).abs() < 0.3));
        assert!(near, "{before:?} {palette:?}");
        let target = Some(Target { units: vec!["bone".to_owned()], ..Target::default() });
        let gone = opened.after(&scene, Action::DeleteGaussians(DeleteGaussians { target })).unwrap();
        let (bone, skin, _) = counts(&gone);
        assert_eq!((bone, skin), (0, 400));
    }
}
