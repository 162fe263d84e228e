//! The subcommands on projects: list, delete, back up and restore.
#![allow(clippy::print_stderr, reason = "a command line prints words to stderr")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Subcommand;
use serde::Serialize;
use sg_input::print;
use supergaussian_scene::journal;

use crate::project_folder::{FolderError, ProjectFolder};
use crate::report::{WRONG_INPUT, fail, print_json};

/// Subcommands on projects.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Prints the kept projects as JSON, or deletes one.
    ///
    /// Example: supergaussian scene projects
    Projects {
        #[command(subcommand)]
        command: Option<ProjectsCommand>,
    },
    /// Copies a project to a new file, also while it is open.
    ///
    /// The copy holds every change that was accepted before it began. It is a project itself. A file is never replaced.
    ///
    /// Example: supergaussian backup tooth-1a2b3c4d5e6f tooth-monday.sgproj
    Backup {
        /// Project file, or name from `supergaussian projects`
        project: PathBuf,
        /// The new file
        #[arg(value_name = "FILE")]
        copy: PathBuf,
    },
    /// Makes a new project from a backup.
    ///
    /// A project is never replaced. To go back to a backup, delete the project first and restore it under its name.
    ///
    /// Example: supergaussian restore tooth-monday.sgproj tooth-1a2b3c4d5e6f
    Restore {
        /// The backup
        #[arg(value_name = "FILE")]
        backup: PathBuf,
        /// The new project file, or a name in the folder of projects
        project: PathBuf,
    },
}

#[derive(Debug, Subcommand)]
pub(crate) enum ProjectsCommand {
    /// Deletes a project that no session has open, and its scene if that was made from a volume and has no other project.
    ///
    /// Example: supergaussian projects delete tooth-1a2b3c4d5e6f
    Delete {
        /// Name from `supergaussian projects`
        name: String,
    },
    /// Prints as JSON which scene a project is of.
    ///
    /// Example: supergaussian scene projects describe tooth-monday.sgproj
    Describe {
        /// Project file, or name from `supergaussian projects`
        project: PathBuf,
    },
    /// Prints as JSON where projects are kept, and scenes that were made from volumes.
    ///
    /// Example: supergaussian scene projects folders
    Folders,
}

/// A project.
#[derive(Serialize)]
struct ProjectReport<'a> {
    path: &'a Path,
    /// The scene's file when the project was last opened.
    scene: &'a Path,
    /// Number of accepted commands.
    revision: u64,
}

/// Runs a subcommand: 0 done, 1 the work failed, 2 the arguments or the input are wrong.
pub(crate) fn run(command: &Command) -> ExitCode {
    done(command).unwrap_or_else(|error| fail(&error, if error.is_input() { WRONG_INPUT } else { 1 }))
}

fn done(command: &Command) -> Result<ExitCode, FolderError> {
    let folder = ProjectFolder::of_user()?;
    match command {
        Command::Projects { command: None } => return Ok(print_json(&folder.list()?)),
        Command::Projects { command: Some(ProjectsCommand::Delete { name }) } => {
            for path in folder.delete(name)? {
                print::status(&format!("deleted {}", path.display()));
            }
        }
        Command::Projects { command: Some(ProjectsCommand::Describe { project }) } => {
            let path = folder.meant(project);
            let found = journal::describe(&path)?;
            return Ok(print_json(&ProjectReport { path: &path, scene: &found.scene, revision: found.revision }));
        }
        Command::Projects { command: Some(ProjectsCommand::Folders) } => return Ok(print_json(&folder.places())),
        Command::Backup { project, copy } => {
            journal::copy(&folder.meant(project), copy)?;
            print::status(&format!("{}: a copy of {}", copy.display(), folder.meant(project).display()));
        }
        Command::Restore { backup, project } => {
            let project = folder.for_new(project)?;
            journal::copy(backup, &project)?;
            print::status(&format!("{}: restored from {}", project.display(), backup.display()));
        }
    }
    Ok(ExitCode::SUCCESS)
}
