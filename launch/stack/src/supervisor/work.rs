//! Work of a service, from its health message.

use std::time::Duration;

use sg_proto::bus::Health;

use crate::reconcile::Work;

/// Work and waits below this are not worth a line, milliseconds.
const NOTABLE_MS: u64 = 1000;

/// The present work of a service.
pub(super) fn work_of(health: &Health) -> Work {
    let of_actors = health.actors.iter().filter(|a| a.busy_ms > 0);
    let of_actors = of_actors.map(|a| (a.busy_ms, format!("actor `{}`, busy with {},", a.name, a.busy_with)));
    let of_rows =
        health.rows.iter().filter(|r| r.busy_ms > 0).map(|r| (r.busy_ms, format!("the handler of {}", r.name)));
    let (stalled_ms, stalled_in) = of_actors.chain(of_rows).max_by_key(|(ms, _)| *ms).unwrap_or_default();
    Work {
        stalled: Duration::from_millis(stalled_ms),
        stalled_in,
        summary: summary(health),
        loading_steps: health.loading_steps,
    }
}

/// All work and waits that take long, one line.
fn summary(health: &Health) -> String {
    let seconds = |ms: u64| format!("{:.1} s", ms as f64 / 1e3);
    let mut parts = Vec::new();
    for actor in health.actors.iter().filter(|a| a.busy_ms >= NOTABLE_MS) {
        parts.push(format!("busy with {} for {}", actor.busy_with, seconds(actor.busy_ms)));
    }
    for row in health.rows.iter().filter(|r| r.busy_ms >= NOTABLE_MS) {
        parts.push(format!("busy with {} for {}", row.name, seconds(row.busy_ms)));
    }
    let of_rows = health.rows.iter().map(|r| (r.queued, r.waited_ms));
    let waiting = health.actors.iter().map(|a| (a.queued, a.waited_ms)).chain(of_rows);
    let (count, longest) = waiting.fold((0_u32, 0), |(n, most), (queued, ms)| (n.saturating_add(queued), most.max(ms)));
    if longest >= NOTABLE_MS {
        parts.push(format!("{count} waiting, the oldest for {}", seconds(longest)));
    }
    parts.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::bus::{ActorHealth, RowHealth};

    #[test]
    fn the_longest_work_is_the_one_that_stalls() {
        let actor = ActorHealth {
            name: "painter".into(),
            busy_with: "cmd/capture".into(),
            busy_ms: 9000,
            queued: 1,
            waited_ms: 8700,
            ..ActorHealth::default()
        };
        let idle = ActorHealth { name: "other".into(), ..ActorHealth::default() };
        let row = RowHealth { name: "cmd/content".into(), queued: 2, waited_ms: 400, busy_ms: 500 };
        let health = Health { actors: vec![idle, actor], rows: vec![row], loading_steps: 3, ..Health::default() };
        let work = work_of(&health);
        assert_eq!((work.stalled, work.loading_steps), (Duration::from_secs(9), 3));
        assert_eq!(work.stalled_in, "actor `painter`, busy with cmd/capture,");
        assert_eq!(work.summary, "busy with cmd/capture for 9.0 s; 3 waiting, the oldest for 8.7 s");
        assert_eq!(work_of(&Health::default()), Work::default());
    }
}
