//! Writing editable units as PLY files: ours, iVR-GS's float file, iVR-GS's quantised file, and iVR-GS's folder.

use std::borrow::Cow;
use std::io::Write;
use std::path::{Path, PathBuf};

use glam::DMat4;

use crate::splat::codebook_columns::Quantised;
use crate::splat::columns::filter_comment;
use crate::splat::editable::make_editable;
use crate::splat::format::{WriteJob, WriteProblem};
use crate::splat::ply::{self, OutElement};
use crate::splat::problem::{Problem, Warning, WarningCode};
use crate::splat::unit_comments::{UnitComments, convention_name};
use crate::splat::{activation, editable_columns, ivrgs_folder, palette};
use crate::staged_file::{self, StagedFile};
use sg_scene::model::{BaseUnit, Convention, Scene};

/// The storage of an editable unit's columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Storage {
    /// Floats, as used.
    AsUsed,
    /// Floats, in a convention of iVR-GS.
    IvrGsFloat,
    /// Codebook indices, in a convention of iVR-GS.
    IvrGsQuantised,
}

impl Storage {
    /// The convention of a unit's file: the requested one, else the unit's own if the storage has it.
    fn convention(self, requested: Option<Convention>, unit: &BaseUnit) -> Convention {
        match (self, requested, unit.convention) {
            (Self::AsUsed, ..) => Convention::Ours,
            (_, Some(requested), _) => requested,
            (Self::IvrGsFloat, None, Convention::Ours | Convention::HeadActivated) => Convention::HeadRaw,
            (Self::IvrGsQuantised, None, Convention::Ours | Convention::HeadRaw) => Convention::HeadActivated,
            (_, None, own) => own,
        }
    }
}

/// Writes a scene as a folder, or its only unit as one file.
pub(crate) fn write(
    job: &WriteJob<'_>,
    storage: Storage,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<PathBuf>, WriteProblem> {
    let write = if job.is_folder { write_folder } else { write_file };
    write(job, storage, warnings)
}

/// Writes the only unit of a scene as one file.
pub(crate) fn write_file(
    job: &WriteJob<'_>,
    storage: Storage,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<PathBuf>, WriteProblem> {
    let unit = job.scene.units.first().ok_or_else(|| Problem::new("scene", "it has no unit", "add one"))?;
    let convention = storage.convention(job.options.convention, unit);
    job.write_file(|out| {
        let prepared = prepare(unit, convention, warnings);
        write_unit(out, &prepared, storage, convention, Alone::Yes(job.scene), warnings)?;
        warn_of_unit(unit, storage, warnings);
        Ok(())
    })
}

/// Writes iVR-GS's folders, each with its palette checkpoint: under a temporary name first, then moved into place.
fn write_folder(
    job: &WriteJob<'_>,
    storage: Storage,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<PathBuf>, WriteProblem> {
    if job.path.is_dir() && std::fs::read_dir(job.path)?.next().is_some() {
        let remedy = "give a new folder, so that no old unit is taken for part of the scene";
        return Err(Problem::new("path", "the folder is not empty", remedy).into());
    }
    let parent = match job.path.parent() {
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
    for (k, unit) in job.scene.units.iter().enumerate() {
        let folder = ivrgs_folder::unit_folder(staged.path(), k);
        std::fs::create_dir_all(&folder)?;
        let convention = storage.convention(job.options.convention, unit);
        let prepared = prepare(unit, convention, warnings);
        let mut out = StagedFile::create(&folder.join(ivrgs_folder::PLY_NAME))?;
        write_unit(&mut out, &prepared, storage, convention, Alone::Yes(job.scene), warnings)?;
        out.commit()?;
        let mut checkpoint = StagedFile::create(&folder.join(palette::FILE_NAME))?;
        checkpoint.write_all(&palette::write(prepared.palette, 0)?)?;
        checkpoint.commit()?;
        warn_of_unit(unit, storage, warnings);
        files.push(ivrgs_folder::unit_folder(job.path, k).join(ivrgs_folder::PLY_NAME));
    }
    std::fs::rename(staged.path(), job.path)?;
    // The folder has moved, so there is nothing left to remove.
    let _ = staged.keep();
    staged_file::sync_folder(job.path)?;
    Ok(files)
}

fn warn_of_unit(unit: &BaseUnit, storage: Storage, warnings: &mut Vec<Warning>) {
    if unit.transfer_function.is_some() {
        let message = format!("unit `{}`: only a scene.toml keeps the path of its transfer function", unit.name);
        warnings.push(Warning::new(WarningCode::Lossy, message));
    }
    if storage != Storage::AsUsed && (unit.opacity != 1.0 || unit.transform != DMat4::IDENTITY) {
        let message =
            format!("unit `{}`: iVR-GS knows no opacity factor and no transform; they stand in a comment", unit.name);
        warnings.push(Warning::new(WarningCode::Lossy, message));
    }
}

/// The comments of a unit's file.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Alone<'a> {
    /// Everything: it stands alone in this scene.
    Yes(&'a Scene),
    /// Only the meaning of the columns: the rest stands in `scene.toml`.
    No,
}

/// Writes an editable unit, as [`prepare`] gives it, in a convention.
pub(crate) fn write_unit(
    out: &mut impl Write,
    unit: &BaseUnit,
    storage: Storage,
    convention: Convention,
    alone: Alone<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<(), WriteProblem> {
    let no_shading = Problem::new(format!("unit `{}`", unit.name), "it has no shading columns", "write it as 3dgs");
    let used = unit.gaussians.shading.as_ref().ok_or(no_shading)?;
    let stored = if convention == Convention::Ours {
        Cow::Borrowed(used)
    } else {
        let (stored, cut) = activation::deactivate(used, convention);
        if cut > 0 {
            let name = convention_name(convention);
            let message =
                format!("unit `{}`: {cut} shading values are beyond what `{name}` holds and are cut to it", unit.name);
            warnings.push(Warning::new(WarningCode::Lossy, message));
        }
        Cow::Owned(stored)
    };
    let mut comments = match alone {
        Alone::Yes(scene) => UnitComments::of_unit(unit, convention, scene),
        Alone::No => UnitComments::of_columns(unit, convention),
    };
    comments.extend(filter_comment(&unit.gaussians));
    if storage == Storage::IvrGsQuantised {
        if unit.gaussians.harmonics.is_some() {
            let message = format!("unit `{}`: its harmonics are not kept", unit.name);
            warnings.push(Warning::new(WarningCode::Lossy, message));
        }
        let quantised = Quantised::new(&unit.gaussians, &stored, warnings)?;
        return Ok(ply::write(out, &comments, &quantised.elements(&unit.gaussians))?);
    }
    let properties = editable_columns::properties(&unit.gaussians, &stored);
    let element = OutElement { name: "gaussians", rows: unit.gaussians.len(), properties };
    Ok(ply::write(out, &comments, &[element])?)
}

/// The unit as a file of this convention holds it: with shading columns, and without negative offsets for iVR-GS.
pub(crate) fn prepare<'a>(
    unit: &'a BaseUnit,
    convention: Convention,
    warnings: &mut Vec<Warning>,
) -> Cow<'a, BaseUnit> {
    let mut out = Cow::Borrowed(unit);
    if unit.gaussians.shading.is_none() {
        make_editable(out.to_mut(), warnings);
    }
    if convention == Convention::Ours {
        return out;
    }
    let raised = out.gaussians.shading.as_ref().and_then(|s| editable_columns::raise_offsets(out.palette, s));
    if let Some((palette, columns)) = raised {
        let message = format!(
            "unit `{}`: iVR-GS holds no negative offset colours; the palette was lowered from {} to {palette} and the offsets raised, colours stay",
            unit.name, unit.palette
        );
        warnings.push(Warning::new(WarningCode::Lossy, message));
        let to = out.to_mut();
        to.palette = palette;
        to.gaussians.shading = Some(columns);
    }
    out
}
