//! The summary of a demo, in five lines.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::json;
use sg_proto::keys;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;

use crate::input::Scene;
use crate::playback::{Measurements, Player};
use crate::supervisor_client::services;
use crate::terminal::{self, Failure, format_count, format_time};

/// Longest time for a service's state.
const ANSWER: Duration = Duration::from_secs(30);

/// The numbers of a demo.
#[derive(Debug, Clone)]
pub(super) struct Summary {
    scene: PathBuf,
    transcript: PathBuf,
    pictures: Vec<PathBuf>,
    gaussians: u64,
    base_units: usize,
    units: Vec<String>,
    selected: u64,
    revision: u64,
    clusters: u32,
    clustering_ms: f64,
    fit_seconds: Option<f64>,
    start_seconds: f64,
    replies: usize,
    restarts: u32,
    size: Option<u32>,
    measured: Measurements,
    /// Utterances that the agents could not carry out.
    pub(super) failed_utterances: Vec<String>,
}

impl Summary {
    /// Requests the states of the services.
    pub(super) async fn gather(
        bus: &Bus,
        player: Player,
        transcript: PathBuf,
        scene: &Scene,
        start_seconds: f64,
    ) -> Result<Self, Failure> {
        let soon = || Context::root().deadline_in(ANSWER);
        let state = bus.newest(&keys::SCENE_STATE, &soon()).await?;
        let selection = bus.newest(&keys::SELECTION_STATE, &soon()).await?;
        let restarts = services(bus).await?.services.iter().map(|s| s.restarts).sum();
        Ok(Self {
            scene: scene.path.clone(),
            transcript,
            pictures: player.pictures.clone(),
            gaussians: state.count,
            base_units: state.base_units.len(),
            units: state.units.iter().filter(|u| !u.derived).map(|u| u.name.clone()).collect(),
            selected: state.selection.map_or(0, |s| s.count),
            revision: state.revision,
            clusters: selection.clusters,
            clustering_ms: selection.clustering_ms,
            fit_seconds: scene.fit_seconds,
            start_seconds,
            replies: player.replies,
            restarts,
            size: (!player.pictures.is_empty()).then(|| player.size()),
            measured: player.measured.clone(),
            failed_utterances: player.failed_utterances,
        })
    }

    /// Prints the summary: JSON, or the pictures' paths and five lines.
    pub(super) fn tell(&self, json: bool) {
        if json {
            terminal::print_line(&self.json().to_string());
            return;
        }
        for picture in &self.pictures {
            terminal::print_line(&picture.display().to_string());
        }
        for line in self.lines() {
            terminal::print_line(&line);
        }
    }

    fn json(&self) -> serde_json::Value {
        json!({
            "scene": self.scene, "transcript": self.transcript, "pictures": self.pictures,
            "gaussians": self.gaussians, "base_units": self.base_units, "units": self.units,
            "selected": self.selected, "revision": self.revision, "clusters": self.clusters,
            "clustering_seconds": self.clustering_ms / 1000.0, "fit_seconds": self.fit_seconds,
            "start_seconds": self.start_seconds, "picture_pixels": self.size,
            "walk_seconds": seconds(&self.measured.walk), "frame_seconds": seconds(&self.measured.frame),
            "stroke_to_picture_seconds": seconds(&self.measured.stroke_to_picture),
            "reply_seconds": seconds(&self.measured.reply),
            "replies": self.replies, "replies_done": self.replies - self.failed_utterances.len(), "restarts": self.restarts,
        })
    }

    fn lines(&self) -> [String; 5] {
        let plural = if self.base_units == 1 { "" } else { "s" };
        let fitted = self.fit_seconds.map_or(String::new(), |s| format!(", made in {}", format_time(s * 1000.0)));
        let units = if self.units.is_empty() { "none saved".to_owned() } else { self.units.join(", ") };
        let size = self.size.map_or(String::new(), |s| format!("{s}×{s} "));
        let median = |list: &[f64]| median(list).map_or_else(|| "-".to_owned(), format_time);
        let m = &self.measured;
        [
            format!("Gaussians   {} in {} base unit{plural}{fitted}", format_count(self.gaussians), self.base_units),
            format!("clusters    {}, made in {}", format_count(self.clusters.into()), format_time(self.clustering_ms)),
            format!("selected    {} Gaussians; units: {units}", format_count(self.selected)),
            format!(
                "latencies   start-up {}, walk {}, stroke to picture {}, {size}frame {}, reply {} (medians)",
                format_time(self.start_seconds * 1000.0),
                median(&m.walk),
                median(&m.stroke_to_picture),
                median(&m.frame),
                median(&m.reply)
            ),
            format!(
                "replies     {} of {} done; {} restarts; transcript: {}",
                self.replies - self.failed_utterances.len(),
                self.replies,
                self.restarts,
                self.transcript.display()
            ),
        ]
    }
}

fn seconds(ms: &[f64]) -> Vec<f64> {
    ms.iter().map(|ms| ms / 1000.0).collect()
}

/// The median; the lower one of two middle values.
fn median(list: &[f64]) -> Option<f64> {
    let mut sorted = list.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len().checked_sub(1)? / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_median_is_a_value_of_the_list() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), Some(2.0));
    }
}
