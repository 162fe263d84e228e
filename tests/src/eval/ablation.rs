//! The tables of the paper's appendix, on every subject.

use serde::Serialize;
use sg_clusters::cluster_graph::GraphForm;
use sg_clusters::clustering::{ClusteringOptions, Level, Method};
use sg_clusters::features::FeatureKind;
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::Silent;
use sg_selection::selection_index::{Background, WalkOptions};
use sg_selection::strokes::Mode;

use super::hand::{Hand, scene_graph};
use super::measure::{ClusterRow, Made, WalkRow, With, at_equal_number, judge, play};
use super::shapes::shape;
use super::subject::{Origin, Parametrisation, Subject};
use super::{EvalError, Options, measured};

/// Everything that was measured.
#[derive(Debug, Clone, Serialize)]
pub struct Ablation {
    /// Layout of this file.
    pub schema: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Whether this is the short form.
    pub quick: bool,
    /// Clusters every clustering was to have.
    pub clusters_wanted: usize,
    /// Scenes, each coherent and (made ones) scrambled.
    pub subjects: Vec<SubjectRows>,
}

/// Measurements on one scene.
#[derive(Debug, Clone, Serialize)]
pub struct SubjectRows {
    /// Name.
    pub name: String,
    /// Made or measured.
    pub origin: Origin,
    /// How the scene is written down.
    pub parametrisation: Parametrisation,
    /// Gaussians.
    pub gaussians: usize,
    /// Those to be selected.
    pub wanted: usize,
    /// Parts that clusters are judged by.
    pub parts: usize,
    /// Ways to cluster, with the default walk on each.
    pub clusterings: Vec<ClusterRow>,
    /// Ways to select, on the default clusters.
    pub walks: Vec<WalkRow>,
}

/// The rows of the cluster tables: name, features (none: the scene's default), options.
#[must_use]
pub fn cluster_variants() -> Vec<(&'static str, Option<FeatureKind>, ClusteringOptions)> {
    let base = ClusteringOptions::default;
    let by = |method| ClusteringOptions { method, ..base() };
    let level = |level| ClusteringOptions { level, ..base() };
    vec![
        ("geodesic", None, base()),
        ("euclidean-feature", None, by(Method::EuclideanFeature)),
        ("euclidean", None, by(Method::Euclidean)),
        ("adaptive", None, ClusteringOptions { adaptive: true, ..base() }),
        ("windowed", None, level(Level::Windowed)),
        ("fast", None, level(Level::Fast)),
        ("features oriented", Some(FeatureKind::Oriented), base()),
        ("features invariant", Some(FeatureKind::Invariant), base()),
        ("features printed", Some(FeatureKind::Printed), base()),
    ]
}

/// The multipliers of the σ sweep.
pub const SIGMAS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

/// The leaks that are compared with the farthest rule.
pub const LEAKS: [f64; 5] = [0.0, 0.003, 0.01, 0.03, 0.1];

/// A multiplier at which a term of the weight is nothing.
const OFF: f64 = 1e9;

/// The rows of the walk tables.
#[must_use]
pub fn walk_variants() -> Vec<(String, With)> {
    let base = WalkOptions::default;
    let form = |form| With::Walk(WalkOptions { form, ..base() });
    let mut rows = vec![
        ("walk".to_owned(), With::Walk(base())),
        ("walk, no features".to_owned(), With::Walk(WalkOptions { sigma_f: OFF, ..base() })),
        ("walk, no distance".to_owned(), With::Walk(WalkOptions { sigma_s: OFF, ..base() })),
        ("walk, three green strokes".to_owned(), With::WalkOfThree(base())),
        ("walk on Gaussians".to_owned(), With::GaussianWalk(base())),
        ("clusters hit".to_owned(), With::Hits(Mode::Cluster)),
        ("Gaussians hit".to_owned(), With::Hits(Mode::Point)),
        ("graph contact".to_owned(), form(GraphForm::Contact)),
        ("graph printed".to_owned(), form(GraphForm::Printed)),
        ("graph all-pairs".to_owned(), form(GraphForm::AllPairs)),
        ("graph euclidean".to_owned(), form(GraphForm::Euclidean)),
    ];
    for leak in LEAKS {
        rows.push((format!("leak {leak}"), With::Walk(WalkOptions { leak, ..base() })));
    }
    let farthest = WalkOptions { background: Background::Farthest, ..base() };
    rows.push(("farthest 5 %".to_owned(), With::Walk(farthest)));
    for sigma_s in SIGMAS {
        for sigma_f in SIGMAS {
            let options = WalkOptions { sigma_s, sigma_f, ..base() };
            rows.push((format!("sigma {sigma_s} {sigma_f}"), With::Walk(options)));
        }
    }
    rows
}

/// Measures everything. `tell` receives the progress.
///
/// # Errors
/// [`EvalError`].
pub fn run(options: &Options, tell: &dyn Fn(&str)) -> Result<Ablation, EvalError> {
    let mut subjects = Vec::new();
    for name in &options.shapes {
        let made = shape(name, options.gaussians, options.seed).ok_or_else(|| EvalError::Shape(name.clone()))?;
        subjects.push(made.scrambled(options.seed));
        subjects.insert(subjects.len() - 1, made);
    }
    if let Some(data) = &options.data {
        subjects.extend(measured::measured(data, 2 * options.gaussians, options.seed, tell)?);
    }
    let rows = subjects.iter().map(|subject| on(subject, options, tell)).collect::<Result<_, _>>()?;
    Ok(Ablation {
        schema: 1,
        seed: options.seed,
        quick: options.quick,
        clusters_wanted: options.clusters,
        subjects: rows,
    })
}

fn on(subject: &Subject, options: &Options, tell: &dyn Fn(&str)) -> Result<SubjectRows, EvalError> {
    let title = format!("{} ({:?})", subject.name, subject.parametrisation).to_lowercase();
    tell(&format!("{title}: strokes"));
    let of = |features| {
        let geometry = GeometryOptions { features, ..GeometryOptions::default() };
        Geometry::of_scene(&subject.scene, geometry, &Silent)
    };
    let base = of(None)?;
    let graph = scene_graph(&base);
    let hand = Hand::new(subject, &graph).ok_or(EvalError::Nothing)?;
    let trials = hand.trials(options.trials, options.seed);
    let mut clusterings = Vec::new();
    let mut first: Option<Made> = None;
    for (variant, features, how) in cluster_variants() {
        tell(&format!("{title}: clusters, {variant}"));
        let own;
        let geometry = match features {
            None => &base,
            some => {
                own = of(some)?;
                &own
            }
        };
        let made = at_equal_number(geometry, &how, options.clusters)?;
        clusterings.push(judge(subject, geometry, &made, variant, &trials)?);
        first.get_or_insert(made);
    }
    let made = first.ok_or(EvalError::Nothing)?;
    let mut walks = Vec::new();
    // How a scene is written down does not change its graph; its features are judged above.
    if subject.parametrisation == Parametrisation::Coherent {
        for (variant, with) in walk_variants() {
            tell(&format!("{title}: {variant}"));
            let trials = match with {
                With::GaussianWalk(_) => &trials[..options.gaussian_trials.min(trials.len())],
                _ => &trials[..],
            };
            walks.push(play(subject, &base, &made.clustering, with, &variant, trials)?);
        }
    }
    let parts: std::collections::BTreeSet<i32> = subject.part.iter().copied().collect();
    Ok(SubjectRows {
        name: subject.name.clone(),
        origin: subject.origin,
        parametrisation: subject.parametrisation,
        gaussians: subject.scene.len(),
        wanted: subject.wanted(),
        parts: parts.len(),
        clusterings,
        walks,
    })
}
