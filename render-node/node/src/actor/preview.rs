//! The pending selection, shown before it is durable.

use sg_proto::keys::{self, role};
use sg_proto::selection::Preview;
use sg_runtime::bus::{Bus, BusError};
use sg_scene::mask::Mask;
use tokio::sync::watch;

/// Most waiting previews; only the newest is drawn.
const WAITING: usize = 4;

/// The newest preview, while the bus exists.
pub(super) async fn follow(bus: &Bus) -> Result<watch::Receiver<Option<Preview>>, BusError> {
    let mut told = bus.subscribe(&keys::SELECTION_PREVIEW, role::SELECTION, WAITING).await?;
    let (newest, previews) = watch::channel(None);
    tokio::spawn(async move {
        while let Some((preview, _)) = told.next().await {
            newest.send_replace(Some(preview));
        }
    });
    Ok(previews)
}

/// A mask with the Gaussians of `runs` turned over: how many are passed over, how many differ, and so on.
pub(super) fn changed(mask: &Mask, runs: &[u32]) -> Mask {
    let mut mask = mask.clone();
    let mut at = 0_usize;
    for run in runs.chunks(2) {
        if let &[passed, differ] = run {
            let first = at.saturating_add(passed as usize).min(mask.len());
            at = first.saturating_add(differ as usize).min(mask.len());
            for i in first..at {
                mask.set(i, !mask.get(i));
            }
        }
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_turn_over_what_differs() {
        let mask = Mask::from_fn(20, |i| i < 5);
        let got = changed(&mask, &[3, 4, 9, 2]);
        assert_eq!(got.ones().collect::<Vec<_>>(), [0, 1, 2, 5, 6, 16, 17]);
        assert_eq!(changed(&mask, &[]), mask);
        // Runs past the end or without length are ignored.
        assert_eq!(changed(&mask, &[18, 40, 3]).ones().count(), 7);
        assert_eq!(changed(&mask, &[u32::MAX, u32::MAX]), mask);
    }
}
