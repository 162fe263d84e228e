//! `progress`: the small window of a file that opens.

use std::process::ExitCode;

use sg_input::print;
use sg_viewer::window::{ProgressUpdate, show_progress};

/// Exit status after a person has cancelled. `supergaussian open` knows it.
const CANCELLED: u8 = 3;

#[derive(Debug, clap::Args)]
pub(crate) struct ProgressArgs {
    /// Name of the file
    name: String,
}

/// Shows the window until standard input ends or a person cancels.
pub(crate) fn run(args: &ProgressArgs) -> ExitCode {
    let read = |send: Box<dyn Fn(ProgressUpdate) + Send>| {
        let body = move || {
            for line in std::io::stdin().lines().map_while(Result::ok) {
                if let Some(update) = update(&line) {
                    send(update);
                }
            }
            send(ProgressUpdate::End);
        };
        // Without the thread the window closes with the process of `open`.
        if let Err(e) = std::thread::Builder::new().name("news".to_owned()).spawn(body) {
            print::status(&format!("supergaussian-render-node: {e}"));
        }
    };
    match show_progress(&args.name, read) {
        Ok(false) => ExitCode::SUCCESS,
        Ok(true) => ExitCode::from(CANCELLED),
        Err(e) => {
            print::status(&format!("supergaussian-render-node: {e}"));
            ExitCode::FAILURE
        }
    }
}

/// The news of a line `SHARE STEP`.
fn update(line: &str) -> Option<ProgressUpdate> {
    let (share, step) = line.split_once(' ')?;
    let share: f32 = share.parse().ok()?;
    Some(ProgressUpdate::Step(share, step.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_a_share_and_a_step() {
        assert_eq!(
            update("0.25 classifying voxels"),
            Some(ProgressUpdate::Step(0.25, "classifying voxels".to_owned()))
        );
        assert_eq!(update("soon"), None);
    }
}
