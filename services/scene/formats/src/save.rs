//! Writing a scene in any of its formats.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use glam::DMat4;

use crate::format::write::{self, Alone, WriteProblem};
use crate::format::{Format, Problem, Warning, WarningCode, ivrgs_folder, palette};
use crate::scene_file::SceneFile;
use crate::staged_file::{self, StagedFile};
use sg_scene::model::{BaseUnit, Convention, Scene};

/// How a scene is to be written.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SaveOptions {
    /// The format; without it the path's extension and the scene's columns decide.
    pub format: Option<Format>,
    /// For iVR-GS: the activation of the shading columns. Without it the unit's own, or `head-raw` for float and
    /// `head-activated` for quantised files.
    pub convention: Option<Convention>,
    /// For the compressed PLY: Morton order, which packs better but changes every Gaussian's index.
    pub reorder: bool,
}

/// What was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Saved {
    /// The format that was taken.
    pub format: Format,
    /// The files, the one to open first.
    pub files: Vec<PathBuf>,
    /// What the format could not keep.
    pub warnings: Vec<Warning>,
}

/// A scene that could not be written; what stood at the path is as it was, except that a `scene.toml`'s units may already be new.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// The system refused.
    #[error("{path}: {source}; nothing was written")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The format, the path or the options do not suit the scene.
    #[error("{path}: {problem}")]
    Unsuitable {
        /// The file or folder.
        path: PathBuf,
        /// What does not fit and what would.
        problem: Problem,
    },
}

/// Writes a scene; files appear whole, under a temporary name first.
///
/// By extension: `scene.toml` (any `.toml`) with one PLY for each base unit beside it; `.compressed.ply`; `.ply`, which is
/// ours for an editable unit and 3DGS for a scene drawn from harmonics unless a format is given; a folder for `ivrgs` and
/// `ivrgs-quantised`. 3DGS and compressed files hold all units as one, unlit; ours and iVR-GS's hold a single unit.
///
/// # Errors
/// [`SaveError`].
pub fn save(path: &Path, scene: &Scene, options: &SaveOptions) -> Result<Saved, SaveError> {
    let unsuitable = |problem| SaveError::Unsuitable { path: path.to_path_buf(), problem };
    let target = Target::of(path).ok_or_else(|| {
        unsuitable(Problem::new(
            "path",
            "its extension says no format",
            "end it with .ply, .compressed.ply or .toml, or give a folder and --format ivrgs",
        ))
    })?;
    let format = choose(target, scene, options).map_err(unsuitable)?;
    if options.reorder && format != Format::CompressedPly {
        return Err(unsuitable(Problem::new(
            "options",
            format!("{format} keeps the order"),
            "reorder only compressed files",
        )));
    }
    scene.units.iter().try_for_each(write::check).map_err(unsuitable)?;
    let mut warnings = Vec::new();
    let job = Job { path, scene, format, options };
    let written = match (target, format) {
        (_, Format::SceneToml) | (Target::Toml, _) => job.scene_toml(&mut warnings),
        (Target::Folder, _) => job.folder(&mut warnings),
        _ => job.single(&mut warnings).map(|()| vec![path.to_path_buf()]),
    };
    match written {
        Ok(files) => {
            Ok(Saved { format: if target == Target::Toml { Format::SceneToml } else { format }, files, warnings })
        }
        Err(WriteProblem::Unsuitable(problem)) => Err(unsuitable(problem)),
        Err(WriteProblem::Io(source)) => Err(SaveError::Write { path: path.to_path_buf(), source }),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Toml,
    CompressedPly,
    Ply,
    Folder,
}

impl Target {
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        if name.ends_with(".toml") {
            Some(Self::Toml)
        } else if name.ends_with(".compressed.ply") {
            Some(Self::CompressedPly)
        } else if name.ends_with(".ply") {
            Some(Self::Ply)
        } else {
            (path.is_dir() || !name.contains('.')).then_some(Self::Folder)
        }
    }
}

fn choose(target: Target, scene: &Scene, options: &SaveOptions) -> Result<Format, Problem> {
    let shaded = scene.units.iter().filter(|u| u.gaussians.shading.is_some()).count();
    let format = match (target, options.format) {
        (Target::Toml, None) => Format::SceneToml,
        (Target::Toml, Some(f @ (Format::SceneToml | Format::Ours))) => f,
        (Target::CompressedPly, None) => Format::CompressedPly,
        (Target::Ply, None) if shaded == 0 => Format::ThreeDgs,
        (Target::Ply, None) => Format::Ours,
        (Target::Ply | Target::CompressedPly, Some(f)) if f != Format::SceneToml => f,
        (Target::Folder, Some(f @ (Format::IvrGs | Format::IvrGsQuantised))) => f,
        (Target::Folder, _) => {
            return Err(Problem::new(
                "path",
                "it is a folder",
                "give --format ivrgs or ivrgs-quantised, or a .ply or .toml path",
            ));
        }
        (_, Some(f)) => {
            return Err(Problem::new("format", format!("{f} does not fit the path's extension"), "change one of them"));
        }
    };
    let is_single = target != Target::Folder && target != Target::Toml;
    if is_single && matches!(format, Format::Ours | Format::IvrGs | Format::IvrGsQuantised) && scene.units.len() != 1 {
        let what = format!("{format} holds one base unit in a file, the scene has {}", scene.units.len());
        let remedy = "write a scene.toml, an iVR-GS folder, or --format 3dgs, which makes them one";
        return Err(Problem::new("format", what, remedy));
    }
    Ok(format)
}

struct Job<'a> {
    path: &'a Path,
    scene: &'a Scene,
    format: Format,
    options: &'a SaveOptions,
}

impl Job<'_> {
    fn single(&self, warnings: &mut Vec<Warning>) -> Result<(), WriteProblem> {
        let mut out = StagedFile::create(self.path)?;
        match self.format {
            Format::ThreeDgs => write::three_dgs(&mut out, self.scene, warnings)?,
            Format::CompressedPly => write::compressed(&mut out, self.scene, self.options.reorder, warnings)?,
            _ => {
                let unit =
                    self.scene.units.first().ok_or_else(|| Problem::new("scene", "it has no unit", "add one"))?;
                let convention = self.convention(unit);
                let prepared = write::prepare(unit, convention, warnings);
                let alone = Alone::Yes(self.scene.bounds);
                write::editable(&mut out, &prepared, self.format, convention, alone, warnings)?;
                self.warn_of_unit(unit, warnings);
            }
        }
        out.commit()?;
        Ok(staged_file::sync_folder(self.path)?)
    }

    fn convention(&self, unit: &BaseUnit) -> Convention {
        match (self.format, self.options.convention, unit.convention) {
            (Format::IvrGs | Format::IvrGsQuantised, Some(asked), _) => asked,
            (Format::IvrGs, None, Convention::Ours | Convention::HeadActivated) => Convention::HeadRaw,
            (Format::IvrGsQuantised, None, Convention::Ours | Convention::HeadRaw) => Convention::HeadActivated,
            (Format::IvrGs | Format::IvrGsQuantised, None, own) => own,
            _ => Convention::Ours,
        }
    }

    fn warn_of_unit(&self, unit: &BaseUnit, warnings: &mut Vec<Warning>) {
        if unit.transfer_function.is_some() {
            let message = format!("unit `{}`: only a scene.toml keeps the path of its transfer function", unit.name);
            warnings.push(Warning::new(WarningCode::Lossy, message));
        }
        if matches!(self.format, Format::IvrGs | Format::IvrGsQuantised)
            && (unit.opacity != 1.0 || unit.transform != DMat4::IDENTITY)
        {
            let message = format!(
                "unit `{}`: iVR-GS knows no opacity factor and no transform; they stand in a comment",
                unit.name
            );
            warnings.push(Warning::new(WarningCode::Lossy, message));
        }
    }

    /// One PLY for each unit, then the scene file that names them.
    fn scene_toml(&self, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
        let names = file_names(&self.scene.units);
        let mut staged = Vec::with_capacity(names.len());
        let paths: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
        let mut file = SceneFile::of_scene(self.scene, &paths);
        for ((unit, name), entry) in self.scene.units.iter().zip(&names).zip(&mut file.units) {
            let mut out = StagedFile::create(&self.path.with_file_name(name))?;
            if unit.gaussians.shading.is_none() && self.format != Format::Ours {
                write::three_dgs_columns(&mut out, &unit.gaussians)?;
            } else {
                // Giving a unit shading columns changes its palette, which the scene file has to say.
                let prepared = write::prepare(unit, Convention::Ours, warnings);
                entry.palette = Some(prepared.palette);
                entry.shading = Some(prepared.shading);
                entry.oriented_normals = Some(prepared.oriented_normals);
                write::editable(&mut out, &prepared, Format::Ours, Convention::Ours, Alone::No, warnings)?;
            }
            staged.push(out);
        }
        let mut files = vec![self.path.to_path_buf()];
        for out in staged {
            files.push(out.commit()?);
        }
        staged_file::replace(self.path, file.to_text().as_bytes())?;
        staged_file::sync_folder(self.path)?;
        Ok(files)
    }

    /// iVR-GS's folders, each with its palette checkpoint, made elsewhere and moved into place.
    fn folder(&self, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
        if self.path.is_dir() && std::fs::read_dir(self.path)?.next().is_some() {
            let remedy = "give a new folder, so that no old unit is taken for part of the scene";
            return Err(Problem::new("path", "the folder is not empty", remedy).into());
        }
        let parent = match self.path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".staged-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o777));
        }
        let staged = builder.tempdir_in(parent)?;
        let mut files = Vec::new();
        for (k, unit) in self.scene.units.iter().enumerate() {
            let folder = ivrgs_folder::unit_folder(staged.path(), k);
            std::fs::create_dir_all(&folder)?;
            let convention = self.convention(unit);
            let prepared = write::prepare(unit, convention, warnings);
            let mut out = StagedFile::create(&folder.join(ivrgs_folder::PLY_NAME))?;
            let alone = Alone::Yes(self.scene.bounds);
            write::editable(&mut out, &prepared, self.format, convention, alone, warnings)?;
            out.commit()?;
            let mut checkpoint = StagedFile::create(&folder.join(palette::FILE_NAME))?;
            checkpoint.write_all(&palette::write(prepared.palette, 0)?)?;
            checkpoint.commit()?;
            self.warn_of_unit(unit, warnings);
            files.push(ivrgs_folder::unit_folder(self.path, k).join(ivrgs_folder::PLY_NAME));
        }
        std::fs::rename(staged.path(), self.path)?;
        // What it named has moved; there is nothing left to remove.
        let _ = staged.keep();
        staged_file::sync_folder(self.path)?;
        Ok(files)
    }
}

/// A file name for each unit: its name in plain letters, told apart where two would be the same on any system.
fn file_names(units: &[BaseUnit]) -> Vec<String> {
    let mut names: Vec<String> = Vec::with_capacity(units.len());
    for unit in units {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '_' };
        let stem: String = unit.name.chars().take(64).map(plain).collect();
        let stem = if stem.is_empty() { "unit".to_owned() } else { stem };
        let is_taken = |name: &str| names.iter().any(|n| n.eq_ignore_ascii_case(name));
        let numbered = (2_usize..).map(|k| format!("{stem}-{k}.ply"));
        let name = std::iter::once(format!("{stem}.ply")).chain(numbered).find(|n| !is_taken(n));
        names.push(name.unwrap_or_default());
    }
    names
}
