//! The Super-Gaussians of the scene, as published by the selection process.

use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_formats::npy;
use sg_proto::bus::Code;
use sg_proto::keys;
use sg_raster::structure::labels_of;
use sg_runtime::blobs::{Blobs, StoredFile};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_viewer::display::Clusters;

/// Timeout for an answer of the selection process. It is several times the restart time of that process. It stays below the
/// caller's own deadline, for a stack without a selection process.
const SELECTION_WAIT: Duration = Duration::from_millis(500);

/// Pause before labels of other Gaussians are asked for again: the selection process follows the scene too.
const OTHER_LABELS_PAUSE: Duration = Duration::from_millis(20);

/// The newest known clusters.
#[derive(Default)]
pub(super) struct ClusterLabels {
    hash: String,
    clusters: Option<Arc<Clusters>>,
}

impl ClusterLabels {
    /// The Super-Gaussians, with the members of each. They are read again only if the selection process has different
    /// labels.
    ///
    /// # Errors
    /// `Unavailable` while there is no selection process; labels that cannot be had or do not fit `gaussians` for half a second.
    pub(super) async fn newest(
        &mut self,
        bus: &Bus,
        blobs: &Blobs,
        gaussians: usize,
        context: &Context,
    ) -> Result<Arc<Clusters>, Fault> {
        let begun = Instant::now();
        loop {
            match self.read(bus, blobs, gaussians, context).await {
                Err(fault) if fault.code == Code::Internal && begun.elapsed() < SELECTION_WAIT => {
                    tokio::time::sleep(OTHER_LABELS_PAUSE).await;
                }
                outcome => return outcome,
            }
        }
    }

    async fn read(
        &mut self,
        bus: &Bus,
        blobs: &Blobs,
        gaussians: usize,
        context: &Context,
    ) -> Result<Arc<Clusters>, Fault> {
        let asking = context.next().within(SELECTION_WAIT);
        let (state, sender) = bus.newest_identified(&keys::SELECTION_STATE, &asking).await?;
        let is_known =
            |clusters: &&Arc<Clusters>| self.hash == state.labels_hash && clusters.labels().len() == gaussians;
        if let Some(clusters) = self.clusters.as_ref().filter(is_known) {
            return Ok(Arc::clone(clusters));
        }
        let stored = StoredFile { path: &state.labels_path, hash: &state.labels_hash, sender: sender.as_ref() };
        let path = blobs.fetch(bus, &keys::SELECTION_CONTENT, stored, &context.next()).await?;
        let labels = tokio::task::block_in_place(|| npy::read_labels(&path));
        let labels = labels.map_err(|e| Fault::internal(e.to_string()))?;
        let labels: Arc<[u32]> = labels_of(labels, gaussians).map_err(|e| Fault::internal(e.to_string()))?.into();
        let clusters = Arc::new(tokio::task::block_in_place(|| Clusters::new(labels)));
        (self.hash, self.clusters) = (state.labels_hash, Some(Arc::clone(&clusters)));
        Ok(clusters)
    }
}
