//! Between the shading columns as iVR-GS stores them and as they are used.
//!
//! | convention | offset colour | normal | ks | β |
//! | --- | --- | --- | --- | --- |
//! | `ours` | as stored | as stored | as stored | as stored |
//! | `legacy` (before January 2025, and the released checkpoints) | σ(x) | x / max(‖x‖, 10⁻³) | as stored | as stored |
//! | `head-raw` (since then, float files) | σ(x) | x / max(‖x‖, 10⁻³) | 5·σ(x) | 50·σ(x) |
//! | `head-activated` (since then, quantised files) | σ(x) | x / max(‖x‖, 10⁻³) | as stored | as stored |
//!
//! ka and kd are always as stored.

use glam::Vec3;
use rayon::prelude::*;

use sg_scene::model::{Convention, ShadingColumns};

/// Greatest specular factor that `head-raw` can hold.
const KS_LIMIT: f64 = 5.0;
/// Greatest exponent that `head-raw` can hold.
const SHININESS_LIMIT: f64 = 50.0;
/// σ(±16) is 0 and 1 to within 1.2e-7, the spacing of f32 at 1.
const LOGIT_LIMIT: f64 = 16.0;

/// From stored to used.
pub(crate) fn activate(columns: &mut ShadingColumns, convention: Convention) {
    if convention == Convention::Ours {
        return;
    }
    columns.offset_color.par_iter_mut().for_each(|c| *c = Vec3::from_array(c.to_array().map(sigmoid)));
    columns.normal.par_iter_mut().for_each(|n| *n /= n.length().max(1e-3));
    if convention == Convention::HeadRaw {
        columns.specular.par_iter_mut().for_each(|x| *x = (KS_LIMIT * f64::from(sigmoid(*x))) as f32);
        columns.shininess.par_iter_mut().for_each(|x| *x = (SHININESS_LIMIT * f64::from(sigmoid(*x))) as f32);
    }
}

/// From used to stored, and the number of values that the convention cannot hold and that are cut.
pub(crate) fn deactivate(columns: &ShadingColumns, convention: Convention) -> (ShadingColumns, usize) {
    let mut out = columns.clone();
    if convention == Convention::Ours {
        return (out, 0);
    }
    let outside = |values: &[f32], limit: f64| {
        values.par_iter().filter(|&&x| !(0.0..=limit).contains(&f64::from(x)) && !x.is_nan()).count()
    };
    let mut cut = outside(bytemuck::cast_slice(&out.offset_color), 1.0);
    out.offset_color.par_iter_mut().for_each(|c| *c = Vec3::from_array(c.to_array().map(|x| logit(f64::from(x)))));
    if convention == Convention::HeadRaw {
        cut += outside(&out.specular, KS_LIMIT) + outside(&out.shininess, SHININESS_LIMIT);
        out.specular.par_iter_mut().for_each(|x| *x = logit(f64::from(*x) / KS_LIMIT));
        out.shininess.par_iter_mut().for_each(|x| *x = logit(f64::from(*x) / SHININESS_LIMIT));
    }
    (out, cut)
}

/// The convention that stored columns most likely follow, and why. Only a file of iVR-GS whose comments say nothing needs this.
pub(crate) fn guess(stored: &ShadingColumns, quantised: bool) -> (Convention, String) {
    let finite = |values: &[f32]| values.iter().copied().filter(|x| x.is_finite()).collect::<Vec<_>>();
    let shininess = finite(&stored.shininess);
    let low = shininess.iter().copied().fold(f32::INFINITY, f32::min);
    let high = shininess.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if low < 0.0 {
        return (Convention::HeadRaw, format!("an exponent β of {low} is stored, so β and ks await their sigmoid"));
    }
    if quantised {
        return (Convention::HeadActivated, "a quantised file whose β are all at least 0".to_owned());
    }
    if high > 6.0 {
        return (Convention::Legacy, format!("an exponent β of {high} is stored, too large to await a sigmoid"));
    }
    let mut specular = finite(&stored.specular);
    let middle = specular.len() / 2;
    let median = if specular.is_empty() { 0.0 } else { *specular.select_nth_unstable_by(middle, f32::total_cmp).1 };
    if median < 0.0 {
        return (Convention::HeadRaw, format!("the median ks is {median}, so β and ks await their sigmoid"));
    }
    (Convention::Legacy, "nothing in β and ks speaks for the later form".to_owned())
}

/// 1 / (1 + e⁻ˣ), in f64 and rounded once.
pub(crate) fn sigmoid(x: f32) -> f32 {
    (1.0 / (1.0 + (-f64::from(x)).exp())) as f32
}

/// The inverse of [`sigmoid`], finite for every number. Arguments are clamped to 0 to 1.
pub(crate) fn logit(p: f64) -> f32 {
    let p = p.clamp(0.0, 1.0);
    (p / (1.0 - p)).ln().clamp(-LOGIT_LIMIT, LOGIT_LIMIT) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn columns(offset: f32, specular: f32, shininess: f32) -> ShadingColumns {
        ShadingColumns {
            offset_color: vec![Vec3::splat(offset)],
            normal: vec![Vec3::X],
            ambient: vec![0.25],
            diffuse: vec![0.5],
            specular: vec![specular],
            shininess: vec![shininess],
        }
    }

    proptest! {
        #[test]
        fn storing_and_using_are_inverse(offset in 0.0_f32..=1.0, specular in 0.0_f32..=5.0, shininess in 0.0_f32..=50.0) {
            let used = columns(offset, specular, shininess);
            for convention in [Convention::Ours, Convention::Legacy, Convention::HeadRaw, Convention::HeadActivated] {
                let (mut stored, cut) = deactivate(&used, convention);
                prop_assert_eq!(cut, 0);
                activate(&mut stored, convention);
                prop_assert!((stored.offset_color[0].x - offset).abs() < 5e-7);
                prop_assert!((stored.specular[0] - specular).abs() < 3e-6);
                prop_assert!((stored.shininess[0] - shininess).abs() < 3e-5);
                prop_assert_eq!(stored.normal[0], Vec3::X);
            }
        }
    }

    #[test]
    fn activations_are_those_of_the_conventions() {
        let mut head = columns(0.0, 0.0, 0.0);
        head.normal = vec![Vec3::new(0.0, 5e-4, 0.0)];
        activate(&mut head, Convention::HeadRaw);
        assert_eq!((head.offset_color[0].x, head.specular[0], head.shininess[0]), (0.5, 2.5, 25.0));
        assert_eq!(head.normal[0], Vec3::new(0.0, 0.5, 0.0), "short normals are not blown up");
        let mut legacy = columns(0.0, -1.0, 20.0);
        activate(&mut legacy, Convention::Legacy);
        assert_eq!((legacy.offset_color[0].x, legacy.specular[0], legacy.shininess[0]), (0.5, -1.0, 20.0));
    }

    #[test]
    fn values_outside_are_counted() {
        assert_eq!(deactivate(&columns(-0.1, 6.0, 60.0), Convention::Legacy).1, 3);
        assert_eq!(deactivate(&columns(-0.1, 6.0, 60.0), Convention::HeadRaw).1, 5);
        assert_eq!(deactivate(&columns(-0.1, 6.0, 60.0), Convention::Ours).1, 0);
    }

    #[test]
    fn the_guess_follows_the_numbers() {
        let of = |specular, shininess, quantised| guess(&columns(0.0, specular, shininess), quantised).0;
        assert_eq!(of(0.1, -2.0, false), Convention::HeadRaw);
        assert_eq!(of(0.1, -2.0, true), Convention::HeadRaw);
        assert_eq!(of(0.1, 20.0, false), Convention::Legacy);
        assert_eq!(of(0.1, 20.0, true), Convention::HeadActivated);
        assert_eq!(of(-3.0, 1.0, false), Convention::HeadRaw);
        assert_eq!(of(0.1, 1.0, false), Convention::Legacy);
        assert_eq!(of(f32::NAN, f32::NAN, false), Convention::Legacy);
    }
}
