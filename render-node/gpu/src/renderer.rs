//! Draws one scene on one device.

use glam::{DMat3, Vec2};
use sg_raster::image::Image;
use sg_raster::render::{check_look, check_scene};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::appearance_buffers::AppearanceBuffers;
use crate::buffers::{RenderTargets, WorkBuffers};
use crate::depth;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::frame_uniform::frame_uniform;
use crate::pass_chain::{BindGroups, FrameOutput, FramePlan, FrameResources, Passes, cannot_blend_quads};
use crate::readback::texture_bytes;
use crate::scene_buffers::SceneBuffers;
use crate::settings::{FrameStats, Options, Rasterizer, Settings};
use crate::shader_layout::Frame;
use crate::stats::{PassSeconds, StatsReadback};
use crate::tiles::{ListSizes, TileMode};
use crate::view_limits::{picture_size, pixels_fit};
use crate::visibility_mask::VisibilityMask;

/// Eyes whose forward axes differ by less share one order: their view depths agree.
const PARALLEL: f64 = 1e-6;

/// Capacity of the list of pairs before the first picture.
const FIRST_PAIRS: u64 = 1 << 20;

/// Limit of the windows of one picture.
const MAX_WINDOWS: u64 = 64;

/// Draws one scene on one device.
pub struct Renderer {
    gpu: Gpu,
    scene: SceneBuffers,
    appearance: AppearanceBuffers,
    passes: Passes,
    frame: wgpu::Buffer,
    /// One for each submission of a frame: canted eyes are two.
    readbacks: [StatsReadback; 2],
    work: WorkBuffers,
    targets: RenderTargets,
    groups: BindGroups,
    mask: Option<VisibilityMask>,
    /// Limit of the pairs in one window.
    listed_pairs: u64,
    /// Number of pairs of the last measured picture.
    pairs: u64,
    /// Length of its longest list of a tile.
    longest: u32,
    /// Whether tiles drew it.
    tiled: bool,
    last_stats: FrameStats,
}

impl Renderer {
    /// Uploads a scene.
    ///
    /// # Errors
    /// [`GpuError`] for an invalid scene, too little memory, or a device that does not respond.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::with_options(gpu, scene, Options::default())
    }

    /// Uploads a scene for a renderer with these limits.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with_options(gpu: &Gpu, scene: &Scene, options: Options) -> Result<Self, GpuError> {
        check_scene(scene)?;
        let scene = SceneBuffers::upload(gpu, scene, options.half);
        gpu.check()?;
        let appearance = AppearanceBuffers::new(gpu, scene.len, &scene.units);
        let passes = Passes::new(gpu, &scene, options.multiview.unwrap_or(!gpu.is_software()));
        let work = WorkBuffers::new(gpu, &scene, 1, false);
        let renderer = Self {
            appearance,
            passes,
            frame: gpu.uniform("frame", &Frame::default()),
            readbacks: [StatsReadback::new(gpu), StatsReadback::new(gpu)],
            work,
            targets: RenderTargets::new(gpu, [1, 1], 1),
            groups: BindGroups::default(),
            mask: None,
            listed_pairs: u64::from(options.listed_pairs).clamp(1024, gpu.largest_binding() / 4),
            pairs: 0,
            longest: 0,
            tiled: false,
            last_stats: FrameStats::default(),
            scene,
            gpu: gpu.clone(),
        };
        gpu.wait()?;
        Ok(renderer)
    }

    /// The device of the renderer.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Number of Gaussians in the scene.
    #[must_use]
    pub fn gaussians(&self) -> usize {
        self.scene.len
    }

    /// Whether the device can draw with [`Rasterizer::Quads`] and [`Rasterizer::Bands`].
    #[must_use]
    pub fn blends_quads(&self) -> bool {
        self.passes.blends_quads()
    }

    /// Sets the visibility mask of the left and the right eye: triangles, their corners as shares of the picture's width and
    /// height from the upper left. From the next picture on quadrilaterals skip these pixels, and the background stays.
    /// Visible pixels stay the same to the last bit. Tiles ignore the mask, and so do triangles that are not finite.
    pub fn hide(&mut self, eyes: [&[[Vec2; 3]]; 2]) {
        self.mask = VisibilityMask::upload(&self.gpu, eyes);
    }

    /// Bytes of the scene's columns on the device.
    #[must_use]
    pub fn column_bytes(&self) -> u64 {
        self.scene.bytes
    }

    /// Number of Gaussians with a NaN or infinite attribute. The renderer does not draw them.
    #[must_use]
    pub fn dropped_non_finite(&self) -> usize {
        self.scene.non_finite
    }

    /// Bytes that the last change of the appearance uploaded.
    #[must_use]
    pub fn appearance_bytes(&self) -> u64 {
        self.appearance.uploaded_bytes
    }

    /// Draws one picture for each camera and reads them back. Waits for the device; meant for single pictures and tests.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn picture(
        &mut self,
        cameras: &[Camera],
        appearance: &Appearance,
        settings: Settings,
    ) -> Result<(Vec<Image>, FrameStats), GpuError> {
        let stats = self.draw_complete(cameras, appearance, settings)?;
        let images = self.targets.pictures.iter().map(|picture| self.read(picture)).collect::<Result<_, _>>()?;
        Ok((images, stats))
    }

    /// Draws [`Self::pictures`] and waits until they are complete. Draws again with larger lists if needed.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn draw_complete(
        &mut self,
        cameras: &[Camera],
        appearance: &Appearance,
        settings: Settings,
    ) -> Result<FrameStats, GpuError> {
        // Statistics of an earlier picture must not count for this one.
        self.gpu.wait()?;
        self.read_stats()?;
        loop {
            self.draw(cameras, appearance, settings)?;
            let (stats, complete) = self.finish()?;
            if complete {
                return Ok(stats);
            }
        }
    }

    /// Textures of the last pictures, one for each camera of [`Self::draw`]: f32 RGBA as in [`Image`]. Later submissions read
    /// them complete. The next draw overwrites them.
    #[must_use]
    pub fn pictures(&self) -> &[wgpu::Texture] {
        &self.targets.pictures
    }

    /// Depth textures of the last [`Self::pictures`], or none without [`Settings::depths`]: f32, view z in the scene's unit, 0
    /// below an accumulated opacity of [`sg_raster::pick::SURFACE`].
    ///
    /// Tiles store the depth of the Gaussian that reaches this opacity, as [`sg_raster::pick`] does. In the affine projection
    /// this is the depth of its center, in the ray-consistent one the depth of its densest place on the pixel's ray.
    /// Quadrilaterals store the weighted mean depth of all centers, at a quarter of the width and height, rounded up.
    #[must_use]
    pub fn depths(&self) -> &[wgpu::Texture] {
        &self.targets.depths
    }

    /// Reads [`Self::depths`] back, rows from the top. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn read_depths(&self) -> Result<Vec<Vec<f32>>, GpuError> {
        let read = |t| texture_bytes(&self.gpu, t, 4).map(|bytes| bytemuck::pod_collect_to_vec(&bytes));
        self.targets.depths.iter().map(read).collect()
    }

    /// Waits for the last picture. Returns its statistics, and whether the picture is complete. After an incomplete picture
    /// the next one uses larger lists.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn finish(&mut self) -> Result<(FrameStats, bool), GpuError> {
        self.gpu.wait()?;
        self.read_stats()?;
        let complete = self.groups.tiles.as_ref().is_none_or(|t| t.complete(self.pairs, self.longest));
        Ok((self.last_stats, complete))
    }

    /// Submits a picture for each camera (one, or two eyes of one size) without a wait. Scenes without selection, units or
    /// their own colors pay nothing for them.
    ///
    /// # Errors
    /// [`GpuError::Input`] and [`GpuError::Views`] for invalid input, [`GpuError::TooMany`] if an earlier picture held more
    /// Gaussians than fit, and all errors that the device reported since the last call.
    pub fn draw(&mut self, cameras: &[Camera], appearance: &Appearance, settings: Settings) -> Result<(), GpuError> {
        let size = picture_size(&self.gpu, cameras, settings)?;
        if settings.rasterizer() != Rasterizer::Tiles && !self.blends_quads() {
            return Err(cannot_blend_quads(&self.gpu));
        }
        for camera in cameras {
            check_look([self.scene.len, self.scene.units.len()], appearance, camera)?;
        }
        self.gpu.check()?;
        // Process finished readbacks, without a wait.
        let _ = self.gpu.device.poll(wgpu::PollType::Poll);
        self.read_stats()?;
        self.appearance.update(&self.gpu, &self.scene.units, self.scene.origin, appearance);
        if self.targets.size != size || self.targets.pictures.len() != cameras.len() {
            self.targets = RenderTargets::new(&self.gpu, size, cameras.len());
            self.groups.drop_sized();
        }
        let pictures = if settings.depths { cameras.len() } else { 0 };
        depth::prepare_textures(&self.gpu, &mut self.targets.depths, (size, pictures), settings.rasterizer());
        let forward = |c: &Camera| DMat3::from_mat4(c.view()).row(2);
        let parallel = match cameras {
            [left, right] => (forward(right) - forward(left)).abs().max_element() <= PARALLEL,
            _ => true,
        };
        if parallel && pixels_fit(&self.gpu, size, cameras.len() as u64, settings) {
            self.submit_frame(cameras, 0, settings)?;
        } else {
            for (k, camera) in cameras.iter().enumerate() {
                self.submit_frame(std::slice::from_ref(camera), k, settings)?;
            }
        }
        self.gpu.check()
    }

    /// Draws views of one depth order into the pictures from `first` on.
    fn submit_frame(&mut self, cameras: &[Camera], first: usize, settings: Settings) -> Result<(), GpuError> {
        let views = cameras.len() as u32;
        let rasterizer = settings.rasterizer();
        let mode = TileMode { window: settings.sort_window(), depths: settings.depths };
        let per_ray = mode.window.is_some();
        if !self.work.fit(views, per_ray) {
            self.work = WorkBuffers::new(&self.gpu, &self.scene, views, per_ray);
            self.groups = BindGroups::default();
        }
        let size = self.targets.size;
        let plan = FramePlan { size, rasterizer, mode, lists: self.list_sizes(), masked: self.mask.is_some() };
        let Self { gpu, scene, appearance, passes, frame, readbacks, work, targets, groups, mask, .. } = self;
        let bound = passes.bind(groups, &FrameResources { gpu, frame, scene, appearance, work }, plan)?;
        let uniform = frame_uniform(cameras, settings, (scene, appearance, work), size, bound.pair_capacity);
        gpu.write_uniform(frame, &uniform);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let stats = &mut readbacks[first];
        stats.begin();
        let output = FrameOutput {
            first_eye: first,
            pictures: targets.pictures.get(first..).unwrap_or_default(),
            depths: targets.depths.get(first..).unwrap_or_default(),
        };
        bound.encode((gpu, mask.as_ref()), &mut encoder, stats, work, output);
        let copied = stats.copy(&mut encoder, &work.totals, &work.longest_list);
        gpu.submit([encoder.finish()]);
        if copied {
            stats.map();
            self.tiled = rasterizer == Rasterizer::Tiles;
        }
        Ok(())
    }

    /// Sizes of the lists for as many pairs as the last measured picture had, and a quarter more.
    fn list_sizes(&self) -> ListSizes {
        let limit = self.listed_pairs;
        let capacity = (self.pairs + self.pairs / 4).next_power_of_two().clamp(FIRST_PAIRS.min(limit), limit);
        let windows = self.pairs.div_ceil(capacity).clamp(1, MAX_WINDOWS) as u32;
        ListSizes { capacity, windows, longest: self.longest }
    }

    /// Takes the completed readbacks.
    fn read_stats(&mut self) -> Result<(), GpuError> {
        let read: Vec<_> = self.readbacks.iter().filter_map(StatsReadback::take).collect();
        if read.is_empty() {
            return Ok(());
        }
        let (mut stats, mut marked) = (FrameStats::default(), 0);
        if self.tiled {
            (self.pairs, self.longest) = (0, 0);
        }
        for picture in read {
            // Eyes with separate orders share the buffers: the larger count decides.
            stats.listed = stats.listed.max(picture.totals.listed);
            marked = marked.max(picture.totals.marked);
            if self.tiled {
                stats.tile_pairs = stats.tile_pairs.saturating_add(picture.totals.pairs);
                self.pairs = self.pairs.max(picture.totals.pairs.into());
                self.longest = self.longest.max(picture.longest);
            }
            stats.seconds = match (stats.seconds, picture.seconds) {
                (Some(a), Some(b)) => Some(PassSeconds::plus(&a, &b)),
                (a, b) => a.or(b),
            };
        }
        let device = || self.gpu.name().to_owned();
        if u64::from(marked) > self.work.capacity {
            return Err(GpuError::TooMany { device: device(), found: marked.into(), capacity: self.work.capacity });
        }
        let limit = self.listed_pairs * MAX_WINDOWS;
        if self.tiled && self.pairs > limit {
            let reason = format!(
                "one picture can have {limit} pairs of a Gaussian and a tile, not {}; draw it with quadrilaterals",
                self.pairs
            );
            return Err(GpuError::Failed { device: device(), reason });
        }
        self.last_stats = stats;
        Ok(())
    }

    fn read(&self, picture: &wgpu::Texture) -> Result<Image, GpuError> {
        let [width, height] = self.targets.size;
        let rgba = texture_bytes(&self.gpu, picture, 16)?;
        Ok(Image { width, height, rgba: bytemuck::pod_collect_to_vec(&rgba) })
    }
}
