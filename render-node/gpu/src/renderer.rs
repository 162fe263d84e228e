//! One scene on one device: cameras in, pictures out.

use glam::{DMat3, DVec3, Vec2, Vec4};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use super::GpuError;
use super::columns::{BLOCK, Columns};
use super::depth::{self, Depths};
use super::device::Gpu;
use super::hidden::Hidden;
use super::look::Look;
use super::passes::{BANDS, Needs, Passes};
use super::rays::Waiting;
use super::reading::bytes_of;
pub use super::timing::PassSeconds;
use super::timing::{Onto, Span, Timing};
use super::uniform::{FrameUniform, ViewUniform};
use super::work::{
    ALL_DRAWN, BAND_DRAWS, Canvas, Mode, Ordering, PART_DISPATCHES, Quads, STRETCH, Tiles, Work, tile_count,
};
use sg_raster::image::Image;
use sg_raster::render::{Projection, Quality, check_look, check_scene};
use sg_raster::{Limits, NEAR};

/// How splats are blended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rasterizer {
    /// Lists for each 16 × 16 tile, blended by compute shaders.
    #[default]
    Tiles,
    /// A quadrilateral for each splat, blended by the fixed function.
    Quads,
    /// The same in five bands, near to far, between which pixels that let almost nothing through are closed: solid surfaces
    /// spare what lies behind them, and where one sees through everything it costs a test for each pixel.
    Bands,
}

impl Rasterizer {
    /// All.
    pub const ALL: [Self; 3] = [Self::Tiles, Self::Quads, Self::Bands];
}

/// How pictures are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Settings {
    /// `Exact` is for the CPU alone; here it means `Standard`.
    pub quality: Quality,
    /// How splats are blended.
    pub rasterizer: Rasterizer,
    /// Whether both eyes see the colours of the eye between them, which spares one of two evaluations of the shading.
    pub shared_shading: bool,
    /// How Gaussians are projected and ordered. [`Projection::PerRay`] is drawn by tiles, whatever the rasterizer.
    pub projection: Projection,
    /// Whether [`Renderer::depths`] are made as well; their time is not in [`PassSeconds`], but for what tiles and rays note.
    pub depths: bool,
}

impl Settings {
    /// What blends: rays need lists.
    fn rasterizer(&self) -> Rasterizer {
        if self.waiting().is_some() { Rasterizer::Tiles } else { self.rasterizer }
    }

    /// How layers are put in order on each ray, where they are.
    fn waiting(&self) -> Option<Waiting> {
        match (self.projection, self.quality) {
            (Projection::Affine, _) => None,
            (Projection::PerRay, Quality::Fast) => Some(Waiting { layers: 32, parts: 32 }),
            (Projection::PerRay, _) => Some(Waiting { layers: 32, parts: 256 }),
        }
    }
}

/// What drawing did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Drawn {
    /// Gaussians that may reach a picture.
    pub listed: u32,
    /// Pairs of a Gaussian and a tile, all views; 0 with quadrilaterals.
    pub tile_pairs: u32,
    /// Time of the device in each pass, where it can measure it.
    pub seconds: Option<PassSeconds>,
}

/// What a renderer may use of its device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Whether shading columns and harmonics are stored in half precision (2⁻¹¹ of each number).
    pub half: bool,
    /// Most pairs of a Gaussian and a tile that are listed at once, 16 bytes each; more are blended in windows.
    pub listed_pairs: u32,
    /// Whether quadrilaterals of two parallel eyes are blended in one pass where the device can. Left open, graphics cards
    /// do and software devices do not: they win nothing, and lavapipe of Mesa 22.3 draws the right eye wrongly.
    pub multiview: Option<bool>,
}

impl Default for Options {
    fn default() -> Self {
        Self { half: false, listed_pairs: 1 << 23, multiview: None }
    }
}

/// Forward axes of two eyes that differ by less share one order: by view depth it is then the same for both.
const PARALLEL: f64 = 1e-6;

/// Pairs of a Gaussian and a tile that there is room for before any picture has been drawn.
const FIRST_PAIRS: u64 = 1 << 20;

/// Most tiles of a picture on a software device, which leaves a loop over the tiles of one Gaussian after 65,535 rounds.
const SOFTWARE_TILES: u32 = 60_000;

/// Most windows of one picture.
const WINDOWS: u64 = 64;

/// Draws one scene on one device.
pub struct Renderer {
    gpu: Gpu,
    columns: Columns,
    look: Look,
    passes: Passes,
    frame: wgpu::Buffer,
    /// One for each picture that is handed in by itself: canted eyes are two.
    timings: [Timing; 2],
    work: Work,
    canvas: Canvas,
    bound: Bound,
    pairs: u64,
    listed_pairs: u64,
    /// What of the views nobody can see.
    hidden: Option<Hidden>,
    /// Splats of the longest list of a tile.
    longest: u32,
    /// Whether the picture that the device was last asked about is made of tiles.
    tiled: bool,
    told: Drawn,
}

/// Passes bound to the buffers of now; what is `None` is bound when it is next needed.
#[derive(Default)]
struct Bound {
    needs: Option<(Needs, u64)>,
    ordering: Option<Ordering>,
    quads: Option<Quads>,
    tiles: Option<Tiles>,
    depths: Option<(Rasterizer, Depths)>,
}

impl Renderer {
    /// Uploads a scene.
    ///
    /// # Errors
    /// [`GpuError`] for a scene that makes no picture, too little memory, or a device that does not answer.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        Self::with_options(gpu, scene, Options::default())
    }

    /// Uploads a scene for a renderer with limits of its own.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with_options(gpu: &Gpu, scene: &Scene, options: Options) -> Result<Self, GpuError> {
        check_scene(scene)?;
        let columns = Columns::upload(gpu, scene, options.half);
        gpu.check()?;
        let look = Look::new(gpu, columns.len, &columns.units);
        let passes = Passes::new(gpu, &columns, options.multiview.unwrap_or(!gpu.is_software()));
        let work = Work::new(gpu, &columns, 1, false);
        let renderer = Self {
            look,
            passes,
            frame: gpu.buffer("frame", size_of::<FrameUniform>() as u64, wgpu::BufferUsages::UNIFORM),
            timings: [Timing::new(gpu), Timing::new(gpu)],
            work,
            canvas: Canvas::new(gpu, [1, 1], 1),
            bound: Bound::default(),
            pairs: 0,
            listed_pairs: u64::from(options.listed_pairs).clamp(1024, gpu.largest_binding() / 4),
            hidden: None,
            longest: 0,
            tiled: false,
            told: Drawn::default(),
            columns,
            gpu: gpu.clone(),
        };
        gpu.wait()?;
        Ok(renderer)
    }

    /// The device that draws.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Gaussians in the scene.
    #[must_use]
    pub fn gaussians(&self) -> usize {
        self.columns.len
    }

    /// Whether the device can draw with [`Rasterizer::Quads`] and [`Rasterizer::Bands`].
    #[must_use]
    pub fn blends_quads(&self) -> bool {
        self.passes.quads.is_some()
    }

    /// Says what of the left and the right eye's pictures nobody can see: triangles, their corners as shares of the width and
    /// height from the upper left. From the next picture on quadrilaterals are not blended there, and the background stays;
    /// visible pixels are the same to the last bit. Tiles are blended everywhere. Corners that are not finite hide nothing.
    pub fn hide(&mut self, eyes: [&[[Vec2; 3]]; 2]) {
        self.hidden = Hidden::upload(&self.gpu, eyes);
    }

    /// Bytes that the scene's columns take on the device.
    #[must_use]
    pub fn column_bytes(&self) -> u64 {
        self.columns.bytes
    }

    /// Gaussians with a NaN or infinite attribute, which are drawn nowhere.
    #[must_use]
    pub fn dropped_non_finite(&self) -> usize {
        self.columns.non_finite
    }

    /// Bytes that the newest change of the look sent to the device.
    #[must_use]
    pub fn look_bytes(&self) -> u64 {
        self.look.uploaded
    }

    /// Draws and reads the pictures back, one for each camera. For single pictures and tests: it waits for the device.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn picture(
        &mut self,
        cameras: &[Camera],
        appearance: &Appearance,
        settings: Settings,
    ) -> Result<(Vec<Image>, Drawn), GpuError> {
        let drawn = self.whole(cameras, appearance, settings)?;
        let images = self.canvas.pictures.iter().map(|picture| self.read(picture)).collect::<Result<_, _>>()?;
        Ok((images, drawn))
    }

    /// Draws [`Self::pictures`] and waits until they are there and complete, however much room they need.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn whole(
        &mut self,
        cameras: &[Camera],
        appearance: &Appearance,
        settings: Settings,
    ) -> Result<Drawn, GpuError> {
        // An answer about an earlier picture must not be taken for one about this.
        self.gpu.wait()?;
        self.learn()?;
        loop {
            self.draw(cameras, appearance, settings)?;
            let (drawn, complete) = self.finish()?;
            if complete {
                return Ok(drawn);
            }
        }
    }

    /// The newest pictures where they lie on the device, one for each camera of [`Self::draw`] in its order: f32 RGBA, as an
    /// [`Image`] is. What is handed to the device later reads them complete; the next draw writes them anew.
    #[must_use]
    pub fn pictures(&self) -> &[wgpu::Texture] {
        &self.canvas.pictures
    }

    /// How far away what the newest pictures show is, one for each of [`Self::pictures`] that was drawn with
    /// [`Settings::depths`], else none: f32, view z in the scene's unit, 0 where the accumulated opacity stays below
    /// [`sg_raster::pick::SURFACE`]. Tiles and rays tell the depth of the Gaussian that brings a pixel there, as [`sg_raster::pick`]
    /// does: in the affine projection of its centre, by ray of the place where it is densest on the pixel's ray. Quadrilaterals
    /// tell the mean depth of all centres that a pixel shows, by share, at a quarter of the width and height, rounded up.
    #[must_use]
    pub fn depths(&self) -> &[wgpu::Texture] {
        &self.canvas.depths
    }

    /// [`Self::depths`] read back, rows from the top: it waits for the device.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn read_depths(&self) -> Result<Vec<Vec<f32>>, GpuError> {
        let read = |t| bytes_of(&self.gpu, t, 4).map(|bytes| bytemuck::pod_collect_to_vec(&bytes));
        self.canvas.depths.iter().map(read).collect()
    }

    /// Waits until the newest picture is drawn: what drawing did, and whether all of it is in the picture. Where it is not,
    /// the next one makes room.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn finish(&mut self) -> Result<(Drawn, bool), GpuError> {
        self.gpu.wait()?;
        self.learn()?;
        let complete = |t: &Tiles| self.pairs <= t.capacity * t.windows.len() as u64 && t.blends(self.longest);
        Ok((self.told, self.bound.tiles.as_ref().is_none_or(complete)))
    }

    /// Hands a picture of each camera (one, or two eyes of one size) to the device and does not wait for it. Without a
    /// selection, units or colours of its own a scene pays nothing for them.
    ///
    /// # Errors
    /// [`GpuError::Input`] and [`GpuError::Views`] for what makes no picture, [`GpuError::TooMany`] when an earlier picture
    /// was found to hold more than fits, and whatever the device has reported since the last call.
    pub fn draw(&mut self, cameras: &[Camera], appearance: &Appearance, settings: Settings) -> Result<(), GpuError> {
        let first = cameras.first().ok_or_else(|| GpuError::Views("no camera was given".to_owned()))?;
        let size = [first.width, first.height];
        if cameras.len() > 2 || cameras.iter().any(|c| [c.width, c.height] != size) {
            return Err(GpuError::Views("one camera or two of one size are drawn together".to_owned()));
        }
        let largest = self.gpu.device.limits().max_texture_dimension_2d;
        if size.iter().any(|s| *s > largest) {
            let [width, height] = size;
            return Err(GpuError::Views(format!(
                "{} draws pictures of at most {largest} pixels each way, not {width} x {height}",
                self.gpu.name()
            )));
        }
        if settings.rasterizer() != Rasterizer::Tiles && !self.blends_quads() {
            return Err(GpuError::Views(format!("{} cannot blend in f32; draw with tiles", self.gpu.name())));
        }
        let tiles: u32 = tile_count(size, settings.waiting().is_some()).iter().product();
        if settings.rasterizer() == Rasterizer::Tiles && self.gpu.is_software() && tiles > SOFTWARE_TILES {
            return Err(GpuError::Views(format!(
                "{} can list at most {SOFTWARE_TILES} tiles for one Gaussian, not the {tiles} of this picture; draw it with \
                 quadrilaterals, in the affine projection",
                self.gpu.name()
            )));
        }
        // Tiles collect the pixels of all views that are drawn together in one buffer.
        let fits = |views: u64| {
            let bytes = 16 * views * u64::from(size[0]) * u64::from(size[1]);
            settings.rasterizer() != Rasterizer::Tiles || bytes <= self.gpu.largest_binding()
        };
        let all_fit = fits(cameras.len() as u64);
        if !fits(1) {
            let [width, height] = size;
            return Err(GpuError::Views(format!(
                "{} cannot hold {width} x {height} pixels in one buffer; draw the picture with quadrilaterals, in the affine \
                 projection",
                self.gpu.name()
            )));
        }
        for camera in cameras {
            check_look([self.columns.len, self.columns.units.len()], appearance, camera)?;
        }
        self.gpu.check()?;
        // Whatever has been answered meanwhile; nothing is waited for.
        let _ = self.gpu.device.poll(wgpu::PollType::Poll);
        self.learn()?;
        self.look.set(&self.gpu, &self.columns.units, self.columns.origin, appearance);
        if self.canvas.size != size || self.canvas.pictures.len() != cameras.len() {
            self.canvas = Canvas::new(&self.gpu, size, cameras.len());
            self.bound.quads = None;
            self.bound.tiles = None;
            self.bound.depths = None;
        }
        let pictures = if settings.depths { cameras.len() } else { 0 };
        depth::prepare(&self.gpu, &mut self.canvas.depths, (size, pictures), settings.rasterizer());
        let forward = |c: &Camera| DMat3::from_mat4(c.view()).row(2);
        let together = all_fit && cameras.iter().all(|c| (forward(c) - forward(first)).abs().max_element() <= PARALLEL);
        if together {
            self.draw_together(cameras, 0, settings);
        } else {
            for (k, camera) in cameras.iter().enumerate() {
                self.draw_together(std::slice::from_ref(camera), k, settings);
            }
        }
        self.gpu.check()
    }

    /// Draws views that share one order into the pictures from `first` on.
    fn draw_together(&mut self, cameras: &[Camera], first: usize, settings: Settings) {
        let views = cameras.len() as u32;
        let (rasterizer, waiting) = (settings.rasterizer(), settings.waiting());
        let per_ray = waiting.is_some();
        if !self.work.serves(views, per_ray) {
            self.work = Work::new(&self.gpu, &self.columns, views, per_ray);
            self.bound = Bound::default();
        }
        if let Some(waiting) = waiting {
            self.passes.prepare_rays(&self.gpu, waiting, settings.depths);
        }
        if settings.depths {
            self.passes.prepare_depths(&self.gpu);
        }
        self.bind(rasterizer, (waiting, settings.depths));
        self.write_frame(cameras, settings);
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.timings[first].begin();
        self.encode_order(&mut encoder, first);
        match rasterizer {
            Rasterizer::Tiles => self.encode_tiles(&mut encoder, first, views),
            Rasterizer::Quads | Rasterizer::Bands => {
                self.encode_quads(&mut encoder, first, rasterizer == Rasterizer::Bands);
            }
        }
        self.encode_compose(&mut encoder, first, rasterizer);
        if settings.depths {
            self.encode_depths(&mut encoder, first);
        }
        let asked = self.timings[first].ask(&mut encoder, &self.work.totals, &self.work.longest);
        self.gpu.submit([encoder.finish()]);
        if asked {
            self.tiled = rasterizer == Rasterizer::Tiles;
            self.timings[first].expect_answer();
        }
    }

    fn bind(&mut self, rasterizer: Rasterizer, mode: Mode) {
        let needs = Needs::of(&self.columns, &self.look.now, mode.0.is_some());
        let key = Some((needs, self.look.generation));
        let tested = self.hidden.is_some() || rasterizer == Rasterizer::Bands;
        let Self { gpu, columns, look, passes, frame, work, canvas, bound, .. } = self;
        if bound.needs != key {
            bound.needs = key;
            bound.ordering = None;
        }
        let ordering =
            bound.ordering.get_or_insert_with(|| Ordering::bind(gpu, frame, (columns, look, work), passes, needs));
        let order = (&*work, &ordering.depths);
        match rasterizer {
            Rasterizer::Quads | Rasterizer::Bands => {
                if tested {
                    passes.test(gpu);
                }
                if bound.quads.as_ref().is_none_or(|q| q.is_tested() != tested) {
                    bound.quads = Some(Quads::bind(gpu, frame, order, passes, (canvas.size, tested)));
                }
            }
            Rasterizer::Tiles => {
                let most = self.listed_pairs;
                let wanted = (self.pairs + self.pairs / 4).next_power_of_two();
                let capacity = wanted.clamp(FIRST_PAIRS.min(most), most);
                let windows = self.pairs.div_ceil(capacity).clamp(1, WINDOWS) as u32;
                let stretches = self.longest.div_ceil(STRETCH).max(1);
                let fits = |t: &Tiles| t.mode == mode && t.holds(capacity, windows) && t.blends(self.longest);
                if !bound.tiles.as_ref().is_some_and(fits) {
                    // Freed first: both at once may not fit.
                    bound.tiles = None;
                    bound.depths = None;
                    let lists = (capacity, windows, stretches);
                    bound.tiles = Some(Tiles::bind(gpu, frame, order, passes, canvas.size, lists, mode));
                }
            }
        }
        let Some(depths) = passes.depths().filter(|_| mode.1) else { return };
        if bound.depths.as_ref().is_none_or(|(of, _)| *of != rasterizer) {
            let made = match (rasterizer, &bound.tiles) {
                (Rasterizer::Quads | Rasterizer::Bands, _) => Depths::of_quads(gpu, frame, order, depths, canvas.size),
                (Rasterizer::Tiles, Some(tiles)) => Depths::of_tiles(gpu, frame, (depths, tiles, work.views)),
                (Rasterizer::Tiles, None) => return,
            };
            bound.depths = Some((rasterizer, made));
        }
    }

    /// Takes in what the device has answered.
    fn learn(&mut self) -> Result<(), GpuError> {
        let answers: Vec<_> = self.timings.iter().filter_map(Timing::answer).collect();
        if answers.is_empty() {
            return Ok(());
        }
        let (mut told, mut most_found) = (Drawn::default(), 0);
        if self.tiled {
            (self.pairs, self.longest) = (0, 0);
        }
        for ([listed, marked, _, pairs, longest], seconds) in answers {
            // Where eyes have an order each, there has to be room for the one that needs more.
            told.listed = told.listed.max(listed);
            most_found = most_found.max(marked);
            if self.tiled {
                told.tile_pairs = told.tile_pairs.saturating_add(pairs);
                self.pairs = self.pairs.max(pairs.into());
                self.longest = self.longest.max(longest);
            }
            told.seconds = match (told.seconds, seconds) {
                (Some(a), Some(b)) => Some(a.plus(&b)),
                (a, b) => a.or(b),
            };
        }
        let device = || self.gpu.name().to_owned();
        if u64::from(most_found) > self.work.capacity {
            return Err(GpuError::TooMany { device: device(), found: most_found.into(), capacity: self.work.capacity });
        }
        let most = self.listed_pairs * WINDOWS;
        if self.tiled && self.pairs > most {
            let pairs = self.pairs;
            let reason = format!(
                "{pairs} pairs of Gaussians and tiles are more than the {most} of one picture; draw it with quadrilaterals"
            );
            return Err(GpuError::Failed { device: device(), reason });
        }
        self.told = told;
        Ok(())
    }

    fn write_frame(&self, cameras: &[Camera], settings: Settings) {
        let Limits { cut, ratio, stop } = match settings.quality {
            Quality::Exact | Quality::Standard => Limits::STANDARD,
            Quality::Fast => Limits::FAST,
        };
        let origin = self.columns.origin;
        let mut views = [ViewUniform::default(); 2];
        for (view, camera) in views.iter_mut().zip(cameras) {
            *view = ViewUniform::of(camera, origin);
        }
        let between = cameras.iter().map(Camera::eye).sum::<DVec3>() / cameras.len() as f64 - origin;
        let shares = settings.shared_shading && cameras.len() > 1;
        let now = &self.look.now;
        let uniform = FrameUniform {
            views,
            shading_eye: between.as_vec3().extend(f32::from(u8::from(shares))),
            light: now.light,
            overlay: now.overlay_color,
            background: now.background,
            limits: Vec4::new(cut as f32, ratio as f32, stop, NEAR as f32),
            size: self.canvas.size,
            tiles: tile_count(self.canvas.size, settings.waiting().is_some()),
            view_count: cameras.len() as u32,
            capacity: self.work.capacity as u32,
            pair_capacity: self.bound.tiles.as_ref().map_or(0, |t| t.capacity as u32),
            edits: now.edits,
            mask_words: self.look.mask_words(),
            clips: now.sides,
            spare: [0; 2],
        };
        self.gpu.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(&uniform));
    }

    fn encode_order(&mut self, encoder: &mut wgpu::CommandEncoder, first: usize) {
        let Self { gpu, columns, passes, timings, work, bound, .. } = self;
        let timing = &mut timings[first];
        let Bound { needs: Some((needs, _)), ordering: Some(ordering), .. } = bound else { return };
        {
            let mut pass = timing.compute(encoder, Span::List);
            let kernels = passes.specialised(gpu, *needs);
            let blocks = |count: u32| [count.div_ceil(BLOCK as u32), 1, 1];
            for (group, p) in ordering.mark.iter().zip(&columns.parts) {
                kernels.mark.run(&mut pass, group, blocks(p.part.count));
            }
            passes.sum_blocks.run(&mut pass, &ordering.sum_blocks, [1, 1, 1]);
            for (group, p) in ordering.list.iter().zip(&columns.parts) {
                passes.list.run(&mut pass, group, blocks(p.part.count));
            }
        }
        {
            let mut pass = timing.compute(encoder, Span::Project);
            let kernels = passes.specialised(gpu, *needs);
            for (group, at) in ordering.project.iter().zip((PART_DISPATCHES..).step_by(3)) {
                kernels.project.run_counted(&mut pass, group, &work.dispatches, at);
            }
        }
        let mut pass = timing.compute(encoder, Span::Sort);
        passes.depth_sort.run(&mut pass, &ordering.depths, &work.dispatches, 0);
    }

    fn encode_tiles(&mut self, encoder: &mut wgpu::CommandEncoder, first: usize, views: u32) {
        let Self { passes, timings, work, bound, canvas, .. } = self;
        let timing = &mut timings[first];
        let Some(tiles) = &bound.tiles else { return };
        let [across, down] = tile_count(canvas.size, tiles.mode.0.is_some());
        let rays = passes.rays(tiles.mode.0, tiles.mode.1);
        let affine = (&passes.touch, &passes.list_pairs, passes.blend_of(tiles.mode.1));
        let (touch, list, blend) = rays.map_or(affine, |rays| (&rays.touch, &rays.list, &rays.blend));
        for (k, window) in tiles.windows.iter().enumerate() {
            {
                let mut pass = timing.compute(encoder, Span::Bin);
                if k == 0 {
                    touch.run_counted(&mut pass, &tiles.touch, &work.dispatches, 3);
                    passes.sum_touched.run(&mut pass, &tiles.sum_touched, [1, 1, 1]);
                }
                passes.open_window.run(&mut pass, &window.open, [1, 1, 1]);
                list.run_counted(&mut pass, &window.list, &work.dispatches, 3);
                if let (Some(by_depth), Some(rays)) = (&tiles.by_depth, rays) {
                    rays.measure.run_counted(&mut pass, &by_depth.measure, &tiles.dispatches, 3);
                    passes.pair_sort.run(&mut pass, &by_depth.sorting, &tiles.dispatches, 0);
                    rays.order.run_counted(&mut pass, &by_depth.order, &tiles.dispatches, 3);
                }
                passes.pair_sort.run(&mut pass, &tiles.sorting, &tiles.dispatches, 0);
                passes.clear_lists.run(&mut pass, &tiles.clear_lists, [tiles.clear_groups, 1, 1]);
                passes.find_ends.run_counted(&mut pass, &tiles.find_ends, &tiles.dispatches, 3);
                passes.longest.run(&mut pass, &tiles.longest, [tiles.clear_groups, 1, 1]);
            }
            let mut pass = timing.compute(encoder, Span::Blend);
            for stretch in &window.blend {
                blend.run(&mut pass, stretch, [across, down, views]);
            }
        }
    }

    fn encode_quads(&mut self, encoder: &mut wgpu::CommandEncoder, first: usize, in_bands: bool) {
        let Self { gpu, passes, timings, work, bound, hidden, .. } = self;
        let timing = &mut timings[first];
        let Some(quads) = &bound.quads else { return };
        let tested = passes.tested().filter(|_| quads.is_tested());
        let (pipelines, mask) = passes.quads_of(work.views, quads.is_tested());
        let draws = if in_bands { BANDS } else { 1 };
        for band in 0..draws {
            let draw = if in_bands { BAND_DRAWS + 4 * band } else { ALL_DRAWN };
            let stays = band > 0;
            if let (true, Some(tested)) = (stays, tested) {
                for (k, group) in (0..).zip(&quads.close) {
                    let depths = quads.depths(k, false);
                    let onto = Onto { color: None, depths: depths.as_ref(), stays };
                    tested.closing.encode(&mut timing.drawing(encoder, Span::Blend, onto, None), group);
                }
            }
            for (k, (group, pipeline)) in (0..).zip(quads.draw.iter().zip(pipelines)) {
                let (target, depths) = (quads.target(k, mask.is_some()), quads.depths(k, mask.is_some()));
                let onto = Onto { color: Some(&target), depths: depths.as_ref(), stays };
                let mut pass = timing.drawing(encoder, Span::Blend, onto, mask);
                if let (false, Some(hidden), Some(tested)) = (stays, hidden.as_ref(), tested) {
                    hidden.encode(gpu, &tested.hiding, &mut pass, (first, work.views, k as usize));
                }
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, group, &[]);
                pass.draw_indirect(&work.dispatches, 4 * draw);
            }
        }
    }

    fn encode_compose(&mut self, encoder: &mut wgpu::CommandEncoder, first: usize, rasterizer: Rasterizer) {
        let Self { passes, timings, bound, canvas, .. } = self;
        let timing = &mut timings[first];
        let (groups, pipelines) = match (rasterizer, &bound.quads, &bound.tiles) {
            (Rasterizer::Quads | Rasterizer::Bands, Some(quads), _) => (&quads.compose, &passes.compose_quads),
            (Rasterizer::Tiles, _, Some(tiles)) => (&tiles.compose, &passes.compose_tiles),
            _ => return,
        };
        for ((group, pipeline), picture) in groups.iter().zip(pipelines).zip(canvas.pictures.iter().skip(first)) {
            let target = picture.create_view(&wgpu::TextureViewDescriptor::default());
            let mut pass =
                timing.drawing(encoder, Span::Compose, Onto { color: Some(&target), depths: None, stays: false }, None);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.draw(0..3, 0..1);
        }
    }

    fn encode_depths(&self, encoder: &mut wgpu::CommandEncoder, first: usize) {
        let (Some((_, depths)), Some(passes)) = (&self.bound.depths, self.passes.depths()) else { return };
        let pictures = self.canvas.depths.get(first..).unwrap_or_default();
        depths.encode(encoder, passes, &self.work.dispatches, pictures);
    }

    fn read(&self, picture: &wgpu::Texture) -> Result<Image, GpuError> {
        let [width, height] = self.canvas.size;
        let rgba = bytes_of(&self.gpu, picture, 16)?;
        Ok(Image { width, height, rgba: bytemuck::pod_collect_to_vec(&rgba) })
    }
}
