//! The quantised PLY of iVR-GS: 24 bytes a Gaussian and 5,120 bytes of codebooks.
//!
//! Element `gaussians` holds the position as half-precision bit patterns in `short`, and each other property as an
//! index (`uchar`). The index refers to element `codebook_centers`: 256 rows of ten half-precision properties. The
//! components of a vector share one codebook, the quaternion has one for w and one for x, y, z.

use glam::Vec3;
use half::f16;
use rayon::prelude::*;

use crate::splat::codebook::{Codebook, SIZE};
use crate::splat::editable_columns::PROPERTIES;
use crate::splat::ply::{OutElement, OutProperty, OutValues, Scalar, Table};
use crate::splat::problem::{Problem, Warning, WarningCode};
use sg_scene::model::{Gaussians, ShadingColumns};

/// The codebooks in file order.
const BOOKS: [&str; 10] = [
    "opacity",
    "scaling",
    "rotation_re",
    "rotation_im",
    "normal",
    "offset_color",
    "diffuse_factor",
    "shininess",
    "ambient_factor",
    "specular_factor",
];

/// Reads both elements; the shading columns are as the codebooks store them.
pub(crate) fn read(table: &Table<'_>, centres: &Table<'_>) -> Result<Gaussians, Problem> {
    table.require(&PROPERTIES, "a quantised iVR-GS file needs its 21 columns: write it again")?;
    if centres.rows == 0 || centres.rows > SIZE {
        let what = format!("{} rows", centres.rows);
        return Err(Problem::new("element codebook_centers", what, format!("a codebook has 1 to {SIZE} centres")));
    }
    let halves = |bits: [u16; 3]| Vec3::from_array(bits.map(|b| f16::from_bits(b).to_f32()));
    let position = match table.column("x").map(|c| c.scalar) {
        Some(Scalar::F32 | Scalar::F64) => table.floats(["x", "y", "z"], Vec3::from_array)?,
        _ => table.bits16(["x", "y", "z"], halves)?,
    };
    let book = |name| book(centres, name);
    let (opacity, scaling, normal) = (book("opacity")?, book("scaling")?, book("normal")?);
    let (real, imaginary, offset) = (book("rotation_re")?, book("rotation_im")?, book("offset_color")?);
    let scalar = |name, centres: [f32; SIZE]| table.bytes([name], |[i]| look_up(&centres, i));
    let vec3 = |names, centres: [f32; SIZE]| table.bytes(names, |i| Vec3::from_array(i.map(|i| look_up(&centres, i))));
    check_indices(table, centres.rows)?;
    let rotation = table.bytes(["rot_0", "rot_1", "rot_2", "rot_3"], |[w, x, y, z]| {
        [look_up(&real, w), look_up(&imaginary, x), look_up(&imaginary, y), look_up(&imaginary, z)]
    })?;
    let shading = ShadingColumns {
        offset_color: vec3(["offset_color_0", "offset_color_1", "offset_color_2"], offset)?,
        normal: vec3(["normal_0", "normal_1", "normal_2"], normal)?,
        ambient: scalar("ambient_factor", book("ambient_factor")?)?,
        diffuse: scalar("diffuse_factor", book("diffuse_factor")?)?,
        specular: scalar("specular_factor", book("specular_factor")?)?,
        shininess: scalar("shininess", book("shininess")?)?,
    };
    Ok(Gaussians {
        position,
        rotation,
        log_scale: vec3(["scale_0", "scale_1", "scale_2"], scaling)?,
        opacity_logit: scalar("opacity", opacity)?,
        shading: Some(shading),
        harmonics: None,
        extra: table.extra(|name| PROPERTIES.contains(&name)),
        antialiased: false,
    })
}

/// One codebook, padded with its first centre.
fn book(centres: &Table<'_>, name: &'static str) -> Result<[f32; SIZE], Problem> {
    centres.require(&[name], "a quantised iVR-GS file needs its ten codebooks: write it again")?;
    let values = match centres.column(name).map(|c| c.scalar) {
        Some(Scalar::F32 | Scalar::F64) => centres.floats([name], |[x]| x)?,
        _ => centres.bits16([name], |[bits]| f16::from_bits(bits).to_f32())?,
    };
    let mut out = [values.first().copied().unwrap_or_default(); SIZE];
    out.iter_mut().zip(values).for_each(|(to, from)| *to = from);
    Ok(out)
}

fn look_up(centres: &[f32; SIZE], index: u8) -> f32 {
    centres[usize::from(index)]
}

/// Refuses an index past the end of a short codebook.
fn check_indices(table: &Table<'_>, rows: usize) -> Result<(), Problem> {
    if rows == SIZE {
        return Ok(());
    }
    for name in PROPERTIES.into_iter().skip(3) {
        let indices = table.bytes([name], |[i]| i)?;
        if let Some(row) = indices.iter().position(|&i| usize::from(i) >= rows) {
            return Err(Problem::new(
                format!("element gaussians, row {row}, property {name}"),
                format!("the index is past the end of a codebook of {rows} centres"),
                "the file is damaged: write it again",
            ));
        }
    }
    Ok(())
}

/// A unit in this format's terms, ready to be written.
pub(crate) struct Quantised {
    position: Vec<[u16; 3]>,
    /// Index columns in the order of [`PROPERTIES`] after the position, several to one array.
    indices: [Vec<u8>; 10],
    centres: [Vec<i16>; 10],
}

impl Quantised {
    /// Quantises Gaussians; `stored` are their shading columns in the file's convention.
    ///
    /// # Errors
    /// A position that half precision cannot hold.
    pub(crate) fn new(g: &Gaussians, stored: &ShadingColumns, warnings: &mut Vec<Warning>) -> Result<Self, Problem> {
        let limit = f16::MAX.to_f32();
        let beyond = |p: &Vec3| p.to_array().iter().any(|x| x.is_finite() && x.abs() > limit);
        if let Some(row) = g.position.iter().position(beyond) {
            return Err(Problem::new(
                format!("row {row}"),
                format!("its position is beyond ±{limit}, the greatest half-precision number"),
                "write it as --format ivrgs, or scale the scene",
            ));
        }
        let position: Vec<[u16; 3]> =
            g.position.par_iter().map(|p| p.to_array().map(|x| f16::from_f32(x).to_bits())).collect();
        let error = |(p, bits): (&Vec3, &[u16; 3])| {
            let back = Vec3::from_array(bits.map(|b| f16::from_bits(b).to_f32()));
            if p.is_finite() { (*p - back).abs().max_element() } else { 0.0 }
        };
        let worst = g.position.par_iter().zip(&position).map(error).reduce(|| 0.0, f32::max);
        warnings.push(Warning::new(
            WarningCode::Lossy,
            format!(
                "positions are rounded to half precision (by up to {worst:e}), everything else to 256 values a column"
            ),
        ));
        // iVR-GS normalises quaternions before it makes their codebooks.
        let unit: Vec<[f32; 4]> = (0..g.len())
            .into_par_iter()
            .map(|i| {
                let q = g.unit_rotation(i);
                [q.w as f32, q.x as f32, q.y as f32, q.z as f32]
            })
            .collect();
        let real: Vec<f32> = unit.par_iter().map(|q| q[0]).collect();
        let imaginary: Vec<f32> = unit.par_iter().flat_map_iter(|q| [q[1], q[2], q[3]]).collect();
        // In the order of BOOKS.
        let columns: [&[f32]; 10] = [
            &g.opacity_logit,
            bytemuck::cast_slice(&g.log_scale),
            &real,
            &imaginary,
            bytemuck::cast_slice(&stored.normal),
            bytemuck::cast_slice(&stored.offset_color),
            &stored.diffuse,
            &stored.shininess,
            &stored.ambient,
            &stored.specular,
        ];
        let books = columns.map(Codebook::of);
        let mut indices: [Vec<u8>; 10] = Default::default();
        for ((to, book), values) in indices.iter_mut().zip(&books).zip(columns) {
            *to = book.encode(values);
        }
        Ok(Self { position, indices, centres: books.map(|b| b.bits()) })
    }

    /// The elements of the file; `g` gives the columns that are kept as they are.
    pub(crate) fn elements<'a>(&'a self, g: &'a Gaussians) -> Vec<OutElement<'a>> {
        let [opacity, scaling, real, imaginary, normal, offset, diffuse, shininess, ambient, specular] = &self.indices;
        let column = |name, values: &'a [u8], width, at| OutProperty::new(name, OutValues::U8(values), width, at);
        let bits: &[i16] = bytemuck::cast_slice(&self.position);
        let mut p: Vec<_> =
            [("x", 0), ("y", 1), ("z", 2)].map(|(n, at)| OutProperty::new(n, OutValues::I16(bits), 3, at)).into();
        p.push(column("opacity", opacity, 1, 0));
        p.extend([("normal_0", 0), ("normal_1", 1), ("normal_2", 2)].map(|(n, at)| column(n, normal, 3, at)));
        p.extend([("scale_0", 0), ("scale_1", 1), ("scale_2", 2)].map(|(n, at)| column(n, scaling, 3, at)));
        p.push(column("rot_0", real, 1, 0));
        p.extend([("rot_1", 0), ("rot_2", 1), ("rot_3", 2)].map(|(n, at)| column(n, imaginary, 3, at)));
        let offsets = [("offset_color_0", 0), ("offset_color_1", 1), ("offset_color_2", 2)];
        p.extend(offsets.map(|(n, at)| column(n, offset, 3, at)));
        p.push(column("diffuse_factor", diffuse, 1, 0));
        p.push(column("shininess", shininess, 1, 0));
        p.push(column("ambient_factor", ambient, 1, 0));
        p.push(column("specular_factor", specular, 1, 0));
        p.extend(g.extra.iter().filter(|e| !PROPERTIES.contains(&e.name.as_str())).map(OutProperty::extra));
        let book =
            |(name, centres): (&'static str, &'a Vec<i16>)| OutProperty::new(name, OutValues::I16(centres), 1, 0);
        vec![
            OutElement { name: "gaussians", rows: self.position.len(), properties: p },
            OutElement {
                name: "codebook_centers",
                rows: SIZE,
                properties: BOOKS.into_iter().zip(&self.centres).map(book).collect(),
            },
        ]
    }
}
