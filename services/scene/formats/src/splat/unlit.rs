//! A scene as one set of Gaussians with fixed colours, for formats without base units and light.
//!
//! The colour of an editable Gaussian becomes palette + offset (its diffuse colour under full light). A unit's opacity
//! factor and transform go into its Gaussians. Normals become `nx ny nz`. Unchanged values keep their bits.

use std::borrow::Cow;

use glam::{DMat4, Vec3};
use rayon::prelude::*;

use crate::splat::activation::logit;
use crate::splat::columns::C0;
use crate::splat::columns::{is_normal, normal_columns};
use crate::splat::problem::{Warning, WarningCode};
use sg_scene::model::{BaseUnit, ExtraColumn, ExtraValues, Gaussians, Harmonics, SOURCE_PREFIX, Scene};

/// All units, one after another in scene order.
pub(crate) fn flatten<'a>(scene: &'a Scene, warnings: &mut Vec<Warning>) -> Cow<'a, Gaussians> {
    if scene.has_shading() {
        warnings.push(Warning::new(
            WarningCode::Lossy,
            "colours are written as palette + offset, unlit: palette, ka, kd, ks and β are not kept",
        ));
    }
    if let [unit] = scene.units.as_slice() {
        return flatten_unit(unit, warnings);
    }
    let message = format!("the {} base units become one", scene.units.len());
    warnings.push(Warning::new(WarningCode::Lossy, message));
    let parts: Vec<_> = scene.units.iter().map(|u| flatten_unit(u, warnings)).collect();
    Cow::Owned(concatenate(&parts, warnings))
}

fn flatten_unit<'a>(unit: &'a BaseUnit, warnings: &mut Vec<Warning>) -> Cow<'a, Gaussians> {
    let mut out = Cow::Borrowed(&unit.gaussians);
    if let Some(shading) = &unit.gaussians.shading {
        let color = |offset: &Vec3| (((unit.palette + *offset).as_dvec3() - 0.5) / C0).as_vec3().to_array();
        let dc = shading.offset_color.par_iter().map(color).collect();
        let g = out.to_mut();
        g.shading = None;
        g.harmonics = Some(Harmonics { degree: 0, dc, rest: vec![] });
        g.extra.retain(|e| !is_normal(&e.name) && !e.name.starts_with(SOURCE_PREFIX));
        g.extra.splice(0..0, normal_columns(&shading.normal));
    } else {
        out = with_harmonics(&unit.gaussians);
    }
    if unit.opacity != 1.0 {
        let factor = f64::from(unit.opacity);
        let scaled = |x: &mut f32| *x = logit(factor / (1.0 + (-f64::from(*x)).exp()));
        out.to_mut().opacity_logit.par_iter_mut().for_each(scaled);
    }
    if unit.transform != DMat4::IDENTITY {
        let g = out.to_mut();
        let all: Vec<usize> = (0..g.len()).collect();
        if !g.transform(&all, &unit.transform) {
            let message = format!("unit `{}` is stretched: its view-dependent colours are only turned", unit.name);
            warnings.push(Warning::new(WarningCode::Lossy, message));
        }
    }
    out
}

/// The Gaussians with harmonics: middle grey if they have none.
pub(crate) fn with_harmonics(g: &Gaussians) -> Cow<'_, Gaussians> {
    let mut out = Cow::Borrowed(g);
    if g.harmonics.is_none() {
        out.to_mut().harmonics = Some(Harmonics { degree: 0, dc: vec![[0.0; 3]; g.len()], rest: vec![] });
    }
    out
}

fn concatenate(parts: &[Cow<'_, Gaussians>], warnings: &mut Vec<Warning>) -> Gaussians {
    let antialiased = !parts.is_empty() && parts.iter().all(|p| p.antialiased);
    if !antialiased && parts.iter().any(|p| p.antialiased) {
        let message = "only some units were trained with a compensated pixel filter; the file drops this note";
        warnings.push(Warning::new(WarningCode::Lossy, message));
    }
    let mut out = Gaussians { antialiased, ..Gaussians::default() };
    let degree = parts.iter().filter_map(|p| p.harmonics.as_ref()).map(|h| h.degree).max().unwrap_or_default();
    let mut harmonics = Harmonics { degree, ..Harmonics::default() };
    let terms = harmonics.rest_per_gaussian();
    for part in parts {
        out.position.extend_from_slice(&part.position);
        out.rotation.extend_from_slice(&part.rotation);
        out.log_scale.extend_from_slice(&part.log_scale);
        out.opacity_logit.extend_from_slice(&part.opacity_logit);
        if let Some(h) = &part.harmonics {
            harmonics.dc.extend_from_slice(&h.dc);
            let k = h.rest_per_gaussian();
            for i in 0..part.len() {
                let row = h.rest.get(i * k..(i + 1) * k).unwrap_or_default();
                harmonics.rest.extend_from_slice(row);
                harmonics.rest.extend(std::iter::repeat_n([0.0; 3], terms - row.len()));
            }
        }
    }
    out.harmonics = Some(harmonics);
    let (kept, dropped) = concatenate_extra(parts);
    out.extra = kept;
    if !dropped.is_empty() {
        let message = format!("columns that some units lack are not kept: {}", dropped.join(", "));
        warnings.push(Warning::new(WarningCode::Lossy, message));
    }
    out
}

/// The extra columns that all parts have in one type, and the names of the others. Missing normals are zero.
fn concatenate_extra(parts: &[Cow<'_, Gaussians>]) -> (Vec<ExtraColumn>, Vec<String>) {
    let mut names: Vec<&str> = Vec::new();
    for name in parts.iter().flat_map(|p| &p.extra).map(|e| e.name.as_str()) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let (mut kept, mut dropped) = (Vec::new(), Vec::new());
    for name in names {
        let mut all: Option<ExtraValues> = None;
        let whole = parts.iter().all(|part| {
            let zeros = || ExtraValues::F32(vec![0.0; part.len()]);
            let found = part.extra.iter().find(|e| e.name == name).map(|e| e.values.clone());
            match (found.or_else(|| is_normal(name).then(zeros)), &mut all) {
                (Some(values), None) => {
                    all = Some(values);
                    true
                }
                (Some(values), Some(all)) => append(all, values),
                (None, _) => false,
            }
        });
        match all.filter(|_| whole) {
            Some(values) => kept.push(ExtraColumn { name: name.to_owned(), values }),
            None => dropped.push(name.to_owned()),
        }
    }
    (kept, dropped)
}

fn append(to: &mut ExtraValues, from: ExtraValues) -> bool {
    match (to, from) {
        (ExtraValues::I8(a), ExtraValues::I8(b)) => a.extend(b),
        (ExtraValues::U8(a), ExtraValues::U8(b)) => a.extend(b),
        (ExtraValues::I16(a), ExtraValues::I16(b)) => a.extend(b),
        (ExtraValues::U16(a), ExtraValues::U16(b)) => a.extend(b),
        (ExtraValues::I32(a), ExtraValues::I32(b)) => a.extend(b),
        (ExtraValues::U32(a), ExtraValues::U32(b)) => a.extend(b),
        (ExtraValues::F32(a), ExtraValues::F32(b)) => a.extend(b),
        (ExtraValues::F64(a), ExtraValues::F64(b)) => a.extend(b),
        _ => return false,
    }
    true
}
