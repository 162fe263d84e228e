//! The names of 3DGS columns and of the harmonics columns that several PLY formats share.

use glam::Vec3;
use sg_scene::model::{ExtraColumn, ExtraValues, Gaussians, Harmonics};

use crate::splat::ply::{OutProperty, OutValues, Scalar, Table, f32_at};
use crate::splat::problem::Problem;

/// The constant spherical harmonic, 1/(2√π).
pub(crate) const C0: f64 = Harmonics::C0;

/// The remedy for a 3DGS file with missing columns.
pub(crate) const REMEDY: &str = "a 3DGS file needs x y z f_dc_0..2 opacity scale_0..2 rot_0..3";

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
        values: ExtraValues::F32(normals.iter().map(|n| n.to_array()[k]).collect()),
    };
    vec![axis("nx", 0), axis("ny", 1), axis("nz", 2)]
}

/// The comment for a compensated pixel filter, as other programs write and read it.
pub(crate) fn filter_comment(g: &Gaussians) -> Vec<String> {
    if g.antialiased { vec!["SplatRenderMode: mip".to_owned()] } else { Vec::new() }
}
