//! Words as they are spoken: numbers in words, signs by name, no punctuation.

/// Largest number that is said as a number; longer ones are said digit by digit.
const LARGEST: u64 = 999_999_999;

const ONES: [&str; 20] = [
    "zero",
    "one",
    "two",
    "three",
    "four",
    "five",
    "six",
    "seven",
    "eight",
    "nine",
    "ten",
    "eleven",
    "twelve",
    "thirteen",
    "fourteen",
    "fifteen",
    "sixteen",
    "seventeen",
    "eighteen",
    "nineteen",
];

const TENS: [&str; 10] = ["", "", "twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"];

/// The spoken words of a text, in lower case. Letters of all scripts and apostrophes within words are kept; numbers, `%`, `°`,
/// `&`, `+` and `=` become words; everything else separates words.
///
/// ```
/// use sg_speech::spoken::words;
///
/// assert_eq!(words("Fade the left_kidney to 20 %!").join(" "), "fade the left kidney to twenty percent");
/// ```
#[must_use]
pub fn words(text: &str) -> Vec<String> {
    let characters: Vec<char> = text.chars().flat_map(char::to_lowercase).collect();
    let at = |k: usize| characters.get(k).copied().unwrap_or(' ');
    let mut words = Vec::new();
    let mut k = 0;
    while k < characters.len() {
        let begin = k;
        if at(k).is_ascii_digit() {
            let separates = |k: usize, sign: char| at(k) == sign && at(k + 1).is_ascii_digit();
            while at(k).is_ascii_digit() || separates(k, ',') && is_thousands(&characters, k) {
                k += 1;
            }
            let whole: String = characters[begin..k].iter().filter(|c| c.is_ascii_digit()).collect();
            number(&whole, &mut words);
            if separates(k, '.') {
                words.push("point".into());
                k += 1;
                while at(k).is_ascii_digit() {
                    digit(at(k), &mut words);
                    k += 1;
                }
            }
        } else if at(k).is_alphabetic() {
            while at(k).is_alphabetic() || is_apostrophe(at(k)) && at(k + 1).is_alphabetic() {
                k += 1;
            }
            words.push(characters[begin..k].iter().map(|c| if is_apostrophe(*c) { '\'' } else { *c }).collect());
        } else {
            let minus =
                matches!(at(k), '-' | '−') && at(k + 1).is_ascii_digit() && (k == 0 || at(k - 1).is_whitespace());
            let sign = match at(k) {
                '%' => Some("percent"),
                '°' => Some("degrees"),
                '&' => Some("and"),
                '+' => Some("plus"),
                '=' => Some("equals"),
                _ if minus => Some("minus"),
                _ => None,
            };
            words.extend(sign.map(str::to_owned));
            k += 1;
        }
    }
    words
}

fn is_apostrophe(c: char) -> bool {
    matches!(c, '\'' | '’')
}

/// Whether a comma stands before exactly three digits.
fn is_thousands(characters: &[char], comma: usize) -> bool {
    characters[comma + 1..].iter().take_while(|c| c.is_ascii_digit()).count() == 3
}

fn digit(digit: char, words: &mut Vec<String>) {
    let value = digit.to_digit(10).unwrap_or_default() as usize;
    words.push(ONES[value].to_owned());
}

fn number(digits: &str, words: &mut Vec<String>) {
    let leading_zero = digits.len() > 1 && digits.starts_with('0');
    match digits.parse::<u64>() {
        Ok(value) if value <= LARGEST && !leading_zero => cardinal(value, words),
        _ => digits.chars().for_each(|c| digit(c, words)),
    }
}

fn cardinal(value: u64, words: &mut Vec<String>) {
    let mut say = |word: &str| words.push(word.to_owned());
    let (unit, name) = match value {
        0..20 => return say(ONES[value as usize]),
        20..100 => {
            say(TENS[value as usize / 10]);
            if !value.is_multiple_of(10) {
                say(ONES[value as usize % 10]);
            }
            return;
        }
        100..1_000 => (100, "hundred"),
        1_000..1_000_000 => (1_000, "thousand"),
        _ => (1_000_000, "million"),
    };
    cardinal(value / unit, words);
    words.push(name.to_owned());
    if !value.is_multiple_of(unit) {
        cardinal(value % unit, words);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn texts_are_said_as_people_say_them() {
        for (text, said) in [
            ("Hide the sac.", "hide the sac"),
            ("zoom to 200 %", "zoom to two hundred percent"),
            ("to 0.35", "to zero point three five"),
            ("1,250,007 Gaussians", "one million two hundred fifty thousand seven gaussians"),
            ("1,2", "one two"),
            ("don’t show T2", "don't show t two"),
            ("turn -15°", "turn minus fifteen degrees"),
            ("left-kidney_2", "left kidney two"),
            ("0042 & 99999999999", "zero zero four two and nine nine nine nine nine nine nine nine nine nine nine"),
            ("Äste über", "äste über"),
            ("…, —", ""),
        ] {
            assert_eq!(words(text).join(" "), said, "{text}");
        }
    }

    proptest! {
        #[test]
        fn spoken_words_are_said_as_they_are(text in "\\PC{0,40}") {
            let said = words(&text);
            prop_assert!(said.iter().all(|w| w.chars().all(|c| c.is_alphabetic() || c == '\'' )), "{said:?}");
            prop_assert_eq!(&words(&said.join(" ")), &said);
        }

        #[test]
        fn different_numbers_are_said_differently(a in 0_u64..2_000_000, b in 0_u64..2_000_000) {
            prop_assert_eq!(a == b, words(&a.to_string()) == words(&b.to_string()));
        }
    }
}
