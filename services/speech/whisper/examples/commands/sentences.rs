//! The sentences that are spoken, and those that the decoder knows: `tests/sentences`.

use std::path::Path;

fn lines(name: &str) -> Vec<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sentences").join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    text.lines().map(str::trim).filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

/// All commands, with every label, colour and percentage.
pub(crate) fn known() -> Vec<String> {
    let mut sentences = lines("commands.txt");
    for (place, values) in [("{label}", "labels.txt"), ("{color}", "colors.txt"), ("{percent}", "percents.txt")] {
        let values = lines(values);
        sentences = sentences
            .into_iter()
            .flat_map(|sentence| match sentence.contains(place) {
                true => values.iter().map(|value| sentence.replace(place, value)).collect(),
                false => vec![sentence],
            })
            .collect();
    }
    sentences
}

/// What is spoken: commands and other sentences, to calibrate with or to report.
pub(crate) struct Spoken {
    pub(crate) commands: Vec<String>,
    pub(crate) others: Vec<String>,
}

impl Spoken {
    pub(crate) fn calibration() -> Self {
        Self { commands: lines("spoken-calibration.txt"), others: lines("off-topic-calibration.txt") }
    }

    pub(crate) fn report() -> Self {
        Self { commands: lines("spoken-report.txt"), others: lines("off-topic-report.txt") }
    }
}

/// The labels, as a prompt has them.
pub(crate) fn labels() -> Vec<String> {
    lines("labels.txt")
}
