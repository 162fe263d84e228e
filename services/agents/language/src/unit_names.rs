//! Names of units: as spoken against as they stand in the scene.

use sg_proto::scene::State;

use crate::syntax::token::{self, Kind};

/// Names of the units that a person can speak of: base units and those saved by name, in the order of the scene.
#[must_use]
pub fn addressable(state: &State) -> Vec<&str> {
    let base = state.base_units.iter().map(|u| u.name.as_str());
    base.chain(state.units.iter().filter(|u| !u.derived).map(|u| u.name.as_str())).collect()
}

/// Names of all units, those made by commands on the selection or on "everything else" too.
#[must_use]
pub fn all(state: &State) -> Vec<&str> {
    let base = state.base_units.iter().map(|u| u.name.as_str());
    base.chain(state.units.iter().map(|u| u.name.as_str())).collect()
}

/// What looking a spoken name up gave.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Lookup<'n> {
    /// The name as it stands.
    Unique(&'n str),
    /// More than one name fits equally well.
    Ambiguous(Vec<&'n str>),
    /// None fits; those that come near, nearest first.
    Missing(Vec<&'n str>),
}

/// A name reduced to what counts when it is spoken: the lemmas of its words, without a leading article.
pub(crate) fn normalized(name: &str) -> Vec<String> {
    let mut lemmas: Vec<String> = token::tokens(name)
        .into_iter()
        .flat_map(|t| match t.kind {
            Kind::Quoted => normalized(&t.text),
            Kind::Mark(_) => Vec::new(),
            Kind::Word | Kind::Number(_) | Kind::Color(_) => vec![t.lemma],
        })
        .collect();
    if lemmas.len() > 1 && matches!(lemmas.first().map(String::as_str), Some("the" | "a" | "an")) {
        lemmas.remove(0);
    }
    lemmas
}

/// Looks a spoken name up: exactly, then without regard to case, then word by word in any inflection.
#[must_use]
pub fn lookup<'n>(spoken: &str, names: &[&'n str]) -> Lookup<'n> {
    let spoken = spoken.trim();
    if let Some(name) = names.iter().find(|n| **n == spoken) {
        return Lookup::Unique(name);
    }
    let lower = spoken.to_lowercase();
    let key = normalized(spoken);
    let by_case = names.iter().copied().filter(|n| n.to_lowercase() == lower).collect::<Vec<_>>();
    let by_words = || names.iter().copied().filter(|n| !key.is_empty() && normalized(n) == key).collect::<Vec<_>>();
    let fits = if by_case.is_empty() { by_words() } else { by_case };
    match fits.as_slice() {
        [] => Lookup::Missing(similar(spoken, names)),
        [name] => Lookup::Unique(name),
        _ => Lookup::Ambiguous(fits),
    }
}

/// Names that come near a spoken one, nearest first, at most three: a slip of the pen or ear, or some of its words.
#[must_use]
pub fn similar<'n>(spoken: &str, names: &[&'n str]) -> Vec<&'n str> {
    let key = normalized(spoken);
    let joined = key.join(" ");
    if joined.is_empty() {
        return Vec::new();
    }
    let mut scored: Vec<(f64, &str)> = names
        .iter()
        .filter_map(|name| {
            let other = normalized(name);
            let shared = key.iter().filter(|w| other.contains(w)).count();
            let letters = strsim::normalized_damerau_levenshtein(&joined, &other.join(" "));
            let words = if shared > 0 { 0.6 + 0.1 * shared as f64 } else { 0.0 };
            let score = letters.max(words);
            (score >= 0.6).then_some((score, *name))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| a.1.cmp(b.1)));
    scored.into_iter().take(3).map(|(_, name)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_before_case_before_words() {
        let names = ["Sac", "sac", "red vessel", "leaves"];
        assert_eq!(lookup("sac", &names), Lookup::Unique("sac"));
        assert_eq!(lookup("SAC", &names), Lookup::Ambiguous(vec!["Sac", "sac"]));
        assert_eq!(lookup("the Red Vessels", &names), Lookup::Unique("red vessel"));
        assert_eq!(lookup("leaf", &names), Lookup::Unique("leaves"));
    }

    #[test]
    fn near_misses_are_offered_and_strangers_are_not() {
        let names = ["sac", "vessel", "left renal artery"];
        assert_eq!(lookup("sack", &names), Lookup::Missing(vec!["sac"]));
        assert_eq!(lookup("vesel", &names), Lookup::Missing(vec!["vessel"]));
        assert_eq!(lookup("artery", &names), Lookup::Missing(vec!["left renal artery"]));
        assert_eq!(lookup("weather", &names), Lookup::Missing(vec![]));
    }

    #[test]
    fn separators_inside_a_name_do_not_matter() {
        assert_eq!(lookup("base unit 2", &["base-unit_2"]), Lookup::Unique("base-unit_2"));
    }
}
