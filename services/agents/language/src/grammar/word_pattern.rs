//! Patterns of words in a sentence: "is/are X hidden". Words between slashes are alternatives, and `X` stands for some words.

use crate::syntax::token::{Kind, Token};

/// The words of a sentence, without its marks. A percent sign is a word.
pub(super) fn words(tokens: &[Token]) -> Vec<Token> {
    let is_word = |t: &&Token| t.is_mark('%') || !matches!(t.kind, Kind::Mark(_));
    tokens.iter().filter(is_word).cloned().collect()
}

/// Number of the first words that fit a phrase.
fn fitting(words: &[Token], phrase: &str) -> Option<usize> {
    let mut length = 0;
    for choice in phrase.split_whitespace() {
        let said = words.get(length)?;
        if !choice.split('/').any(|word| said.text == word) {
            return None;
        }
        length += 1;
    }
    Some(length)
}

/// The words behind a beginning.
pub(super) fn after<'t>(words: &'t [Token], beginning: &str) -> Option<&'t [Token]> {
    words.get(fitting(words, beginning)?..)
}

/// The words before an end.
pub(super) fn before<'t>(words: &'t [Token], ending: &str) -> Option<&'t [Token]> {
    let from = words.len().checked_sub(ending.split_whitespace().count())?;
    fitting(words.get(from..)?, ending)?;
    words.get(..from)
}

/// The words behind the longest of some beginnings.
pub(super) fn after_any<'t>(words: &'t [Token], beginnings: &[&str]) -> Option<&'t [Token]> {
    beginnings.iter().filter_map(|beginning| after(words, beginning)).min_by_key(|rest| rest.len())
}

/// The words that `X` stands for where a whole sentence fits a pattern; none for a pattern without `X`.
pub(super) fn matched<'t>(words: &'t [Token], pattern: &str) -> Option<&'t [Token]> {
    match pattern.split_once('X') {
        None => after(words, pattern).filter(|rest| rest.is_empty()),
        Some((lead, tail)) => before(after(words, lead)?, tail).filter(|object| !object.is_empty()),
    }
}

/// Whether a whole sentence fits one of some patterns.
pub(super) fn matches_any(words: &[Token], patterns: &[&str]) -> bool {
    patterns.iter().any(|pattern| matched(words, pattern).is_some())
}

/// The words without those of some beginnings and ends. Something always stays.
pub(super) fn core<'t>(words: &'t [Token], leads: &[&str], tails: &[&str]) -> &'t [Token] {
    let mut rest = words;
    loop {
        let ended = || tails.iter().filter_map(|tail| before(rest, tail)).min_by_key(|shorter| shorter.len());
        let shorter = after_any(rest, leads).filter(|shorter| !shorter.is_empty()).or_else(ended);
        match shorter.filter(|shorter| !shorter.is_empty()) {
            Some(shorter) => rest = shorter,
            None => return rest,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::token::{text_of, tokens};

    #[test]
    fn patterns_fit_whole_sentences() {
        let object = |said: &str, pattern: &str| {
            let words = words(&tokens(said));
            matched(&words, pattern).map(|object| text_of(said, object).to_owned())
        };
        assert_eq!(object("Is the bone hidden?", "is/are X hidden/off").as_deref(), Some("the bone"));
        assert_eq!(object("are the bones off", "is/are X hidden/off").as_deref(), Some("the bones"));
        assert_eq!(object("what is hidden", "what is hidden").as_deref(), Some(""));
        assert_eq!(object("how do I hide it", "how do i X").as_deref(), Some("hide it"));
        for said in ["is hidden", "is the bone hidden now", "the bone is hidden"] {
            assert_eq!(object(said, "is/are X hidden"), None, "{said}");
        }
    }

    #[test]
    fn a_core_has_no_politeness() {
        let said = "Please, can you tell me: is the bone hidden or not?";
        let words = words(&tokens(said));
        let core = core(&words, &["please", "can you tell me"], &["or not"]);
        assert_eq!(text_of(said, core), "is the bone hidden");
        let only = super::words(&tokens("please"));
        assert_eq!(super::core(&only, &["please"], &["please"]).len(), 1);
    }
}
