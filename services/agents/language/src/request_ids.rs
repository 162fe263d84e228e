//! Ids that a repeated request gives again, so that what it causes happens once.

/// The id under which something caused by a request takes effect: BLAKE3 of the request's id and what it is for,
/// hexadecimal (64 bytes).
///
/// A request that is sent again under the same id, by a client that retries or a service that was restarted, yields the
/// same ids, and the scene answers a command it has seen with its first result.
#[must_use]
pub fn derived(request: &str, purpose: &str) -> String {
    let mut hasher = blake3::Hasher::new_derive_key("supergaussian agents: id of a caused message, version 1");
    // The length keeps ("ab", "c") and ("a", "bc") apart.
    hasher.update(&(request.len() as u64).to_le_bytes());
    hasher.update(request.as_bytes());
    hasher.update(purpose.as_bytes());
    hasher.finalize().to_hex().to_string()
}

/// The id of the scene command for one clause of a plan.
#[must_use]
pub fn command(plan: &str, clause: usize) -> String {
    derived(plan, &format!("clause {clause}"))
}

/// The id of the request for what an utterance means.
#[must_use]
pub fn intent(utterance: &str) -> String {
    derived(utterance, "intent")
}

/// The id of the request to a model for the words of a reply.
#[must_use]
pub fn paraphrase(utterance: &str) -> String {
    derived(utterance, "wording")
}

/// The id of the plan for an utterance.
#[must_use]
pub fn plan(utterance: &str) -> String {
    derived(utterance, "plan")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_repeat_for_the_same_and_differ_for_others() {
        let plan_id = plan("utterance");
        assert_eq!(command(&plan_id, 0), command(&plan("utterance"), 0));
        assert_ne!(command(&plan_id, 0), command(&plan_id, 1));
        assert_ne!(command(&plan_id, 1), command(&plan("another"), 1));
        assert_ne!(derived("ab", "c"), derived("a", "bc"));
        assert!(plan_id.len() <= sg_proto::limits::MAX_NAME_BYTES);
    }
}
