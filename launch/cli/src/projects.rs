//! `projects`: lists, opens and deletes the projects that no launch file names.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::Value;
use sg_stack::suggestion::suggestion;

use crate::input::VolumeOptions;
use crate::open;
use crate::subcommands::{json_of, run_of_scene};
use crate::terminal::{self, CommandResult, Failure, columns};

#[derive(Debug, clap::Args)]
pub(crate) struct ProjectsArgs {
    #[command(subcommand)]
    command: Option<ProjectsCommand>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum ProjectsCommand {
    /// Open a project with its scene in its own window and session
    #[command(after_help = "Example: supergaussian projects open tooth-1a2b3c4d5e6f")]
    Open {
        /// Name from `supergaussian projects`
        name: String,
    },
    /// Delete a project that no session has open
    #[command(after_help = "Example: supergaussian projects delete tooth-1a2b3c4d5e6f")]
    Delete {
        /// Name from `supergaussian projects`
        name: String,
    },
}

pub(crate) async fn projects(arguments: &ProjectsArgs, session_name: Option<&str>) -> CommandResult {
    match &arguments.command {
        None => list(arguments.json),
        Some(ProjectsCommand::Delete { name }) => {
            run_of_scene(&["projects", "delete", name.as_str()].map(OsString::from))
        }
        Some(ProjectsCommand::Open { name }) => {
            let (scene, project) = scene_of(name)?;
            open::open_path(&scene, project.as_deref(), &VolumeOptions::default(), session_name).await
        }
    }
}

/// The projects as the scene's executable reports them.
fn listed() -> Result<Vec<Value>, Failure> {
    match json_of("scene", &["projects".as_ref()])? {
        Value::Array(projects) => Ok(projects),
        _ => Err(Failure::Work("`supergaussian scene projects` printed no list".to_owned())),
    }
}

fn text<'a>(project: &'a Value, field: &str) -> &'a str {
    project[field].as_str().unwrap_or_default()
}

fn list(json: bool) -> CommandResult {
    let projects = listed()?;
    if json {
        terminal::print_line(&Value::Array(projects).to_string());
        return Ok(());
    }
    if projects.is_empty() {
        terminal::print_status("no projects are kept");
        return Ok(());
    }
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let mut rows = vec![["NAME", "SIZE", "CHANGED", "IN USE", "SCENE"].map(str::to_owned).to_vec()];
    rows.extend(projects.iter().map(|project| {
        let seconds = now.saturating_sub(project["changed"].as_u64().unwrap_or(0));
        let in_use = if project["in_use"] == true { "yes" } else { "no" };
        let size: u64 = ["bytes", "scene_bytes"].iter().filter_map(|part| project[part].as_u64()).sum();
        let scene = if project["error"].is_null() { text(project, "scene") } else { text(project, "error") };
        vec![
            text(project, "name").to_owned(),
            format!("{} kB", terminal::format_count(size.div_ceil(1000))),
            age(seconds),
            in_use.to_owned(),
            scene.to_owned(),
        ]
    }));
    for line in columns(&rows) {
        terminal::print_line(&line);
    }
    Ok(())
}

/// A time that has passed, in its largest unit.
fn age(seconds: u64) -> String {
    match seconds {
        0..60 => "just now".to_owned(),
        60..3600 => format!("{} min ago", seconds / 60),
        3600..172_800 => format!("{} h ago", seconds / 3600),
        _ => format!("{} days ago", seconds / 86_400),
    }
}

/// Paths of a project's scene and of the project. A scene that is kept without a project gets one.
fn scene_of(name: &str) -> Result<(PathBuf, Option<PathBuf>), Failure> {
    let projects = listed()?;
    let Some(project) = projects.iter().find(|p| text(p, "name") == name) else {
        let hint = suggestion(name, projects.iter().map(|p| text(p, "name")));
        return Err(Failure::Input(format!("there is no project `{name}`{hint}; `supergaussian projects` lists them")));
    };
    if let Some(error) = project["error"].as_str() {
        return Err(Failure::Input(error.to_owned()));
    }
    let (scene, path) = (PathBuf::from(text(project, "scene")), project["path"].as_str().map(PathBuf::from));
    if !scene.exists() {
        return Err(Failure::Input(format!(
            "{}: the scene of project `{name}` is gone; open a copy of it with `supergaussian open`, its edits are found again",
            scene.display()
        )));
    }
    Ok((scene, path))
}

#[cfg(test)]
mod tests {
    use super::age;

    #[test]
    fn ages_have_the_largest_unit_that_fits() {
        let ages = [0, 59, 60, 3599, 3600, 172_799, 172_800].map(age);
        assert_eq!(ages, ["just now", "just now", "1 min ago", "59 min ago", "1 h ago", "47 h ago", "2 days ago"]);
    }
}
