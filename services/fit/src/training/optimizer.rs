//! Adam (Kingma and Ba 2015) on the attributes of Gaussians.

use glam::Vec3;
use rayon::prelude::*;
use sg_raster::gradient::{GaussianGradient, Gradients};
use sg_scene::model::{Scene, ShadingColumns};

/// How many numbers one Gaussian has: position, log scale, rotation, opacity, offset colour, normal, ka, kd, ks, ln β.
pub(super) const NUMBERS: usize = 21;
/// The numbers of one Gaussian.
pub(super) type Numbers = [f32; NUMBERS];
/// Decay of the mean and of the mean square.
const DECAYS: [f32; 2] = [0.9, 0.999];
/// Least root of the mean square, as 3DGS.
const EPSILON: f32 = 1e-15;
/// Bounds of the logit of the opacity. Beyond, its derivatives vanish.
const LOGITS: [f32; 2] = [-9.0, 9.0];

/// Logit of an opacity up to which a Gaussian is hidden on purpose.
const HIDDEN_LOGIT: f32 = -15.0;
/// Bounds of ln β.
const LOG_SHININESS: [f32; 2] = [0.0, 5.3];

/// Learning rates: the greatest change of a number in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Of positions, in mean standard deviations of the Gaussian itself. 3DGS takes a share of the scene's extent, which
    /// fits one size of Gaussians alone.
    pub position: f32,
    /// Of logarithms of scales.
    pub log_scale: f32,
    /// Of components of unit quaternions.
    pub rotation: f32,
    /// Of logits of opacities.
    pub opacity: f32,
    /// Of offset colours.
    pub color: f32,
    /// Of components of unit normals.
    pub normal: f32,
    /// Of ka, kd and ks.
    pub shading: f32,
    /// Of logarithms of exponents β.
    pub log_shininess: f32,
}

impl Default for Rates {
    fn default() -> Self {
        Self {
            position: 0.06,
            log_scale: 0.03,
            rotation: 0.012,
            opacity: 0.05,
            color: 0.005,
            normal: 0.02,
            shading: 0.008,
            log_shininess: 0.02,
        }
    }
}

impl Rates {
    /// Only those of the shading: offset colours, normals, factors and exponents.
    #[must_use]
    pub fn of_shading(self) -> Self {
        Self { position: 0.0, log_scale: 0.0, rotation: 0.0, opacity: 0.0, ..self }
    }

    /// This share of all rates.
    #[must_use]
    pub fn times(self, share: f32) -> Self {
        Self {
            position: share * self.position,
            log_scale: share * self.log_scale,
            rotation: share * self.rotation,
            opacity: share * self.opacity,
            color: share * self.color,
            normal: share * self.normal,
            shading: share * self.shading,
            log_shininess: share * self.log_shininess,
        }
    }
}

/// The numbers of all Gaussians and what Adam remembers of them.
pub(super) struct Optimizer {
    rows: Vec<Row>,
    step: u32,
}

#[derive(Clone, Copy)]
struct Row {
    numbers: Numbers,
    mean: Numbers,
    square: Numbers,
    /// Mean standard deviation at the start.
    size: f32,
    has_normal: bool,
    /// Bounds of the offset colour, so that the diffuse colour stays within 0 and 1.
    palette: Vec3,
}

impl Optimizer {
    pub(super) fn new(scene: &Scene) -> Self {
        let rows = scene.units.iter().flat_map(|unit| {
            let (gaussians, palette) = (&unit.gaussians, unit.palette);
            let none = ShadingColumns::default();
            let shading = gaussians.shading.as_ref().unwrap_or(&none);
            let rows: Vec<Row> = (0..gaussians.len())
                .map(|i| {
                    let at = |column: &[f32]| column.get(i).copied().unwrap_or_default();
                    let of = |column: &[Vec3]| column.get(i).copied().unwrap_or_default();
                    let (scale, rotation) = (of(&gaussians.log_scale), gaussians.unit_rotation(i).as_quat());
                    let normal = of(&shading.normal);
                    let log_shininess = at(&shading.shininess).max(f32::MIN_POSITIVE).ln();
                    let parts: [&[f32]; 10] = [
                        &of(&gaussians.position).to_array(),
                        &scale.to_array(),
                        &[rotation.w, rotation.x, rotation.y, rotation.z],
                        &[at(&gaussians.opacity_logit)],
                        &of(&shading.offset_color).to_array(),
                        &normal.to_array(),
                        &[at(&shading.ambient)],
                        &[at(&shading.diffuse)],
                        &[at(&shading.specular)],
                        &[log_shininess],
                    ];
                    let mut numbers = [0.0; NUMBERS];
                    numbers.iter_mut().zip(parts.concat()).for_each(|(number, value)| *number = value);
                    Row {
                        numbers,
                        mean: [0.0; NUMBERS],
                        square: [0.0; NUMBERS],
                        size: (scale.element_sum() / 3.0).exp(),
                        has_normal: normal != Vec3::ZERO,
                        palette,
                    }
                })
                .collect();
            rows
        });
        Self { rows: rows.collect(), step: 0 }
    }

    /// Makes one step and writes the numbers to the scene. A Gaussian without any derivative stays, and so does what it remembers:
    /// no view of another unit moves it.
    pub(super) fn step(&mut self, scene: &mut Scene, gradients: &Gradients, rates: &Rates) {
        self.step += 1;
        let corrections = DECAYS.map(|decay| 1.0 - decay.powi(self.step.min(10_000) as i32));
        self.rows.par_iter_mut().zip(&gradients.gaussians).with_min_len(512).for_each(|(row, gradient)| {
            row.step(gradient, rates, corrections);
        });
        self.write_to(scene);
    }

    /// Writes the numbers to the scene.
    pub(super) fn write_to(&self, scene: &mut Scene) {
        write_numbers(scene, self.numbers());
    }

    /// The numbers of all Gaussians.
    pub(super) fn numbers(&self) -> impl Iterator<Item = &Numbers> {
        self.rows.iter().map(|row| &row.numbers)
    }

    /// The means of all Gaussians.
    pub(super) fn means(&self) -> impl Iterator<Item = &Numbers> {
        self.rows.iter().map(|row| &row.mean)
    }

    /// The mean squares of all Gaussians.
    pub(super) fn squares(&self) -> impl Iterator<Item = &Numbers> {
        self.rows.iter().map(|row| &row.square)
    }

    /// The optimizer of a start as it was after a step: numbers, means and mean squares, each in scene order.
    pub(super) fn restored(scene: &Scene, step: u32, [numbers, means, squares]: &[Vec<Numbers>; 3]) -> Self {
        let mut optimizer = Self { step, ..Self::new(scene) };
        for (row, ((numbers, mean), square)) in optimizer.rows.iter_mut().zip(numbers.iter().zip(means).zip(squares)) {
            (row.numbers, row.mean, row.square) = (*numbers, *mean, *square);
        }
        optimizer
    }
}

/// Writes numbers in scene order to a scene.
pub(super) fn write_numbers<'a>(scene: &mut Scene, mut numbers: impl Iterator<Item = &'a Numbers>) {
    for unit in &mut scene.units {
        let gaussians = &mut unit.gaussians;
        for (i, numbers) in (0..gaussians.len()).zip(numbers.by_ref()) {
            let [px, py, pz, sx, sy, sz, qw, qx, qy, qz, opacity, ..] = *numbers;
            gaussians.position[i] = Vec3::new(px, py, pz);
            gaussians.log_scale[i] = Vec3::new(sx, sy, sz);
            gaussians.rotation[i] = [qw, qx, qy, qz];
            gaussians.opacity_logit[i] = opacity;
            let Some(shading) = &mut gaussians.shading else { continue };
            let [.., r, g, b, nx, ny, nz, ambient, diffuse, specular, log_shininess] = *numbers;
            shading.offset_color[i] = Vec3::new(r, g, b);
            shading.normal[i] = Vec3::new(nx, ny, nz);
            shading.ambient[i] = ambient;
            shading.diffuse[i] = diffuse;
            shading.specular[i] = specular;
            shading.shininess[i] = log_shininess.exp();
        }
    }
}

impl Row {
    fn step(&mut self, gradient: &GaussianGradient, rates: &Rates, [mean_correction, square_correction]: [f32; 2]) {
        let slopes = self.slopes(gradient);
        if slopes.iter().all(|slope| *slope == 0.0) || !slopes.iter().all(|slope| slope.is_finite()) {
            return;
        }
        let rates = self.rates(rates);
        for k in 0..NUMBERS {
            let slope = slopes[k];
            self.mean[k] += (1.0 - DECAYS[0]) * (slope - self.mean[k]);
            self.square[k] += (1.0 - DECAYS[1]) * (slope * slope - self.square[k]);
            let change = (self.mean[k] / mean_correction) / ((self.square[k] / square_correction).sqrt() + EPSILON);
            self.numbers[k] -= rates[k] * change;
        }
        self.hold();
    }

    fn slopes(&self, gradient: &GaussianGradient) -> [f32; NUMBERS] {
        let GaussianGradient { position: p, log_scale: s, rotation: [w, x, y, z], offset_color: c, normal: n, .. } =
            *gradient;
        // By ln β: the exponent spans decades.
        let log_shininess = gradient.shininess * f64::from(self.numbers[NUMBERS - 1].exp());
        [
            p.x,
            p.y,
            p.z,
            s.x,
            s.y,
            s.z,
            w,
            x,
            y,
            z,
            gradient.opacity_logit,
            c.x,
            c.y,
            c.z,
            n.x,
            n.y,
            n.z,
            gradient.ambient,
            gradient.diffuse,
            gradient.specular,
            log_shininess,
        ]
        .map(|slope| slope as f32)
    }

    fn rates(&self, rates: &Rates) -> [f32; NUMBERS] {
        let place = rates.position * self.size;
        let normal = if self.has_normal { rates.normal } else { 0.0 };
        let (s, q, c, k) = (rates.log_scale, rates.rotation, rates.color, rates.shading);
        [
            place,
            place,
            place,
            s,
            s,
            s,
            q,
            q,
            q,
            q,
            rates.opacity,
            c,
            c,
            c,
            normal,
            normal,
            normal,
            k,
            k,
            k,
            rates.log_shininess,
        ]
    }

    /// Keeps numbers where they mean something.
    fn hold(&mut self) {
        let unit = |numbers: &mut [f32]| {
            let length = numbers.iter().map(|x| x * x).sum::<f32>().sqrt();
            if length > 0.0 {
                numbers.iter_mut().for_each(|x| *x /= length);
            }
        };
        unit(&mut self.numbers[6..10]);
        // What the transfer function hides stays hidden: it is far below, and no step reaches it.
        if self.numbers[10] > HIDDEN_LOGIT {
            self.numbers[10] = self.numbers[10].clamp(LOGITS[0], LOGITS[1]);
        }
        for (number, palette) in self.numbers[11..14].iter_mut().zip(self.palette.to_array()) {
            *number = number.clamp(-palette, (1.0 - palette).max(-palette));
        }
        if self.has_normal {
            unit(&mut self.numbers[14..17]);
        }
        self.numbers[17..20].iter_mut().for_each(|factor| *factor = factor.clamp(0.0, 2.0));
        self.numbers[20] = self.numbers[20].clamp(LOG_SHININESS[0], LOG_SHININESS[1]);
    }
}
