//! Pronunciations of words in ARPAbet: the recognizer's dictionary, and letter-to-sound for words that it lacks.

use std::collections::HashMap;
use std::path::Path;

use crate::child_process::{Limits, Program};
use crate::error::SpeechError;

/// Largest dictionary that is read.
const MAX_DICTIONARY: u64 = 64 << 20;

/// Most pronunciations of a word that are used.
const MAX_VARIANTS: usize = 4;

/// Most bytes of phonemes for one request.
const MAX_PHONEMES: usize = 1 << 20;

/// Words with their phones, as CMUdict has them.
pub struct Dictionary {
    text: String,
    /// Places of the lines of a word.
    lines: HashMap<Box<str>, Vec<(u32, u32)>>,
}

impl Dictionary {
    /// Reads a dictionary: a word and its phones on each line, further pronunciations as `word(2)`.
    ///
    /// # Errors
    /// [`SpeechError::File`]: absent, too long or without words.
    pub fn read(path: &Path) -> Result<Self, SpeechError> {
        let fail = |problem: String| SpeechError::File(format!("{}: {problem}", path.display()));
        let text = sg_input::file::read_text(path, MAX_DICTIONARY).map_err(|error| fail(error.to_string()))?;
        let dictionary = Self::of(text);
        if dictionary.lines.is_empty() {
            return Err(fail("no line has a word and its phones; is it a dictionary?".into()));
        }
        Ok(dictionary)
    }

    fn of(text: String) -> Self {
        let mut lines: HashMap<Box<str>, Vec<(u32, u32)>> = HashMap::new();
        let mut at = 0;
        for line in text.split_inclusive('\n') {
            if let Some((word, phones)) = line.trim_end().split_once([' ', '\t']) {
                let name = word.split_once('(').filter(|(name, _)| !name.is_empty()).map_or(word, |(name, _)| name);
                let begin = at + word.len() + 1;
                let variants = lines.entry(name.to_lowercase().into()).or_default();
                if variants.len() < MAX_VARIANTS
                    && let (Ok(begin), Ok(end)) = (u32::try_from(begin), u32::try_from(begin + phones.len()))
                {
                    variants.push((begin, end));
                }
            }
            at += line.len();
        }
        Self { text, lines }
    }

    /// Pronunciations of a word, each as phones with spaces between.
    pub fn look_up(&self, word: &str) -> impl Iterator<Item = &str> {
        let places = self.lines.get(word).into_iter().flatten();
        places.filter_map(|(begin, end)| self.text.get(*begin as usize..*end as usize).map(str::trim))
    }

    /// Its words, in no order.
    pub fn words(&self) -> impl Iterator<Item = &str> {
        self.lines.keys().map(AsRef::as_ref)
    }
}

/// Phonemes of espeak-ng's `en-us` in the International Phonetic Alphabet, with phones of ARPAbet. The longest one that fits
/// is taken.
const PHONEMES: &[(&str, &str)] = &[
    ("aɪɚ", "AY ER"),
    ("aɪə", "AY AH"),
    ("aʊɚ", "AW ER"),
    ("ɔːɹ", "AO R"),
    ("oːɹ", "AO R"),
    ("ɑːɹ", "AA R"),
    ("aɪ", "AY"),
    ("aʊ", "AW"),
    ("dʒ", "JH"),
    ("eɪ", "EY"),
    ("iə", "IY AH"),
    ("iː", "IY"),
    ("n̩", "AH N"),
    ("oʊ", "OW"),
    ("oː", "AO"),
    ("tʃ", "CH"),
    ("uː", "UW"),
    ("ɐɹ", "ER"),
    ("ɑː", "AA"),
    ("ɔɪ", "OY"),
    ("ɔː", "AO"),
    ("əl", "AH L"),
    ("əʊ", "OW"),
    ("ɛɹ", "EH R"),
    ("ɜː", "ER"),
    ("ɪɹ", "IH R"),
    ("ʊɹ", "UH R"),
    ("a", "AE"),
    ("b", "B"),
    ("d", "D"),
    ("e", "EH"),
    ("f", "F"),
    ("h", "HH"),
    ("i", "IY"),
    ("j", "Y"),
    ("k", "K"),
    ("l", "L"),
    ("m", "M"),
    ("n", "N"),
    ("o", "OW"),
    ("p", "P"),
    ("s", "S"),
    ("t", "T"),
    ("u", "UW"),
    ("v", "V"),
    ("w", "W"),
    ("x", "K"),
    ("z", "Z"),
    ("æ", "AE"),
    ("ð", "DH"),
    ("ŋ", "NG"),
    ("ɐ", "AH"),
    ("ɑ", "AA"),
    ("ɒ", "AA"),
    ("ɔ", "AO"),
    ("ə", "AH"),
    ("ɚ", "ER"),
    ("ɛ", "EH"),
    ("ɜ", "ER"),
    ("ɡ", "G"),
    ("ɪ", "IH"),
    ("ɬ", "L"),
    ("ɹ", "R"),
    ("ɾ", "T"),
    ("ʃ", "SH"),
    ("ʊ", "UH"),
    ("ʌ", "AH"),
    ("ʒ", "ZH"),
    ("θ", "TH"),
    ("ᵻ", "IH"),
];

/// Signs that are no sound of their own: stress, length, ties, separators, the glottal stop.
fn is_silent(c: char) -> bool {
    matches!(c, 'ˈ' | 'ˌ' | 'ː' | '_' | '\u{361}' | '\u{200d}' | 'ʔ' | '-' | '\u{303}' | ' ')
}

/// Phones of ARPAbet for phonemes of espeak-ng; `None` for a sound that English lacks.
fn arpabet(phonemes: &str) -> Option<String> {
    // The tap stands for /t/ and /d/; what espeak-ng marks as a switch of language, "(en)", is no sound.
    let mut phones = Vec::new();
    let mut rest = phonemes;
    while let Some(first) = rest.chars().next() {
        if first == '(' {
            rest = rest.split_once(')')?.1;
        } else if is_silent(first) {
            rest = &rest[first.len_utf8()..];
        } else {
            let fits = PHONEMES.iter().filter(|(phoneme, _)| rest.starts_with(phoneme));
            let (phoneme, sounds) = fits.max_by_key(|(phoneme, _)| phoneme.len())?;
            phones.push(*sounds);
            rest = &rest[phoneme.len()..];
        }
    }
    (!phones.is_empty()).then(|| phones.join(" "))
}

/// Pronounces words by espeak-ng's letter-to-sound rules for American English.
#[derive(Debug, Clone)]
pub struct LetterToSound(Program);

impl LetterToSound {
    /// Finds espeak-ng on a search path.
    ///
    /// # Errors
    /// [`SpeechError::Missing`].
    pub fn find(path: Option<&std::ffi::OsStr>) -> Result<Self, SpeechError> {
        Program::find("espeak-ng", "espeak-ng", path).map(Self)
    }

    /// Phones of words of letters and apostrophes, in their order; `None` for a word with sounds that English lacks.
    ///
    /// # Errors
    /// [`SpeechError`]: the program fails, or gives another number of words.
    pub fn pronounce(&self, words: &[&str], limits: &Limits) -> Result<Vec<Option<String>>, SpeechError> {
        if words.is_empty() {
            return Ok(Vec::new());
        }
        // Each word is a paragraph, which gives it a line of its own.
        let text = words.join("\n\n");
        let arguments = ["-v", "en-us", "-q", "--ipa", "--stdin"].map(Into::into);
        let output = self.0.run(&arguments, text.as_bytes(), MAX_PHONEMES, limits)?;
        let output = String::from_utf8_lossy(&output);
        let lines: Vec<&str> = output.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        if lines.len() != words.len() {
            let problem = format!("it gave {} pronunciations for {} words", lines.len(), words.len());
            return Err(SpeechError::Failed { program: self.0.name().into(), problem });
        }
        Ok(lines.into_iter().map(arpabet).collect())
    }
}

/// Least number of changed, missing and additional phones between two pronunciations.
#[must_use]
pub fn phone_errors(said: &str, right: &str) -> usize {
    let (said, right): (Vec<&str>, Vec<&str>) = (said.split(' ').collect(), right.split(' ').collect());
    crate::accuracy::edit_distance(&said, &right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dictionary_has_all_variants() {
        let dictionary = Dictionary::of("Sac S AE K\nthe DH AH\nthe(2) DH IY\n\nbroken\n'em AH M\n".into());
        assert_eq!(dictionary.look_up("the").collect::<Vec<_>>(), ["DH AH", "DH IY"]);
        assert_eq!(dictionary.look_up("sac").collect::<Vec<_>>(), ["S AE K"]);
        assert_eq!(dictionary.look_up("'em").count() + dictionary.look_up("broken").count(), 1);
        let refused = Dictionary::read(Path::new("/no/such.dict")).err().unwrap().to_string();
        assert!(refused.starts_with("/no/such.dict: "), "{refused}");
    }

    #[test]
    fn phonemes_become_phones() {
        assert_eq!(arpabet("v_ˈɑː_k_s_əl").as_deref(), Some("V AA K S AH L"));
        assert_eq!(arpabet("ˈaɪsəʒɚfˌɪs").as_deref(), Some("AY S AH ZH ER F IH S"));
        assert_eq!(arpabet("(en)sˈæk(de)").as_deref(), Some("S AE K"));
        assert_eq!(arpabet("tʃˈɔːɹd").as_deref(), Some("CH AO R D"));
        assert_eq!((arpabet("ʘ"), arpabet(""), arpabet("(en")), (None, None, None));
    }
}
