//! `solve`: solves one random walk on a graph from a file.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use sg_input::{file, limits};
use sg_walk::{Precision, Problem, Solver, WalkError, solve};
use supergaussian_selection::graph_file::{self, GraphFile};

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
    let graph = graph_file::parse(text).map_err(|e| wrong(path, &e.to_string()))?;
    let GraphFile { network, seeds, leak } = graph;
    let problem = Problem { network: &network, seeds: &seeds, leak, leaking: None };
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
