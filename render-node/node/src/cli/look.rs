//! The scene of the command as its options show it, and what draws it.

use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, DVec4, Vec3};
use sg_edit::wire::decode_vector;
use sg_formats::load::{LoadOptions, load};
use sg_gpu::backend::{Backend, Engine};
use sg_gpu::{GpuError, Settings};
use sg_input::number_format::grouped;
use sg_input::print;
use sg_proto::light_presets::{LightPreset, ViewerAxes};
use sg_raster::finish::Finish;
use sg_raster::foveation::Foveation;
use sg_raster::occlusion::ambient_occlusion;
use sg_raster::outline::{OutlineStyle, draw_outlines};
use sg_raster::pick;
use sg_raster::render::{Options, Rendered};
use sg_reclassify::reclassify_scene;
use sg_scene::appearance::{Appearance, Clip, Overlay};
use sg_scene::camera::{Camera, Light, LightMode};
use sg_scene::framing;
use sg_scene::model::Scene;

use super::Picture;
use super::failure::Failure;
use super::names::{BackendName, LightName};
use super::show;
use super::transfer_function::read_transfer_function;
use super::values::{Background, backdrop};

/// Edge of the picture where neither a camera nor a size is given.
const DEFAULT_SIZE: u32 = 1024;

/// The scene of the command under its transfer function; prints its warnings.
pub(super) fn read_scene(picture: &Picture) -> Result<Scene, Failure> {
    let options = LoadOptions {
        convention: picture.convention.map(Into::into),
        shading: picture.shading.map(Into::into),
        palette: picture.palette,
    };
    let loaded = load(&picture.scene, &options).map_err(Failure::input)?;
    for warning in &loaded.warnings {
        print::status(&format!("warning: {warning}"));
    }
    let mut scene = loaded.scene;
    if let Some(file) = &picture.transfer_function {
        let function = read_transfer_function(file)?;
        reclassify_scene(&mut scene, &function)
            .map_err(|e| Failure::input(format!("{}: {e}", picture.scene.display())))?;
    }
    Ok(scene)
}

/// The appearance before it is known from where it is seen.
pub(super) fn clipped(picture: &Picture, scene: &Scene) -> Appearance {
    Appearance { clips: clips(picture), ..Appearance::of(scene) }
}

/// The camera of a single picture: the given one, or one that frames the scene, in the light and before the background of the options.
pub(super) fn camera(picture: &Picture, scene: &Scene, appearance: &Appearance, given: Option<Camera>) -> Camera {
    let camera = given.unwrap_or_else(|| {
        let [width, height] = [picture.width, picture.height].map(|edge| edge.unwrap_or(DEFAULT_SIZE));
        framing::default_camera_of(scene, appearance, width, height)
    });
    lit(picture, scene, camera)
}

/// The camera with the near distance, the light and the background of the options.
pub(super) fn lit(picture: &Picture, scene: &Scene, mut camera: Camera) -> Camera {
    camera.near = match picture.near {
        Some(near) => near,
        None if camera.near == 0.0 => framing::near_distance(scene),
        None => camera.near,
    };
    if let Some(light) = picture.light {
        camera.light = preset_light(light, &camera);
    }
    if let Some(Background::Color(color)) = picture.background {
        camera.background = color.to_array();
    }
    camera
}

/// How the scene looks.
pub(super) struct Look {
    pub(super) appearance: Appearance,
    pub(super) legend: Option<show::LegendReport>,
    /// The Super-Gaussian of each Gaussian, where they are given.
    labels: Option<Vec<u32>>,
}

impl Look {
    /// The options on top of an appearance, in the light and before the background of a camera.
    pub(super) fn new(
        picture: &Picture,
        scene: &Scene,
        camera: &Camera,
        mut appearance: Appearance,
    ) -> Result<Self, Failure> {
        appearance.light = camera.light;
        appearance.background = camera.background();
        appearance.overlay = read_overlay(picture, scene)?;
        appearance.filter = picture.filter.into();
        appearance.term = picture.term.into();
        let labels = picture.clusters.as_deref().map(|path| show::read_labels(path, scene)).transpose()?;
        let legend = match picture.show {
            Some(shown) => {
                let options = show::ColorOptions { map: picture.color_map, range: picture.range, seed: picture.seed };
                show::colors(shown, &options, (scene, labels.as_deref()), &mut appearance)?
            }
            None => None,
        };
        if picture.ambient_occlusion {
            let began = Instant::now();
            appearance.occlusion = ambient_occlusion(scene, &appearance);
            match appearance.occlusion {
                Some(_) => print::status(&format!("ambient occlusion: {:.3} s", began.elapsed().as_secs_f64())),
                None => print::status("warning: no ambient occlusion, since nothing visible has shading columns"),
            }
        }
        Ok(Self { appearance, legend, labels })
    }

    /// The last step of a picture that was drawn over the plain background.
    pub(super) fn finish(&self, picture: &Picture) -> (Vec3, Finish) {
        let plain = self.appearance.background;
        (plain, Finish { backdrop: backdrop(picture.background, plain), dither: !picture.no_dither })
    }
}

/// Quality, projection and blending of the options.
pub(super) fn settings(picture: &Picture) -> Settings {
    Settings {
        quality: picture.quality.into(),
        projection: picture.projection.into(),
        rasterizer: picture.rasterizer.into(),
        foveation: picture.foveation.and_then(Foveation::beyond),
        ..Settings::default()
    }
}

/// Draws pictures of one scene with one look.
pub(super) struct Painter<'a> {
    picture: &'a Picture,
    engine: Engine,
    look: &'a Look,
    options: Options,
}

impl<'a> Painter<'a> {
    pub(super) fn new(picture: &'a Picture, scene: Scene, look: &'a Look) -> Result<Self, Failure> {
        let Settings { quality, projection, rasterizer, foveation, .. } = settings(picture);
        let options = Options { quality, projection, foveation };
        let backend = match picture.backend {
            // No device is opened for options that it cannot draw.
            _ if !options.drawn_by_devices() => Backend::Cpu,
            name => name.into(),
        };
        if matches!(picture.backend, BackendName::Gpu) && backend == Backend::Cpu {
            print::status("warning: `exact` and `per-ray` are drawn by the cores, not by a graphics device");
        }
        let engine = Engine::new(scene, backend, Some(rasterizer)).map_err(Failure::work)?;
        Ok(Self { picture, engine, look, options })
    }

    /// Draws one picture, with outlines where the options have them.
    pub(super) fn draw(&mut self, camera: &Camera) -> Result<Rendered, Failure> {
        let Look { appearance, labels, .. } = self.look;
        let mut drawn = self.engine.draw(appearance, camera, self.options).map_err(|e| match e {
            GpuError::Input(_) => Failure::input(e),
            _ => Failure::work(e),
        })?;
        if let Some(trouble) = self.engine.take_fallback_error() {
            print::status(&format!("warning: {trouble}"));
        }
        if let (Some(width), Some(labels)) = (self.picture.outlines, labels) {
            let projection = self.options.projection;
            let (front, _) = pick::front_ids(self.engine.scene(), appearance, camera, projection, pick::SURFACE)
                .map_err(Failure::input)?;
            let style = OutlineStyle { color: self.picture.outline_color, width };
            draw_outlines(&mut drawn.image, &front, labels, style).map_err(Failure::work)?;
        }
        Ok(drawn)
    }

    pub(super) fn engine(&self) -> &Engine {
        &self.engine
    }

    pub(super) fn options(&self) -> Options {
        self.options
    }
}

/// Reports Gaussians that cannot be drawn.
pub(super) fn warn_of_dropped(gaussians: usize) {
    if gaussians > 0 {
        print::status(&format!(
            "warning: {} Gaussians with NaN or infinite attributes were left out",
            grouped(gaussians as u64)
        ));
    }
}

fn read_overlay(picture: &Picture, scene: &Scene) -> Result<Option<Overlay>, Failure> {
    let Some(path) = &picture.mask else { return Ok(None) };
    let mask = sg_formats::npy::read_mask(path, scene.len()).map_err(Failure::input)?;
    Ok(Some(Overlay {
        mask: Arc::new(mask),
        color: picture.mask_color,
        mix: picture.mask_mix,
        opacity: picture.mask_opacity,
    }))
}

/// A preset as this camera's viewer sees it.
fn preset_light(name: LightName, camera: &Camera) -> Light {
    // The rows of the view are the camera's axes: right, down, forward.
    let rows = camera.view().transpose();
    let axis = |row: DVec4, sign: f64| (sign * row.truncate()).normalize_or_zero().to_array();
    let axes =
        ViewerAxes { right: axis(rows.x_axis, 1.0), up: axis(rows.y_axis, -1.0), backward: axis(rows.z_axis, -1.0) };
    let set = LightPreset::from(name).set_light(&axes);
    let own = Light::default();
    let (mode, direction) = match set.direction {
        Some(to) => (LightMode::Direction, decode_vector(&to).as_vec3().to_array()),
        None => (LightMode::Headlight, own.direction),
    };
    let [ka, kd, ks, shininess] =
        [set.ambient, set.diffuse, set.specular, set.shininess].map(|factor| factor.unwrap_or(1.0));
    Light { mode, direction, ka, kd, ks, shininess }
}

/// The planes and boxes of the options.
pub(super) fn clips(picture: &Picture) -> Vec<Clip> {
    let halves = |n: &[f64; 6]| (DVec3::new(n[0], n[1], n[2]), DVec3::new(n[3], n[4], n[5]));
    let planes = picture.clip_plane.iter().map(halves).map(|(point, normal)| Clip::plane(point, normal));
    let between = |keep_inside: bool| {
        move |n: &[f64; 6]| {
            let (a, b) = halves(n);
            Clip::between(a.min(b), a.max(b), keep_inside)
        }
    };
    let boxes = picture.clip_box.iter().map(between(true)).chain(picture.cut_box.iter().map(between(false)));
    planes.chain(boxes).collect()
}
