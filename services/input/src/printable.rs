//! Text of files on its way to a terminal or a log.

use std::borrow::Cow;
use std::fmt::Write as _;

/// The text as part of one line: control characters, line ends, and characters that reorder or hide text are escaped.
///
/// The escapes are those of JSON (`\n`, `\u001b`), so JSON stays JSON of the same value.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, is_unsafe)
}

/// [`printable`] for several lines: line ends and tabs stay.
#[must_use]
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| is_unsafe(c) && !matches!(c, '\n' | '\t'))
}

/// Whether a character could act on a terminal, or make a line look like another.
fn is_unsafe(c: char) -> bool {
    c.is_control()
        || matches!(c,
            // Directional marks, embeddings, overrides and isolates.
            '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
            // Line and paragraph separators, invisible operators and fillers.
            | '\u{2028}' | '\u{2029}' | '\u{200b}' | '\u{2060}'..='\u{2065}' | '\u{206a}'..='\u{206f}' | '\u{feff}'
            | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
        || (c as u32) & 0xfffe == 0xfffe
        || matches!(c, '\u{fdd0}'..='\u{fdef}')
}

fn escaped(text: &str, is_unsafe: impl Fn(char) -> bool) -> Cow<'_, str> {
    // Most text is plain ASCII.
    if text.bytes().all(|b| (b' '..=b'~').contains(&b)) || !text.contains(&is_unsafe) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match c {
            c if !is_unsafe(c) => out.push(c),
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            '\t' => out.push_str("\\t"),
            c => {
                for unit in c.encode_utf16(&mut [0; 2]) {
                    // Writing into a String cannot fail.
                    let _ = write!(out, "\\u{unit:04x}");
                }
            }
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn nothing_acts_on_the_terminal() {
        for (text, expected) in [
            ("sac", "sac"),
            ("脑 é – “x”", "脑 é – “x”"),
            ("\u{1b}[2Jgone\r\n", "\\u001b[2Jgone\\r\\n"),
            ("\u{9b}31m\u{7f}\0", "\\u009b31m\\u007f\\u0000"),
            ("exe\u{202e}yl.p", "exe\\u202eyl.p"),
            ("\u{e0041}\u{ffff}", "\\udb40\\udc41\\uffff"),
        ] {
            assert_eq!(printable(text), expected);
        }
        assert_eq!(printable_lines("a\tb\n\u{7}c"), "a\tb\n\\u0007c");
    }

    proptest! {
        #[test]
        fn printable_text_is_one_plain_line(text in any::<String>()) {
            let line = printable(&text);
            prop_assert!(!line.chars().any(is_unsafe));
            prop_assert_eq!(printable(&line), line.clone());
            prop_assert_eq!(printable_lines(&text).lines().count() <= text.lines().count().max(1), true);
        }
    }
}
