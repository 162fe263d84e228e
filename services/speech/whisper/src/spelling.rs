//! Sentences as people type them and as the model spells them.

use text2num::{Language, replace_numbers_in_text};

/// Words that begin questions.
const QUESTIONS: [&str; 12] =
    ["what", "where", "which", "who", "how", "is", "are", "can", "could", "does", "do", "why"];

/// A sentence in lower case without punctuation, with numbers in digits: equal for what sounds the same.
///
/// "Fade everything else to twenty percent." and "fade everything else to 20%" both become
/// "fade everything else to 20 percent".
#[must_use]
pub fn normalized(text: &str) -> String {
    let mut spaced = String::with_capacity(text.len() + 8);
    let characters: Vec<char> = text.chars().flat_map(char::to_lowercase).collect();
    for (at, character) in characters.iter().enumerate() {
        let beside = |offset: isize| {
            let at = at.checked_add_signed(offset);
            at.and_then(|at| characters.get(at)).is_some_and(|other| other.is_alphanumeric())
        };
        match character {
            '%' => spaced.push_str(" percent "),
            // "the sac's", and the point in "0.5".
            '\'' | '’' if beside(-1) && beside(1) => spaced.push('\''),
            '.' if beside(-1) && beside(1) => spaced.push('.'),
            other if other.is_alphanumeric() => spaced.push(*other),
            _ => spaced.push(' '),
        }
    }
    let words = joined(&spaced);
    joined(&replace_numbers_in_text(&words, &Language::english(), 0.0))
}

fn joined(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Most spellings of a sentence.
pub(crate) const MOST_SPELLINGS: usize = 6;

/// How a model may write a sentence: with a capital at its start, with and without a mark at its end, and "20%" for "20 percent".
/// Each begins with a space, as texts of the model do.
pub(crate) fn spellings(sentence: &str) -> Vec<String> {
    let sentence = joined(sentence.trim().trim_end_matches(['.', '!', '?']));
    let digits = replace_numbers_in_text(&sentence, &Language::english(), 10.0);
    let percent = digits.replace(" percent", "%");
    let mut forms = vec![sentence];
    for form in [digits, percent] {
        if !forms.contains(&form) {
            forms.push(form);
        }
    }
    let of_form = |form: &String| {
        let first = form.split(' ').next().unwrap_or_default().to_lowercase();
        let mark = if QUESTIONS.contains(&first.as_str()) { "?" } else { "." };
        let mut rest = form.chars();
        let capital: String = rest.next().into_iter().flat_map(char::to_uppercase).collect();
        let text = format!(" {capital}{}", rest.as_str());
        [format!("{text}{mark}"), text]
    };
    forms.iter().flat_map(of_form).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_sounds_the_same_is_the_same() {
        for (text, expected) in [
            ("Make the sac red.", "make the sac red"),
            ("fade everything else to 20%", "fade everything else to 20 percent"),
            ("Fade everything else to twenty percent!", "fade everything else to 20 percent"),
            ("Set the sac's opacity to 0.5, please", "set the sac's opacity to 0.5 please"),
            ("  UNDO…  ", "undo"),
            ("zoom-in", "zoom in"),
            ("", ""),
        ] {
            assert_eq!(normalized(text), expected);
        }
    }

    #[test]
    fn sentences_have_the_spellings_of_models() {
        assert_eq!(spellings("make the sac red"), [" Make the sac red.", " Make the sac red"]);
        assert_eq!(spellings("how big is it?"), [" How big is it?", " How big is it"]);
        let fading = spellings("fade it to twenty percent");
        for form in [" Fade it to twenty percent.", " Fade it to 20 percent.", " Fade it to 20%.", " Fade it to 20%"] {
            assert!(fading.iter().any(|spelling| spelling == form), "{form} not in {fading:?}");
        }
    }

    proptest! {
        #[test]
        fn normalizing_twice_is_normalizing_once(text in "[ -~]{0,40}") {
            let once = normalized(&text);
            prop_assert_eq!(normalized(&once), once.clone());
            for spelling in spellings(&text) {
                prop_assert!(spelling.starts_with(' '));
            }
        }
    }
}
