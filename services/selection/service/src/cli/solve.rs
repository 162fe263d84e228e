//! `solve`: solves one random walk on a graph from a file.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::{Deserialize, Serialize};
use sg_input::{file, limits};
use sg_walk::{Conductance, Network, Precision, Problem, Seed, Solver, WalkError, solve};

use super::{Failure, check_outputs, named, write};

#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The graph and the seeds, as JSON.
    graph: PathBuf,
    /// The solution to write, as JSON.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The algorithm: subtraction-free elimination, sparse Cholesky, or conjugate gradients.
    #[arg(long, default_value = "gth", value_parser = named::<Solver>(&["gth", "cholesky", "cg"]))]
    solver: Solver,
    /// Arithmetic of the solver.
    #[arg(long, default_value = "f64", value_parser = named::<Precision>(&["f64", "f32"]))]
    precision: Precision,
}

/// Most nodes of a graph of any size.
const MAX_NODES: usize = 50_000_000;
/// Nodes that a file of any length may have.
const FREE_NODES: usize = 10_000;

/// Most nodes of a graph in a file of `length` bytes. A node that takes part takes a few bytes.
fn most_nodes(length: usize) -> usize {
    length.saturating_add(FREE_NODES).min(MAX_NODES)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Graph {
    nodes: usize,
    edges: Vec<(usize, usize, f64)>,
    #[serde(default)]
    foreground: Vec<usize>,
    #[serde(default)]
    background: Vec<usize>,
    #[serde(default)]
    leak: f64,
}

#[derive(Serialize)]
struct Answer {
    p: Vec<f64>,
    q: Vec<f64>,
    reached: Vec<bool>,
    selected: Vec<bool>,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.graph;
    check_outputs(&[Some(&arguments.out)], &[Some(path)])?;
    let text = file::read_text(path, limits::DATA_BYTES)
        .map_err(|e| Failure::input(format!("{}: {e}; give the path of a graph JSON file", path.display())))?;
    let graph: Graph = serde_json::from_str(&text).map_err(|e| wrong(path, &e.to_string()))?;
    let length = text.len();
    drop(text);
    let (network, seeds) = check(&graph, most_nodes(length)).map_err(|reason| wrong(path, &reason))?;
    let problem = Problem { network: &network, seeds: &seeds, leak: graph.leak, leaking: None };
    let solver = arguments.solver.with(arguments.precision);
    let solution = solve(&problem, solver.as_ref(), None).map_err(|e| match e {
        WalkError::Breakdown { .. } => Failure::work(format!("{}: {e}", path.display())),
        _ => wrong(path, &e.to_string()),
    })?;
    let selected = (0..network.len()).map(|u| solution.is_selected(u)).collect();
    let answer = Answer { selected, p: solution.p, q: solution.q, reached: solution.reached };
    let text = serde_json::to_string(&answer).map_err(Failure::work)? + "\n";
    write(&arguments.out, text.as_bytes())
}

fn wrong(path: &Path, reason: &str) -> Failure {
    Failure::input(format!("{}: {reason}", path.display()))
}

fn check(graph: &Graph, most: usize) -> Result<(Network, Vec<Seed>), String> {
    let n = graph.nodes;
    if n > most {
        return Err(format!("{n} nodes are too many for this file; at most {most} of its nodes can take part"));
    }
    let mut edges = Vec::with_capacity(graph.edges.len());
    for (i, &(u, v, w)) in graph.edges.iter().enumerate() {
        if u.max(v) >= n {
            return Err(format!("edge {i} joins {u} and {v}; nodes run from 0 to below {n}"));
        }
        let conductance = Conductance::new(w)
            .ok_or_else(|| format!("edge {i} has the weight {w}; weights must be finite and at least 0"))?;
        edges.push((u as u32, v as u32, conductance));
    }
    let mark = |name: &str, nodes: &[usize]| -> Result<Vec<bool>, String> {
        let mut marked = vec![false; n];
        for &u in nodes {
            *marked.get_mut(u).ok_or_else(|| format!("{name} names node {u}; nodes run from 0 to below {n}"))? = true;
        }
        Ok(marked)
    };
    let foreground = mark("foreground", &graph.foreground)?;
    let background = mark("background", &graph.background)?;
    let seeds = foreground
        .iter()
        .zip(&background)
        .map(|pair| match pair {
            (true, false) => Seed::Foreground,
            (false, true) => Seed::Background,
            _ => Seed::None,
        })
        .collect();
    Ok((Network::new(n, edges.into_iter()), seeds))
}
