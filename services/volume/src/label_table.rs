//! Names and colours of labels, as files of label maps tell them.
//!
//! Two sources are read: the `Segment…` keys of a NRRD header, as 3D Slicer writes them, and the label descriptions of
//! ITK-SNAP.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use sg_input::{file, limits, printable};

use crate::histogram::COLORS;

/// Most labels of a table.
const MOST_ENTRIES: usize = 65_536;
/// Longest name in bytes. A number still fits behind it where names are limited to 128 bytes.
const MOST_NAME_BYTES: usize = 112;
/// Strongest change of a colour that was taken before.
const STRONGEST_TINT: f32 = 0.8;
/// What is left of the difference to the strongest change after each round of the colours.
const TINT_STEP: f32 = 0.6;

/// What a file tells of one label.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LabelEntry {
    /// Its name, printable and not empty.
    pub name: Option<String>,
    /// Its colour, RGB from 0 to 1.
    pub color: Option<[f32; 3]>,
}

/// Names and colours of labels.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LabelTable {
    entries: BTreeMap<i32, LabelEntry>,
}

/// A file of label descriptions was refused.
#[derive(Debug, thiserror::Error)]
pub enum LabelTableError {
    /// The file cannot be read.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A line describes no label.
    #[error(
        "{}: line {line}: `{text}` describes no label; give the label, red, green, blue (0 to 255), alpha, two flags and a \
         name in quotation marks, as ITK-SNAP does",
        .path.display()
    )]
    Line {
        /// The file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Its beginning, printable.
        text: String,
    },
    /// The file describes no label, or too many.
    #[error("{}: {labels} labels are described; give 1 to {MOST_ENTRIES}", .path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Number of labels up to there.
        labels: usize,
    },
}

impl LabelTable {
    /// What the table tells of a label.
    #[must_use]
    pub fn get(&self, label: i32) -> Option<&LabelEntry> {
        self.entries.get(&label)
    }

    /// The labels, by increasing number.
    pub fn labels(&self) -> impl Iterator<Item = i32> {
        self.entries.keys().copied()
    }

    /// The table of ITK-SNAP's label descriptions: lines of a label, red, green, blue, alpha, two flags, and a name in
    /// quotation marks.
    ///
    /// # Errors
    /// [`LabelTableError`]: one line with the file, the line and a remedy.
    pub fn load(path: &Path) -> Result<Self, LabelTableError> {
        let io = |source| LabelTableError::Io { path: path.to_owned(), source };
        let text = file::read_text(path, limits::TEXT_BYTES).map_err(io)?;
        let mut table = Self::default();
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let Some((label, entry)) = description(line) else {
                let text = printable(&line.chars().take(60).collect::<String>()).into_owned();
                return Err(LabelTableError::Line { path: path.to_owned(), line: number + 1, text });
            };
            table.entries.insert(label, entry);
            if table.entries.len() > MOST_ENTRIES {
                return Err(LabelTableError::Count { path: path.to_owned(), labels: table.entries.len() });
            }
        }
        if table.entries.is_empty() {
            return Err(LabelTableError::Count { path: path.to_owned(), labels: 0 });
        }
        Ok(table)
    }

    /// The table of the segments that a NRRD header has: `Segment0_Name`, `Segment0_Color` and `Segment0_LabelValue`. A segment
    /// without a value has its number plus 1, as in older files. Values that are no such thing are passed over, since the keys
    /// belong to another program.
    #[must_use]
    pub(crate) fn of_segments(pairs: &[(String, String)]) -> Self {
        let mut segments: BTreeMap<u32, (Option<i32>, LabelEntry)> = BTreeMap::new();
        for (key, value) in pairs {
            let Some((number, what)) = key.strip_prefix("Segment").and_then(|rest| rest.split_once('_')) else {
                continue;
            };
            let Ok(number) = number.parse::<u32>() else { continue };
            if segments.len() >= MOST_ENTRIES && !segments.contains_key(&number) {
                continue;
            }
            match what {
                "Name" => segments.entry(number).or_default().1.name = clean_name(value),
                "Color" => segments.entry(number).or_default().1.color = fractions(value),
                "LabelValue" => segments.entry(number).or_default().0 = value.trim().parse().ok(),
                _ => {}
            }
        }
        let label = |(number, (label, entry)): (u32, (Option<i32>, LabelEntry))| {
            Some((label.or_else(|| i32::try_from(number).ok()?.checked_add(1))?, entry))
        };
        Self { entries: segments.into_iter().filter_map(label).collect() }
    }
}

/// A colour for the label at this place of a list: the Okabe-Ito set, then lighter and darker ones of it.
#[must_use]
pub fn color_at(place: usize) -> [f32; 3] {
    let (round, at) = (place / COLORS.len(), place % COLORS.len());
    let goal = if round % 2 == 1 { 1.0 } else { 0.0 };
    let tint = STRONGEST_TINT * (1.0 - TINT_STEP.powi(round.div_ceil(2).min(64) as i32));
    COLORS[at].map(|channel| channel + tint * (goal - channel))
}

/// One line of ITK-SNAP's label descriptions.
fn description(line: &str) -> Option<(i32, LabelEntry)> {
    let (numbers, rest) = line.split_once('"')?;
    let (name, _) = rest.rsplit_once('"')?;
    let words: Vec<&str> = numbers.split_whitespace().collect();
    let &[label, red, green, blue, _, _, _] = words.as_slice() else { return None };
    let channel = |word: &str| word.parse::<u8>().ok().map(|x| f32::from(x) / 255.0);
    let color = [channel(red)?, channel(green)?, channel(blue)?];
    Some((label.parse().ok()?, LabelEntry { name: clean_name(name), color: Some(color) }))
}

/// Three numbers from 0 to 1.
fn fractions(text: &str) -> Option<[f32; 3]> {
    let mut numbers = text.split_whitespace().map(|word| word.parse::<f32>().ok().filter(|x| (0.0..=1.0).contains(x)));
    let color = [numbers.next()??, numbers.next()??, numbers.next()??];
    numbers.next().is_none().then_some(color)
}

/// A name of a file as the name of a unit: on one line, printable, not too long; `None` if nothing is left.
fn clean_name(text: &str) -> Option<String> {
    let words = text.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty());
    let line = words.collect::<Vec<_>>().join(" ");
    let mut name = printable(&line).into_owned();
    if name.len() > MOST_NAME_BYTES {
        let end = name.char_indices().map(|(at, c)| at + c.len_utf8()).take_while(|end| *end <= MOST_NAME_BYTES).last();
        name.truncate(end.unwrap_or(0));
        name.truncate(name.trim_end().len());
    }
    (!name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(of: &[(&str, &str)]) -> Vec<(String, String)> {
        of.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
    }

    #[test]
    fn segments_of_a_header_are_named_and_coloured() {
        let table = LabelTable::of_segments(&pairs(&[
            ("Segment0_Name", "  left\tkidney \u{1b}[31m"),
            ("Segment0_Color", "0.5 0.25 1"),
            ("Segment0_LabelValue", "7"),
            ("Segment1_Name", ""),
            ("Segment1_Color", "2 0 0"),
            ("Segment2_Name", &"x".repeat(400)),
            ("Segment99999999999_Name", "too far"),
            ("Segmentation_MasterRepresentation", "Binary labelmap"),
        ]));
        let of = |label| table.get(label).cloned().unwrap_or_default();
        assert_eq!(of(7), LabelEntry { name: Some("left kidney [31m".to_owned()), color: Some([0.5, 0.25, 1.0]) });
        assert_eq!(of(2), LabelEntry::default(), "nothing of it can be used");
        assert_eq!(of(3).name.map(|name| name.len()), Some(MOST_NAME_BYTES));
        assert_eq!(table.labels().collect::<Vec<_>>(), [2, 3, 7]);
    }

    #[test]
    fn descriptions_of_itk_snap_are_read_and_wrong_lines_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("labels.txt");
        let text = "# ITK-SnAP Label Description File\n    0     0    0    0        0  0  0    \"Clear Label\"\n\
                    \n    3   255    0   51        1  1  1    \"Caudate \"head\"\"\r\n";
        std::fs::write(&path, text).unwrap();
        let table = LabelTable::load(&path).unwrap();
        let caudate = LabelEntry { name: Some("Caudate \"head\"".to_owned()), color: Some([1.0, 0.0, 0.2]) };
        assert_eq!((table.get(3), table.labels().count()), (Some(&caudate), 2));
        for (wrong, part) in [
            ("1 0 0 0 1 1 1 \"a\"\n2 256 0 0 1 1 1 \"b\"\n", "line 2: `2 256"),
            ("1 0 0 0 1 1 1 no quotes\n", "line 1"),
            ("1 0 0 0 \"too few\"\n", "line 1"),
            ("# nothing\n", "0 labels are described"),
        ] {
            std::fs::write(&path, wrong).unwrap();
            let said = LabelTable::load(&path).unwrap_err().to_string();
            assert!(said.contains(part) && said.contains("labels.txt") && said.lines().count() == 1, "{said}");
        }
    }

    #[test]
    fn colors_of_many_labels_differ() {
        assert_eq!(color_at(0), COLORS[0]);
        let all: Vec<[f32; 3]> = (0..70).map(color_at).collect();
        for (i, a) in all.iter().enumerate() {
            assert!(a.iter().all(|x| (0.0..=1.0).contains(x)));
            for b in all.iter().take(i) {
                let apart: f32 = a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum();
                assert!(apart > 0.002, "{a:?} {b:?}");
            }
        }
    }
}
