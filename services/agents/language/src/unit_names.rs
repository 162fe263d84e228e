//! Lookup of spoken names among the units and the kept viewpoints of a scene.

use sg_proto::scene::State;

use crate::syntax::token::normalized_name;

/// Names of base units and editable units, in the order of the scene.
#[must_use]
pub fn addressable(state: &State) -> Vec<&str> {
    let base = state.base_units.iter().map(|u| u.name.as_str());
    base.chain(state.units.iter().filter(|u| !u.derived).map(|u| u.name.as_str())).collect()
}

/// Names of all units, derived units included.
#[must_use]
pub fn all(state: &State) -> Vec<&str> {
    let base = state.base_units.iter().map(|u| u.name.as_str());
    base.chain(state.units.iter().map(|u| u.name.as_str())).collect()
}

/// Names of kept viewpoints, oldest first.
#[must_use]
pub fn kept_views(state: &State) -> Vec<&str> {
    state.kept_views.iter().map(|kept| kept.name.as_str()).collect()
}

/// The result of a lookup.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Lookup<'n> {
    /// One name matches.
    Unique(&'n str),
    /// Several names match equally well.
    Ambiguous(Vec<&'n str>),
    /// No name matches. The similar names, the most similar first.
    Missing(Vec<&'n str>),
}

/// Finds a spoken name: exact, then case-insensitive, then word by word in any inflection.
#[must_use]
pub fn lookup<'n>(spoken: &str, names: &[&'n str]) -> Lookup<'n> {
    let spoken = spoken.trim();
    if let Some(name) = names.iter().find(|n| **n == spoken) {
        return Lookup::Unique(name);
    }
    let lower = spoken.to_lowercase();
    let key = normalized_name(spoken);
    let by_case = names.iter().copied().filter(|n| n.to_lowercase() == lower).collect::<Vec<_>>();
    let by_words =
        || names.iter().copied().filter(|n| !key.is_empty() && normalized_name(n) == key).collect::<Vec<_>>();
    let fits = if by_case.is_empty() { by_words() } else { by_case };
    match fits.as_slice() {
        [] => Lookup::Missing(similar(spoken, names)),
        [name] => Lookup::Unique(name),
        _ => Lookup::Ambiguous(fits),
    }
}

/// At most three similar names, the most similar first: names with a typing error or with common words.
#[must_use]
pub fn similar<'n>(spoken: &str, names: &[&'n str]) -> Vec<&'n str> {
    let key = normalized_name(spoken);
    let joined = key.join(" ");
    if joined.is_empty() {
        return Vec::new();
    }
    let mut scored: Vec<(f64, &str)> = names
        .iter()
        .filter_map(|name| {
            let other = normalized_name(name);
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
    fn an_exact_match_wins() {
        let names = ["Sac", "sac", "red vessel", "leaves"];
        assert_eq!(lookup("sac", &names), Lookup::Unique("sac"));
        assert_eq!(lookup("SAC", &names), Lookup::Ambiguous(vec!["Sac", "sac"]));
        assert_eq!(lookup("the Red Vessels", &names), Lookup::Unique("red vessel"));
        assert_eq!(lookup("leaf", &names), Lookup::Unique("leaves"));
    }

    #[test]
    fn only_similar_names_are_suggested() {
        let names = ["sac", "vessel", "left renal artery"];
        assert_eq!(lookup("sack", &names), Lookup::Missing(vec!["sac"]));
        assert_eq!(lookup("vesel", &names), Lookup::Missing(vec!["vessel"]));
        assert_eq!(lookup("artery", &names), Lookup::Missing(vec!["left renal artery"]));
        assert_eq!(lookup("weather", &names), Lookup::Missing(vec![]));
    }

    #[test]
    fn separators_in_a_name_are_ignored() {
        assert_eq!(lookup("base unit 2", &["base-unit_2"]), Lookup::Unique("base-unit_2"));
    }
}
