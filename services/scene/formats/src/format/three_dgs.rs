//! The PLY of 3D Gaussian Splatting (Kerbl et al. 2023) as its authors' program writes it.
//!
//! One element `vertex`: `x y z`, usually `nx ny nz` (zero), `f_dc_0..2`, `f_rest_…` (channel-major: all red, all green,
//! all blue; 0, 9, 24 or 45 of them), `opacity` (logit), `scale_0..2` (logarithm), `rot_0..3` (w, x, y, z, any length).
//! Normals and whatever else a file holds are kept as extra columns. Two relatives are told apart:
//!
//! - 2D Gaussian Splatting has no `scale_2`: its flat Gaussians get a thickness of a thousandth of their smaller extent.
//! - iVR-GS's first stage writes its columns in another order than its header names them; they are renamed.

use crate::format::ply::{Column, OutProperty, OutValues, Scalar, Table, f32_at};
use crate::format::problem::{Problem, Warning, WarningCode};
use glam::Vec3;
use sg_scene::model::{ExtraColumn, Gaussians, Harmonics};

const REMEDY: &str = "a 3DGS file needs x y z f_dc_0..2 opacity scale_0..2 rot_0..3";
/// Thickness of a flat Gaussian relative to its smaller extent, as a natural logarithm.
const LN_THICKNESS: f32 = -6.907_755_4;

/// Reads the rows of `vertex`.
pub(crate) fn read(table: &Table<'_>, warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
    refuse_relatives(table)?;
    let renamed = stage_one(table);
    if renamed.is_some() {
        warnings.push(Warning::new(
            WarningCode::Remapped,
            "a first-stage iVR-GS file, whose columns stand in another order than its header says: they were put right",
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

/// Reads `f_dc_*` and `f_rest_*`.
pub(crate) fn read_harmonics(table: &Table<'_>) -> Result<Harmonics, Problem> {
    let dc = table.floats(["f_dc_0", "f_dc_1", "f_dc_2"], |c| c)?;
    let count = table.columns.iter().filter(|c| c.name.starts_with("f_rest_")).count();
    let degree = match count {
        0 => 0,
        9 => 1,
        24 => 2,
        45 => 3,
        _ => {
            return Err(Problem::new(
                format!("element {}", table.name),
                format!("{count} properties f_rest_…"),
                "spherical harmonics of degree 0 to 3 have 0, 9, 24 or 45 of them",
            ));
        }
    };
    let mut rest_columns = Vec::with_capacity(count);
    for i in 0..count {
        let name = format!("f_rest_{i}");
        table.require(&[&name], REMEDY)?;
        let column = table.column(&name).filter(|c| c.scalar == Scalar::F32);
        rest_columns.push(column.map(|c| c.offset).ok_or_else(|| {
            Problem::new(
                format!("element {}, property {name}", table.name),
                "its type is not float",
                "write it as float",
            )
        })?);
    }
    let per_gaussian = count / 3;
    let mut rest = vec![[0.0_f32; 3]; per_gaussian * table.rows];
    let (red, others) = rest_columns.split_at(per_gaussian);
    let (green, blue) = others.split_at(per_gaussian);
    table.fill(&mut rest, per_gaussian, |row, to| {
        for (((out, &r), &g), &b) in to.iter_mut().zip(red).zip(green).zip(blue) {
            *out = [f32_at(row, r), f32_at(row, g), f32_at(row, b)];
        }
    });
    Ok(Harmonics { degree, dc, rest })
}

/// The columns of a file, for a writer. `g` has no shading that matters: see [`crate::format::unlit`].
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

/// `f_dc_*` and `f_rest_*`, channel-major.
pub(crate) fn harmonics_properties(h: &Harmonics) -> Vec<OutProperty<'_>> {
    let mut out: Vec<_> = OutProperty::vector(["f_dc_0", "f_dc_1", "f_dc_2"], bytemuck::cast_slice(&h.dc)).collect();
    let terms = h.rest_per_gaussian();
    let values = OutValues::F32(bytemuck::cast_slice(&h.rest));
    for channel in 0..3 {
        for term in 0..terms {
            let name = format!("f_rest_{}", channel * terms + term);
            out.push(OutProperty::new(name, values, 3 * terms, 3 * term + channel));
        }
    }
    out
}

/// Whether a column is one that the model holds under its own name.
pub(crate) fn is_known(name: &str) -> bool {
    matches!(
        name,
        "x" | "y" | "z" | "opacity" | "scale_0" | "scale_1" | "scale_2" | "rot_0" | "rot_1" | "rot_2" | "rot_3"
    ) || is_harmonic(name)
}

/// Whether a column is part of the spherical harmonics.
pub(crate) fn is_harmonic(name: &str) -> bool {
    matches!(name, "f_dc_0" | "f_dc_1" | "f_dc_2") || name.starts_with("f_rest_")
}

/// Whether a column is a normal in the spelling of point clouds.
pub(crate) fn is_normal(name: &str) -> bool {
    matches!(name, "nx" | "ny" | "nz")
}

/// Columns of normals under the names of point clouds.
pub(crate) fn normal_columns(normals: &[Vec3]) -> Vec<ExtraColumn> {
    let axis = |name: &str, k: usize| ExtraColumn {
        name: name.to_owned(),
        values: sg_scene::model::ExtraValues::F32(normals.iter().map(|n| n.to_array()[k]).collect()),
    };
    vec![axis("nx", 0), axis("ny", 1), axis("nz", 2)]
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

/// The table with its columns under the right names, if it is a file of iVR-GS's first stage: the header says
/// `x y z f_dc f_rest opacity normal scale rot`, the rows hold position, normal, dc, rest, opacity, scale, rotation.
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
