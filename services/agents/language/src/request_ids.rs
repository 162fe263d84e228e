//! Deterministic ids of derived requests, so that a repeated request has no second effect.

/// The id of a request that another request causes: BLAKE3 of the other's id and a purpose, as 64 hexadecimal digits.
///
/// A repeated request with the same id causes requests with the same ids. The scene answers a known command with its
/// first result.
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

/// The id of the request to the intent agent.
#[must_use]
pub fn intent(utterance: &str) -> String {
    derived(utterance, "intent")
}

/// The id of the prompt that rephrases a reply.
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
    fn equal_inputs_give_equal_ids_and_others_differ() {
        let plan_id = plan("utterance");
        assert_eq!(command(&plan_id, 0), command(&plan("utterance"), 0));
        assert_ne!(command(&plan_id, 0), command(&plan_id, 1));
        assert_ne!(command(&plan_id, 1), command(&plan("another"), 1));
        assert_ne!(derived("ab", "c"), derived("a", "bc"));
        assert!(plan_id.len() <= sg_proto::limits::MAX_NAME_BYTES);
    }
}
