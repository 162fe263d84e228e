//! The picture of a window and its mouse actions.

use std::sync::Arc;
use std::time::Instant;

use egui::{Color32, Pos2, Rect, TextureHandle, TextureId, Ui, Vec2};
use glam::{DVec2, DVec3};
use sg_gpu::Gpu;
use sg_gpu::backend::Engine;
use sg_raster::finish::Finish;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::framing::{FirstView, framed};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::orientation::{Axis, Orientation};
use sg_scene::view::View;

use super::contour::Contour;
use super::drawing::{self, DrawnPicture, FrontJob, FrontSurface, Picture, PictureJob};
use super::error::WindowError;
use super::grid::GroundGrid;
use super::image_texture::show_image;
use super::mouse_tool::MouseTool;
use super::move_tool::MoveTool;
use super::navigation::Navigator;
use super::picture_request::PictureRequest;
use super::polygon::Polygon;
use super::shape_tool::ShapeTool;
use crate::display::{
    AdaptiveQuality, BrushController, BrushSample, BrushSign, Clusters, DisplayMode, FollowedScene, LatestWorker,
    Level, OcclusionWorker, Tools, ViewState,
};

/// Time that a picture may take while something moves, seconds.
const BUDGET: f64 = 0.04;

/// Distance between the eyes of the side-by-side view, as a share of the way to the target.
const EYES: f64 = 0.06;

/// A picture of a request, from none to the best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Started {
    Nothing,
    InMotion,
    AtRest,
}

/// The picture of a window.
pub(super) struct SceneView {
    pub(super) scene: Arc<Scene>,
    pub(super) navigator: Navigator,
    /// The scene's first view at the window's shape, where it is shown.
    framed: Option<View>,
    pub(super) mouse_tool: MouseTool,
    pub(super) stereo: bool,
    pub(super) brush_controller: BrushController,
    picture_worker: LatestWorker<PictureJob, DrawnPicture>,
    occlusion_worker: OcclusionWorker,
    front_worker: LatestWorker<FrontJob, Option<FrontSurface>>,
    pub(super) front: Option<FrontSurface>,
    /// Number of `front`: it counts up with each one found.
    pub(super) front_number: u64,
    contour: Contour,
    requested_front: Option<(Camera, Appearance)>,
    /// The newest picture, where it came through memory.
    pixels: Option<TextureHandle>,
    /// Texture id of the newest picture.
    picture: Option<TextureId>,
    /// Size of the newest picture, pixels of the screen.
    picture_size: [u32; 2],
    /// The newest picture, if it lies on the window's device and is not registered there yet.
    on_device: Option<wgpu::Texture>,
    /// The device that pictures may stay on, and their texture id there.
    shown_by: Option<(Gpu, TextureId)>,
    /// The device that draws, if one does.
    drawn_by: Option<Gpu>,
    requested: Option<PictureRequest>,
    changed: Instant,
    /// The best picture of the last request that was started.
    started: Started,
    /// Whether the surface in front is queried once the picture at rest is drawn.
    expects_front: bool,
    adaptive_quality: AdaptiveQuality,
    pub(super) lasso: Vec<Pos2>,
    pub(super) polygon: Polygon,
    pub(super) shape_tool: ShapeTool,
    pub(super) move_tool: MoveTool,
    pub(super) ground_grid: GroundGrid,
    /// Notches of the wheel for the last walk.
    pub(super) notches: f64,
    /// Modifiers of the last turn of the wheel.
    pub(super) wheel: egui::Modifiers,
    /// Position of the brush, and its sign.
    pub(super) hover: Option<(BrushSample, BrushSign)>,
    pub(super) newest: PictureStats,
}

/// Statistics of the newest picture.
#[derive(Debug, Clone, Default)]
pub(super) struct PictureStats {
    pub(super) engine: String,
    pub(super) level: Option<Level>,
    pub(super) seconds: f64,
    pub(super) pictures: u64,
    pub(super) trouble: Option<String>,
}

impl SceneView {
    /// A viewport that draws with `engine`, waking the loop by `wake`.
    pub(super) fn new(
        engine: Engine,
        scene: Arc<Scene>,
        navigator: Navigator,
        brush_controller: BrushController,
        pool: Arc<rayon::ThreadPool>,
        wake: impl Fn() + Clone + Send + 'static,
    ) -> Result<Self, WindowError> {
        let threads = |e: std::io::Error| WindowError::Threads(e.to_string());
        let drawn_by = engine.gpu().cloned();
        Ok(Self {
            navigator,
            framed: None,
            mouse_tool: MouseTool::default(),
            stereo: false,
            brush_controller,
            occlusion_worker: OcclusionWorker::new(Arc::clone(&pool), wake.clone()).map_err(threads)?,
            picture_worker: drawing::pictures(engine, Arc::clone(&pool), wake.clone()).map_err(threads)?,
            ground_grid: GroundGrid::new(wake.clone()).map_err(threads)?,
            shape_tool: ShapeTool::new(Arc::clone(&pool), wake.clone()).map_err(threads)?,
            move_tool: MoveTool::new(wake.clone()).map_err(threads)?,
            front_worker: drawing::fronts(pool, wake).map_err(threads)?,
            scene,
            front: None,
            front_number: 0,
            contour: Contour::default(),
            requested_front: None,
            pixels: None,
            picture: None,
            picture_size: [0, 0],
            on_device: None,
            shown_by: None,
            drawn_by,
            requested: None,
            changed: Instant::now(),
            started: Started::Nothing,
            expects_front: false,
            adaptive_quality: AdaptiveQuality::new(BUDGET),
            lasso: Vec::new(),
            polygon: Polygon::default(),
            notches: 0.0,
            wheel: egui::Modifiers::NONE,
            hover: None,
            newest: PictureStats::default(),
        })
    }

    /// Shows the same Gaussians, some of them elsewhere.
    pub(super) fn show_scene(&mut self, followed: FollowedScene) {
        self.scene = followed.scene;
        if let Some(brush) = followed.brush {
            self.brush_controller.set_brush(brush);
        }
        // The surface in front is that of the former places.
        (self.front, self.requested_front) = (None, None);
    }

    /// Pictures that were late while something moved.
    pub(super) fn late(&self) -> u64 {
        self.adaptive_quality.late()
    }

    /// Whether the shown picture is the best one of the last request.
    pub(super) fn is_current(&self) -> bool {
        self.started == Started::AtRest && self.picture_worker.is_idle()
    }

    /// Whether the best picture is shown and no work is pending.
    pub(super) fn is_settled(&self) -> bool {
        self.started == Started::AtRest
            && !self.expects_front
            && [self.picture_worker.is_idle(), self.front_worker.is_idle(), self.occlusion_worker.is_idle()]
                == [true; 3]
            && self.shape_tool.is_idle()
            && self.move_tool.is_idle()
            && self.ground_grid.is_idle()
    }

    /// Shows the scene's `first` view at the shape of `rect` for as long as the eye stays there, and frames it anew when the
    /// window changes its shape. `file` is the scene without edits.
    pub(super) fn keep_framed(&mut self, first: &mut FirstView, file: &Scene, shared: View, rect: Rect) {
        if self.framed == Some(self.navigator.view) || self.navigator.view == shared {
            let aspect = f64::from(rect.width().max(1.0)) / f64::from(rect.height().max(1.0));
            let view = first.shown(file, shared, aspect);
            self.framed = (view != shared).then_some(view);
            self.navigator.view = view;
        }
    }

    /// Whether the eye is where the scene's view, or its frame at the window's shape, puts it.
    pub(super) fn is_at(&self, shared: View) -> bool {
        let view = self.navigator.view;
        view == shared || self.framed == Some(view)
    }

    /// Frames what the newest picture shows, from the present direction.
    pub(super) fn fit(&mut self) {
        let View { eye, target, up, .. } = self.navigator.view;
        self.frame(target - eye, up);
    }

    /// Looks from the side of the scene that an axis points to, at what the newest picture shows.
    pub(super) fn look_from_side(&mut self, orientation: Orientation, axis: Axis) {
        let (direction, up) = orientation.direction_and_up(orientation.side(axis));
        self.frame(direction, up);
    }

    /// Frames what the newest picture shows, in its width and height, along `direction` from the eye.
    fn frame(&mut self, direction: DVec3, up: DVec3) {
        let fov_y_degrees = self.navigator.view.fov_y_degrees;
        let [width, height] = self.size();
        let aspect = f64::from(width) / f64::from(height);
        let own = Appearance::of(&self.scene);
        let appearance = self.requested.as_ref().map_or(&own, |requested| &requested.appearance);
        let view = framed(&self.scene, appearance, (direction, up), fov_y_degrees, aspect);
        self.navigator.look_from(view);
    }

    /// Size of the picture in pixels of the screen.
    pub(super) fn size(&self) -> [u32; 2] {
        let camera = self.requested.as_ref().and_then(|w| w.cameras.first());
        camera.map_or([1280, 960], |c| [c.width, c.height])
    }

    /// Requests a new picture for another context. It may stay on the device of `shown_by`, under that texture id.
    pub(super) fn show_by(&mut self, shown_by: Option<(Gpu, TextureId)>) {
        self.shown_by = shown_by;
        (self.pixels, self.picture, self.on_device, self.requested) = (None, None, None, None);
        self.contour.forget();
    }

    /// The device that draws pictures, if one does.
    pub(super) fn drawn_by(&self) -> Option<&Gpu> {
        self.drawn_by.as_ref()
    }

    /// The newest picture where it lies on the device that shows the window, once.
    pub(super) fn take_picture(&mut self) -> Option<wgpu::Texture> {
        self.on_device.take()
    }

    /// Gives up a stroke, a lasso, a polygon, a shape or a move.
    pub(super) fn abandon(&mut self) {
        self.brush_controller.abandon();
        self.lasso.clear();
        self.polygon.clear();
        self.shape_tool.clear();
        self.move_tool.clear();
    }

    /// The highlight: the selection with the stroke under way, or with the preview of a stroke begun here or of a shape.
    pub(super) fn highlighted(&self, state: &ViewState, tools: &Tools) -> Arc<Mask> {
        let clusters = state.clusters.as_deref();
        if self.brush_controller.is_drawing() {
            return self.brush_controller.selects(&state.selected, clusters);
        }
        if let Some(selected) = self.shape_tool.would_select(&state.selected) {
            return selected;
        }
        match self.hover.filter(|_| state.services.selection) {
            Some((sample, sign)) => {
                Arc::new(self.brush_controller.would_select(tools, sample, sign, &state.selected, clusters))
            }
            None => Arc::clone(&state.selected),
        }
    }

    /// The camera of a picture that fills `rect`, one pixel a point.
    pub(super) fn camera(&self, rect: Rect) -> Camera {
        let edge = |x: f32| (x.round() as u32).max(1);
        self.navigator.camera(edge(rect.width()), edge(rect.height()))
    }

    /// Surface point in front at a position of the window.
    pub(super) fn front_at(&self, rect: Rect, at: Pos2) -> Option<DVec3> {
        let front = self.front.as_ref().filter(|f| !self.stereo && f.is_of(&self.camera(rect)))?;
        let place = at - rect.min;
        Some(front.at(DVec2::new(f64::from(place.x), f64::from(place.y)))?.point)
    }

    /// Cameras of the picture in pixels of the screen.
    fn cameras(&self, rect: Rect, pixels_per_point: f32) -> Vec<Camera> {
        let (width, height) = (rect.width() * pixels_per_point, rect.height() * pixels_per_point);
        let edge = |x: f32| (x.round() as u32).clamp(1, sg_proto::limits::MAX_PICTURE_PIXELS);
        if !self.stereo {
            return vec![self.navigator.camera(edge(width), edge(height))];
        }
        let view = self.navigator.view;
        let forward = view.target - view.eye;
        let side = 0.5 * EYES * forward.length() * forward.cross(view.up).normalize_or_zero();
        let eye = |way: DVec3| {
            let apart = View { eye: view.eye + way, target: view.target + way, ..view };
            let mut camera = self.navigator.at(apart).camera(edge(0.5 * width), edge(height));
            // Both look straight ahead; points at the target's depth coincide in both pictures.
            camera.cx += camera.fx * way.dot(side.normalize_or_zero()) / forward.length();
            camera
        };
        vec![eye(-side), eye(side)]
    }

    /// Shows the newest picture in `rect`, and wishes for another where `appearance` or the eye has changed.
    pub(super) fn show(&mut self, ui: &Ui, rect: Rect, appearance: &Appearance, state: &ViewState, tools: &Tools) {
        let occlusion = self.occlusion(appearance, tools);
        let appearance = &Appearance { occlusion, ..appearance.clone() };
        let cameras = self.cameras(rect, ui.ctx().pixels_per_point());
        let fits = |clusters: &&Arc<Clusters>| clusters.labels().len() == self.scene.len();
        let outlines = state.clusters.as_ref().filter(|_| tools.display_mode == DisplayMode::Outlines).filter(fits);
        let outlines = outlines.map(|clusters| Arc::clone(clusters.labels()));
        let requested = PictureRequest {
            scene: Arc::clone(&self.scene),
            cameras,
            appearance: appearance.clone(),
            outlines: outlines.is_some(),
            gradient: tools.gradient,
            quality: tools.quality,
            projection: tools.projection,
        };
        let now = Instant::now();
        if self.requested.as_ref() != Some(&requested) {
            self.changed = now;
            self.started = Started::Nothing;
            self.requested = Some(requested);
        }
        let still = now.duration_since(self.changed);
        let settles = self.adaptive_quality.settles();
        let moving = still < settles;
        // One picture in motion is enough of what no longer changes; one at rest follows it.
        let wanted = if moving { Started::InMotion } else { Started::AtRest };
        if self.started < wanted
            && self.picture_worker.is_idle()
            && let Some(PictureRequest { scene, cameras, appearance, .. }) = &self.requested
        {
            let level = self.adaptive_quality.level(tools.quality, moving);
            let projection = tools.projection;
            let (scene, cameras, appearance) = (Arc::clone(scene), cameras.clone(), appearance.clone());
            let shown_by = self.shown_by.as_ref().map(|(gpu, _)| gpu.clone());
            let finish = Finish::to_look_at(appearance.background, tools.gradient);
            self.picture_worker.submit(PictureJob {
                scene,
                cameras,
                appearance,
                level,
                projection,
                moving,
                outlines,
                shown_by,
                finish,
            });
            self.started = wanted;
        }
        // At rest only a finished picture wakes the loop: a frame that asks for the next one keeps a core busy.
        if moving {
            ui.ctx().request_repaint_after(settles.saturating_sub(still));
        }
        self.request_front(rect, appearance);
        if let Some(picture) = self.picture {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            let placed = placed(rect, self.picture_size);
            ui.painter().with_clip_rect(rect).image(picture, placed, whole, Color32::WHITE);
        }
        self.show_grid(ui, rect, appearance, state, tools);
        self.draw_contour(ui, rect, appearance);
        self.draw_markers(ui, rect, state);
        self.draw_brush_ring(ui, rect, tools);
        self.show_polygon(ui, rect);
    }

    /// Draws the contour of the highlight, where the surface in front is known.
    fn draw_contour(&mut self, ui: &Ui, rect: Rect, appearance: &Appearance) {
        let camera = self.camera(rect);
        let Some(overlay) = appearance.overlay.as_ref().filter(|overlay| !overlay.mask.is_none()) else { return };
        let Some(front) = self.front.as_ref().filter(|front| !self.stereo && front.is_of(&camera)) else { return };
        let texture = self.contour.texture(ui, (self.front_number, front.ids()), overlay);
        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        ui.painter().with_clip_rect(rect).image(texture, rect, whole, Color32::WHITE);
    }

    /// The newest ambient occlusion, where it is wanted.
    pub(super) fn occlusion(&mut self, appearance: &Appearance, tools: &Tools) -> Option<Arc<[f32]>> {
        tools.occlusion.then(|| self.occlusion_worker.factors(&self.scene, appearance)).flatten()
    }

    /// Takes the newest picture and its findings. It comes first in a frame, so that all of the frame refers to that picture. Nothing
    /// else may cause another frame.
    pub(super) fn take_in(&mut self, ui: &Ui) {
        if let Some(DrawnPicture { picture, size, level, moving, seconds, engine, drawn_by }) =
            self.picture_worker.take()
        {
            self.adaptive_quality.record(seconds, moving);
            self.newest.engine = engine;
            self.newest.seconds = seconds;
            self.drawn_by = drawn_by;
            match picture {
                Ok(picture) => {
                    self.newest.level = Some(level);
                    self.newest.pictures += 1;
                    self.newest.trouble = None;
                    self.picture_size = size;
                    self.store(ui, picture);
                    if !moving {
                        let [width, height] = size;
                        tracing::debug!("a picture at rest: {width}x{height}");
                    }
                }
                Err(trouble) => self.newest.trouble = Some(trouble),
            }
        }
        if let Some(front) = self.front_worker.take() {
            self.front = front;
            self.front_number += 1;
        }
    }

    fn store(&mut self, ui: &Ui, picture: Picture) {
        match picture {
            Picture::Pixels(image) => {
                self.picture = Some(show_image(ui, &mut self.pixels, "picture", image));
            }
            // On a device that no longer presents the window, the picture is useless; another one is already requested.
            Picture::OnDevice(gpu, texture) => {
                if let Some((_, id)) = self.shown_by.as_ref().filter(|(now, _)| now.is(&gpu)) {
                    (self.picture, self.on_device, self.pixels) = (Some(*id), Some(texture), None);
                }
            }
        }
    }

    /// Queries the frontmost surface once the picture at rest is drawn: both together would delay that picture.
    fn request_front(&mut self, rect: Rect, appearance: &Appearance) {
        let is_queried = !self.stereo && !self.brush_controller.is_drawing();
        self.expects_front = is_queried && !self.is_current();
        if !is_queried || self.expects_front {
            return;
        }
        // The highlight changes no place of anything.
        let wanted =
            (self.camera(rect), Appearance { overlay: None, colors: None, occlusion: None, ..appearance.clone() });
        if self.requested_front.as_ref() != Some(&wanted) {
            let (camera, appearance) = wanted.clone();
            self.front_worker.submit((Arc::clone(&self.scene), camera, appearance));
            self.requested_front = Some(wanted);
        }
    }
}

/// Where a picture of this size lies in `rect`: as high as it, and in its middle. One that was drawn for another shape is neither
/// stretched nor squeezed, since the vertical field of view stays.
fn placed(rect: Rect, [width, height]: [u32; 2]) -> Rect {
    let width = rect.height() * width as f32 / height.max(1) as f32;
    Rect::from_center_size(rect.center(), Vec2::new(width, rect.height()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_another_shape_keeps_its_proportions() {
        let rect = Rect::from_min_size(Pos2::new(10.0, 20.0), Vec2::new(400.0, 200.0));
        assert_eq!(placed(rect, [800, 400]), rect);
        let narrow = placed(rect, [300, 300]);
        assert_eq!((narrow.center(), narrow.size()), (rect.center(), Vec2::new(200.0, 200.0)));
        assert_eq!(placed(rect, [0, 0]).width(), 0.0);
    }
}
