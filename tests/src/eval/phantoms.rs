//! Made volumes with labelled organs, fitted like measured ones: filled scenes to choose numbers on.

use glam::{DMat3, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sg_fit::labels::labels_of;
use sg_fit::{Options, direct_start};
use sg_volume::transfer::{ControlPoint, Scale, Units};
use sg_volume::{Grid, Scalars, TransferFunction, Volume};

use super::EvalError;
use super::solid::{direction, normal};
use super::subject::{Origin, Parametrisation, Subject};

/// Names of the phantoms: organs by their label, and organs by grey values that differ little.
pub const PHANTOMS: [&str; 2] = ["organs", "nuclei"];

/// Voxels along each axis.
const EDGE: usize = 80;

struct Organ {
    centre: DVec3,
    axes: DMat3,
    radii: DVec3,
}

impl Organ {
    fn contains(&self, p: DVec3) -> bool {
        (self.axes.transpose() * (p - self.centre) / self.radii).length_squared() < 1.0
    }
}

/// A phantom of at most `n` Gaussians.
///
/// # Errors
/// [`EvalError::Shape`] for an unknown name, [`EvalError::Data`] if the fit fails.
pub fn phantom(name: &str, n: usize, seed: u64) -> Result<Subject, EvalError> {
    let stream = PHANTOMS.iter().position(|p| *p == name).ok_or_else(|| EvalError::Shape(name.to_owned()))?;
    let wrong = |why: String| EvalError::Data { path: format!("phantom {name}"), why };
    let grey = name == "nuclei";
    let mut r = ChaCha8Rng::seed_from_u64(seed);
    r.set_stream(200 + stream as u64);
    let organs: Vec<Organ> = (0..12)
        .map(|k| {
            let size = if k < 4 { 0.42 } else { 0.26 } * r.random_range(0.7..1.2);
            let radii = size * DVec3::new(1.0, r.random_range(0.6..1.0), r.random_range(0.5..1.0));
            let x = direction(&mut r);
            let y = x.any_orthonormal_vector();
            Organ {
                centre: direction(&mut r) * r.random_range(0.0..0.6_f64),
                axes: DMat3::from_cols(x, y, x.cross(y)),
                radii,
            }
        })
        .collect();
    let body = |p: DVec3| (p / DVec3::new(0.95, 0.85, 0.9)).length_squared() < 1.0;
    let mut labels = vec![0_u8; EDGE.pow(3)];
    for (i, label) in labels.iter_mut().enumerate() {
        let voxel = [i % EDGE, i / EDGE % EDGE, i / (EDGE * EDGE)];
        let p = DVec3::from_array(voxel.map(|v| (v as f64 + 0.5) / EDGE as f64 * 2.0 - 1.0));
        if body(p) {
            let organ = organs.iter().rposition(|o| o.contains(p)).map(|k| k as u8 + 2);
            // A body of one label would hide its organs: only its outside is a boundary of opacity.
            *label = organ.unwrap_or(u8::from(grey));
        }
    }
    let values: Vec<u8> = if grey {
        let shade: Vec<f64> = (0..14).map(|l| if l == 0 { 0.0 } else { 110.0 + r.random_range(-25.0..25.0) }).collect();
        labels.iter().map(|l| (shade[*l as usize] + 6.0 * normal(&mut r)).clamp(0.0, 255.0) as u8).collect()
    } else {
        labels.clone()
    };
    let grid = || {
        let spacing = DVec3::splat(2.0 / EDGE as f64);
        Grid::new([EDGE; 3], spacing, DVec3::splat(-1.0), DMat3::IDENTITY).map_err(|e| wrong(e.to_string()))
    };
    let volume = |data: Vec<u8>| Volume::new(grid()?, Scalars::from(data), None).map_err(|e| wrong(e.to_string()));
    let points: &[(f64, f32)] = if grey {
        &[(0.0, 0.0), (60.0, 0.01), (140.0, 0.05), (255.0, 0.10)]
    } else {
        &[(0.0, 0.0), (0.5, 0.0), (0.5, 0.2), (13.0, 0.2)]
    };
    let function = TransferFunction {
        domain: [points[0].0, points[points.len() - 1].0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: points
            .iter()
            .map(|&(value, opacity)| ControlPoint { value, color: [0.8, 0.7, 0.6], opacity })
            .collect(),
        base_units: Vec::new(),
    };
    let options = Options { gaussians: n, seed, ..Options::default() };
    let field = volume(values)?.to_field();
    let start = direct_start(&field, &function, &options, |_| ()).map_err(|e| wrong(e.to_string()))?;
    let part = labels_of(&start.scene, &volume(labels)?).map_err(|e| wrong(e.to_string()))?;
    let target = part.iter().map(|p| *p == 2).collect();
    Ok(Subject {
        name: name.to_owned(),
        origin: Origin::Made,
        parametrisation: Parametrisation::Coherent,
        scene: start.scene,
        part,
        target,
    })
}
