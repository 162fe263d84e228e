//! The float PLY of editable Gaussians: iVR-GS's intermediate file, and our own.
//!
//! One element `gaussians` of 21 `float` properties. The two differ only in the activation of the shading columns
//! ([`crate::splat::activation`]). A comment `convention = "…"` names it; without one it is guessed.

use glam::Vec3;
use rayon::prelude::*;

use crate::splat::columns::{harmonics_properties, is_harmonic, read_harmonics};
use crate::splat::ply::{OutProperty, OutValues, Table};
use crate::splat::problem::Problem;
use sg_scene::model::{Gaussians, ShadingColumns};

/// The properties in file order.
pub(crate) const PROPERTIES: [&str; 21] = [
    "x",
    "y",
    "z",
    "opacity",
    "normal_0",
    "normal_1",
    "normal_2",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
    "offset_color_0",
    "offset_color_1",
    "offset_color_2",
    "diffuse_factor",
    "shininess",
    "ambient_factor",
    "specular_factor",
];

/// Reads the rows of `gaussians`; the shading columns are as stored.
pub(crate) fn read(table: &Table<'_>) -> Result<Gaussians, Problem> {
    table.require(&PROPERTIES, "an iVR-GS or Super-Gaussian file needs its 21 columns: write it again")?;
    let vec3 = |names| table.floats(names, Vec3::from_array);
    let scalar = |name| table.floats([name], |[x]| x);
    let shading = ShadingColumns {
        offset_color: vec3(["offset_color_0", "offset_color_1", "offset_color_2"])?,
        normal: vec3(["normal_0", "normal_1", "normal_2"])?,
        ambient: scalar("ambient_factor")?,
        diffuse: scalar("diffuse_factor")?,
        specular: scalar("specular_factor")?,
        shininess: scalar("shininess")?,
    };
    // Our own files keep the harmonics of a scene that has both.
    let harmonics = table.column("f_dc_0").map(|_| read_harmonics(table)).transpose()?;
    let kept_harmonics = harmonics.is_some();
    Ok(Gaussians {
        position: vec3(["x", "y", "z"])?,
        rotation: table.floats(["rot_0", "rot_1", "rot_2", "rot_3"], |q| q)?,
        log_scale: vec3(["scale_0", "scale_1", "scale_2"])?,
        opacity_logit: scalar("opacity")?,
        shading: Some(shading),
        harmonics,
        extra: table.extra(|name| PROPERTIES.contains(&name) || kept_harmonics && is_harmonic(name)),
        antialiased: false,
    })
}

/// The columns of a file; `stored` are the shading columns in the file's convention.
pub(crate) fn properties<'a>(g: &'a Gaussians, stored: &'a ShadingColumns) -> Vec<OutProperty<'a>> {
    let scalar = |name, values: &'a [f32]| OutProperty::new(name, OutValues::F32(values), 1, 0);
    let normal = bytemuck::cast_slice(&stored.normal);
    let offset = bytemuck::cast_slice(&stored.offset_color);
    let mut out: Vec<_> = OutProperty::vector(["x", "y", "z"], bytemuck::cast_slice(&g.position)).collect();
    out.push(scalar("opacity", &g.opacity_logit));
    out.extend(OutProperty::vector(["normal_0", "normal_1", "normal_2"], normal));
    out.extend(OutProperty::vector(["scale_0", "scale_1", "scale_2"], bytemuck::cast_slice(&g.log_scale)));
    out.extend(OutProperty::vector(["rot_0", "rot_1", "rot_2", "rot_3"], bytemuck::cast_slice(&g.rotation)));
    out.extend(OutProperty::vector(["offset_color_0", "offset_color_1", "offset_color_2"], offset));
    out.push(scalar("diffuse_factor", &stored.diffuse));
    out.push(scalar("shininess", &stored.shininess));
    out.push(scalar("ambient_factor", &stored.ambient));
    out.push(scalar("specular_factor", &stored.specular));
    if let Some(h) = &g.harmonics {
        out.extend(harmonics_properties(h));
    }
    let clashes = |name: &str| PROPERTIES.contains(&name) || g.harmonics.is_some() && is_harmonic(name);
    out.extend(g.extra.iter().filter(|e| !clashes(&e.name)).map(OutProperty::extra));
    out
}

/// Offset colours for a format that holds only 0 to 1. The palette is lowered by the least negative offset; offsets
/// rise by the same. The colour of every Gaussian, palette plus offset, stays. Returns the palette and the columns, or
/// nothing where none is needed.
pub(crate) fn raise_offsets(palette: Vec3, columns: &ShadingColumns) -> Option<(Vec3, ShadingColumns)> {
    let least = columns.offset_color.par_iter().filter(|c| c.is_finite()).copied().reduce(|| Vec3::ZERO, Vec3::min);
    let lowered = (palette + least).clamp(Vec3::ZERO, Vec3::ONE);
    // The palette may be 0 already. Negative offsets are then cut, with a warning.
    if least == Vec3::ZERO || lowered == palette {
        return None;
    }
    let shift = palette - lowered;
    let mut columns = columns.clone();
    columns.offset_color.par_iter_mut().for_each(|c| *c += shift);
    Some((lowered, columns))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn raised_offsets_keep_every_colour() {
        let palette = Vec3::new(0.5, 0.25, 0.125);
        let offset_color = vec![Vec3::new(-0.25, 0.5, 0.0), Vec3::new(0.25, -0.25, 0.5), Vec3::splat(f32::NAN)];
        let columns = ShadingColumns { offset_color: offset_color.clone(), ..ShadingColumns::default() };
        let (lowered, raised) = raise_offsets(palette, &columns).unwrap();
        assert_eq!(lowered, Vec3::new(0.25, 0.0, 0.125));
        for (before, after) in offset_color.iter().zip(&raised.offset_color).take(2) {
            assert_eq!(palette + *before, lowered + *after);
            assert!(after.min_element() >= 0.0 && after.max_element() <= 1.0);
        }
        let fine = ShadingColumns { offset_color: vec![Vec3::splat(0.5)], ..ShadingColumns::default() };
        assert!(raise_offsets(palette, &fine).is_none());
        assert!(raise_offsets(Vec3::ZERO, &columns).is_none());
    }
}
