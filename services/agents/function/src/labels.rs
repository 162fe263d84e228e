//! Units that the labeling service finds for names that no unit has.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use sg_language::{resolved_names, unit_choice};
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::labeling::{Candidate, DescribeRequest, FindRequest, Outcome, ProposedRegion, RegionView, ViewsRequest};
use sg_proto::language::ResolvedName;
use sg_proto::scene::Target;
use sg_runtime::bus::{Bus, BusError};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

/// Length of the queue of services that start and end.
const QUEUE: usize = 64;
/// Longest name that is sent, bytes: as long as the service takes.
const MAX_TEXT_BYTES: usize = 512;

/// What a name means.
pub(crate) enum Meaning {
    /// These units, at least one.
    Units(Vec<ResolvedName>),
    /// One of several units, or none that is like another one; a question or a reason for the person.
    Question(String),
    /// No unit, or a session without the service. Perhaps one of these regions that nobody has named, the likeliest first.
    Unknown(Vec<ProposedRegion>),
}

/// The labeling service, if the session has one.
pub(crate) struct Labels {
    bus: Bus,
    /// Whether a labeling service was ready at some time. One that restarts is worth a wait.
    is_served: Arc<AtomicBool>,
}

impl Labels {
    /// Watches for a labeling service.
    pub(crate) async fn watch(bus: Bus) -> Result<Self, BusError> {
        let is_served = Arc::new(AtomicBool::new(false));
        let mut changes = bus.watch_liveliness(QUEUE).await?;
        let served = Arc::clone(&is_served);
        tokio::spawn(async move {
            while let Some(change) = changes.recv().await {
                if change.alive && change.role == role::LABELING {
                    served.store(true, Ordering::Relaxed);
                }
            }
        });
        Ok(Self { bus, is_served })
    }

    /// The units that a spoken name means at a revision of the scene. It takes at most half of the remaining time.
    ///
    /// # Errors
    /// `Unavailable` or `DeadlineExceeded` where the service is away for longer.
    pub(crate) async fn find(&self, spoken: &str, revision: u64, context: &Context) -> Result<Meaning, Fault> {
        if !self.is_served.load(Ordering::Relaxed) || spoken.len() > MAX_TEXT_BYTES {
            return Ok(Meaning::Unknown(Vec::new()));
        }
        let request = FindRequest {
            text: spoken.to_owned(),
            at_least_revision: revision,
            regions: true,
            ..FindRequest::default()
        };
        let reply = match self.bus.ask(&keys::LABELING_FIND, &request, &half_of(context)).await {
            Ok(reply) => reply,
            Err(fault) if matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded) => return Err(fault),
            Err(fault) => {
                tracing::warn!(%fault, "the labeling service did not resolve a name");
                return Ok(Meaning::Unknown(Vec::new()));
            }
        };
        Ok(match reply.outcome() {
            Outcome::Match => Meaning::Units(reply.units.iter().map(|found| resolved(spoken, found)).collect()),
            Outcome::Ambiguous => Meaning::Question(resolved_names::question(spoken, &reply.units)),
            // A name for things of a kind is no name that somebody could give.
            Outcome::NoMatch if unit_choice::is_alike(spoken) && !reply.reason.is_empty() => {
                Meaning::Question(resolved_names::refusal(&reply.reason))
            }
            Outcome::NoMatch | Outcome::Unspecified => Meaning::Unknown(reply.regions),
        })
    }

    /// The view that shows most of a target among the rest of the scene; `None` in a session without the service. It takes at most
    /// half of the remaining time.
    ///
    /// # Errors
    /// The fault of the service: it is away or late, or nothing of the target is visible.
    pub(crate) async fn best_view(
        &self,
        target: &Target,
        revision: u64,
        context: &Context,
    ) -> Result<Option<RegionView>, Fault> {
        if !self.is_served.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let request =
            ViewsRequest { target: Some(target.clone()), at_least_revision: revision, ..ViewsRequest::default() };
        let reply = self.bus.ask(&keys::LABELING_VIEWS, &request, &half_of(context)).await?;
        // Those are the views that tell most about the target alone. What hides it is in the way of one that tells more.
        let value = |view: &RegionView| view.entropy * view.unhidden;
        Ok(reply.views.into_iter().rev().max_by(|a, b| value(a).total_cmp(&value(b))))
    }

    /// Words for the look of a unit, or of the selection where the name is empty. None of a session without the service, or of
    /// something invisible.
    pub(crate) async fn look(&self, unit: &str, revision: u64, context: &Context) -> Vec<String> {
        if !self.is_served.load(Ordering::Relaxed) {
            return Vec::new();
        }
        let request = DescribeRequest { unit: unit.to_owned(), at_least_revision: revision };
        match self.bus.ask(&keys::LABELING_DESCRIBE, &request, &half_of(context)).await {
            Ok(reply) => reply.words,
            Err(fault) => {
                tracing::debug!(%fault, "no look");
                Vec::new()
            }
        }
    }
}

/// The context of a question that takes at most half of the remaining time. The rest is for the command and the reply.
fn half_of(context: &Context) -> Context {
    context.next().within(context.remaining() / 2)
}

fn resolved(spoken: &str, found: &Candidate) -> ResolvedName {
    let (unit, explanation) = (found.unit.clone(), found.explanation.clone());
    ResolvedName { spoken: spoken.to_owned(), unit, explanation, ..ResolvedName::default() }
}
