//! Named settings of the light, as photographers use them. Directions follow the viewer when a preset is set; later the light stays
//! where it is.

use crate::scene::{LightMode, SetLight, Vector};

/// Axes of the viewer in the scene frame, of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewerAxes {
    /// To the right in the picture.
    pub right: [f64; 3],
    /// Up in the picture.
    pub up: [f64; 3],
    /// From the scene to the eye.
    pub backward: [f64; 3],
}

/// A named light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightPreset {
    /// From the eye: no place in view is without light.
    Headlight,
    /// A key light from the upper left before the scene: shapes have a light and a dark side.
    Studio,
    /// From above behind the scene: edges are bright, and what faces the viewer is dim.
    Rim,
    /// Only ambient light: colours as they are, without shapes.
    Flat,
}

/// The numbers of a preset.
struct Numbers {
    /// To the light along the viewer's axes, of any length; `None` for a light at the eye.
    direction: Option<[f64; 3]>,
    /// Multipliers on ka, kd, ks and the specular exponent.
    factors: [f32; 4],
}

impl LightPreset {
    /// All, in the order of a panel.
    pub const ALL: [Self; 4] = [Self::Headlight, Self::Studio, Self::Rim, Self::Flat];

    /// Its name in commands and on panels.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Headlight => "headlight",
            Self::Studio => "studio",
            Self::Rim => "rim",
            Self::Flat => "flat",
        }
    }

    /// One line on its effect.
    #[must_use]
    pub fn hint(self) -> &'static str {
        match self {
            Self::Headlight => "From the eye.",
            Self::Studio => "From the upper left, with highlights.",
            Self::Rim => "From above behind the scene: bright edges.",
            Self::Flat => "Ambient light only.",
        }
    }

    fn numbers(self) -> Numbers {
        match self {
            Self::Headlight => Numbers { direction: None, factors: [1.0, 1.0, 1.0, 1.0] },
            Self::Studio => Numbers { direction: Some([-0.55, 0.65, 0.75]), factors: [0.75, 1.25, 1.5, 1.5] },
            Self::Rim => Numbers { direction: Some([0.3, 0.8, -0.55]), factors: [0.7, 1.6, 0.5, 1.0] },
            Self::Flat => Numbers { direction: None, factors: [1.75, 0.0, 0.0, 1.0] },
        }
    }

    /// The command that sets it for a viewer. It sets every part of the light.
    #[must_use]
    pub fn set_light(self, axes: &ViewerAxes) -> SetLight {
        let Numbers { direction, factors: [ambient, diffuse, specular, shininess] } = self.numbers();
        let vector = direction.map(|[x, y, z]| {
            let length = (x * x + y * y + z * z).sqrt();
            let along = |k: usize| (x * axes.right[k] + y * axes.up[k] + z * axes.backward[k]) / length;
            Vector { x: along(0), y: along(1), z: along(2) }
        });
        let mode = if vector.is_some() { LightMode::Direction } else { LightMode::Headlight };
        SetLight {
            mode: mode.into(),
            direction: vector,
            ambient: Some(ambient),
            diffuse: Some(diffuse),
            specular: Some(specular),
            shininess: Some(shininess),
            relative: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_light_from_where_their_names_say() {
        // From the front: x is right, z is up, and the eye is at -y.
        let axes = ViewerAxes { right: [1.0, 0.0, 0.0], up: [0.0, 0.0, 1.0], backward: [0.0, -1.0, 0.0] };
        let direction = |preset: LightPreset| preset.set_light(&axes).direction;
        assert!(direction(LightPreset::Headlight).is_none() && direction(LightPreset::Flat).is_none());
        let studio = direction(LightPreset::Studio).unwrap();
        assert!(studio.x < 0.0 && studio.z > 0.0 && studio.y < 0.0, "upper left, before the scene: {studio:?}");
        let rim = direction(LightPreset::Rim).unwrap();
        assert!(rim.z > 0.0 && rim.y > 0.0, "above, behind the scene: {rim:?}");
        for Vector { x, y, z } in [studio, rim] {
            assert!((x * x + y * y + z * z - 1.0).abs() < 1e-12);
        }
        for preset in LightPreset::ALL {
            let set = preset.set_light(&axes);
            assert!(set.ambient.is_some() && set.diffuse.is_some() && set.specular.is_some() && !set.relative);
            assert!(set.ambient > Some(0.0), "{}: nothing is ever black", preset.name());
        }
    }
}
