//! What is said about a training that a signal has ended.

use std::path::Path;

use sg_input::number_format::grouped;

use crate::training_run::Trained;

/// How the work of the command has ended.
pub(crate) enum End {
    /// All is done.
    Whole,
    /// A signal has ended a training; its best scene is written.
    Stopped,
}

/// How the training of one volume goes on.
pub(crate) enum Further {
    /// By the same command with `--resume`.
    Resume,
    /// By the same command: it starts from the scene that was written.
    Same,
    /// From the scene that was written; there is no checkpoint.
    FromScene,
}

/// The line about a stopped training of one volume.
pub(crate) fn stopped_line(trained: &Trained, scene_file: &Path, further: &Further) -> String {
    let words = || std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
    let how = match further {
        Further::Resume => format!("`{}` goes on", command(words(), &["--resume"])),
        Further::Same => format!("`{}` goes on from it", command(words(), &[])),
        Further::FromScene => format!("--start {} trains it further", quoted(&scene_file.to_string_lossy())),
    };
    format!("stopped after {}; {} is the best scene so far; {how}", reached(trained), scene_file.display())
}

/// Steps and quality of a training.
pub(crate) fn reached(trained: &Trained) -> String {
    let steps = trained.report.iterations;
    let plural = if steps == 1 { "" } else { "s" };
    format!("{} step{plural} at {:.1} dB", grouped(steps as u64), trained.report.result.footprint_psnr_db)
}

/// A command line for a shell. New options stand first: after `--` they would be names of files.
fn command(words: impl Iterator<Item = String>, options: &[&str]) -> String {
    let options = options.iter().map(|option| (*option).to_owned());
    let words = words.filter(|word| word != "--resume").map(|word| quoted(&word));
    ["supergaussian".to_owned(), "fit".to_owned()].into_iter().chain(options).chain(words).collect::<Vec<_>>().join(" ")
}

/// A word for a shell.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./,:=@%+".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_line_is_that_of_a_shell_and_resumes_once() {
        let words = ["a b.raw", "--resume", "--out", "it's", "--seconds", "9.5", ""].map(str::to_owned);
        assert_eq!(
            command(words.into_iter(), &["--resume"]),
            r"supergaussian fit --resume 'a b.raw' --out 'it'\''s' --seconds 9.5 ''"
        );
    }
}
