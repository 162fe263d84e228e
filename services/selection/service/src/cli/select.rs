//! `select`: plays strokes and writes the mask.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use serde::{Deserialize, Serialize};
use sg_clusters::cache::{ClusterCache, Found, key};
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{Clustering, cluster};
use sg_clusters::geometry::Geometry;
use sg_clusters::progress::{Progress, Stage};
use sg_formats::npy::{read_labels, read_mask, write_array, write_mask};
use sg_input::number_format::grouped;
use sg_input::print::status;
use sg_input::{file, limits};
use sg_proto::stroke_file::{self, Limits};
use sg_scene::model::Scene;
use sg_selection::answers::{Answers, Scale};
use sg_selection::mask_agreement::Agreement;
use sg_selection::operation_context::OperationContext;
use sg_selection::refinement::Refiner;
use sg_selection::selection_index::{Background, SelectionIndex, TOLERANCE, WalkOptions, WalkSummary};
use sg_selection::session::{Proposal, SelectionError, SelectionSession};
use sg_selection::steps::Step;
use sg_selection::strokes::{MAX_POINTS, MAX_STEPS, Mode};
use sg_selection::tuning::Tuning;
use sg_walk::WalkError;
use sg_walk::multilevel::Quality;

use crate::wire;

use super::{Bar, Failure, check_outputs, named, read_scene, write, write_report};

/// Nodes of the walks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Method {
    Cluster,
    Gaussian,
}

#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// A Gaussian file, a scene.toml, or an iVR-GS output folder.
    scene: PathBuf,
    /// The strokes to play, in order.
    #[arg(long, value_name = "FILE")]
    strokes: PathBuf,
    /// Existing clusters to use, int32 (n,). By default the scene is clustered.
    #[arg(long, value_name = "FILE")]
    clusters: Option<PathBuf>,
    /// The mask to write, uint8 (n,).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// File for the probabilities of the last walk, float64 (clusters,), or (n,) with --method gaussian.
    #[arg(long, value_name = "FILE")]
    probabilities: Option<PathBuf>,
    /// JSON file for proposed places of the next stroke: clusters, best first and spread out. Only with --method cluster.
    #[arg(long, value_name = "FILE")]
    proposals: Option<PathBuf>,
    /// Number of proposals.
    #[arg(long, value_name = "N", default_value_t = 8, requires = "proposals")]
    proposal_count: usize,
    /// Refine the boundary: solve the walk on single Gaussians within this many hops of it. The default is 8 hops. Only with
    /// --method cluster.
    #[arg(long, value_name = "HOPS", num_args = 0..=1, default_missing_value = "8")]
    refine: Option<usize>,
    /// True mask for the comparison, uint8 or bool (n,).
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Nodes of the walks: clusters or single Gaussians. More than 2,000 Gaussians are solved by iteration.
    #[arg(long, default_value = "cluster", value_parser = named::<Method>(&["cluster", "gaussian"]))]
    method: Method,
    /// The graph of clusters.
    #[arg(long, default_value = "contact", value_parser = named::<GraphForm>(&["contact", "printed", "all-pairs", "euclidean"]))]
    graph: GraphForm,
    /// Factor on σ_s, the median length of the graph's edges.
    #[arg(long, allow_negative_numbers = true, value_name = "X", default_value_t = 1.0)]
    sigma_s: f64,
    /// Factor on σ_f, the median feature distance of the graph's edges.
    #[arg(long, allow_negative_numbers = true, value_name = "Y", default_value_t = 1.0)]
    sigma_f: f64,
    /// Leak ε of every unseeded cluster to the background, in units of its degree. Without it the first answer chooses the
    /// leak. With --method gaussian it is the leak of every Gaussian, unscaled, 0.03 by default. With --refine it is scaled
    /// to the shorter steps between Gaussians.
    #[arg(long, allow_negative_numbers = true, value_name = "E")]
    leak: Option<f64>,
    /// The answer to take, where no leak is given.
    #[arg(long, default_value = "default", conflicts_with_all = ["leak"], value_parser = named::<Scale>(&["narrower", "default", "wider"]))]
    scale: Scale,
    /// κ of creases: contacts of this concavity are weakened to 1/e. 0 leaves creases out. The default is 0.1, and 0 with
    /// --leak.
    #[arg(long, allow_negative_numbers = true, value_name = "K")]
    crease: Option<f64>,
    /// Source of background without background strokes.
    #[arg(long, default_value = "leak", value_parser = named::<Background>(&["leak", "farthest"]))]
    background: Background,
    #[command(flatten)]
    clustering: super::Clustering,
    /// Folder of cached clusters. The next run on the same scene reuses them.
    #[arg(long, value_name = "DIR", conflicts_with = "clusters")]
    cache: Option<PathBuf>,
    /// JSON file for the report.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the report to standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    scene: &'a PathBuf,
    strokes: usize,
    gaussians: usize,
    clusters: usize,
    selected: usize,
    #[serde(flatten)]
    walk: WalkSummary,
    /// ε of the walk.
    leak: f64,
    /// The answers at every scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    answers: Option<Listed<'a>>,
    /// Quality of a walk on single Gaussians.
    #[serde(skip_serializing_if = "Option::is_none")]
    iterated: Option<Quality>,
    /// Quality of the refinement.
    #[serde(skip_serializing_if = "Option::is_none")]
    refined: Option<Band>,
    /// Time of all strokes.
    seconds: f64,
    /// Time of the earlier stages: reading, clusters, cluster graph.
    stage_seconds: BTreeMap<&'static str, f64>,
    #[serde(flatten)]
    agreement: Option<Agreement>,
}

/// The answers, and the one whose mask is written.
#[derive(Serialize)]
struct Listed<'a> {
    #[serde(flatten)]
    scale: &'a Answers,
    /// Position in the steps. With a leak of one's own it is the nearest step.
    taken: usize,
}

/// The band of the refinement.
#[derive(Serialize)]
struct Band {
    /// Number of Gaussians.
    band: usize,
    #[serde(flatten)]
    quality: Quality,
}

/// Proposed places of the next stroke.
#[derive(Serialize)]
struct Proposals {
    proposals: Vec<Proposal>,
}

/// Seconds by stage.
#[derive(Default)]
struct StageTimer(BTreeMap<&'static str, f64>);

impl StageTimer {
    fn time<T>(&mut self, stage: &'static str, f: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = f();
        *self.0.entry(stage).or_default() += start.elapsed().as_secs_f64();
        out
    }
}

impl From<SelectionError> for Failure {
    fn from(error: SelectionError) -> Self {
        match error {
            SelectionError::Walk(WalkError::Breakdown { .. }) => Self::work(error),
            _ => Self::input(error),
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let options = walk_options(arguments);
    options.check().map_err(|reason| Failure::input(format!("--{reason}")))?;
    if arguments.method == Method::Gaussian && arguments.proposals.is_some() {
        return Err(Failure::input("--proposals names clusters; use it with --method cluster"));
    }
    if arguments.method == Method::Gaussian && arguments.refine.is_some() {
        return Err(Failure::input("--refine refines a walk on clusters; use it with --method cluster"));
    }
    let outputs = [&arguments.probabilities, &arguments.proposals, &arguments.report].map(Option::as_ref);
    let inputs =
        [Some(&arguments.scene), Some(&arguments.strokes), arguments.clusters.as_ref(), arguments.truth.as_ref()];
    check_outputs(&[&[Some(&arguments.out)], &outputs[..]].concat(), &inputs)?;
    let steps = read_steps(&arguments.strokes)?;
    let mut clock = StageTimer::default();
    let scene = Arc::new(clock.time("read", || read_scene(&arguments.scene))?.scene);
    let truth = arguments.truth.as_ref().map(|file| read_mask(file, scene.len())).transpose()?;
    let bar = Bar::new();
    let uses_clusters = steps.iter().filter_map(Step::stroke).any(|s| s.mode == Mode::Cluster);
    let made = index(arguments, &scene, options, uses_clusters, &bar, &mut clock);
    bar.finish();
    let (index, refiner) = made?;
    let geometry = arguments.clustering.geometry()?;
    let index = Arc::new(index.with_operation_context(OperationContext::new(Arc::clone(&scene), geometry)));

    let start = Instant::now();
    let mut session = SelectionSession::new(Arc::clone(&index));
    let count = steps.len();
    for (number, step) in (1..).zip(steps) {
        session.add_step(step).map_err(|e| {
            let failure = Failure::from(e);
            let message = format!("{}: stroke {number}: {}", arguments.strokes.display(), failure.message);
            Failure { message, ..failure }
        })?;
    }
    let answers = session.answers()?.cloned();
    let missing = answers.as_ref().filter(|a| a.at(arguments.scale).is_none());
    if let Some(answer) =
        answers.as_ref().and_then(|a| a.at(arguments.scale)).filter(|_| arguments.scale != Scale::Default)
    {
        session.tune(Tuning { leak: answer.leak, ..session.tuning() })?;
    }
    let seconds = start.elapsed().as_secs_f64();
    if missing.is_some() {
        status("no clear step lies on that side; the first answer is kept");
    }
    let refined = match (&refiner, arguments.refine) {
        (Some(refiner), Some(hops)) => clock.time("refine", || refiner.refine(&session, hops, TOLERANCE))?,
        _ => None,
    };
    let mask = refined.as_ref().map_or_else(|| session.mask(), |r| &r.mask);
    write_mask(&arguments.out, mask)?;
    if let Some(file) = &arguments.probabilities {
        let p = session.walk().map_or_else(|| vec![0.0; index.nodes()], |w| w.solution.p.clone());
        write_array(file, &[p.len()], &p)?;
    }
    if let Some(file) = &arguments.proposals {
        let proposals = Proposals { proposals: session.proposals(arguments.proposal_count) };
        let text = serde_json::to_string_pretty(&proposals).map_err(Failure::work)? + "\n";
        write(file, text.as_bytes())?;
    }
    let selected = mask.count();
    status(&format!(
        "{} of {} Gaussians selected in {count} steps in {:.1} ms: {}",
        grouped(selected as u64),
        grouped(scene.len() as u64),
        1e3 * seconds,
        arguments.out.display()
    ));
    let report = Report {
        scene: &arguments.scene,
        strokes: count,
        gaussians: scene.len(),
        clusters: index.clusters(),
        selected,
        walk: session.walk().map(|w| w.summary).unwrap_or_default(),
        leak: session.tuning().leak,
        answers: answers.as_ref().map(|a| Listed { scale: a, taken: a.step_at(session.tuning().leak) }),
        iterated: session.walk().and_then(|w| w.quality),
        refined: refined.as_ref().map(|r| Band { band: r.band.iter().filter(|b| **b).count(), quality: r.quality }),
        seconds,
        stage_seconds: clock.0,
        agreement: truth.map(|t| Agreement::of((0..scene.len()).map(|g| (mask.get(g), t.get(g))))),
    };
    write_report(&report, arguments.report.as_ref(), arguments.json)
}

/// A leak of one's own means the published walk, and otherwise the first answer decides.
fn walk_options(arguments: &Arguments) -> WalkOptions {
    let every_scale =
        arguments.leak.is_none() && arguments.method == Method::Cluster && arguments.background == Background::Leak;
    let base = if every_scale { WalkOptions::every_scale() } else { WalkOptions::default() };
    WalkOptions {
        form: arguments.graph,
        sigma_s: arguments.sigma_s,
        sigma_f: arguments.sigma_f,
        crease: arguments.crease.map_or(base.crease, |kappa| (kappa != 0.0).then_some(kappa)),
        leak: arguments.leak.unwrap_or(base.leak),
        background: arguments.background,
        ..base
    }
}

/// Reads the steps of a stroke file.
fn read_steps(path: &Path) -> Result<Vec<Step>, Failure> {
    let name = path.display();
    let text = file::read_text(path, limits::TEXT_BYTES)
        .map_err(|e| Failure::input(format!("{name}: {e}; give the path of a strokes JSON file")))?;
    let limits = Limits { strokes: 0..=MAX_STEPS, points: MAX_POINTS };
    let steps = stroke_file::parse(&text, &limits).map_err(|e| Failure::input(format!("{name}: {e}")))?;
    // A file holds no masks, so their length is irrelevant.
    let decode = |(number, step)| {
        wire::decode_limited(step, 0, MAX_POINTS).map_err(|e| Failure::input(format!("{name}: stroke {number}: {e}")))
    };
    (1..).zip(&steps).map(decode).collect()
}

fn index(
    arguments: &Arguments,
    scene: &Scene,
    options: WalkOptions,
    uses_clusters: bool,
    bar: &Bar,
    clock: &mut StageTimer,
) -> Result<(SelectionIndex, Option<Refiner>), Failure> {
    let geometry_options = arguments.clustering.geometry()?;
    let clustering_options = arguments.clustering.options();
    let cached = arguments
        .cache
        .as_ref()
        .filter(|_| arguments.method == Method::Cluster && arguments.graph == GraphForm::Contact)
        // Refinement needs the neighbour graph, and the cache does not hold it.
        .filter(|_| arguments.refine.is_none())
        .map(|folder| (ClusterCache::new(folder), key(scene, geometry_options, &clustering_options)));
    if let Some((cache, key)) = &cached {
        match clock.time("cache", || cache.load(key, scene.len())) {
            Found::Entry(entry) => {
                let (clustering, graph) = *entry;
                return Ok((SelectionIndex::of_clusters(scene, &clustering, &graph, options), None));
            }
            Found::Damaged(why) => status(&format!("warning: {why}; the clusters are computed again")),
            Found::Nothing => {}
        }
    }
    let geometry =
        clock.time("geometry", || Geometry::of_scene(scene, geometry_options, bar)).map_err(Failure::input)?;
    let clustering = match &arguments.clusters {
        Some(file) => {
            let labels = read_labels(file)?;
            Clustering::of_labels(&geometry, labels, None)
                .map_err(|e| Failure::input(format!("{}: {e}", file.display())))?
        }
        None if arguments.method == Method::Gaussian && !uses_clusters => {
            Clustering::of_labels(&geometry, vec![-1; scene.len()], None)?
        }
        None => clock.time("clusters", || cluster(&geometry, &clustering_options, bar))?.0,
    };
    bar.at(Stage::ClusterGraph, 0.0);
    if arguments.method == Method::Gaussian {
        let index = clock.time("graph", || SelectionIndex::of_gaussians(scene, &geometry, &clustering, options));
        return Ok((index, None));
    }
    let graph =
        clock.time("graph", || ClusterGraph::new(&geometry, &clustering, options.form)).map_err(Failure::work)?;
    if let Some((cache, key)) = &cached
        && let Err(e) = cache.store(key, &clustering, &graph)
    {
        status(&format!("warning: {}: {e}; the clusters were not cached", cache.path(key).display()));
    }
    let refiner = arguments
        .refine
        .map(|_| clock.time("refiner", || Refiner::new(&geometry, &graph, options.sigma_s, options.sigma_f)));
    Ok((clock.time("order", || SelectionIndex::of_clusters(scene, &clustering, &graph, options)), refiner))
}
