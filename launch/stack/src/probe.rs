//! The readiness probe of a candidate, before the hand-over: does it speak the contract of its role?
//!
//! The probe addresses the candidate by its instance, so its answers have no effect. The probe is quick. The
//! conformance suite of a role tests more.

use std::time::Duration;

use sg_proto::bus::{Health, Phase, Ready, StatusRequest};
use sg_proto::keys::{self, Kind, role, rows};
use sg_proto::language::{Intent, IntentRequest};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;

use crate::reconcile::PROBE_TIME;

/// An utterance that every intent agent understands.
const HELP: &str = "help";

/// Probes a candidate for `role`. `ready` is its announcement. Takes less than [`PROBE_TIME`].
///
/// # Errors
/// The first mismatch, in one line.
pub(crate) async fn probe(bus: &Bus, ready: &Ready, role: &str) -> Result<(), String> {
    check_announcement(ready, role)?;
    let context = Context::root().deadline_in(PROBE_TIME.mul_f64(0.8));
    let under = keys::instance(&ready.instance);
    // An answer of another major version has another type and is refused on receipt.
    let health = bus.ask_role(&keys::STATUS, &under, &StatusRequest {}, &context).await;
    check_health(&health.map_err(|fault| format!("{}: {fault}", keys::STATUS.name))?, ready, role)?;
    if role == role::AGENT_INTENT {
        let request = IntentRequest { text: HELP.to_owned(), ..IntentRequest::default() };
        let within = context.next().within(Duration::from_secs(5));
        let intent = bus.ask_role(&keys::PARSE, &under, &request, &within).await;
        check_intent(&intent.map_err(|fault| format!("{} of \"{HELP}\": {fault}", keys::PARSE.name))?)?;
    }
    Ok(())
}

/// Checks the announcement.
fn check_announcement(ready: &Ready, role: &str) -> Result<(), String> {
    if ready.role != role {
        return Err(format!("it announced role `{}` instead of `{role}`", ready.role));
    }
    let needed = rows().into_iter().filter(|r| r.belongs_to(role) && !matches!(r.kind, Kind::Stream { .. }));
    let missing: Vec<_> = needed.map(|r| r.name).filter(|n| !ready.declares.iter().any(|d| d == n)).collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("it does not declare {}", missing.join(", "))) }
}

fn check_health(health: &Health, ready: &Ready, role: &str) -> Result<(), String> {
    if (health.role.as_str(), &health.instance) != (role, &ready.instance) {
        return Err(format!(
            "asked as `{}` of role `{role}`, it answered as `{}` of role `{}`",
            ready.instance, health.instance, health.role
        ));
    }
    match health.phase() {
        Phase::Standby => Ok(()),
        phase => Err(format!("in standby it reports the phase {}", phase.as_str_name())),
    }
}

fn check_intent(intent: &Intent) -> Result<(), String> {
    if intent.clauses.is_empty() && intent.suggestions.is_empty() {
        return Err(format!("it did not understand \"{HELP}\""));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::language::Clause;

    fn ready(role: &str) -> Ready {
        let declares = rows().into_iter().filter(|r| r.belongs_to(role)).map(|r| r.name.to_owned()).collect();
        Ready { role: role.to_owned(), instance: "x-2".to_owned(), declares, ..Ready::default() }
    }

    #[test]
    fn announcement_must_declare_all_rows_of_the_role() {
        assert_eq!(check_announcement(&ready(role::SCENE), role::SCENE), Ok(()));
        let mut lacking = ready(role::SCENE);
        lacking.declares.retain(|d| !["cmd/apply", "cmd/cancel", "event/change"].contains(&d.as_str()));
        assert_eq!(check_announcement(&lacking, role::SCENE).unwrap_err(), "it does not declare cmd/cancel, cmd/apply");
        let wrong = check_announcement(&ready(role::SCENE), role::SELECTION).unwrap_err();
        assert_eq!(wrong, "it announced role `scene` instead of `selection`");
    }

    #[test]
    fn health_must_match_instance_role_and_phase() {
        let ready = ready(role::SCENE);
        let health = |role: &str, instance: &str, phase: Phase| Health {
            role: role.to_owned(),
            instance: instance.to_owned(),
            phase: phase.into(),
            ..Health::default()
        };
        assert_eq!(check_health(&health("scene", "x-2", Phase::Standby), &ready, "scene"), Ok(()));
        assert!(check_health(&health("scene", "x-1", Phase::Standby), &ready, "scene").is_err());
        assert!(check_health(&health("view", "x-2", Phase::Standby), &ready, "scene").is_err());
        assert!(check_health(&health("scene", "x-2", Phase::Draining), &ready, "scene").is_err());
        assert!(check_health(&health("scene", "x-2", Phase::Unspecified), &ready, "scene").is_err());
    }

    #[test]
    fn empty_intent_fails_the_probe() {
        assert!(check_intent(&Intent::default()).is_err());
        assert_eq!(check_intent(&Intent { clauses: vec![Clause::default()], ..Intent::default() }), Ok(()));
    }
}
