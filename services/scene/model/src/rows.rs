//! Some Gaussians of a set, in an order of their own.

use crate::model::{ExtraColumn, ExtraValues, Gaussians, Harmonics, ShadingColumns};

impl Gaussians {
    /// The Gaussians of these indices, in this order, with all their columns. Indices past the end are left out.
    #[must_use]
    pub fn rows(&self, order: &[usize]) -> Self {
        let extra = |column: &ExtraColumn| ExtraColumn { name: column.name.clone(), values: column.values.rows(order) };
        let shading = |s: &ShadingColumns| ShadingColumns {
            offset_color: take(&s.offset_color, order),
            normal: take(&s.normal, order),
            ambient: take(&s.ambient, order),
            diffuse: take(&s.diffuse, order),
            specular: take(&s.specular, order),
            shininess: take(&s.shininess, order),
        };
        let harmonics = |h: &Harmonics| {
            let k = h.rest_per_gaussian();
            let row = |&i: &usize| h.rest.get(i * k..(i + 1) * k).unwrap_or_default();
            Harmonics { degree: h.degree, dc: take(&h.dc, order), rest: order.iter().flat_map(row).copied().collect() }
        };
        Self {
            position: take(&self.position, order),
            rotation: take(&self.rotation, order),
            log_scale: take(&self.log_scale, order),
            opacity_logit: take(&self.opacity_logit, order),
            shading: self.shading.as_ref().map(shading),
            harmonics: self.harmonics.as_ref().map(harmonics),
            extra: self.extra.iter().map(extra).collect(),
            antialiased: self.antialiased,
        }
    }
}

impl ExtraValues {
    fn rows(&self, order: &[usize]) -> Self {
        match self {
            Self::I8(v) => Self::I8(take(v, order)),
            Self::U8(v) => Self::U8(take(v, order)),
            Self::I16(v) => Self::I16(take(v, order)),
            Self::U16(v) => Self::U16(take(v, order)),
            Self::I32(v) => Self::I32(take(v, order)),
            Self::U32(v) => Self::U32(take(v, order)),
            Self::F32(v) => Self::F32(take(v, order)),
            Self::F64(v) => Self::F64(take(v, order)),
        }
    }
}

fn take<T: Copy>(values: &[T], order: &[usize]) -> Vec<T> {
    order.iter().filter_map(|&i| values.get(i)).copied().collect()
}
