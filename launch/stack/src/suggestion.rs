//! Suggestions for names that do not exist.

/// Longest name with suggestions, bytes. The comparison takes the product of two lengths in time and memory.
const LONGEST_NAME: usize = 128;

/// `; did you mean …?` with the nearest candidate, or a short list of all candidates.
#[must_use]
pub fn suggestion<'a>(wrong: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let candidates: Vec<_> = candidates.into_iter().collect();
    let near = candidates
        .iter()
        .filter(|c| c.len() <= LONGEST_NAME && wrong.len() <= LONGEST_NAME)
        .map(|c| (strsim::damerau_levenshtein(&wrong.to_lowercase(), &c.to_lowercase()), *c))
        .filter(|(distance, c)| *distance <= (c.chars().count().max(wrong.chars().count()) / 3).max(1))
        .min();
    match near {
        Some((_, c)) => format!("; did you mean `{c}`?"),
        None if candidates.is_empty() => String::new(),
        None => {
            let short = candidates.iter().filter(|c| c.len() <= LONGEST_NAME);
            let mut listed: Vec<_> = short.take(16).map(|c| format!("`{c}`")).collect();
            if candidates.len() > listed.len() {
                listed.push("…".to_owned());
            }
            format!("; there are {}", listed.join(", "))
        }
    }
}
