//! The crate `wgpu-3dgs-viewer`, driven with our cameras.

use wgpu::TextureFormat;
use wgpu_3dgs_viewer as peer;
use wgpu_3dgs_viewer::core::glam::{Mat4, UVec2, Vec3, Vec4};
use wgpu_3dgs_viewer::core::{
    GaussianDisplayMode, GaussianMaxStdDev, GaussianPod, GaussianPodWithShNoneCov3dSingleConfigs, GaussianShDegree,
    PlyGaussians,
};

use crate::Renderer;
use crate::device::{Gpu, Target, bits};
use crate::turn::{Ball, Camera};

/// Why it does not draw.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ViewerError {
    #[error(transparent)]
    Create(#[from] peer::ViewerCreateError),
    #[error("a maximum standard deviation of {0}: give one from 0 to 3")]
    StdDev(f32),
}

/// How it is to draw.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Options {
    /// Into what.
    pub(crate) format: TextureFormat,
    /// Where Gaussians end, in its standard deviations. It widens them by S / √8 as well: at 3 they are 6 % too wide.
    pub(crate) std_dev: f32,
}

/// Its viewer with a scene; without room for harmonics where the scene has none above degree 0.
pub(crate) fn open(gpu: &Gpu, scene: &PlyGaussians, options: Options) -> Result<Box<dyn Renderer>, ViewerError> {
    if scene.iter().all(|g| g.sh.iter().all(|&x| x == 0.0)) {
        Ok(Box::new(Viewer::<GaussianPodWithShNoneCov3dSingleConfigs>::new(gpu, scene, options, 0)?))
    } else {
        Ok(Box::new(Viewer::<peer::DefaultGaussianPod>::new(gpu, scene, options, 3)?))
    }
}

struct Viewer<G: GaussianPod> {
    viewer: peer::Viewer<G>,
    ball: Ball,
    options: Options,
}

impl<G: GaussianPod> Viewer<G> {
    fn new(gpu: &Gpu, scene: &PlyGaussians, options: Options, degree: u8) -> Result<Self, ViewerError> {
        let std_dev = GaussianMaxStdDev::new(options.std_dev).ok_or(ViewerError::StdDev(options.std_dev))?;
        let degree = GaussianShDegree::new(degree).unwrap_or_default();
        let mut viewer = peer::Viewer::new(&gpu.device, options.format, scene)?;
        viewer.update_gaussian_transform(&gpu.queue, 1.0, GaussianDisplayMode::Splat, degree, false, std_dev);
        Ok(Self { viewer, ball: Ball::around(&scene.0), options })
    }
}

impl<G: GaussianPod> Renderer for Viewer<G> {
    fn name(&self) -> String {
        format!("wgpu-3dgs-viewer 0.8.0 ({}, {:.2} σ)", bits(self.options.format), self.options.std_dev)
    }

    fn draw(&mut self, gpu: &Gpu, camera: &Camera, target: &Target) {
        let (near, far) = self.ball.depths(camera);
        let size = UVec2::new(camera.width, camera.height);
        self.viewer.update_camera(&gpu.queue, &Theirs { camera, near, far }, size);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        // What its `render` does, but over transparent black: that clears to opaque black, which hides the opacity.
        let count = u32::try_from(self.viewer.gaussians_buffer.len()).unwrap_or(u32::MAX);
        self.viewer.preprocessor.preprocess(&mut encoder, count);
        self.viewer.radix_sorter.sort(&mut encoder, &self.viewer.radix_sort_indirect_args_buffer);
        self.viewer.renderer.render_with_pass(&mut target.pass(&mut encoder), &self.viewer.indirect_args_buffer);
        gpu.queue.submit([encoder.finish()]);
    }
}

/// One of our cameras as it takes them: x right, y up, looking along −z; depths `near` to `far` become 0 to 1.
struct Theirs<'a> {
    camera: &'a Camera,
    near: f32,
    far: f32,
}

impl peer::CameraTrait for Theirs<'_> {
    fn view(&self) -> Mat4 {
        Mat4::from_scale(Vec3::new(1.0, -1.0, -1.0)) * self.camera.view()
    }

    fn projection(&self, _aspect_ratio: f32) -> Mat4 {
        let (c, near, far) = (self.camera, self.near, self.far);
        let (width, height) = (c.width as f32, c.height as f32);
        Mat4::from_cols(
            Vec4::new(2.0 * c.fx / width, 0.0, 0.0, 0.0),
            Vec4::new(0.0, 2.0 * c.fy / height, 0.0, 0.0),
            Vec4::new(1.0 - 2.0 * c.cx / width, 2.0 * c.cy / height - 1.0, far / (near - far), -1.0),
            Vec4::new(0.0, 0.0, near * far / (near - far), 0.0),
        )
    }
}
