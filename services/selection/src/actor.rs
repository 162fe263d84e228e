//! The selection process: strokes in, a committed selection out.
//!
//! It keeps no truth of its own. The strokes a selection was made from are stored with it in the scene, so that undo takes
//! strokes back as well and a restart forgets nothing.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Deserialize;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::{Command, CommandResult, CommitSelection, StrokeKind, StrokeMode, command};
use sg_proto::{scene as proto, selection};
use sg_runtime::actor::{Actor, Reply};
use sg_runtime::bus::{Bus, Owned};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};
use sg_runtime::scene_feed::{SceneFeed, Update};
use sg_scene::edit::wire::encode_mask;
use sg_scene::edit::{EditState, Replica};
use sg_scene::known::read_known;
use sg_scene::model::Scene;
use sg_selection::cache::{self, ClusterCache, Found};
use sg_selection::cluster_graph::ClusterGraph;
use sg_selection::clustering::{Clustering, ClusteringOptions, cluster};
use sg_selection::geometry::{Geometry, GeometryOptions};
use sg_selection::progress::Silent;
use sg_selection::session::SelectionSession;
use sg_selection::space::{SelectionSpace, WalkOptions};
use sg_selection::strokes::{Kind, Mode, Stroke};
use tokio::sync::watch;

/// Requests that may wait while one is worked on.
const QUEUE: usize = 8;

/// Parameters in the launch file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Params {
    /// Most Super-Gaussians in each base unit.
    max_clusters: usize,
    /// Nearest neighbours of each Gaussian.
    neighbours: usize,
    /// Weight of features against distance.
    compactness: f64,
    /// ε of the leak to the background.
    leak: f64,
    /// Factor on σ_s.
    sigma_s: f64,
    /// Factor on σ_f.
    sigma_f: f64,
    /// Folder of cached clusters; by default one in the session's folder.
    cache: Option<PathBuf>,
}

impl Default for Params {
    fn default() -> Self {
        let (geometry, clustering, walk) =
            (GeometryOptions::default(), ClusteringOptions::default(), WalkOptions::default());
        Self {
            max_clusters: clustering.max_clusters,
            neighbours: geometry.neighbours,
            compactness: clustering.compactness,
            leak: walk.leak,
            sigma_s: walk.sigma_s,
            sigma_f: walk.sigma_f,
            cache: None,
        }
    }
}

/// Loads and begins to serve.
///
/// # Errors
/// Wrong parameters, a scene that cannot be read, a bus that cannot be used.
pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::SELECTION {
        return Err(StartError::Input(format!("role `{}`: this executable serves `{}`", host.role(), role::SELECTION)));
    }
    let params: Params = host.params()?;
    let walk =
        WalkOptions { leak: params.leak, sigma_s: params.sigma_s, sigma_f: params.sigma_f, ..WalkOptions::default() };
    walk.check().map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;

    let mut feed = SceneFeed::open(host.bus()).await?;
    let state = loop {
        match feed.next().await {
            Some((Update::Snapshot(state), _)) => break state,
            Some((Update::Event(_), _)) => (),
            None => return Err(StartError::Failed("the bus closed before the scene was known".to_owned())),
        }
    };
    let state = EditState::from_snapshot(&state).map_err(|e| StartError::Failed(format!("scene snapshot: {e}")))?;
    let cache = ClusterCache::new(&params.cache.clone().unwrap_or_else(|| host.run_dir().join("clusters")));
    let geometry = state.geometry();
    let path = host.scene_path(&geometry.path, &geometry.hash).await?;
    let prepared = tokio::task::block_in_place(|| prepare(&path, &geometry.hash, &params, walk, &cache))?;
    tracing::info!(
        clusters = prepared.space.clusters(),
        from_cache = prepared.from_cache,
        clustering_ms = prepared.clustering_ms,
        "clustered"
    );

    let told = selection::State {
        revision: state.revision(),
        scene_hash: state.geometry().hash.clone(),
        clusters: u32::try_from(prepared.space.clusters()).unwrap_or(u32::MAX),
        clustering_ms: prepared.clustering_ms,
        from_cache: prepared.from_cache,
    };
    let owned = host.bus().own(&keys::SELECTION_STATE, told.clone()).await?;
    let (newest, state) = watch::channel(Arc::new(state));
    tokio::spawn(follow(feed, newest, owned, told));

    let selector = Selector {
        bus: host.bus().clone(),
        session: SelectionSession::new(prepared.space),
        state,
        answered: 0,
        last_walk_ms: 0.0,
    };
    let (mailbox, _) = host.spawn(selector, QUEUE);
    host.serve(&keys::SELECTION_STROKES, QUEUE, move |request, context| {
        let mailbox = mailbox.clone();
        async move { mailbox.ask(context.deadline, |reply| Draw { request, context, reply }).await }
    })
    .await?;
    Ok(())
}

struct Prepared {
    space: Arc<SelectionSpace>,
    from_cache: bool,
    clustering_ms: f64,
}

/// Reads the geometry the scene speaks of and clusters it, or finds the clusters in the cache.
fn prepare(
    path: &Path,
    hash: &str,
    params: &Params,
    walk: WalkOptions,
    cache: &ClusterCache,
) -> Result<Prepared, StartError> {
    let scene = read_known(path, hash).map_err(|e| StartError::Input(e.to_string()))?;
    let start = Instant::now();
    let geometry_options = GeometryOptions { neighbours: params.neighbours, ..GeometryOptions::default() };
    let options = ClusteringOptions {
        max_clusters: params.max_clusters,
        compactness: params.compactness,
        ..ClusteringOptions::default()
    };
    let key = cache::key(&scene, geometry_options, &options);
    let (clustering, graph, from_cache) = match cache.load(&key, scene.len()) {
        Found::Entry(entry) => (entry.0, entry.1, true),
        found => {
            if let Found::Damaged(why) = found {
                tracing::warn!("cached clusters are made anew: {why}");
            }
            let (clustering, graph) = compute(&scene, geometry_options, &options)?;
            if let Err(error) = cache.store(&key, &clustering, &graph) {
                tracing::warn!(%error, "the clusters could not be cached; a restart will make them again");
            }
            (clustering, graph, false)
        }
    };
    let clustering_ms = start.elapsed().as_secs_f64() * 1e3;
    let space = Arc::new(SelectionSpace::of_clusters(&scene, &clustering, &graph, walk));
    Ok(Prepared { space, from_cache, clustering_ms })
}

fn compute(
    scene: &Scene,
    geometry: GeometryOptions,
    options: &ClusteringOptions,
) -> Result<(Clustering, ClusterGraph), StartError> {
    let input = |e: &dyn fmt::Display| StartError::Input(e.to_string());
    let geometry = Geometry::of_scene(scene, geometry, &Silent).map_err(|e| input(&e))?;
    let (clustering, _) = cluster(&geometry, options, &Silent).map_err(|e| input(&e))?;
    let graph = ClusterGraph::new(&geometry, &clustering, WalkOptions::default().form).map_err(|e| input(&e))?;
    Ok((clustering, graph))
}

/// Keeps the newest state and tells which revision it is.
async fn follow(
    mut feed: SceneFeed,
    newest: watch::Sender<Arc<EditState>>,
    owned: Owned<selection::State>,
    mut told: selection::State,
) {
    let mut replica = Replica::new(EditState::clone(&newest.borrow()));
    while let Some((update, context)) = feed.next().await {
        if let Err(error) = take(&mut replica, &update) {
            tracing::error!("the scene cannot be followed: {error}");
            continue;
        }
        newest.send_replace(Arc::new(replica.state().clone()));
        told.revision = replica.revision();
        if let Err(fault) = owned.set(told.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be published");
        }
    }
}

fn take(replica: &mut Replica, update: &Update) -> Result<(), String> {
    match update {
        Update::Event(event) => replica.offer(event).map(drop).map_err(|e| e.to_string()),
        Update::Snapshot(state) => {
            *replica = Replica::new(EditState::from_snapshot(state).map_err(|e| e.to_string())?);
            Ok(())
        }
    }
}

/// Strokes to be drawn.
struct Draw {
    request: selection::StrokesRequest,
    context: Context,
    reply: Reply<selection::StrokesReply>,
}

/// Turns strokes into selections, one request at a time.
struct Selector {
    bus: Bus,
    session: SelectionSession,
    state: watch::Receiver<Arc<EditState>>,
    answered: u64,
    last_walk_ms: f64,
}

/// What may be seen of the selector.
#[derive(Clone)]
struct Seen {
    revision: u64,
    answered: u64,
    strokes: usize,
    last_walk_ms: f64,
}

impl fmt::Display for Seen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { revision, answered, strokes, last_walk_ms } = self;
        write!(f, "revision {revision}, {answered} requests, {strokes} strokes, last walk {last_walk_ms:.1} ms")
    }
}

impl Actor for Selector {
    type Message = Draw;
    type State = Seen;

    fn name(&self) -> &'static str {
        "selector"
    }

    fn state(&self) -> Seen {
        Seen {
            revision: self.state.borrow().revision(),
            answered: self.answered,
            strokes: self.session.strokes().len(),
            last_walk_ms: self.last_walk_ms,
        }
    }

    async fn handle(&mut self, message: Draw) -> Result<(), String> {
        let outcome = self.draw(&message.request, &message.context).await;
        self.answered += 1;
        // An asker that has gone away misses only the answer: what was committed stays.
        let _ = message.reply.send(outcome);
        Ok(())
    }
}

impl Selector {
    async fn draw(
        &mut self,
        request: &selection::StrokesRequest,
        context: &Context,
    ) -> Result<selection::StrokesReply, Fault> {
        let strokes: Vec<Stroke> = request.strokes.iter().map(decode).collect::<Result<_, _>>()?;
        if strokes.is_empty() && !request.restart {
            return Err(Fault::invalid("no strokes to draw; send at least one, or `restart` to begin anew"));
        }
        loop {
            let state = self.newest(context).await?;
            tokio::task::block_in_place(|| self.play(&state, request, &strokes))?;
            match self.commit(&state, context).await {
                // Somebody else changed the selection in between: draw on top of theirs.
                Err(fault)
                    if matches!(fault.code, Code::Aborted | Code::FailedPrecondition)
                        && !context.remaining().is_zero() => {}
                Err(fault) => return Err(fault),
                Ok(result) => return Ok(self.reply(&result)),
            }
        }
    }

    /// The state at least as new as the scene's own, so that strokes are added to the selection that is there.
    async fn newest(&mut self, context: &Context) -> Result<Arc<EditState>, Fault> {
        let revision = self.bus.newest(&keys::SCENE_STATE, &context.next()).await?.revision;
        let caught_up = self.state.wait_for(|state| state.revision() >= revision);
        match tokio::time::timeout_at(context.deadline.into(), caught_up).await {
            Ok(Ok(state)) => Ok(Arc::clone(&state)),
            Ok(Err(_)) => Err(Fault::unavailable("the scene is no longer followed; try again in a moment")),
            Err(_) => Err(Fault::deadline(format!("revision {revision} of the scene did not arrive in time"))),
        }
    }

    /// Brings the session to the strokes of the scene's selection, then draws the new ones; all or nothing.
    fn play(
        &mut self,
        state: &EditState,
        request: &selection::StrokesRequest,
        strokes: &[Stroke],
    ) -> Result<(), Fault> {
        let before: Vec<Stroke> = if request.restart {
            Vec::new()
        } else {
            state.selection().strokes().iter().map(decode).collect::<Result<_, _>>()?
        };
        let mut session = if self.session.strokes().eq(&before) {
            self.session.clone()
        } else {
            SelectionSession::of_strokes(self.session.space(), &before).map_err(|e| Fault::internal(e.to_string()))?
        };
        let start = Instant::now();
        for stroke in strokes {
            session.add_stroke(stroke.clone()).map_err(|e| Fault::invalid(e.to_string()))?;
        }
        self.last_walk_ms = start.elapsed().as_secs_f64() * 1e3;
        self.session = session;
        Ok(())
    }

    async fn commit(&self, state: &EditState, context: &Context) -> Result<CommandResult, Fault> {
        let commit = CommitSelection {
            mask: Some(encode_mask(self.session.mask())),
            strokes: self.session.strokes().map(encode).collect(),
            expected_hash: state.selection().hash().to_owned(),
        };
        // The same request tried again is the same command: the scene returns its first result.
        let id = format!("strokes-{}", context.id);
        let action = Some(command::Action::CommitSelection(commit));
        let command = Command { id: id.clone(), expected_revision: 0, action };
        self.bus.ask(&keys::SCENE_APPLY, &command, &context.next().with_id(id).within(Duration::from_secs(10))).await
    }

    fn reply(&self, result: &CommandResult) -> selection::StrokesReply {
        let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let summary = self.session.walk().map(|w| w.summary).unwrap_or_default();
        let selected = self.session.mask().count();
        let mut line = format!("{selected} of {} Gaussians selected", self.session.mask().len());
        if summary.conflicts > 0 {
            line.push_str(&format!("; {} clusters were brushed both ways", summary.conflicts));
        }
        selection::StrokesReply {
            selected: selected as u64,
            selection_hash: result.selection_hash.clone(),
            revision: result.revision,
            clusters: small(self.session.space().clusters()),
            seeds_foreground: small(summary.seeds_foreground),
            seeds_background: small(summary.seeds_background),
            conflicts: small(summary.conflicts),
            walk_ms: self.last_walk_ms,
            summary: line,
        }
    }
}

fn decode(stroke: &proto::Stroke) -> Result<Stroke, Fault> {
    let mode = match stroke.mode() {
        StrokeMode::Walk => Mode::Walk,
        StrokeMode::Cluster => Mode::Cluster,
        StrokeMode::Point => Mode::Point,
        StrokeMode::Unspecified => return Err(Fault::invalid("a stroke names no mode: walk, cluster or point")),
    };
    let kind = match stroke.kind() {
        StrokeKind::Foreground => Kind::Foreground,
        StrokeKind::Background => Kind::Background,
        StrokeKind::Toggle => Kind::Toggle,
        StrokeKind::Unspecified => {
            return Err(Fault::invalid("a stroke names no kind: foreground, background or toggle"));
        }
    };
    let (points, rest) = stroke.points.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(Fault::invalid("a stroke's points are not triples of x, y and z"));
    }
    if points.len() > sg_proto::limits::MAX_STROKE_POINTS {
        return Err(Fault::exhausted(format!(
            "a stroke of {} points is over the limit of {}; send it in parts",
            points.len(),
            sg_proto::limits::MAX_STROKE_POINTS
        )));
    }
    let stroke = Stroke { mode, kind, radius: stroke.radius, points: points.to_vec() };
    stroke.check().map_err(Fault::invalid)?;
    Ok(stroke)
}

fn encode(stroke: &Stroke) -> proto::Stroke {
    let mode = match stroke.mode {
        Mode::Walk => StrokeMode::Walk,
        Mode::Cluster => StrokeMode::Cluster,
        Mode::Point => StrokeMode::Point,
    };
    let kind = match stroke.kind {
        Kind::Foreground => StrokeKind::Foreground,
        Kind::Background => StrokeKind::Background,
        Kind::Toggle => StrokeKind::Toggle,
    };
    let points = stroke.points.as_flattened().to_vec();
    proto::Stroke { mode: mode.into(), kind: kind.into(), radius: stroke.radius, points }
}
