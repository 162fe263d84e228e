//! The render process, offscreen, in one of two roles. The *view* role draws the shared viewpoint whenever the scene
//! changes. The *capture* role draws pictures on request.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use directories::ProjectDirs;
use glam::{DVec3, Vec3};
use sg_edit::wire::encode_color;
use sg_edit::{EditState, PlacedScene, Replica};
use sg_formats::load_verified::load_verified;
use sg_gpu::GpuError;
use sg_gpu::backend::Engine;
use sg_proto::keys::{self, role};
use sg_proto::render as proto;
use sg_proto::selection::Preview;
use sg_raster::finish::{Backdrop, Finish};
use sg_raster::image::Image;
use sg_raster::image_error::FOOTPRINT;
use sg_raster::outline::{OutlineStyle, draw_outlines};
use sg_raster::pick::{SURFACE, front_ids};
use sg_raster::render::{Options, Projection, Quality, Rendered};
use sg_raster::report::StageSeconds;
use sg_runtime::actor::{Actor, ActorError, Reply};
use sg_runtime::blobs::Blobs;
use sg_runtime::bus::{Bus, RetainedValue};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::metrics::{self, Metric};
use sg_runtime::process::{Host, StartError};
use sg_runtime::progress::{self, Progress};
use sg_runtime::scene_replica::SceneReplica;
use sg_scene::appearance::{Appearance, Overlay, UnitAppearance};
use sg_scene::camera::Camera;
use sg_scene::camera_motion::scaled;
use sg_scene::framing::{self, FirstView};
use sg_scene::mask::Mask;
use sg_scene::tone::Tone;
use sg_viewer::display::{DisplayMode, colors_of};
use sg_viewer::window::threads;
use tokio::sync::watch;
use tokio::time::{Interval, MissedTickBehavior};

mod clusters;
mod decode;
mod display;
mod labeling;
mod params;
mod pick;
mod preview;
mod request_executor;
mod state_sync;
mod tour;
mod watchdog;

use clusters::ClusterLabels;
use decode::{clips, display_mode, projection};
use params::{Display, Params};

/// Most queued picture requests while one is drawn.
const QUEUE: usize = 8;

/// Longest edge of the picture that a unit's coverage is measured in, pixels.
const MEASURE_PIXELS: u32 = 256;

/// Most units measured by one request.
const MEASURE_UNITS: usize = 64;

/// Loads and begins to serve.
///
/// # Errors
/// Wrong parameters, an unreadable scene, or an unusable bus.
pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    let params: Params = host.params()?;
    params.check().map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;
    if let Some(folders) = ProjectDirs::from("", "", "supergaussian") {
        // The rights of this process name the same folder.
        sg_gpu::keep_pipelines_in(folders.cache_dir().join("pipelines"));
    }
    let replica = SceneReplica::<Replica>::follow(host.bus()).await?;
    let newest = replica.newest();
    let state = Arc::clone(newest.replica.state());
    let geometry = state.geometry();
    let path = host.scene_path(&geometry.path, &geometry.hash, &newest.context).await?;
    let scene = tokio::task::block_in_place(|| load_verified(&path, &geometry.hash))
        .map_err(|e| StartError::Input(e.to_string()))?;
    progress::current().step();
    let gaussians = scene.len() as u64;
    let scene = Arc::new(scene);
    if params.display != Display::None {
        if host.role() != role::RENDER_VIEW {
            return Err(StartError::Input(format!("`display` is for the role `{}` alone", role::RENDER_VIEW)));
        }
        return display::open(&host, scene, replica, &params).await;
    }
    let (backend, rasterizer) = (params.backend, params.rasterizer);
    let placed = PlacedScene::new(scene);
    let shown = tokio::task::block_in_place(|| placed.of(&state));
    let mut engine = tokio::task::block_in_place(|| Engine::new(shown, backend, rasterizer))
        .map_err(|e| StartError::Failed(e.to_string()))?;
    if let Some(trouble) = engine.take_fallback_error() {
        tracing::warn!("{trouble}");
    }
    tracing::info!(gaussians, engine = engine.name(), "scene read");

    let (row, content) = match host.role() {
        role::RENDER_VIEW => (&keys::VIEW_STATE, &keys::VIEW_CONTENT),
        role::RENDER_CAPTURE => (&keys::CAPTURE_STATE, &keys::CAPTURE_CONTENT),
        other => {
            return Err(StartError::Input(format!(
                "role `{other}` is not one of a render node: use `{}` or `{}`",
                role::RENDER_VIEW,
                role::RENDER_CAPTURE
            )));
        }
    };
    let display = params.display.name().to_owned();
    let status = proto::State { gaussians, engine: engine.name(), display, ..proto::State::default() };
    let actor = RenderActor {
        bus: host.bus().clone(),
        blobs: host.blobs().clone(),
        first_view: FirstView::of(placed.file()),
        near: params.near.unwrap_or_else(|| framing::near_distance(placed.file())),
        placed,
        engine,
        clusters: ClusterLabels::default(),
        replica: replica.clone(),
        pool: threads().map_err(|e| StartError::Failed(format!("threads to draw with: {e}")))?,
        owned: host.bus().retain(row, status.clone()).await?,
        status,
        preview_feed: preview::follow(host.bus()).await?,
        steps: Progress::default(),
        params,
    };
    let mut preview_feed = actor.preview_feed.clone();
    host.serve_content(content).await?;
    let mut redraw_timer = RedrawTimer::new(actor.params.frames_per_second);
    let (mailbox, _) = host.spawn(actor, QUEUE);
    if host.role() == role::RENDER_VIEW {
        tokio::spawn(async move {
            let mut revisions = replica.receiver();
            revisions.mark_changed();
            loop {
                // Newest value: revisions that pass while a picture is drawn are skipped, and counted.
                tokio::select! {
                    changed = revisions.changed() => if changed.is_err() { break },
                    changed = preview_feed.changed() => if changed.is_err() { break },
                    () = redraw_timer.due() => {}
                }
                let context = revisions.borrow_and_update().context.clone();
                let (done, drawn) = tokio::sync::oneshot::channel();
                if mailbox.tell(Message::View { context, done }).is_ok() {
                    let _ = drawn.await;
                }
            }
        });
    } else {
        host.route(&keys::PICK, QUEUE, &mailbox, |request, context, reply| Message::Pick { request, context, reply })
            .await?;
        host.route(&keys::CAPTURE, QUEUE, &mailbox, |request, context, reply| Message::Capture {
            request,
            context,
            reply,
        })
        .await?;
    }
    Ok(())
}

/// Times at which the view draws without a change.
struct RedrawTimer(Option<Interval>);

impl RedrawTimer {
    fn new(per_second: f64) -> Self {
        Self((per_second > 0.0).then(|| {
            let mut interval = tokio::time::interval(Duration::from_secs_f64(1.0 / per_second));
            // The timer does not make up for a late picture.
            interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
            interval
        }))
    }

    async fn due(&mut self) {
        match &mut self.0 {
            Some(interval) => drop(interval.tick().await),
            None => std::future::pending().await,
        }
    }
}

enum Message {
    /// Draw the current shared viewpoint.
    View { context: Context, done: tokio::sync::oneshot::Sender<()> },
    /// Pick the front Gaussian.
    Pick { request: proto::PickRequest, context: Context, reply: Reply<proto::PickReply> },
    /// Draw a picture on request.
    Capture { request: proto::CaptureRequest, context: Context, reply: Reply<proto::Frame> },
}

/// Draws, one picture at a time.
struct RenderActor {
    bus: Bus,
    blobs: Blobs,
    engine: Engine,
    /// The scene where edits put its Gaussians; the engine draws it as of the last request.
    placed: PlacedScene,
    first_view: FirstView,
    /// Near distance of cameras without a target, and the greatest of those with one.
    near: f64,
    replica: SceneReplica<Replica>,
    /// Every picture is made in this thread pool, so that drawing does not delay input.
    pool: Arc<rayon::ThreadPool>,
    owned: RetainedValue<proto::State>,
    status: proto::State,
    clusters: ClusterLabels,
    /// The newest preview of the selection.
    preview_feed: watch::Receiver<Option<Preview>>,
    /// Progress of the present request. The drawing threads report it.
    steps: Progress,
    params: Params,
}

/// The actor's state for logs.
#[derive(Clone)]
struct RenderStatus(proto::State);

impl fmt::Display for RenderStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let proto::State { revision, frames, skipped_revisions, render_ms, engine, .. } = &self.0;
        write!(
            f,
            "revision {revision}, {frames} pictures, {skipped_revisions} skipped, newest {render_ms:.0} ms, drawn by {engine}"
        )
    }
}

impl Actor for RenderActor {
    type Message = Message;
    type State = RenderStatus;

    fn name(&self) -> &'static str {
        "painter"
    }

    fn state(&self) -> RenderStatus {
        RenderStatus(self.status.clone())
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        self.steps = progress::current();
        match message {
            Message::View { context, done } => {
                self.draw_view(&context).await;
                // The pacing task ends with the process.
                let _ = done.send(());
            }
            Message::Pick { request, context, reply } => {
                let _ = reply.send(self.pick(&request, &context).await);
            }
            Message::Capture { request, context, reply } => {
                let outcome = self.capture(&request, &context).await;
                // A requester that has gone away misses only the picture.
                let _ = reply.send(outcome);
            }
        }
        Ok(())
    }
}

impl RenderActor {
    /// Draws the shared viewpoint and publishes it. If drawing or storing fails, it logs the error; the next frame may
    /// succeed.
    async fn draw_view(&mut self, context: &Context) {
        let request = proto::CaptureRequest {
            width: self.params.width,
            height: self.params.height,
            quality: match self.params.quality.unwrap_or(Quality::Standard) {
                Quality::Exact => proto::Quality::Exact,
                Quality::Standard => proto::Quality::Standard,
                Quality::Fast => proto::Quality::Fast,
            }
            .into(),
            projection: match self.params.projection {
                Projection::Affine => proto::Projection::Affine,
                Projection::PerRay => proto::Projection::PerRay,
            }
            .into(),
            highlight_selection: true,
            ..proto::CaptureRequest::default()
        };
        let newest = self.replica.newest().replica;
        let highlighted = preview::highlighted(&newest, self.preview_feed.borrow_and_update().as_ref());
        let frame = match self.work(|actor| actor.draw(newest.state(), &request, highlighted, None)) {
            Ok(frame) => frame,
            Err(fault) => return tracing::error!(%fault, "the view could not be drawn"),
        };
        self.publish_status(&frame, context).await;
        if let Err(fault) = self.bus.publish(&keys::VIEW_FRAME, &frame, &context.next()).await {
            tracing::warn!(%fault, "a picture could not be announced");
        }
    }

    async fn capture(&mut self, request: &proto::CaptureRequest, context: &Context) -> Result<proto::Frame, Fault> {
        let newest = self.replica.at_least(request.at_least_revision, context.deadline).await?.replica;
        let state = newest.state();
        let labels = match display_mode(request) {
            DisplayMode::Clusters | DisplayMode::FirstComponent | DisplayMode::Outlines => {
                Some(self.labels(state, context).await?)
            }
            _ => None,
        };
        let selected = Arc::clone(state.selection().mask());
        let mut frame = self.work(|actor| actor.draw(state, request, selected, labels.as_deref()))?;
        self.steps.step();
        if request.measure_units {
            frame.units = self.work(|actor| actor.measure(state, request))?;
        }
        self.publish_status(&frame, context).await;
        Ok(frame)
    }

    /// Picks the front Gaussian at a pixel or along a ray.
    async fn pick(&mut self, request: &proto::PickRequest, context: &Context) -> Result<proto::PickReply, Fault> {
        let newest = self.replica.at_least(request.at_least_revision, context.deadline).await?.replica;
        let state = newest.state();
        let hit = self.work(|actor| {
            actor.follow(state)?;
            let scene = actor.engine.scene();
            let view =
                actor.first_view.shown(actor.placed.file(), state.view(), aspect([request.width, request.height]));
            pick::pick(scene, (state, view, actor.near), request)
        })?;
        // A scene without a selection process has no clusters, but picking works all the same.
        let labels = if hit.is_some() { self.labels(state, context).await.ok() } else { None };
        Ok(pick::reply(state, hit, labels.as_deref()))
    }

    async fn labels(&mut self, state: &EditState, context: &Context) -> Result<Arc<[u32]>, Fault> {
        let clusters = self.clusters.newest(&self.bus, &self.blobs, state.count(), context).await?;
        Ok(Arc::clone(clusters.labels()))
    }

    async fn publish_status(&mut self, frame: &proto::Frame, context: &Context) {
        let passed = frame.revision.saturating_sub(self.status.revision + 1);
        if self.status.frames > 0 {
            self.status.skipped_revisions += passed;
        }
        self.status.revision = frame.revision;
        self.status.frames += 1;
        self.status.render_ms = frame.render_ms;
        if let Err(fault) = self.owned.set(self.status.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be published");
        }
    }

    /// Runs a task on the drawing threads and waits for it.
    fn work<T: Send>(&mut self, what: impl FnOnce(&mut Self) -> T + Send) -> T {
        let pool = Arc::clone(&self.pool);
        tokio::task::block_in_place(|| pool.install(|| what(self)))
    }

    /// Draws a picture of a state, with `selected` highlighted if the request asks for it.
    fn draw(
        &mut self,
        state: &EditState,
        request: &proto::CaptureRequest,
        selected: Arc<Mask>,
        labels: Option<&[u32]>,
    ) -> Result<proto::Frame, Fault> {
        let start = Instant::now();
        self.follow(state)?;
        let camera = self.camera_of(state, request)?;
        let projection = projection(request.projection());
        let mut look = if request.only_units.is_empty() {
            state.appearance()
        } else {
            let mut look = alone(state, &request.only_units)?;
            look.base.iter_mut().for_each(|base| base.visible = true);
            let others = look.units.len() - 1;
            look.units.iter_mut().take(others).for_each(|unit| unit.visible = true);
            look
        };
        if request.highlight_selection && !selected.is_none() {
            look.overlay = Some(Overlay {
                mask: selected,
                color: Vec3::from_array(self.params.highlight_color),
                mix: self.params.highlight_mix.unwrap_or(sg_viewer::display::Tools::default().highlight_mix),
                opacity: 1.0,
            });
        }
        look.clips = clips(&request.clips)?;
        let quality = match request.quality() {
            proto::Quality::Exact => Quality::Exact,
            proto::Quality::Unspecified | proto::Quality::Standard => Quality::Standard,
            proto::Quality::Fast => Quality::Fast,
        };
        let display_mode = display_mode(request);
        let (colors, legend) =
            colors_of(self.engine.scene(), labels, display_mode).map_err(|e| Fault::invalid(e.to_string()))?;
        look.colors = colors;
        let Rendered { mut image, .. } =
            self.render(&look, &camera, Options { quality, projection, ..Options::default() })?;
        if let (DisplayMode::Outlines, Some(labels)) = (display_mode, labels) {
            let front = front_ids(self.engine.scene(), &look, &camera, projection, SURFACE);
            let (ids, _) = front.map_err(|e| Fault::invalid(e.to_string()))?;
            let drawn = draw_outlines(&mut image, &ids, labels, OutlineStyle::default());
            drawn.map_err(|e| Fault::internal(e.to_string()))?;
        }
        let kept = |e: &dyn fmt::Display| Fault::exhausted(e.to_string());
        let (mut npy, mut png) = (Vec::new(), Vec::new());
        image.write_npy(&mut npy).map_err(|e| kept(&e))?;
        if request.transparent {
            let finish = Finish { backdrop: Backdrop::Transparent, ..Finish::to_look_at(look.background, false) };
            image.write_finished_png(look.background, &finish, &mut png).map_err(|e| kept(&e))?;
        } else {
            image.write_png(&mut png).map_err(|e| kept(&e))?;
        }
        let (hash, npy_path) = self.blobs.put(&npy, "npy").map_err(|e| kept(&e))?;
        let (png_hash, png_path) = self.blobs.put(&png, "png").map_err(|e| kept(&e))?;
        Ok(proto::Frame {
            width: image.width,
            height: image.height,
            revision: state.revision(),
            hash,
            npy_path: npy_path.display().to_string(),
            png_path: png_path.display().to_string(),
            camera: Some(proto::Camera {
                fx: camera.fx,
                fy: camera.fy,
                cx: camera.cx,
                cy: camera.cy,
                world_to_camera: camera.world_to_camera.to_vec(),
            }),
            render_ms: start.elapsed().as_secs_f64() * 1e3,
            coverage: covered(&image, look.background).0,
            units: Vec::new(),
            png_hash,
            legend: legend.map(|l| decode::legend(display_mode, &l)),
        })
    }

    /// Takes the places that a state gives to Gaussians. Without a change of them it costs nothing.
    fn follow(&mut self, state: &EditState) -> Result<(), Fault> {
        let scene = self.placed.of(state);
        self.engine.show(&scene).map_err(|e| Fault::exhausted(e.to_string()))
    }

    /// The camera of a request.
    fn camera_of(&mut self, state: &EditState, request: &proto::CaptureRequest) -> Result<Camera, Fault> {
        let [width, height] = [request.width, request.height];
        let view = self.first_view.shown(self.placed.file(), state.view(), aspect([width, height]));
        let camera = decode::camera(request.camera.as_ref(), (view, self.near), [width, height])?;
        decode::check_stored(camera.width, camera.height)?;
        Ok(camera)
    }

    fn render(&mut self, look: &Appearance, camera: &Camera, options: Options) -> Result<Rendered, Fault> {
        let drawn = self.engine.draw(look, camera, options).map_err(|e| match e {
            GpuError::Input(_) | GpuError::Views(_) => Fault::invalid(e.to_string()),
            _ => Fault::exhausted(e.to_string()),
        })?;
        if let Some(trouble) = self.engine.take_fallback_error() {
            tracing::warn!("{trouble}; the cores draw");
            self.status.engine = self.engine.name();
        }
        let StageSeconds { preprocess, sort, bin, raster, .. } = drawn.report.seconds;
        for (pass, seconds) in [("preprocess", preprocess), ("sort", sort), ("bin", bin), ("raster", raster)] {
            metrics::observe(Metric::PassSeconds, &[("pass", pass)], Duration::from_secs_f64(seconds.max(0.0)));
        }
        Ok(drawn)
    }

    /// Measures each unit's coverage of the picture when drawn alone; 0 for hidden units. Omits derived units: a person did
    /// not make them.
    fn measure(
        &mut self,
        state: &EditState,
        request: &proto::CaptureRequest,
    ) -> Result<Vec<proto::UnitCoverage>, Fault> {
        let scale =
            f64::from(MEASURE_PIXELS) / f64::from(request.width.max(request.height)).max(f64::from(MEASURE_PIXELS));
        let camera = scaled(&self.camera_of(state, request)?, scale);
        let clips = clips(&request.clips)?;
        let options = Options { projection: projection(request.projection()), ..Quality::Fast.into() };
        let saved = state.units().filter(|u| !u.derived).map(|u| u.name.clone());
        let steps = self.steps.clone();
        let base = state.base_units().iter().map(|b| b.name.clone());
        base.chain(saved)
            .take(MEASURE_UNITS)
            .map(|unit| {
                let look = Appearance { clips: clips.clone(), ..alone(state, std::slice::from_ref(&unit))? };
                let Rendered { image, .. } = self.render(&look, &camera, options)?;
                steps.step();
                let (share, color) = covered(&image, look.background);
                Ok(proto::UnitCoverage { unit, share, mean_color: color.map(encode_color) })
            })
            .collect()
    }
}

/// Width over height of a picture.
fn aspect([width, height]: [u32; 2]) -> f64 {
    f64::from(width.max(1)) / f64::from(height.max(1))
}

/// The scene's look with only these units drawn, as far as they are visible. The last of its units hides the rest.
fn alone(state: &EditState, names: &[String]) -> Result<Appearance, Fault> {
    let mut hidden = Mask::empty(state.count());
    for name in names {
        let unit = state.find(name).map_err(|e| Fault::new(e.code(), e.to_string()).with_details(e.details()))?;
        hidden.union_with(&state.members(unit));
    }
    hidden.invert();
    let mut look = state.appearance();
    look.units.push(UnitAppearance {
        mask: Arc::new(hidden),
        color: None,
        opacity: 1.0,
        visible: false,
        tone: Tone::NEUTRAL,
    });
    Ok(look)
}

/// Share of the pixels with coverage above 1/1024, and the mean colour there without the background, weighted by coverage.
fn covered(image: &Image, background: Vec3) -> (f64, Option<Vec3>) {
    let (mut pixels, mut weight, mut sum) = (0_u64, 0.0_f64, DVec3::ZERO);
    for pixel in image.pixels() {
        if let &[r, g, b, a] = pixel
            && a > FOOTPRINT
        {
            pixels += 1;
            weight += f64::from(a);
            sum += (Vec3::new(r, g, b) - (1.0 - a) * background).as_dvec3();
        }
    }
    let all = u64::from(image.width) * u64::from(image.height);
    let color = (weight > 0.0).then(|| (sum / weight).as_vec3().clamp(Vec3::ZERO, Vec3::ONE));
    (pixels as f64 / all.max(1) as f64, color)
}
