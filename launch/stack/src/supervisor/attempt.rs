//! Requests to candidates: the probe and the promotion.
//!
//! Such a request has a deadline on the bus, which goes on while the supervisor stands still. So a failure during a
//! standstill says nothing about the candidate, and the request is made again.

use std::time::Duration;

use sg_proto::bus::{Code, Phase, PromoteRequest, Ready, StatusRequest};
use sg_proto::keys;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;

use crate::probe;
use crate::reconcile::{Event, ProcessId};

/// Longest time for the question whether a candidate has its role already.
const STATUS_TIME: Duration = Duration::from_secs(5);

/// A request to a candidate.
#[derive(Debug, Clone)]
pub(super) enum CandidateRequest {
    /// Does it speak the contract of its role? With its announcement.
    Probe { id: ProcessId, ready: Box<Ready>, role: String },
    /// It takes its role.
    Promote { id: ProcessId, instance: String, epoch: u64, within: Duration },
}

/// A finished attempt of a request.
#[derive(Debug)]
pub(super) struct Attempt {
    pub(super) request: CandidateRequest,
    pub(super) outcome: Result<(), String>,
    /// The supervisor's standstill when the attempt began.
    pub(super) standstill: Duration,
}

impl CandidateRequest {
    pub(super) fn id(&self) -> ProcessId {
        match self {
            Self::Probe { id, .. } | Self::Promote { id, .. } => *id,
        }
    }

    /// Makes one attempt.
    pub(super) async fn attempt(self, bus: &Bus, standstill: Duration) -> Attempt {
        let outcome = match &self {
            Self::Probe { ready, role, .. } => probe::probe(bus, ready, role).await,
            Self::Promote { instance, epoch, within, .. } => promote(bus, instance, *epoch, *within).await,
        };
        Attempt { request: self, outcome, standstill }
    }
}

impl Attempt {
    pub(super) fn event(self) -> Event {
        let (id, outcome) = (self.request.id(), self.outcome);
        match self.request {
            CandidateRequest::Probe { .. } => Event::Verified { id, outcome },
            CandidateRequest::Promote { .. } => Event::Promoted { id, outcome },
        }
    }
}

/// Promotes a candidate, unless an earlier attempt has done it.
async fn promote(bus: &Bus, instance: &str, epoch: u64, within: Duration) -> Result<(), String> {
    let under = keys::instance(instance);
    let context = Context::root().deadline_in(within);
    let fault = match bus.ask_role(&keys::PROMOTE, &under, &PromoteRequest { epoch }, &context).await {
        Ok(_) => return Ok(()),
        Err(fault) if fault.code != Code::FailedPrecondition => return Err(fault.to_string()),
        Err(fault) => fault,
    };
    // It is not in standby. The answer of an earlier attempt may have been lost.
    let context = Context::root().deadline_in(STATUS_TIME);
    match bus.ask_role(&keys::STATUS, &under, &StatusRequest {}, &context).await {
        Ok(health) if health.phase() == Phase::Ready && health.epoch == epoch => Ok(()),
        _ => Err(fault.to_string()),
    }
}
