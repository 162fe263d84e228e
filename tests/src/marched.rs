//! The picture that ray marching makes of a scene's volume.

use sg_raster::image::Image;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;
use sg_volume::classifier::Classifier;
use sg_volume::dvr::{self, Illumination, Lighting, Material, Pinhole};
use sg_volume::field::Field;

/// Voxels between two samples of a ray.
const STEP: f64 = 0.5;

/// A volume as its scene shows it: the light at the eye and the factors of the scene's first Gaussian.
pub struct Marched {
    field: Field,
    classifier: Classifier,
    lighting: Lighting,
}

impl Marched {
    /// The volume of a scene, classified.
    #[must_use]
    pub fn new(field: Field, classifier: Classifier, scene: &Scene) -> Self {
        let first = |k: &[f32]| k.first().copied().unwrap_or_default();
        let shading = scene.units.first().and_then(|u| u.gaussians.shading.as_ref());
        let lighting = shading.map_or(Lighting::Unlit, |s| {
            let material = Material {
                ambient: first(&s.ambient),
                diffuse: first(&s.diffuse),
                specular: first(&s.specular),
                shininess: first(&s.shininess),
            };
            Lighting::Lit(material, Illumination::Headlight)
        });
        Self { field, classifier, lighting }
    }

    /// Marches a ray through each pixel.
    #[must_use]
    pub fn picture(&self, camera: &Camera) -> Image {
        let pinhole = Pinhole {
            width: camera.width as usize,
            height: camera.height as usize,
            focal: [camera.fx, camera.fy],
            center: [camera.cx, camera.cy],
            world_to_camera: camera.view(),
        };
        let drawn = dvr::render(&self.field, &self.classifier, &pinhole, self.lighting, camera.background(), STEP);
        Image { width: camera.width, height: camera.height, rgba: drawn.pixels.into_flattened() }
    }
}
