//! Our side of the comparison with Python implementations: the same scenes, handed over as arrays, and our times.
//!
//! `tests/peers/compare.py` runs both sides one after the other and prints the table.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm, gaussian_network};
use sg_clusters::clustering::{Clustering, ClusteringOptions, Level, cluster};
use sg_clusters::features::WIDTH;
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::{Progress, Silent, Stage};
use sg_clusters::seeds::voxel_seeds;
use sg_formats::npy::{NpyError, write_array, write_labels};
use sg_walk::multilevel::{Boundary, Multilevel};
use sg_walk::ordering::minimum_degree;
use sg_walk::{Network, Precision, Problem, Seed, Solver, WalkError, solve};

use super::EvalError;
use super::shapes::shape;
use super::subject::Subject;

/// ε of the walks.
const LEAK: f64 = 0.03;

/// Times that a walk on single Gaussians is solved.
const FEW: usize = 5;

/// Times of our clustering.
#[derive(Debug, Clone, Serialize)]
pub struct ClusterTimes {
    /// Gaussians.
    pub gaussians: usize,
    /// Threads.
    pub threads: usize,
    /// Clusters.
    pub clusters: usize,
    /// Σ D after each round.
    pub objective: Vec<f64>,
    /// Seconds by stage, without reading and writing.
    pub seconds: BTreeMap<&'static str, f64>,
    /// Processor seconds of it, user and system.
    pub cpu_seconds: f64,
    /// The most memory it held at once beyond the scene itself; 0 if the system does not report it.
    pub peak_bytes: u64,
    /// The same for each Gaussian.
    pub peak_bytes_per_gaussian: f64,
    /// The same for each Gaussian, stage by stage.
    pub stage_peak_bytes_per_gaussian: BTreeMap<&'static str, f64>,
}

/// Notes the peak of each stage. Each report of a stage reads the peak and resets it.
#[derive(Default)]
struct Peaks {
    stage: Cell<Option<Stage>>,
    bytes: RefCell<BTreeMap<&'static str, u64>>,
}

impl Peaks {
    fn note(&self, next: Option<Stage>) {
        let stage = self.stage.replace(next).map_or("before", Stage::name);
        let peak = memory("VmHWM:");
        let mut bytes = self.bytes.borrow_mut();
        let entry = bytes.entry(stage).or_default();
        *entry = peak.max(*entry);
        reset_peak();
    }
}

impl Progress for Peaks {
    fn at(&self, stage: Stage, _: f64) {
        self.note(Some(stage));
    }
}

/// Times of our walks on one graph.
#[derive(Debug, Clone, Serialize)]
pub struct WalkTimes {
    /// Clusters or Gaussians.
    pub on: &'static str,
    /// Nodes.
    pub nodes: usize,
    /// Edges.
    pub edges: usize,
    /// One entry a way of solving.
    pub solvers: Vec<SolverTimes>,
}

/// Times of one way of solving, milliseconds.
#[derive(Debug, Clone, Serialize)]
pub struct SolverTimes {
    /// Which.
    pub solver: &'static str,
    /// Wall-clock time of the parts made once a scene: an elimination order, levels.
    pub setup_ms: f64,
    /// Processor time of that.
    pub setup_cpu_ms: f64,
    /// By the clock, the median of a solution.
    pub solve_ms: f64,
    /// Processor time of a solution, on average.
    pub solve_cpu_ms: f64,
}

/// Makes the scene that both sides work on.
///
/// # Errors
/// [`EvalError::Shape`].
pub fn scene(name: &str, gaussians: usize, seed: u64) -> Result<Subject, EvalError> {
    shape(name, gaussians, seed).ok_or_else(|| EvalError::Shape(name.to_owned()))
}

fn failed(path: &Path) -> impl Fn(NpyError) -> EvalError {
    let path = path.display().to_string();
    move |e| EvalError::Data { path: path.clone(), why: e.to_string() }
}

/// Clusters a subject at a level and writes the labels to `labels.npy`. With `export` it also writes the other side's inputs:
/// `position.npy`, `features.npy`, `seeds.npy` (positions in these columns) and `cell.npy`.
///
/// # Errors
/// [`EvalError`].
pub fn cluster_times(subject: &Subject, level: Level, folder: &Path, export: bool) -> Result<ClusterTimes, EvalError> {
    let options = ClusteringOptions { level, ..ClusteringOptions::default() };
    let before = processor_seconds();
    let held = reset_peak();
    let peaks = Peaks::default();
    let geometry = Geometry::of_scene(&subject.scene, GeometryOptions::default(), &peaks)?;
    let (clustering, report) = cluster(&geometry, &options, &peaks)?;
    peaks.note(None);
    let stages = peaks.bytes.into_inner();
    let peak_bytes = stages.values().copied().max().unwrap_or(0).saturating_sub(held);
    let cpu_seconds = processor_seconds() - before;
    let gaussians = subject.scene.len();
    let path = folder.join("labels.npy");
    write_labels(&path, &clustering.labels).map_err(failed(&path))?;
    if export {
        let unit = &geometry.units[0];
        let seeds = voxel_seeds(&unit.vertices, &unit.component, unit.components, options.max_clusters);
        let gaussian = &unit.vertices.gaussian;
        let in_scene = |v: usize| gaussian[v] as usize;
        let mut position = vec![0.0; 3 * gaussians];
        let mut features = vec![0.0_f32; WIDTH * gaussians];
        for (v, (p, row)) in unit.vertices.position.iter().zip(&unit.features.rows).enumerate() {
            position[3 * in_scene(v)..3 * in_scene(v) + 3].copy_from_slice(p);
            features[WIDTH * in_scene(v)..WIDTH * (in_scene(v) + 1)].copy_from_slice(row);
        }
        let seeds_at: Vec<i32> = seeds.sources.iter().map(|&s| gaussian[s as usize] as i32).collect();
        let write = |name: &str, f: &dyn Fn(&Path) -> Result<(), NpyError>| {
            let path = folder.join(name);
            f(&path).map_err(failed(&path))
        };
        write("position.npy", &|p| write_array(p, &[gaussians, 3], &position))?;
        write("features.npy", &|p| write_array(p, &[gaussians, WIDTH], &features))?;
        write("seeds.npy", &|p| write_labels(p, &seeds_at))?;
        write("cell.npy", &|p| write_array(p, &[1], &[seeds.cell]))?;
    }
    Ok(ClusterTimes {
        gaussians,
        threads: rayon::current_num_threads(),
        clusters: report.clusters,
        objective: report.objective,
        seconds: report.seconds,
        cpu_seconds,
        peak_bytes,
        peak_bytes_per_gaussian: peak_bytes as f64 / gaussians.max(1) as f64,
        stage_peak_bytes_per_gaussian: stages
            .into_iter()
            .map(|(stage, peak)| (stage, peak.saturating_sub(held) as f64 / gaussians.max(1) as f64))
            .collect(),
    })
}

/// Solves a walk on clusters and one on single Gaussians. Each goes from a ball around the deepest of the target to one far from
/// it. Each system is written as `walk-ON-edges.npy` (u, v, w) and `walk-ON-seeds.npy` (0 none, 1 foreground, 2 background). Our
/// result is `walk-ON-p.npy`, one row a way of solving. The leak is 0.03.
///
/// # Errors
/// [`EvalError`].
pub fn walk_times(subject: &Subject, folder: &Path, repeats: usize) -> Result<Vec<WalkTimes>, EvalError> {
    let geometry = Geometry::of_scene(&subject.scene, GeometryOptions::default(), &Silent)?;
    let (clustering, _) = cluster(&geometry, &ClusteringOptions::default(), &Silent)?;
    let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact)?;
    let at = |g: usize| subject.scene.position(g).unwrap_or(DVec3::ZERO);
    let brush = |side: bool| -> Vec<usize> {
        let first = subject.target.iter().position(|t| *t == side).map_or(DVec3::ZERO, at);
        let radius = 0.05 * subject.scene.bounds.longest_edge();
        (0..subject.scene.len()).filter(|&g| subject.target[g] == side && at(g).distance(first) < radius).collect()
    };
    let (green, red) = (brush(true), brush(false));
    let own: Vec<usize> = (0..subject.scene.len()).collect();
    let by_cluster: Vec<usize> = labels_of(&clustering);
    let seeded = |nodes: usize, node: &[usize]| {
        let mut seeds = vec![Seed::None; nodes];
        // Green last: a cluster that both hit is green here, on both sides of the comparison.
        red.iter().for_each(|&g| seeds[node[g]] = Seed::Background);
        green.iter().for_each(|&g| seeds[node[g]] = Seed::Foreground);
        seeds
    };
    let failed = |e: WalkError| EvalError::Data { path: "walk".to_owned(), why: e.to_string() };
    let mut out = Vec::new();

    let network = graph.network(1.0, 1.0, None);
    let seeds = seeded(network.len(), &by_cluster);
    let algorithm = Solver::Gth.with(Precision::F64);
    let (start, used) = (Instant::now(), processor_seconds());
    let order = minimum_degree(network.adjacency());
    let setup = [start.elapsed().as_secs_f64(), processor_seconds() - used];
    let problem = Problem { network: &network, seeds: &seeds, leak: LEAK, leaking: None };
    let eliminate = || solve(&problem, &*algorithm, Some(&order)).map(|s| s.p);
    let (times, p) = timed("elimination f64", setup, repeats, eliminate).map_err(failed)?;
    hand_over(folder, "clusters", &network, &seeds, &[p])?;
    out.push(WalkTimes::of("clusters", &network, vec![times]));

    let network = Arc::new(gaussian_network(&geometry, 1.0, 1.0));
    let seeds = seeded(network.len(), &own);
    let known = Multilevel::known(&seeds);
    let (mut solvers, mut found) = (Vec::new(), Vec::new());
    for (name, precision, tolerance) in
        [("multilevel 1e-3", Precision::F32, 1e-3), ("multilevel 1e-9", Precision::F64, 1e-9)]
    {
        let (start, used) = (Instant::now(), processor_seconds());
        let levels = Multilevel::new(Arc::clone(&network), precision);
        let setup = [start.elapsed().as_secs_f64(), processor_seconds() - used];
        let iterate =
            || levels.solve(&Boundary { known: &known, leak: LEAK, leaking: None }, tolerance).map(|answer| answer.p);
        let (times, p) = timed(name, setup, FEW, iterate).map_err(failed)?;
        solvers.push(times);
        found.push(p);
    }
    hand_over(folder, "gaussians", &network, &seeds, &found)?;
    out.push(WalkTimes::of("gaussians", &network, solvers));
    Ok(out)
}

impl WalkTimes {
    fn of(on: &'static str, network: &Network, solvers: Vec<SolverTimes>) -> Self {
        // Both triangles of the matrix are stored.
        Self { on, nodes: network.len(), edges: network.adjacency().nnz() / 2, solvers }
    }
}

fn labels_of(clustering: &Clustering) -> Vec<usize> {
    clustering.labels.iter().map(|l| usize::try_from(*l).unwrap_or(0)).collect()
}

/// Times a walk `repeats` times; `setup` is the time before it, seconds by the clock and of the processor.
fn timed(
    solver: &'static str,
    setup: [f64; 2],
    repeats: usize,
    mut walk: impl FnMut() -> Result<Vec<f64>, WalkError>,
) -> Result<(SolverTimes, Vec<f64>), WalkError> {
    let repeats = repeats.max(1);
    let (mut times, mut p) = (Vec::new(), Vec::new());
    let used = processor_seconds();
    for _ in 0..repeats {
        let start = Instant::now();
        p = walk()?;
        times.push(1e3 * start.elapsed().as_secs_f64());
    }
    let solve_cpu_ms = 1e3 * (processor_seconds() - used) / repeats as f64;
    times.sort_by(f64::total_cmp);
    let [setup_ms, setup_cpu_ms] = setup.map(|seconds| 1e3 * seconds);
    Ok((SolverTimes { solver, setup_ms, setup_cpu_ms, solve_ms: times[times.len() / 2], solve_cpu_ms }, p))
}

fn hand_over(folder: &Path, on: &str, network: &Network, seeds: &[Seed], p: &[Vec<f64>]) -> Result<(), EvalError> {
    let mut edges: Vec<f64> = Vec::new();
    for u in 0..network.len() as u32 {
        for (v, w) in network.links(u).filter(|l| l.0 > u) {
            edges.extend([f64::from(u), f64::from(v), w.scaled(0)]);
        }
    }
    let number = |s: &Seed| match s {
        Seed::None => 0,
        Seed::Foreground => 1,
        Seed::Background => 2,
    };
    let seeds: Vec<i32> = seeds.iter().map(number).collect();
    let path = |what: &str| folder.join(format!("walk-{on}-{what}.npy"));
    let (e, s, q) = (path("edges"), path("seeds"), path("p"));
    write_array(&e, &[edges.len() / 3, 3], &edges).map_err(failed(&e))?;
    write_labels(&s, &seeds).map_err(failed(&s))?;
    write_array(&q, &[p.len(), network.len()], &p.concat()).map_err(failed(&q))
}

/// Processor seconds of this process, user and system.
fn processor_seconds() -> f64 {
    use nix::sys::resource::{UsageWho, getrusage};
    use nix::sys::time::TimeValLike as _;
    getrusage(UsageWho::RUSAGE_SELF)
        .map_or(0.0, |u| (u.user_time().num_microseconds() + u.system_time().num_microseconds()) as f64 / 1e6)
}

/// Resets the peak if the kernel permits it; returns the memory resident now, in bytes.
fn reset_peak() -> u64 {
    // Without the right to reset it, the peak is that of the process so far. It is no less.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    memory("VmRSS:")
}

/// A line of the kernel's account of this process, in bytes; 0 if there is none.
#[must_use]
pub fn memory(line: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let found = status.lines().find_map(|l| l.strip_prefix(line));
    found.and_then(|l| l.trim().trim_end_matches("kB").trim().parse::<u64>().ok()).unwrap_or(0) * 1024
}
