//! Speed against error of the solvers of random walks, by precision and size: a table in `walks.md` and a plot beside it.
//!
//! `cargo run --release --workspace --example walk_errors -- --out docs` writes the table between the marks in
//! `docs/walks.md` and `docs/pictures/walk-errors.svg`.
#![allow(clippy::print_stdout, reason = "a measurement tells how far it is")]

use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use plotters::prelude::{ChartBuilder, Circle, Color, IntoLogRange, RGBColor, SeriesLabelPosition, WHITE};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;
use sg_clusters::neighbours::neighbour_graph;
use sg_clusters::vertices::Vertices;
use sg_tests::plot::{BLUE, GREEN, GREY, ORANGE, PURPLE, SKY_BLUE, VERMILION, svg};
use sg_walk::elimination::Elimination;
use sg_walk::multilevel::{Boundary, Multilevel};
use sg_walk::ordering::minimum_degree;
use sg_walk::{Conductance, Network, Precision, Problem, Seed, Solution, Solver, solve};

type Outcome<T> = Result<T, Box<dyn Error>>;

#[derive(Parser)]
struct Arguments {
    /// The folder of documents.
    #[arg(long, default_value = "docs")]
    out: PathBuf,
    /// Repetitions; the fastest counts.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// The most nodes of a graph.
    #[arg(long, default_value_t = 170_000)]
    most: usize,
}

/// One measurement.
struct Point {
    method: &'static str,
    nodes: usize,
    leak: f64,
    milliseconds: f64,
    /// Largest |p − p*|; none where the solver failed.
    error: Option<f64>,
}

/// Nodes on a surface, each joined to its nearest, with the weights that walks have. Foreground is at one end, background at the
/// other.
fn graph(n: usize) -> Outcome<(Network, Vec<Seed>)> {
    let mut r = ChaCha8Rng::seed_from_u64(n as u64);
    let points: Vec<[f64; 3]> = (0..n)
        .map(|_| {
            let p: [f64; 3] = std::array::from_fn(|_| r.random_range(-1.0..1.0));
            let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            p.map(|x| x / length)
        })
        .collect();
    let seeds = points
        .iter()
        .map(|p| match p[0] {
            x if x > 0.9 => Seed::Foreground,
            x if x < -0.9 => Seed::Background,
            _ => Seed::None,
        })
        .collect();
    let v = Vertices::ordered((0..).zip(points).collect());
    let graph = neighbour_graph(&v, 10)?;
    let mut lengths: Vec<f64> = graph.edges().map(|e| e.length).collect();
    lengths.sort_by(f64::total_cmp);
    let middle = lengths[lengths.len() / 2];
    let edges: Vec<(u32, u32, Conductance)> = graph
        .edges()
        .map(|e| {
            let feature: f64 = r.random_range(0.0..2.0);
            let w = Conductance::exp(-(e.length / middle).powi(2) - feature * feature);
            (v.gaussian[e.a as usize], v.gaussian[e.b as usize], w)
        })
        .collect();
    Ok((Network::new(n, edges.into_iter()), seeds))
}

fn worst(p: &[f64], truth: &[f64]) -> f64 {
    p.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Fastest of some repetitions in milliseconds, and the result of the last one.
fn fastest<T>(rounds: usize, mut f: impl FnMut() -> T) -> (f64, T) {
    let start = Instant::now();
    let mut out = f();
    let mut best = start.elapsed();
    for _ in 1..rounds {
        let start = Instant::now();
        out = f();
        best = best.min(start.elapsed());
    }
    (1e3 * best.as_secs_f64(), out)
}

/// The largest sizes at which a solver is tried.
const MOST_ELIMINATED: usize = 20_000;

fn measure(n: usize, leak: f64, rounds: usize, points: &mut Vec<Point>) -> Outcome<()> {
    let (network, seeds) = graph(n)?;
    let problem = Problem { network: &network, seeds: &seeds, leak, leaking: None };
    let known = Multilevel::known(&seeds);
    let boundary = Boundary { known: &known, leak, leaking: None };
    let network_shared = Arc::new(network.clone());
    let wide = Multilevel::new(Arc::clone(&network_shared), Precision::F64);
    let order = (n <= MOST_ELIMINATED).then(|| minimum_degree(network.adjacency()));
    // The truth: elimination in another order than the one measured, or the iteration to a tight tolerance.
    let truth = if n <= MOST_ELIMINATED {
        solve(&problem, Solver::Gth.with(Precision::F64).as_ref(), None)?.p
    } else {
        wide.solve(&boundary, 1e-11)?.p
    };
    let mut put = |method, milliseconds, p: Option<Vec<f64>>| {
        let error = p.map(|p| worst(&p, &truth));
        println!("{n} nodes, leak {leak}: {method} {milliseconds:.2} ms, error {error:?}");
        points.push(Point { method, nodes: n, leak, milliseconds, error });
    };
    if let Some(order) = &order {
        let p = |s: Solution| s.p;
        for (method, solver, precision) in [
            ("elimination f64", Solver::Gth, Precision::F64),
            ("elimination f32", Solver::Gth, Precision::F32),
            ("Cholesky f64", Solver::Cholesky, Precision::F64),
            ("Cholesky f32", Solver::Cholesky, Precision::F32),
        ] {
            let solver = solver.with(precision);
            let (ms, got) = fastest(rounds, || solve(&problem, solver.as_ref(), Some(order)));
            put(method, ms, got.ok().map(p));
        }
        let mut kept = Elimination::new(&network, Some(order));
        let start = kept.solve(&seeds, leak, None)?;
        let late = (0..n).find(|&u| seeds[u] == Seed::None).unwrap_or(0);
        let mut other = seeds.clone();
        other[late] = Seed::Foreground;
        let mut best = f64::INFINITY;
        for _ in 0..rounds {
            kept.solve(&other, leak, None)?;
            best = best.min(fastest(1, || kept.solve(&seeds, leak, None)).0);
        }
        put("elimination f64, one seed changed", best, Some(start.p));
    }
    for (method, precision) in
        [("conjugate gradients f64", Precision::F64), ("conjugate gradients f32", Precision::F32)]
    {
        let solver = Solver::Cg.with(precision);
        let (ms, got) =
            fastest(if n > MOST_ELIMINATED { 1 } else { rounds }, || solve(&problem, solver.as_ref(), None));
        put(method, ms, got.ok().map(|s| s.p));
    }
    let narrow = Multilevel::new(network_shared, Precision::F32);
    for (method, made, tolerance) in [
        ("multilevel 1e-3, conductances f32", &narrow, 1e-3),
        ("multilevel 1e-5, conductances f32", &narrow, 1e-5),
        ("multilevel 1e-9, conductances f64", &wide, 1e-9),
    ] {
        let (ms, got) = fastest(rounds, || made.solve(&boundary, tolerance));
        put(method, ms, got.ok().map(|a| a.p));
    }
    Ok(())
}

#[derive(Deserialize)]
struct Case {
    name: String,
    nodes: usize,
    edges: Vec<(u32, u32, f64)>,
    foreground: Vec<usize>,
    background: Vec<usize>,
    leak: f64,
    p: Vec<f64>,
    q: Vec<f64>,
}

/// The hard cases against rational arithmetic: largest entrywise relative error of p and q, and wrong sides.
fn hard_cases() -> Outcome<String> {
    let cases: Vec<Case> = serde_json::from_str(include_str!("../../services/selection/walk/tests/walk_truth.json"))?;
    let mut table = String::from(
        "| case (nodes) | elimination f64 | elimination f32 | Cholesky f64 | Cholesky f32 | conjugate gradients f64 |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    for case in &cases {
        let zero = Conductance::ZERO;
        let edges = case.edges.iter().map(|&(u, v, w)| (u, v, Conductance::new(w).unwrap_or(zero)));
        let network = Network::new(case.nodes, edges);
        let seeds: Vec<Seed> = (0..case.nodes)
            .map(|u| match (case.foreground.contains(&u), case.background.contains(&u)) {
                (true, false) => Seed::Foreground,
                (false, true) => Seed::Background,
                _ => Seed::None,
            })
            .collect();
        let problem = Problem { network: &network, seeds: &seeds, leak: case.leak, leaking: None };
        write!(table, "| {} ({}) |", case.name, case.nodes)?;
        for (solver, precision) in [
            (Solver::Gth, Precision::F64),
            (Solver::Gth, Precision::F32),
            (Solver::Cholesky, Precision::F64),
            (Solver::Cholesky, Precision::F32),
            (Solver::Cg, Precision::F64),
        ] {
            match solve(&problem, solver.with(precision).as_ref(), None) {
                Ok(got) => {
                    let one = |(a, b): (&f64, &f64)| (a - b).abs() / b.abs().max(f64::MIN_POSITIVE);
                    let pairs = got.p.iter().zip(&case.p).chain(got.q.iter().zip(&case.q));
                    let error = pairs.map(one).fold(0.0, f64::max);
                    let right = |u: &usize| got.is_selected(*u) == (case.p[*u] - case.q[*u] > 1e-12);
                    let wrong = case.nodes - (0..case.nodes).filter(right).count();
                    write!(table, " {error:.0e}")?;
                    if wrong > 0 {
                        write!(table, ", **{wrong} wrong**")?;
                    }
                    table += " |";
                }
                Err(_) => table += " **fails** |",
            }
        }
        table += "\n";
    }
    Ok(table)
}

fn table(points: &[Point]) -> Outcome<String> {
    let mut sizes: Vec<usize> = points.iter().map(|p| p.nodes).collect();
    sizes.dedup();
    let mut methods: Vec<&str> = Vec::new();
    for p in points {
        if !methods.contains(&p.method) {
            methods.push(p.method);
        }
    }
    let mut out = String::new();
    for leak in [0.03, 0.0] {
        writeln!(out, "\nLeak {leak}: milliseconds, largest \\|p − p\\*\\|\n")?;
        out += "| solver |";
        sizes.iter().try_for_each(|n| write!(out, " {n} nodes |"))?;
        out += "\n| --- |";
        sizes.iter().for_each(|_| out += " --- |");
        out += "\n";
        for method in &methods {
            write!(out, "| {method} |")?;
            for n in &sizes {
                let found = points.iter().find(|p| p.method == *method && p.nodes == *n && p.leak == leak);
                match found {
                    Some(Point { milliseconds, error: Some(e), .. }) => write!(out, " {milliseconds:.1}, {e:.0e} |")?,
                    Some(_) => out += " fails |",
                    None => out += " |",
                }
            }
            out += "\n";
        }
    }
    Ok(out)
}

/// Colours of the solvers.
const COLORS: [RGBColor; 7] = [BLUE, SKY_BLUE, VERMILION, ORANGE, GREY, PURPLE, GREEN];

fn plot(points: &[Point]) -> Outcome<String> {
    let families: [(&str, &[&str]); 7] = [
        ("elimination f64", &["elimination f64", "elimination f64, one seed changed"]),
        ("elimination f32", &["elimination f32"]),
        ("Cholesky f64", &["Cholesky f64"]),
        ("Cholesky f32", &["Cholesky f32"]),
        ("conjugate gradients f64", &["conjugate gradients f64"]),
        ("conjugate gradients f32", &["conjugate gradients f32"]),
        (
            "multilevel 1e-3, 1e-5, 1e-9",
            &[
                "multilevel 1e-3, conductances f32",
                "multilevel 1e-5, conductances f32",
                "multilevel 1e-9, conductances f64",
            ],
        ),
    ];
    let mut sizes: Vec<usize> = points.iter().map(|p| p.nodes).collect();
    sizes.dedup();
    let radius = |n: usize| 3 + 3 * sizes.iter().position(|s| *s == n).unwrap_or(0) as i32;
    svg((1000, 900), |area| {
        let panels = area.split_evenly((2, 1));
        for (panel, leak) in panels.iter().zip([0.03, 0.0]) {
            let list: Vec<String> = sizes.iter().map(ToString::to_string).collect();
            let title = format!("leak {leak}; a larger circle is a larger graph: {} nodes", list.join(", "));
            let mut chart = ChartBuilder::on(panel)
                .caption(title, ("sans-serif", 18))
                .margin(12)
                .x_label_area_size(40)
                .y_label_area_size(70)
                .build_cartesian_2d((0.03..30_000.0_f64).log_scale(), (1e-17..10.0_f64).log_scale())?;
            chart
                .configure_mesh()
                .x_desc("milliseconds")
                .y_desc("largest |p − p*|")
                .x_label_formatter(&|x| format!("{x}"))
                .y_label_formatter(&|y| format!("{y:.0e}"))
                .light_line_style(WHITE)
                .draw()?;
            for ((name, methods), color) in families.iter().zip(COLORS) {
                let own = points.iter().filter(|p| p.leak == leak && methods.contains(&p.method));
                let circles = own.filter_map(|p| {
                    let at = (p.milliseconds, p.error?.clamp(2e-17, 9.0));
                    Some(Circle::new(at, radius(p.nodes), color.mix(0.75).filled()))
                });
                chart.draw_series(circles)?.label(*name).legend(move |at| Circle::new(at, 6, color.mix(0.75).filled()));
            }
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::LowerRight)
                .background_style(WHITE.mix(0.9))
                .border_style(RGBColor(160, 160, 160))
                .draw()?;
        }
        Ok(())
    })
}

/// Puts a text between the marks `<!-- NAME -->` and `<!-- /NAME -->` of a page.
fn between(page: &str, name: &str, text: &str) -> Outcome<String> {
    let (open, close) = (format!("<!-- {name} -->"), format!("<!-- /{name} -->"));
    let start = page.find(&open).ok_or_else(|| format!("the page lacks {open}"))? + open.len();
    let end = page.find(&close).ok_or_else(|| format!("the page lacks {close}"))?;
    Ok(format!("{}\n{}\n{}", &page[..start], text.trim_end(), &page[end..]))
}

fn main() -> Outcome<()> {
    let arguments = Arguments::parse();
    let mut points = Vec::new();
    for n in [300, 1000, 3000, 10_000, 50_000, 170_000] {
        if n <= arguments.most {
            for leak in [0.03, 0.0] {
                measure(n, leak, arguments.rounds, &mut points)?;
            }
        }
    }
    let path = arguments.out.join("walks.md");
    let page = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let page = between(&page, "sizes", &table(&points)?)?;
    let page = between(&page, "hard cases", &hard_cases()?)?;
    std::fs::create_dir_all(arguments.out.join("pictures"))?;
    sg_formats::staged_file::replace(&arguments.out.join("pictures/walk-errors.svg"), plot(&points)?.as_bytes())?;
    sg_formats::staged_file::replace(&path, page.as_bytes())?;
    Ok(())
}
