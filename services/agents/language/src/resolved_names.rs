//! Sentences about spoken names that mean units of other names.

use std::collections::HashSet;

use sg_proto::labeling::Candidate;
use sg_proto::language::ResolvedName;

use crate::text::{capital, join, join_with};

/// Most units of one question.
const MAX_LISTED: usize = 4;
/// Most reasons of one sentence.
const MAX_REASONS: usize = 2;

/// The question where a spoken name means one of several units.
#[must_use]
pub fn question(spoken: &str, candidates: &[Candidate]) -> String {
    let mut names: Vec<String> = candidates.iter().take(MAX_LISTED).map(|c| format!("“{}”", c.unit)).collect();
    if candidates.len() > MAX_LISTED {
        names.push(format!("{} more", candidates.len() - MAX_LISTED));
    }
    if let ([only], 1) = (&names[..], candidates.len()) {
        return format!("“{spoken}” may mean {only}. Say that name if you mean it.");
    }
    format!("“{spoken}” may mean {}. Name one of them, or say “all” of them.", join_with(&names, "or"))
}

/// The sentence that gives the reason why a spoken name means no unit.
#[must_use]
pub fn refusal(reason: &str) -> String {
    format!("{}.", capital(reason))
}

/// Sentences about the units that were found for spoken names, one for each name. `None` without such names.
#[must_use]
pub fn interpretation(resolved: &[ResolvedName]) -> Option<String> {
    let mut known = HashSet::new();
    let spoken = resolved.iter().map(|name| name.spoken.as_str()).filter(|name| known.insert(*name));
    let sentences: Vec<String> = spoken.map(|name| sentence(name, resolved)).collect();
    (!sentences.is_empty()).then(|| sentences.join(" "))
}

fn sentence(spoken: &str, resolved: &[ResolvedName]) -> String {
    let meant: Vec<&ResolvedName> = resolved.iter().filter(|name| name.spoken == spoken).collect();
    let quoted: Vec<String> = meant.iter().map(|name| format!("“{}”", name.unit)).collect();
    let unit = if meant.len() == 1 { "unit" } else { "units" };
    let mut reasons: Vec<&str> = meant.iter().map(|name| name.explanation.as_str()).filter(|e| !e.is_empty()).collect();
    reasons.dedup();
    let why = match reasons.len() {
        1..=MAX_REASONS => format!(" ({})", reasons.join("; ")),
        _ => String::new(),
    };
    format!("Interpreted “{spoken}” as the {unit} {}{why}.", join(&quoted))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(spoken: &str, unit: &str, explanation: &str) -> ResolvedName {
        let [spoken, unit, explanation] = [spoken, unit, explanation].map(str::to_owned);
        ResolvedName { spoken, unit, explanation, ..ResolvedName::default() }
    }

    #[test]
    fn a_reply_says_how_a_name_was_interpreted() {
        assert_eq!(interpretation(&[]), None);
        let one = name("cranium", "skull", "part of the same kind: cranium ~ skull");
        assert_eq!(
            interpretation(std::slice::from_ref(&one)).as_deref(),
            Some("Interpreted “cranium” as the unit “skull” (part of the same kind: cranium ~ skull).")
        );
        let all = [one, name("kidneys", "left kidney", "kidneys"), name("kidneys", "right kidney", "kidneys")];
        let said = interpretation(&all).unwrap_or_default();
        assert!(
            said.ends_with("Interpreted “kidneys” as the units “left kidney” and “right kidney” (kidneys)."),
            "{said}"
        );
        let by_model = interpretation(&[name("beule", "sac", "")]);
        assert_eq!(by_model.as_deref(), Some("Interpreted “beule” as the unit “sac”."));
    }

    #[test]
    fn a_question_lists_the_candidates() {
        let candidate = |unit: &str| Candidate { unit: unit.to_owned(), ..Candidate::default() };
        let asked = question("kidney", &["left kidney", "right kidney"].map(candidate));
        assert!(asked.starts_with("“kidney” may mean “left kidney” or “right kidney”."), "{asked}");
        let many: Vec<Candidate> = (0..9).map(|i| candidate(&format!("unit {i}"))).collect();
        assert!(question("unit", &many).contains("“unit 3” or 5 more"), "{}", question("unit", &many));
    }
}
