//! Pictures of a volume by ray marching, with the camera, light, background and clips of scenes.
//!
//! Gaussians of the volume should look the same. Samples have the shading of [`Material::STANDARD`], in the rules of
//! [`crate::shading`].

use glam::Vec3;
use sg_scene::appearance::Clip;
use sg_scene::camera::{Camera, LightMode};
use sg_scene::model::{BaseUnit, Gaussians, Scene, SceneBox, ShadingColumns};
use sg_scene::orientation::{LengthUnit, Orientation, PatientFrame};
use sg_volume::dvr::{self, ClipRegion, HalfSpace, Illumination, Lighting, Material, Pinhole, VolumeRenderer};
use sg_volume::{Classifier, ScalarFieldRef, WorldFrame, world_frame};

use crate::image::Image;

/// The picture of a volume or a mesh in f64, with the light and background of the camera.
#[must_use]
pub fn march(marcher: &impl VolumeRenderer, camera: &Camera) -> Image {
    picture(camera, |pinhole, lighting| marcher.picture(pinhole, lighting, camera.background()))
}

/// [`march`] in f32, several times as fast.
#[must_use]
pub fn fast_march(marcher: &impl VolumeRenderer, camera: &Camera) -> Image {
    picture(camera, |pinhole, lighting| marcher.fast_picture(pinhole, lighting, camera.background()))
}

/// A clip of a scene as one of a volume.
#[must_use]
pub fn region(clip: &Clip) -> ClipRegion {
    let sides = clip.sides.iter().map(|side| HalfSpace { normal: side.normal, offset: side.offset }).collect();
    ClipRegion { sides, keeps_inside: clip.keep_inside }
}

/// A scene without Gaussians in the place of what a transfer function shows. Framing gives it the views of a scene of that
/// volume.
#[must_use]
pub fn empty_scene<'a>(field: impl Into<ScalarFieldRef<'a>>, classifier: &Classifier, frame: WorldFrame) -> Scene {
    let bounds = field.into().visible_bounds(classifier);
    let gaussians = Gaussians { shading: Some(ShadingColumns::default()), ..Gaussians::default() };
    let mut scene =
        Scene::compose(vec![BaseUnit::new("volume", gaussians)], Some(SceneBox { min: bounds.min, max: bounds.max }));
    scene.orientation = orientation_of(frame);
    scene
}

/// What the file of a volume tells of directions and lengths. A scene keeps the world coordinates of its volume.
#[must_use]
pub fn orientation_of(frame: WorldFrame) -> Orientation {
    Orientation {
        patient: frame.patient.map(|patient| match patient {
            world_frame::PatientFrame::Lps => PatientFrame::Lps,
            world_frame::PatientFrame::Ras => PatientFrame::Ras,
        }),
        unit: frame.unit.map(|unit| match unit {
            world_frame::LengthUnit::Metre => LengthUnit::Metre,
            world_frame::LengthUnit::Millimetre => LengthUnit::Millimetre,
            world_frame::LengthUnit::Micrometre => LengthUnit::Micrometre,
        }),
        up: None,
    }
}

fn picture(camera: &Camera, march: impl FnOnce(&Pinhole, Lighting) -> dvr::Image) -> Image {
    let pinhole = Pinhole {
        width: camera.width as usize,
        height: camera.height as usize,
        focal: [camera.fx, camera.fy],
        center: [camera.cx, camera.cy],
        world_to_camera: camera.view(),
    };
    let light = &camera.light;
    let own = Material::STANDARD;
    let material = Material {
        haze_ambient: own.haze_ambient * light.ka,
        ambient: own.ambient * light.ka,
        diffuse: own.diffuse * light.kd,
        specular: own.specular * light.ks,
        shininess: own.shininess * light.shininess,
    };
    let illumination = match light.mode {
        LightMode::Headlight => Illumination::Headlight,
        LightMode::Direction => Illumination::Direction(Vec3::from_array(light.direction)),
    };
    let picture = march(&pinhole, Lighting::Lit(material, illumination));
    Image { width: camera.width, height: camera.height, rgba: picture.pixels.into_flattened() }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use sg_scene::framing;
    use sg_volume::phantom::{VesselTree, transfer_function};

    use sg_volume::dvr::RayMarcher;

    use super::*;

    #[test]
    fn a_volume_is_framed_lit_and_clipped_like_its_scene() {
        let volume = VesselTree::new().rasterize(48, 0).unwrap().volume().unwrap();
        let (field, function) = (volume.to_field(), transfer_function());
        let classifier = function.classifier(field.range()).unwrap();
        let scene = empty_scene(&field, &classifier, volume.frame());
        let mut camera = framing::default_camera(&scene, 96, 64);
        let marcher = RayMarcher::new(&field, classifier, 0.5);
        let covered = |image: &Image| image.as_pixels().iter().filter(|p| p[3] > 0.5).count();
        let light = |image: &Image| image.as_pixels().iter().map(|p| p[0] + p[1] + p[2]).sum::<f32>();
        let whole = march(&marcher, &camera);
        assert!(covered(&whole) > 300, "{}", covered(&whole));
        let border = |x: usize, y: usize| whole.as_pixels()[y * 96 + x][3];
        let cut = (0..96).any(|x| border(x, 0) > 0.5 || border(x, 63) > 0.5) || (0..64).any(|y| border(0, y) > 0.5);
        assert!(!cut, "the picture cuts the volume");
        camera.light.ka = 0.5;
        assert!(light(&march(&marcher, &camera)) < 0.9 * light(&whole));
        camera.light.ka = 1.0;
        let middle = 0.5 * (scene.bounds.min + scene.bounds.max);
        let half = RayMarcher::new(&field, function.classifier(field.range()).unwrap(), 0.5)
            .clipped(vec![region(&Clip::plane(middle, DVec3::X))]);
        let half = covered(&march(&half, &camera));
        assert!(half > 50 && 10 * half < 9 * covered(&whole), "{half} of {}", covered(&whole));
    }
}
