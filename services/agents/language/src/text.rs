//! Text formats of answers and reports: numbers, lists, names.

use sg_input::number_format::decimals;
pub(crate) use sg_input::number_format::grouped;
use sg_proto::scene::Target;

use crate::syntax::token;

/// A list in a sentence: "a", "a and b", "a, b and c".
pub(crate) fn join(items: &[String]) -> String {
    join_with(items, "and")
}

/// As [`join`], with another word before the last item.
pub(crate) fn join_with(items: &[String], word: &str) -> String {
    match items {
        [] => String::new(),
        [only] => only.clone(),
        [rest @ .., last] => format!("{} {word} {last}", rest.join(", ")),
    }
}

/// A share from 0 to 1 in percent, as the panels write it: two decimals below 1 %, one below 10 %, and never 0 % for a positive
/// share.
pub(crate) fn percent(share: f64) -> String {
    let value = 100.0 * share;
    if !value.is_finite() {
        return "an unknown share".to_owned();
    }
    match value {
        v if v <= 0.0 => "0 %".to_owned(),
        v if v < 0.005 => "less than 0.01 %".to_owned(),
        v if v < 0.995 => format!("{} %", decimals(v, 2)),
        v if v < 9.95 => format!("{} %", decimals(v, 1)),
        v => format!("{} %", decimals(v, 0)),
    }
}

/// A factor with up to two decimals.
pub(crate) fn factor(value: f64) -> String {
    decimals(value, 2)
}

/// The text with its first letter in upper case.
pub(crate) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}

/// A unit in a sentence, with article.
pub(crate) fn the(name: &str) -> String {
    format!("the {name}")
}

/// Whether a name is plural ("leaves").
pub(crate) fn is_plural(name: &str) -> bool {
    let lower = name.to_lowercase();
    let Some(last) = lower.split_whitespace().last() else { return false };
    let singular_ending = ["ss", "us", "is"].iter().any(|e| last.ends_with(e));
    token::is_irregular_plural(last) || (last.ends_with('s') && !singular_ending && token::lemma(last) != last)
}

/// A target in a sentence, and whether it is plural.
pub(crate) fn target(target: &Target) -> (String, bool) {
    let mut parts: Vec<String> = target.units.iter().map(|u| the(u)).collect();
    if target.selection {
        parts.push("the selection".to_owned());
    }
    let named = join(&parts);
    if target.complement {
        return (format!("everything but {named}"), false);
    }
    if target.everything {
        return ("everything".to_owned(), false);
    }
    let plural = parts.len() > 1 || target.units.first().is_some_and(|u| is_plural(u));
    (named, plural)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positive_shares_are_never_zero_percent() {
        for (share, text) in [
            (0.0, "0 %"),
            (0.00004, "less than 0.01 %"),
            (0.0004, "0.04 %"),
            (0.031, "3.1 %"),
            (0.03, "3 %"),
            (0.2, "20 %"),
            (1.0, "100 %"),
            (0.0996, "10 %"),
        ] {
            assert_eq!(percent(share), text);
        }
    }

    #[test]
    fn plural_names_are_recognized() {
        assert!(is_plural("leaves") && is_plural("left roots") && is_plural("vertebrae"));
        assert!(!is_plural("sac") && !is_plural("pelvis") && !is_plural("nucleus") && !is_plural("abscess"));
    }
}
