//! Clauses of a text: what stands between signs that are heard.
//!
//! A voice has learnt a clause's sign as the last phoneme of the clause, but espeak-ng gives the phonemes alone.

/// A clause with letters, and the sign behind it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Clause {
    /// Without brackets, quotes and signs.
    pub(crate) text: String,
    /// One of `. ? ! , : ;`.
    pub(crate) sign: Option<char>,
}

impl Clause {
    /// Whether a sentence ends with it.
    pub(crate) fn ends_sentence(&self) -> bool {
        matches!(self.sign, Some('.' | '?' | '!'))
    }
}

/// The sign that a character is heard as.
fn sign(c: char) -> Option<char> {
    Some(match c {
        '.' | '?' | '!' | ',' | ':' | ';' => c,
        '。' | '．' | '।' => '.',
        '？' | '؟' => '?',
        '！' => '!',
        '，' | '、' | '،' | '…' => ',',
        '：' => ':',
        '；' | '؛' | '—' | '–' => ';',
        _ => return None,
    })
}

/// Characters that are no sound, or that a program would interpret.
fn is_silent(c: char) -> bool {
    c.is_control() || matches!(c, '[' | ']' | '(' | ')' | '{' | '}' | '<' | '>' | '"' | '“' | '”' | '„' | '«' | '»')
}

/// Splits a text into clauses. Signs within a word or number, such as in "3.5", split nothing.
pub(crate) fn clauses(text: &str) -> Vec<Clause> {
    let characters: Vec<char> = text.chars().map(|c| if is_silent(c) { ' ' } else { c }).collect();
    let (mut clauses, mut clause, mut at) = (Vec::new(), String::new(), 0);
    while let Some(c) = characters.get(at).copied() {
        let run = characters[at..].iter().take_while(|c| sign(**c).is_some()).count();
        let next = characters.get(at + run).copied();
        let Some(found) = sign(c).filter(|found| *found != c || ends(&characters[..at], next)) else {
            clause.push(c);
            at += 1;
            continue;
        };
        // Three full stops are an ellipsis; of other signs the first is heard.
        let ellipsis = found == '.' && run > 2 && next.is_some();
        push(&mut clauses, &mut clause, Some(if ellipsis { ',' } else { found }));
        at += run;
    }
    push(&mut clauses, &mut clause, None);
    clauses
}

/// Whether a sign with `before` in front and `next` behind ends a clause.
fn ends(before: &[char], next: Option<char>) -> bool {
    let Some(next) = next else { return true };
    // A full stop behind a single letter that has another one in front, as in "e.g.", is one of an abbreviation.
    let abbreviated = matches!(before, [.., '.', letter] if letter.is_alphabetic());
    next.is_whitespace() && !abbreviated
}

fn push(clauses: &mut Vec<Clause>, clause: &mut String, sign: Option<char>) {
    let text = clause.split_whitespace().collect::<Vec<_>>().join(" ");
    clause.clear();
    if text.chars().any(char::is_alphanumeric) {
        clauses.push(Clause { text, sign });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(text: &str) -> Vec<String> {
        clauses(text).into_iter().map(|clause| format!("{}|{}", clause.text, clause.sign.unwrap_or(' '))).collect()
    }

    #[test]
    fn signs_end_clauses_where_they_are_heard() {
        assert_eq!(split("Hello, world! It costs 3.5 (about)"), ["Hello|,", "world|!", "It costs 3.5 about| "]);
        assert_eq!(split("At 3:30, 1,000 people; yes: \"no\"?!"), ["At 3:30|,", "1,000 people|;", "yes|:", "no|?"]);
        assert_eq!(split("Tools, e.g. pliers, at 5 p.m."), ["Tools|,", "e.g. pliers|,", "at 5 p.m|."]);
        assert_eq!(split("naïve — yes… what... then..."), ["naïve|;", "yes|,", "what|,", "then|."]);
        assert_eq!(split("好。再见"), ["好|.", "再见| "]);
        assert_eq!(split("… , !"), [""; 0]);
        assert_eq!(split("<b>[[hello]]</b>\n"), ["b hello /b| "]);
    }
}
