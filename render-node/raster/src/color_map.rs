//! Perceptually uniform colour maps: equal steps of the number look like equal steps of the colour.
//!
//! Both are published as free data: viridis (Smith and van der Walt 2015, CC0) and cividis (Nuñez, Anderton and Renslow 2018).
//! Cividis looks nearly the same with and without a colour-vision deficiency. Every eighth entry of their 256 is kept and the
//! rest interpolated, at most 0.02 off.

use glam::Vec3;

/// A map from 0 to 1 to colours, dark to bright.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ColorMap {
    /// Violet, blue, green, yellow.
    #[default]
    Viridis,
    /// Blue, grey, yellow.
    Cividis,
}

impl ColorMap {
    /// RGB at `t`, clamped to 0 to 1; NaN gives [`Self::MISSING`].
    #[must_use]
    pub fn at(self, t: f64) -> Vec3 {
        if t.is_nan() {
            return Self::MISSING;
        }
        let table = match self {
            Self::Viridis => &VIRIDIS,
            Self::Cividis => &CIVIDIS,
        };
        let place = t.clamp(0.0, 1.0) * (table.len() - 1) as f64;
        let before = (place as usize).min(table.len() - 2);
        match table.get(before..before + 2) {
            Some(&[a, b]) => Vec3::from_array(a).lerp(Vec3::from_array(b), (place - before as f64) as f32),
            _ => Self::MISSING,
        }
    }

    /// The colour of a missing number: a grey that neither map has.
    pub const MISSING: Vec3 = Vec3::splat(0.35);
}

const VIRIDIS: [[f32; 3]; 33] = [
    [0.267, 0.005, 0.329],
    [0.277, 0.050, 0.376],
    [0.282, 0.095, 0.417],
    [0.283, 0.135, 0.453],
    [0.279, 0.175, 0.483],
    [0.271, 0.213, 0.507],
    [0.259, 0.251, 0.524],
    [0.245, 0.287, 0.537],
    [0.230, 0.321, 0.545],
    [0.215, 0.354, 0.551],
    [0.200, 0.386, 0.555],
    [0.186, 0.417, 0.557],
    [0.173, 0.447, 0.558],
    [0.161, 0.477, 0.558],
    [0.150, 0.506, 0.557],
    [0.138, 0.536, 0.555],
    [0.128, 0.565, 0.551],
    [0.121, 0.594, 0.544],
    [0.120, 0.624, 0.534],
    [0.131, 0.653, 0.521],
    [0.155, 0.682, 0.503],
    [0.193, 0.710, 0.481],
    [0.241, 0.737, 0.455],
    [0.299, 0.762, 0.423],
    [0.363, 0.787, 0.387],
    [0.433, 0.809, 0.345],
    [0.508, 0.829, 0.299],
    [0.587, 0.847, 0.249],
    [0.669, 0.862, 0.195],
    [0.753, 0.875, 0.143],
    [0.836, 0.886, 0.102],
    [0.917, 0.896, 0.101],
    [0.993, 0.906, 0.144],
];

const CIVIDIS: [[f32; 3]; 33] = [
    [0.000, 0.135, 0.305],
    [0.000, 0.158, 0.357],
    [0.000, 0.179, 0.414],
    [0.017, 0.198, 0.441],
    [0.102, 0.220, 0.436],
    [0.153, 0.242, 0.430],
    [0.194, 0.264, 0.426],
    [0.230, 0.286, 0.424],
    [0.263, 0.307, 0.423],
    [0.294, 0.329, 0.424],
    [0.323, 0.350, 0.426],
    [0.352, 0.372, 0.430],
    [0.380, 0.394, 0.435],
    [0.407, 0.416, 0.442],
    [0.434, 0.439, 0.451],
    [0.460, 0.461, 0.461],
    [0.487, 0.484, 0.471],
    [0.516, 0.507, 0.473],
    [0.546, 0.530, 0.472],
    [0.576, 0.554, 0.469],
    [0.607, 0.578, 0.464],
    [0.638, 0.602, 0.457],
    [0.669, 0.627, 0.449],
    [0.701, 0.652, 0.438],
    [0.733, 0.678, 0.425],
    [0.766, 0.704, 0.410],
    [0.799, 0.731, 0.392],
    [0.833, 0.759, 0.371],
    [0.867, 0.786, 0.346],
    [0.902, 0.815, 0.317],
    [0.937, 0.844, 0.281],
    [0.973, 0.874, 0.234],
    [0.996, 0.909, 0.218],
];

#[cfg(test)]
mod tests {
    use super::*;

    /// CIE lightness over 100 of a colour without transfer curve taken as sRGB.
    fn lightness(c: Vec3) -> f64 {
        let linear = |x: f32| {
            let x = f64::from(x);
            if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
        };
        let y = 0.2126 * linear(c.x) + 0.7152 * linear(c.y) + 0.0722 * linear(c.z);
        if y > 0.008_856 { 1.16 * y.cbrt() - 0.16 } else { 9.033 * y }
    }

    #[test]
    fn lightness_rises_evenly() {
        for map in [ColorMap::Viridis, ColorMap::Cividis] {
            let at = |k: u32| lightness(map.at(f64::from(k) / 64.0));
            let whole = at(64) - at(0);
            assert!(whole > 0.6, "{map:?}: {whole}");
            for k in 0..64 {
                let step = (at(k + 1) - at(k)) / (whole / 64.0);
                assert!((0.7..1.3).contains(&step), "{map:?} {k}: {step}");
            }
        }
    }

    #[test]
    fn ends_and_what_is_no_number() {
        assert_eq!(ColorMap::Viridis.at(-1.0), Vec3::from_array(VIRIDIS[0]));
        assert_eq!(ColorMap::Viridis.at(f64::INFINITY), Vec3::from_array(VIRIDIS[32]));
        assert_eq!(ColorMap::Cividis.at(0.5), Vec3::from_array(CIVIDIS[16]));
        assert_eq!(ColorMap::Cividis.at(f64::NAN), ColorMap::MISSING);
    }
}
