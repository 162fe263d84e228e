//! Writing one PLY file.

use std::borrow::Cow;
use std::io::{self, Write};

use crate::format::compressed::Packed;
use crate::format::editable::make_editable;
use crate::format::ivrgs_quantised::Quantised;
use crate::format::ply::{self, OutElement};
use crate::format::problem::{Problem, Warning, WarningCode};
use crate::format::unit_comments::{UnitComments, convention_name};
use crate::format::{Format, activation, ivrgs, morton, three_dgs, unlit};
use sg_scene::model::{BaseUnit, Convention, Gaussians, Scene, SceneBox};

/// Why a file could not be written.
#[derive(Debug)]
pub(crate) enum WriteProblem {
    Io(io::Error),
    Unsuitable(Problem),
}

impl From<io::Error> for WriteProblem {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<Problem> for WriteProblem {
    fn from(problem: Problem) -> Self {
        Self::Unsuitable(problem)
    }
}

/// Refuses columns of unequal length and names that a header cannot hold.
pub(crate) fn check(unit: &BaseUnit) -> Result<(), Problem> {
    let place = || format!("unit `{}`", unit.name);
    unit.gaussians
        .check_lengths()
        .map_err(|e| Problem::new(place(), e.to_string(), "give every Gaussian all columns"))?;
    for (k, column) in unit.gaussians.extra.iter().enumerate() {
        let name = &column.name;
        let is_word =
            !name.is_empty() && name.len() <= 256 && name.chars().all(|c| !c.is_whitespace() && !c.is_control());
        if !is_word || unit.gaussians.extra.iter().take(k).any(|other| other.name == *name) {
            let what =
                format!("the extra column `{}` has a name twice or one that no PLY can hold", name.escape_debug());
            return Err(Problem::new(place(), what, "give it a name of its own without spaces"));
        }
    }
    Ok(())
}

/// Writes a scene's Gaussians as 3DGS.
pub(crate) fn three_dgs(out: &mut impl Write, scene: &Scene, warnings: &mut Vec<Warning>) -> Result<(), WriteProblem> {
    let flat = unlit::flatten(scene, warnings);
    vertex(out, &flat)
}

/// Writes a unit's Gaussians as 3DGS without its transform, opacity factor and palette, which stand in `scene.toml`.
pub(crate) fn three_dgs_columns(out: &mut impl Write, g: &Gaussians) -> Result<(), WriteProblem> {
    vertex(out, &unlit::with_harmonics(g))
}

/// What other programs write and read, too.
fn filter_comment(g: &Gaussians) -> Vec<String> {
    if g.antialiased { vec!["SplatRenderMode: mip".to_owned()] } else { Vec::new() }
}

fn vertex(out: &mut impl Write, g: &Gaussians) -> Result<(), WriteProblem> {
    let element = OutElement { name: "vertex", rows: g.len(), properties: three_dgs::properties(g) };
    Ok(ply::write(out, &filter_comment(g), &[element])?)
}

/// Writes a scene's Gaussians as a compressed PLY, in Morton order if asked.
pub(crate) fn compressed(
    out: &mut impl Write,
    scene: &Scene,
    reorder: bool,
    warnings: &mut Vec<Warning>,
) -> Result<(), WriteProblem> {
    let mut flat = unlit::flatten(scene, warnings);
    if reorder {
        flat = Cow::Owned(morton::reorder(&flat));
        let message = "the Gaussians are written in Morton order: masks and labels of the old file do not fit";
        warnings.push(Warning::new(WarningCode::Reordered, message));
    }
    let packed = Packed::new(&flat, warnings);
    Ok(ply::write(out, &filter_comment(&flat), &packed.elements(&flat))?)
}

/// What a unit's file says beside its columns.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Alone {
    /// Everything: it stands alone in a scene of this box.
    Yes(SceneBox),
    /// Only what the columns mean: the rest stands in `scene.toml`.
    No,
}

/// Writes an editable unit, as [`prepare`] gives it, in a convention.
pub(crate) fn editable(
    out: &mut impl Write,
    unit: &BaseUnit,
    format: Format,
    convention: Convention,
    alone: Alone,
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
        Alone::Yes(bounds) => UnitComments::of_unit(unit, convention, bounds),
        Alone::No => UnitComments::of_columns(unit, convention),
    };
    comments.extend(filter_comment(&unit.gaussians));
    if format == Format::IvrGsQuantised {
        if unit.gaussians.harmonics.is_some() {
            let message = format!("unit `{}`: its harmonics are not kept", unit.name);
            warnings.push(Warning::new(WarningCode::Lossy, message));
        }
        let quantised = Quantised::new(&unit.gaussians, &stored, warnings)?;
        return Ok(ply::write(out, &comments, &quantised.elements(&unit.gaussians))?);
    }
    let properties = ivrgs::properties(&unit.gaussians, &stored);
    let element = OutElement { name: "gaussians", rows: unit.gaussians.len(), properties };
    Ok(ply::write(out, &comments, &[element])?)
}

/// The unit as a file of this convention will hold it: with shading columns, and with offsets from 0 up where only those fit.
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
    let raised = out.gaussians.shading.as_ref().and_then(|s| ivrgs::raise_offsets(out.palette, s));
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
