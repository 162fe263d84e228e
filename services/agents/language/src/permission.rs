//! What an utterance may ask for, by its source.

use sg_proto::language::{Act, Clause, Source};

/// Acts that read or write a file.
pub const FILE_ACTS: [Act; 4] = [Act::Export, Act::SavePicture, Act::SaveCopy, Act::Open];

/// The reply to another program that asks for a file.
const NO_FILES: &str =
    "Files are only saved and opened for a person, in the window or by `supergaussian say`. Nothing was done.";

/// Why clauses may not be carried out for a source. `None`: they may.
///
/// A program may have a language model that reads labels of a scene. A label must not make it write a file.
#[must_use]
pub fn refusal(source: Source, clauses: &[Clause]) -> Option<&'static str> {
    let reaches_files = clauses.iter().any(|clause| FILE_ACTS.contains(&clause.act()));
    (source == Source::Program && reaches_files).then_some(NO_FILES)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grammar;

    fn clauses(utterance: &str) -> Vec<Clause> {
        grammar::parse(utterance, &grammar::sample_observation(&["sac", "vessel"])).unwrap().clauses
    }

    #[test]
    fn a_program_reaches_no_file() {
        let with_file = [
            "hide the sac and save a picture as front.png",
            "export the sac as sac.ply",
            "save a copy as copy.sgproj",
            "open heart.nrrd",
        ];
        for utterance in with_file {
            let clauses = clauses(utterance);
            assert!(!clauses.is_empty(), "{utterance}");
            assert!(refusal(Source::Program, &clauses).is_some(), "{utterance}");
            for person in [Source::Text, Source::Speech, Source::Unspecified] {
                assert_eq!(refusal(person, &clauses), None, "{utterance}");
            }
        }
        assert_eq!(refusal(Source::Program, &clauses("hide the sac, then undo")), None);
    }

    #[test]
    fn every_act_with_a_file_is_barred() {
        let barred: Vec<Act> = (1..)
            .map_while(|act| Act::try_from(act).ok())
            .filter(|act| {
                crate::commands::table::fields(*act).is_some_and(|fields| fields.iter().any(|f| f.name == "file"))
            })
            .collect();
        assert_eq!(barred, FILE_ACTS);
    }
}
