//! `supergaussian-fuzz`: runs one target. `ops/fuzz` calls it.

#[cfg(feature = "libfuzzer")]
mod engine;

use std::path::Path;
use std::process::ExitCode;

use sg_fuzz::{Stage, TARGETS, Target, corpus, named, seeds};
use sg_input::print;

const USAGE: &str = "supergaussian-fuzz list
supergaussian-fuzz replay TARGET FILE…         reads inputs once
supergaussian-fuzz seeds TARGET FOLDER         writes the right inputs
supergaussian-fuzz unpack TARGET FOLDER        writes the kept inputs
supergaussian-fuzz pack TARGET FOLDER          keeps the inputs of a folder
supergaussian-fuzz run TARGET …                runs the engine with these arguments; needs the feature libfuzzer";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["list"] => Ok(TARGETS.iter().map(|t| format!("{:<18} {}", t.name, t.about)).collect::<Vec<_>>().join("\n")),
        [act, name, rest @ ..] => named(name)
            .ok_or_else(|| format!("no target `{name}`; `supergaussian-fuzz list` names them"))
            .and_then(|target| run(act, target, rest)),
        _ => Err(USAGE.to_owned()),
    };
    match done {
        Ok(text) => {
            // Nothing is left to say where nobody listens.
            let _ = print::result(&text);
            ExitCode::SUCCESS
        }
        Err(error) => {
            print::status_lines(&error);
            ExitCode::from(2)
        }
    }
}

fn run(act: &str, target: &'static Target, rest: &[&str]) -> Result<String, String> {
    match (act, rest) {
        ("replay", files) => replay(target, files),
        ("seeds", [folder]) => {
            let seeds = seeds::of(target.name);
            for (number, seed) in seeds.iter().enumerate() {
                let path = Path::new(folder).join(format!("seed-{number}"));
                std::fs::write(&path, seed).map_err(|e| format!("{}: {e}", path.display()))?;
            }
            Ok(format!("{} inputs", seeds.len()))
        }
        ("unpack", [folder]) => counted(corpus::unpack(target.name, Path::new(folder))),
        ("pack", [folder]) => counted(corpus::pack(target.name, Path::new(folder))),
        #[cfg(feature = "libfuzzer")]
        ("run", arguments) => engine::run(target, arguments),
        _ => Err(USAGE.to_owned()),
    }
}

fn counted(done: Result<usize, corpus::CorpusError>) -> Result<String, String> {
    done.map(|inputs| format!("{inputs} inputs")).map_err(|e| e.to_string())
}

fn replay(target: &Target, files: &[&str]) -> Result<String, String> {
    let stage = Stage::open().map_err(|e| e.to_string())?;
    let mut lines = Vec::new();
    for file in files {
        let bytes =
            sg_input::file::read(Path::new(file), sg_input::limits::DATA_BYTES).map_err(|e| format!("{file}: {e}"))?;
        let said = if target.check(&stage, &bytes) { "accepted" } else { "refused" };
        lines.push(format!("{file}: {said}"));
    }
    Ok(lines.join("\n"))
}
