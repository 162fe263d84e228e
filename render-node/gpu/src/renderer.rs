//! Draws one scene on one device.

use glam::{DMat3, Vec2};
use half::f16;
use sg_raster::image::Image;
use sg_raster::render::{check_look, check_scene};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::appearance_buffers::{AppearanceBuffers, AppearanceState};
use crate::buffers::{MAX_WORKGROUPS, RenderTargets, WorkBuffers};
use crate::depth;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::frame_uniform::{OrderRange, frame_uniform};
use crate::pass_chain::{BindGroups, FrameOutput, FramePlan, FrameResources, Passes, cannot_blend_quads};
use crate::readback::texture_bytes;
use crate::scene_buffers::SceneBuffers;
use crate::settings::{FrameStats, Options, Rasterizer, Settings};
use crate::shader_layout::{Frame, PAIR_BLOCK};
use crate::splats::PipelineKey;
use crate::stats::{PassSeconds, StatsReadback};
use crate::textures::PicturePrecision;
use crate::tiles::{ListSizes, TileMode};
use crate::view_limits::{picture_size, pixels_fit};
use crate::visibility_mask::VisibilityMask;

/// Eyes whose forward axes differ by less share one order: their view depths agree.
pub(super) const PARALLEL: f64 = 1e-6;

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
    /// Precision of the pictures.
    precision: PicturePrecision,
    mask: Option<VisibilityMask>,
    /// Number of masks so far.
    masks: u64,
    /// Limit of the pairs in one window.
    listed_pairs: u64,
    /// Number of pairs of the last measured picture.
    pairs: u64,
    /// Length of its longest list of a tile.
    longest: u32,
    /// Whether tiles drew it.
    tiled: bool,
    /// Number of pictures drawn.
    drawn: u64,
    /// Width and height up to which pictures share their targets; 0 before [`Self::prepare`].
    reserved: [u32; 2],
    /// Whether [`Self::draw`] may replace lists of tiles by longer ones.
    grows: bool,
    /// Whether every pipeline that an edit can need has been compiled: without and with occlusion, for either projection.
    compiled: [[bool; 2]; 2],
    /// Whether [`Self::prepare`] makes the pipelines of pictures with occlusion too.
    expects_occlusion: bool,
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
        let precision = PicturePrecision::of(options.half_pictures);
        let by_default = !gpu.is_software();
        let of_cards = [options.multiview, options.staged_blending].map(|chosen| chosen.unwrap_or(by_default));
        let passes = Passes::new(gpu, &scene, of_cards, precision);
        let work = WorkBuffers::new(gpu, &scene, 1, false);
        let renderer = Self {
            appearance,
            passes,
            frame: gpu.uniform("frame", &Frame::default()),
            readbacks: [StatsReadback::new(gpu), StatsReadback::new(gpu)],
            work,
            targets: RenderTargets::new(gpu, [1, 1], 1, precision),
            precision,
            groups: BindGroups::default(),
            mask: None,
            masks: 0,
            listed_pairs: u64::from(options.listed_pairs)
                .clamp(1024, (gpu.largest_binding() / 4).min(MAX_WORKGROUPS * u64::from(PAIR_BLOCK))),
            pairs: 0,
            longest: 0,
            tiled: false,
            drawn: 0,
            reserved: [0, 0],
            grows: true,
            compiled: [[false; 2]; 2],
            expects_occlusion: false,
            last_stats: FrameStats::default(),
            scene,
            gpu: gpu.clone(),
        };
        gpu.wait()?;
        Ok(renderer)
    }

    /// Draws this scene from now on, if it has the same Gaussians, some of them elsewhere: uploads its columns anew, and keeps
    /// everything else. Returns whether it does; a scene of other columns needs another renderer. For the moment of the upload the
    /// device holds both.
    ///
    /// # Errors
    /// As [`Renderer::new`]; the former scene then stays.
    pub fn show(&mut self, scene: &Scene) -> Result<bool, GpuError> {
        check_scene(scene)?;
        if scene.len() != self.scene.len {
            return Ok(false);
        }
        // A picture under way still reads the former columns.
        self.gpu.wait()?;
        let columns = SceneBuffers::upload(&self.gpu, scene, self.scene.half);
        self.gpu.check()?;
        if !columns.is_like(&self.scene) {
            return Ok(false);
        }
        self.scene = columns;
        self.groups = BindGroups::default();
        self.gpu.wait()?;
        Ok(true)
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

    /// Whether the device has timestamps: [`FrameStats`] then has times.
    #[must_use]
    pub fn has_timestamps(&self) -> bool {
        self.gpu.has(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Sets the visibility mask of the left and the right eye: triangles, their corners as shares of the picture's width and
    /// height from the upper left. From the next picture on quadrilaterals skip these pixels, and tiles those that are hidden
    /// whole; there the background stays. Visible pixels stay the same to the last bit. Triangles that are not finite do not
    /// count.
    pub fn hide(&mut self, eyes: [&[[Vec2; 3]]; 2]) {
        self.masks += 1;
        self.mask = VisibilityMask::upload(&self.gpu, eyes, self.masks);
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

    /// From now on [`Self::prepare`] makes the pipelines of pictures with [`Appearance::occlusion`] too. Most displays never show
    /// any, so they are not compiled before.
    pub fn expect_occlusion(&mut self) {
        self.expects_occlusion = true;
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
        let grows = std::mem::replace(&mut self.grows, true);
        let drawn = loop {
            match self.draw(cameras, appearance, settings).and_then(|()| self.finish()) {
                Ok((stats, true)) => break Ok(stats),
                Ok((_, false)) => (),
                Err(error) => break Err(error),
            }
        };
        self.grows = grows;
        drawn
    }

    /// Textures of the last pictures, one for each camera of [`Self::draw`]: f32 RGBA as in [`Image`], or f16 with
    /// [`Options::half_pictures`]. Later submissions read them complete. The next draw overwrites them.
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
        let read = |t: &wgpu::Texture| {
            let of_quads = t.width() < self.targets.capacity[0] || t.height() < self.targets.capacity[1];
            let rasterizer = if of_quads { Rasterizer::Quads } else { Rasterizer::Tiles };
            let size = depth::depth_size(self.targets.size, rasterizer);
            texture_bytes(&self.gpu, t, size, 4).map(|bytes| bytemuck::pod_collect_to_vec(&bytes))
        };
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

    /// Number of the last picture, counted from 1 by [`Self::draw`].
    #[must_use]
    pub fn drawn(&self) -> u64 {
        self.drawn
    }

    /// Takes finished measurements, without a wait. Returns the newest one.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn measured(&mut self) -> Result<FrameStats, GpuError> {
        self.read_stats()?;
        Ok(self.last_stats)
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
        let tinted = self.scene.tinted(appearance);
        let appearance = tinted.as_ref().unwrap_or(appearance);
        self.gpu.check()?;
        // Process finished readbacks, without a wait.
        let _ = self.gpu.device.poll(wgpu::PollType::Poll);
        self.read_stats()?;
        self.drawn += 1;
        self.appearance.update(&self.gpu, &self.scene.units, self.scene.origin, appearance);
        self.fit_targets(size, cameras.len(), settings);
        if self.draws_together(cameras, size, settings) {
            self.submit_frame(cameras, 0, settings)?;
        } else {
            for (k, camera) in cameras.iter().enumerate() {
                self.submit_frame(std::slice::from_ref(camera), k, settings)?;
            }
        }
        self.gpu.check()
    }

    /// Makes ready what pictures of these cameras' size and below can need, so that [`Self::draw`] creates nothing: targets,
    /// buffers, room for edits, and the pipelines of every edit; those of pictures with occlusion only after
    /// [`Self::expect_occlusion`]. Lists of tiles that have become too short grow here; until
    /// then pictures may lack their farthest splats. Call it between frames. Each call compiles the pipelines of at most one
    /// kind of edit. Returns whether none is left.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn prepare(&mut self, cameras: &[Camera], settings: Settings) -> Result<bool, GpuError> {
        let size = picture_size(&self.gpu, cameras, settings)?;
        if settings.rasterizer() != Rasterizer::Tiles && !self.blends_quads() {
            return Err(cannot_blend_quads(&self.gpu));
        }
        self.read_stats()?;
        if self.reserved == [0, 0] {
            self.appearance.reserve(&self.gpu, self.scene.len);
        }
        self.reserved = size;
        self.fit_targets(size, cameras.len(), settings);
        let views = if self.draws_together(cameras, size, settings) { cameras.len() as u32 } else { 1 };
        self.fit_work(views, settings);
        let plan = self.plan(size, settings, true, u32::BITS);
        let Self { gpu, scene, appearance, passes, frame, work, groups, targets, mask, .. } = self;
        let mask = mask.as_ref();
        let resources = FrameResources { gpu, frame, scene, appearance, work, targets, mask };
        passes.bind(groups, &resources, plan)?;
        let per_ray = settings.sort_window().is_some();
        let occludes = self.expects_occlusion || self.appearance.state.occluded;
        let was_new = self.prepare_edits(per_ray, false) || (occludes && self.prepare_edits(per_ray, true));
        self.grows = false;
        self.gpu.check()?;
        Ok(!was_new)
    }

    /// Makes the pipelines and bind groups of at most one kind of edit, of pictures without or with occlusion. Returns whether it
    /// made some.
    fn prepare_edits(&mut self, per_ray: bool, occluded: bool) -> bool {
        let Self { gpu, scene, appearance, passes, frame, work, groups, targets, mask, compiled, .. } = self;
        let resources = FrameResources { gpu, frame, scene, appearance, work, targets, mask: mask.as_ref() };
        let compiled = &mut compiled[usize::from(per_ray)][usize::from(occluded)];
        let state = AppearanceState { occluded, ..appearance.state };
        let mut keys = PipelineKey::of_edits(scene, &state, per_ray);
        // Another shading term has other kernels: a frame compiles those that it needs.
        let was_new =
            keys.any(|key| (!*compiled || passes.is_compiled(key)) && passes.prepare(groups, &resources, key));
        if !was_new && !*compiled {
            *compiled = true;
            gpu.save_pipelines_or_log();
        }
        was_new
    }

    /// Width and height of the drawn part of [`Self::depths`] for pictures of `size` pixels.
    #[must_use]
    pub fn depth_size(&self, size: [u32; 2], settings: Settings) -> [u32; 2] {
        depth::depth_size(size, settings.rasterizer())
    }

    /// Whether one frame draws all cameras: they share a depth order, and their pixels fit into one binding.
    fn draws_together(&self, cameras: &[Camera], size: [u32; 2], settings: Settings) -> bool {
        let forward = |c: &Camera| DMat3::from_mat4(c.view()).row(2);
        let parallel = match cameras {
            [left, right] => (forward(right) - forward(left)).abs().max_element() <= PARALLEL,
            _ => true,
        };
        parallel && pixels_fit(&self.gpu, size, cameras.len() as u64, settings)
    }

    /// Makes the targets fit pictures of `size` pixels. Pictures within the reserved size keep them.
    fn fit_targets(&mut self, size: [u32; 2], views: usize, settings: Settings) {
        let [width, height] = self.reserved;
        let capacity = if size[0] <= width && size[1] <= height { self.reserved } else { size };
        if self.targets.capacity != capacity || self.targets.pictures.len() != views {
            self.targets = RenderTargets::new(&self.gpu, capacity, views, self.precision);
            self.groups.drop_sized();
        }
        self.targets.size = size;
        let pictures = if settings.depths { views } else { 0 };
        let (gpu, depths) = (&self.gpu, &mut self.targets.depths);
        if depth::prepare_textures(gpu, depths, (capacity, pictures), settings.rasterizer()) {
            // They are bound to the former ones.
            self.groups.tiles = None;
        }
    }

    /// Makes the work buffers fit.
    fn fit_work(&mut self, views: u32, settings: Settings) {
        let per_ray = settings.sort_window().is_some();
        if !self.work.fit(views, per_ray) {
            self.work = WorkBuffers::new(&self.gpu, &self.scene, views, per_ray);
            self.groups = BindGroups::default();
        }
    }

    fn plan(&self, size: [u32; 2], settings: Settings, may_grow: bool, order_bits: u32) -> FramePlan {
        FramePlan {
            size,
            may_grow,
            rasterizer: settings.rasterizer(),
            mode: TileMode { window: settings.sort_window(), depths: settings.depths },
            lists: self.list_sizes(),
            order_bits,
        }
    }

    /// Draws views of one depth order into the pictures from `first` on.
    fn submit_frame(&mut self, cameras: &[Camera], first: usize, settings: Settings) -> Result<(), GpuError> {
        let views = cameras.len() as u32;
        self.fit_work(views, settings);
        let size = self.targets.size;
        let order = OrderRange::of(cameras, settings);
        let plan = self.plan(size, settings, self.grows, order.bits);
        let Self { gpu, scene, appearance, passes, frame, readbacks, work, targets, groups, mask, drawn, .. } = self;
        let mask = mask.as_ref();
        let bound =
            passes.bind(groups, &FrameResources { gpu, frame, scene, appearance, work, targets, mask }, plan)?;
        let eyes = (first, mask.is_some());
        let uniform =
            frame_uniform(cameras, (settings, order), (scene, appearance, work), size, bound.pair_capacity, eyes);
        gpu.write_uniform(frame, &uniform);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let stats = &mut readbacks[first];
        stats.begin(size);
        let output = FrameOutput {
            first_eye: first,
            size,
            pictures: targets.pictures.get(first..).unwrap_or_default(),
            depths: targets.depths.get(first..).unwrap_or_default(),
        };
        bound.encode((gpu, mask), &mut encoder, stats, work, output);
        let copied = stats.copy(&mut encoder, [&work.totals, &work.longest_list, work.near_rays()], *drawn);
        gpu.submit([encoder.finish()]);
        if copied {
            stats.map();
            self.tiled = settings.rasterizer() == Rasterizer::Tiles;
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

    /// Takes the completed readbacks. Those of two submissions belong to one picture, and are taken together.
    fn read_stats(&mut self) -> Result<(), GpuError> {
        if self.readbacks.iter().any(StatsReadback::is_pending) {
            return Ok(());
        }
        let read = self.readbacks.each_ref().map(StatsReadback::take);
        if read.iter().all(Option::is_none) {
            return Ok(());
        }
        let (mut stats, mut marked, mut near) = (FrameStats::default(), 0, 0);
        if self.tiled {
            (self.pairs, self.longest) = (0, 0);
        }
        for picture in read.into_iter().flatten() {
            // Eyes with separate orders share the buffers: the larger count decides.
            stats.listed = stats.listed.max(picture.totals.listed);
            marked = marked.max(picture.totals.marked);
            stats.by_rays = stats.by_rays.saturating_add(picture.near_rays);
            near = near.max(picture.near_rays);
            if self.tiled {
                stats.tile_pairs = stats.tile_pairs.saturating_add(picture.totals.pairs);
                self.pairs = self.pairs.max(picture.totals.pairs.into());
                self.longest = self.longest.max(picture.longest);
            }
            stats.picture = stats.picture.max(picture.picture);
            stats.device_seconds = match (stats.device_seconds, picture.device_seconds) {
                (Some(a), Some(b)) => Some(a + b),
                (a, b) => a.or(b),
            };
            stats.seconds = match (stats.seconds, picture.seconds) {
                (Some(a), Some(b)) => Some(PassSeconds::plus(&a, &b)),
                (a, b) => a.or(b),
            };
        }
        let device = || self.gpu.name().to_owned();
        if u64::from(marked) > self.work.capacity {
            return Err(GpuError::TooMany { device: device(), found: marked.into(), capacity: self.work.capacity });
        }
        let capacity = self.work.near_capacity;
        if u64::from(near) > capacity {
            return Err(GpuError::TooManyNear { device: device(), found: near.into(), capacity });
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
        let bytes = texture_bytes(&self.gpu, picture, [width, height], self.precision.pixel_bytes())?;
        let rgba = match self.precision {
            PicturePrecision::Full => bytemuck::pod_collect_to_vec(&bytes),
            PicturePrecision::Half => {
                bytemuck::pod_collect_to_vec::<u8, f16>(&bytes).into_iter().map(f16::to_f32).collect()
            }
        };
        Ok(Image { width, height, rgba })
    }
}
