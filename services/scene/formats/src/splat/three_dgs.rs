//! The PLY of 3D Gaussian Splatting (Kerbl et al. 2023) as its authors' program writes it.
//!
//! One element `vertex`: `x y z`, usually `nx ny nz` (zero), `f_dc_0..2`, `f_rest_…` (channel-major: all red, all
//! green, all blue; 0, 9, 24 or 45 of them), `opacity` (logit), `scale_0..2` (logarithm), `rot_0..3` (w, x, y, z, any
//! length). Normals and unknown columns are kept as extra columns. Two variants are recognised:
//!
//! - 2D Gaussian Splatting has no `scale_2`. Its flat Gaussians get a thousandth of their smaller extent as thickness.
//! - iVR-GS's first stage writes its columns in another order than its header. They are renamed.

use std::io::Write;
use std::path::PathBuf;

use glam::Vec3;
use sg_scene::model::Gaussians;

use crate::splat::columns::{REMEDY, filter_comment, harmonics_properties, is_known, is_normal, read_harmonics};
use crate::splat::editable_columns;
use crate::splat::format::{Format, PlyLayout, SplatWriter, WriteJob, WriteProblem};
use crate::splat::ply::{self, Column, OutElement, OutProperty, OutValues, PlyFile, Scalar, Table};
use crate::splat::ply_format::PlyFormat;
use crate::splat::problem::{Problem, Warning, WarningCode};
use crate::splat::unit_comments::orientation_of_unlit;
use crate::splat::unlit;

/// Thickness of a flat Gaussian relative to its smaller extent, as a natural logarithm.
const LN_THICKNESS: f32 = -6.907_755_4;

impl Format {
    /// The PLY of 3D Gaussian Splatting.
    pub const THREE_DGS: Self = Self(&PlyFormat {
        layout: Some(PlyLayout::new(
            &["vertex"],
            |file| file.has("vertex") && !file.has("chunk") && !file.has("gaussians"),
            read,
        )),
        writer: Some(SplatWriter {
            is_default_for: |extension, has_shading| extension == ".ply" && !has_shading,
            ..SplatWriter::new(write)
        }),
        ..PlyFormat::new("3dgs", "the PLY of 3D Gaussian Splatting; all units as one, unlit")
    });
}

fn read(file: &PlyFile, warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
    let table = file.required_table("vertex")?;
    warn_of_narrowing(&table, warnings);
    read_vertices(&table, warnings)
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    let comment = orientation_of_unlit(job.scene);
    job.write_file(|out| write_vertices(out, &unlit::flatten(job.scene, warnings), comment))
}

/// Writes a unit's columns without its transform, opacity factor and palette. `scene.toml` stores those.
pub(crate) fn write_columns(out: &mut impl Write, g: &Gaussians) -> Result<(), WriteProblem> {
    write_vertices(out, &unlit::with_harmonics(g), None)
}

fn write_vertices(out: &mut impl Write, g: &Gaussians, comment: Option<String>) -> Result<(), WriteProblem> {
    let comments: Vec<String> = filter_comment(g).into_iter().chain(comment).collect();
    let element = OutElement { name: "vertex", rows: g.len(), properties: properties(g) };
    Ok(ply::write(out, &comments, &[element])?)
}

/// Warns of `double` columns. They are held as `float`.
pub(crate) fn warn_of_narrowing(table: &Table<'_>, warnings: &mut Vec<Warning>) {
    let known = |name: &str| is_known(name) || editable_columns::PROPERTIES.contains(&name);
    let wide: Vec<_> =
        table.columns.iter().filter(|c| c.scalar == Scalar::F64 && known(&c.name)).map(|c| c.name.as_str()).collect();
    if !wide.is_empty() {
        let message = format!("double columns are held as float: {}", wide.join(", "));
        warnings.push(Warning::new(WarningCode::Narrowed, message));
    }
}

/// Reads the rows of `vertex`.
fn read_vertices(table: &Table<'_>, warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
    refuse_relatives(table)?;
    let renamed = stage_one(table);
    if renamed.is_some() {
        warnings.push(Warning::new(
            WarningCode::Remapped,
            "a first-stage iVR-GS file: its columns, which its header misnames, were renamed",
        ));
    }
    let table = renamed.as_ref().unwrap_or(table);
    table.require(
        &[
            "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2",
            "rot_3",
        ],
        REMEDY,
    )?;
    let position = table.floats(["x", "y", "z"], Vec3::from_array)?;
    let rotation = table.floats(["rot_0", "rot_1", "rot_2", "rot_3"], |q| q)?;
    let opacity_logit = table.floats(["opacity"], |[o]| o)?;
    let log_scale = if table.column("scale_2").is_some() {
        table.floats(["scale_0", "scale_1", "scale_2"], Vec3::from_array)?
    } else {
        warnings.push(Warning::new(
            WarningCode::Flattened,
            "a 2D Gaussian file (no scale_2): each Gaussian was made a thousandth as thick as its smaller extent",
        ));
        table.floats(["scale_0", "scale_1"], |[a, b]| Vec3::new(a, b, a.min(b) + LN_THICKNESS))?
    };
    let harmonics = read_harmonics(table)?;
    let extra = table.extra(is_known);
    Ok(Gaussians {
        position,
        rotation,
        log_scale,
        opacity_logit,
        shading: None,
        harmonics: Some(harmonics),
        extra,
        antialiased: false,
    })
}

/// The columns of a file, for a writer. `g` has no shading that matters: see [`crate::splat::unlit`].
pub(crate) fn properties(g: &Gaussians) -> Vec<OutProperty<'_>> {
    let mut out: Vec<_> = OutProperty::vector(["x", "y", "z"], bytemuck::cast_slice(&g.position)).collect();
    let normals: Vec<_> = ["nx", "ny", "nz"].iter().filter_map(|n| g.extra.iter().find(|e| e.name == *n)).collect();
    out.extend(normals.into_iter().map(OutProperty::extra));
    if let Some(h) = &g.harmonics {
        out.extend(harmonics_properties(h));
    }
    out.push(OutProperty::new("opacity", OutValues::F32(&g.opacity_logit), 1, 0));
    out.extend(OutProperty::vector(["scale_0", "scale_1", "scale_2"], bytemuck::cast_slice(&g.log_scale)));
    out.extend(OutProperty::vector(["rot_0", "rot_1", "rot_2", "rot_3"], bytemuck::cast_slice(&g.rotation)));
    out.extend(g.extra.iter().filter(|e| !is_known(&e.name) && !is_normal(&e.name)).map(OutProperty::extra));
    out
}

/// Refuses files that look like this one but mean something else.
fn refuse_relatives(table: &Table<'_>) -> Result<(), Problem> {
    let place = || format!("element {}", table.name);
    if table.column("f_offset_0").is_some() || table.column("f_anchor_feat_0").is_some() {
        return Err(Problem::new(
            place(),
            "these are the anchors of a Scaffold-GS scene, whose Gaussians a network makes for each view",
            "bake the scene to a 3DGS file first",
        ));
    }
    if table.column("diffuse_factor").is_some() {
        return Err(Problem::new(
            place(),
            "this is a TexGS-VolVis file, whose colours stand in a texture or in learned harmonics with shading",
            "export it as 3DGS or iVR-GS first",
        ));
    }
    Ok(())
}

/// The table with its columns under the right names, if iVR-GS's first stage wrote the file. The header says `x y z
/// f_dc f_rest opacity normal scale rot`, the rows hold position, normal, dc, rest, opacity, scale, rotation.
fn stage_one<'a>(table: &Table<'a>) -> Option<Table<'a>> {
    let rest = table.columns.iter().filter(|c| c.name.starts_with("f_rest_")).count();
    let numbered = |name: &str, n: usize| (0..n).map(|i| format!("{name}_{i}")).collect::<Vec<_>>();
    let xyz = || ["x", "y", "z"].map(str::to_owned).to_vec();
    let written = [
        xyz(),
        numbered("f_dc", 3),
        numbered("f_rest", rest),
        vec!["opacity".to_owned()],
        numbered("normal", 3),
        numbered("scale", 3),
        numbered("rot", 4),
    ]
    .concat();
    let meant = [
        xyz(),
        ["nx", "ny", "nz"].map(str::to_owned).to_vec(),
        numbered("f_dc", 3),
        numbered("f_rest", rest),
        vec!["opacity".to_owned()],
        numbered("scale", 3),
        numbered("rot", 4),
    ]
    .concat();
    let head = table.columns.get(..written.len())?;
    let matches = head.iter().zip(&written).all(|(c, w)| c.name == *w && c.scalar == Scalar::F32);
    if !matches {
        return None;
    }
    let rename = |(i, column): (usize, &Column)| match meant.get(i) {
        Some(name) => Column { name: name.clone(), ..column.clone() },
        None => column.clone(),
    };
    let mut renamed = table.clone();
    renamed.columns = table.columns.iter().enumerate().map(rename).collect();
    Some(renamed)
}
