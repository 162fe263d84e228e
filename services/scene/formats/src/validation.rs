//! Counts of Gaussians with NaN, infinite or zero-length values.

use rayon::prelude::*;
use serde::Serialize;

use crate::splat::{Warning, WarningCode};
use sg_scene::model::Gaussians;

/// Counts of Gaussians with NaN or infinite values, and of quaternions without a direction. Such Gaussians are kept.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct NonFiniteCounts {
    /// Centres that are not finite: drawn nowhere, in no cluster.
    pub positions: usize,
    /// Logarithms of the scale that are not finite.
    pub scales: usize,
    /// Opacity logits that are not finite (an infinite one is an opacity of exactly 0 or 1).
    pub opacities: usize,
    /// Quaternions that are not finite: taken as no rotation.
    pub rotations: usize,
    /// Quaternions of length zero: taken as no rotation.
    pub zero_rotations: usize,
    /// Shading attributes with a value that is not finite.
    pub shading: usize,
    /// Harmonics with a value that is not finite.
    pub harmonics: usize,
}

impl NonFiniteCounts {
    /// Counts over all Gaussians.
    #[must_use]
    pub fn of(g: &Gaussians) -> Self {
        let count = |is_bad: &(dyn Fn(usize) -> bool + Sync)| {
            (0..g.len()).into_par_iter().with_min_len(4096).filter(|&i| is_bad(i)).count()
        };
        let rotation = |i: usize| g.rotation.get(i).copied().unwrap_or_default();
        let bad = |x: Option<&f32>| x.is_some_and(|x| !x.is_finite());
        let shading = g.shading.as_ref().map_or(0, |s| {
            count(&|i| {
                s.offset_color.get(i).is_some_and(|c| !c.is_finite())
                    || s.normal.get(i).is_some_and(|n| !n.is_finite())
                    || [&s.ambient, &s.diffuse, &s.specular, &s.shininess].into_iter().any(|v| bad(v.get(i)))
            })
        });
        let harmonics = g.harmonics.as_ref().map_or(0, |h| {
            let k = h.rest_per_gaussian();
            let bad = |rows: Option<&[[f32; 3]]>| rows.is_some_and(|r| r.as_flattened().iter().any(|x| !x.is_finite()));
            count(&|i| bad(h.dc.get(i..=i)) || bad(h.rest.get(i * k..(i + 1) * k)))
        });
        Self {
            positions: count(&|i| !g.has_finite_position(i)),
            scales: count(&|i| g.log_scale.get(i).is_some_and(|s| !s.is_finite())),
            opacities: count(&|i| bad(g.opacity_logit.get(i))),
            rotations: count(&|i| rotation(i).iter().any(|x| !x.is_finite())),
            zero_rotations: count(&|i| rotation(i) == [0.0; 4]),
            shading,
            harmonics,
        }
    }

    /// A warning for each kind with a count above 0.
    pub(crate) fn warnings(&self) -> Vec<Warning> {
        let kinds = [
            (self.positions, WarningCode::NonFinite, "centres that are not finite and not drawn"),
            (self.scales, WarningCode::NonFinite, "scales that are not finite"),
            (self.opacities, WarningCode::NonFinite, "opacities that are not finite"),
            (self.rotations, WarningCode::NonFinite, "rotations that are not finite and read as none"),
            (self.zero_rotations, WarningCode::ZeroRotation, "quaternions of length zero, read as no rotation"),
            (self.shading, WarningCode::NonFinite, "rows of shading attributes that are not finite"),
            (self.harmonics, WarningCode::NonFinite, "rows of harmonics that are not finite"),
        ];
        let present = kinds.into_iter().filter(|(n, ..)| *n > 0);
        present.map(|(n, code, text)| Warning::new(code, format!("{text}: {n}"))).collect()
    }
}
