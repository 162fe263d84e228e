//! The folders of a composed scene in iVR-GS and NLI4VolVis: `TF01/neilf/point_cloud/iteration_<n>/point_cloud.ply`,
//! `TF02/…`, in the order of their names.

use std::path::{Path, PathBuf};

use crate::splat::problem::Problem;

/// The PLY of a unit within its iteration's folder.
pub(crate) const PLY_NAME: &str = "point_cloud.ply";
/// Most transfer functions of a scene.
const MAX_UNITS: usize = 4096;

/// The folder of a written unit; without training, it is iteration 0.
pub(crate) fn unit_folder(root: &Path, index: usize) -> PathBuf {
    root.join(format!("TF{:02}", index + 1)).join("neilf/point_cloud/iteration_0")
}

/// Names and PLY files of the units of a scene's folder, or of a folder of one unit.
pub(crate) fn find(root: &Path) -> Result<Vec<(String, PathBuf)>, Problem> {
    let mut names: Vec<_> = list(root)?
        .into_iter()
        .filter(|(name, path)| name.starts_with("TF") && path.is_dir())
        .map(|(name, _)| name)
        .collect();
    if names.len() > MAX_UNITS {
        return Err(Problem::new(
            "folder",
            format!("{} TF* folders", names.len()),
            format!("a scene has up to {MAX_UNITS}"),
        ));
    }
    names.sort();
    if names.is_empty() {
        let name = root.file_name().map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned());
        let own = [root.join("neilf/point_cloud"), root.join("point_cloud")];
        let Some(clouds) = own.into_iter().find(|p| p.is_dir()) else {
            return Err(Problem::new(
                "folder",
                "there is no scene.toml and no TF*/neilf/point_cloud",
                "give a Gaussian file, a scene.toml, or iVR-GS's output folder of one data set",
            ));
        };
        return Ok(vec![(name, latest(&clouds, "folder")?)]);
    }
    let unit = |name: String| {
        let ply = latest(&root.join(&name).join("neilf/point_cloud"), &format!("folder {name}"))?;
        Ok((name, ply))
    };
    names.into_iter().map(unit).collect()
}

/// The PLY of the highest iteration.
fn latest(clouds: &Path, place: &str) -> Result<PathBuf, Problem> {
    let missing = || {
        let what = format!("there is no neilf/point_cloud/iteration_*/{PLY_NAME}");
        Problem::new(place, what, "train it to the end, or move the folder away")
    };
    if !clouds.is_dir() {
        return Err(missing());
    }
    let number = |name: &str| name.strip_prefix("iteration_").and_then(|n| n.parse::<u64>().ok());
    let latest = list(clouds)?.into_iter().filter_map(|(name, path)| Some((number(&name)?, path))).max();
    latest.map(|(_, folder)| folder.join(PLY_NAME)).filter(|ply| ply.is_file()).ok_or_else(missing)
}

fn list(folder: &Path) -> Result<Vec<(String, PathBuf)>, Problem> {
    let failed =
        |e: std::io::Error| Problem::new(format!("folder {}", folder.display()), e.to_string(), "make it readable");
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        out.push((entry.file_name().to_string_lossy().into_owned(), entry.path()));
    }
    Ok(out)
}
