//! Texts of people: launch files, scripts, strokes, graphs; certificates and logs.

use std::path::Path;
use std::time::Duration;

use sg_proto::prost::Message as _;
use sg_proto::scene::SelectionStep;
use sg_proto::stroke_file::{self, Limits, stroke_of};
use sg_runtime::bus::CertificateContent;
use sg_stack::file::{ExecutableSearch, Source, read};
use sg_stack::log_line::LogLine;
use sg_stack::reconcile::{Event, Reconciler};
use sg_stack::snippet;
use sg_walk::{Precision, Problem, Solver, solve};
use supergaussian::script;
use supergaussian_selection::graph_file::{self, GraphFile};

use crate::stage::Stage;

/// Larger graphs are not solved.
const MAX_SOLVED: usize = 64;

pub(crate) fn strokes(_: &Stage, input: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(input) else { return false };
    let Ok(steps) = stroke_file::parse(text, &Limits::BUS) else { return false };
    assert!(Limits::BUS.strokes.contains(&steps.len()));
    for step in &steps {
        assert_eq!(SelectionStep::decode(step.encode_to_vec().as_slice()).as_ref(), Ok(step));
        if let Some(stroke) = stroke_of(step) {
            assert!(stroke.points.iter().all(|x| x.is_finite()) && stroke.points.len().is_multiple_of(3));
        }
    }
    true
}

/// Lines `#--set a.b=c` at the start are overrides from the command line.
pub(crate) fn launch_file(stage: &Stage, input: &[u8]) -> bool {
    let Ok(mut text) = std::str::from_utf8(input) else { return false };
    let mut overrides = Vec::new();
    while let Some((line, rest)) = text.strip_prefix("#--set ").and_then(|rest| rest.split_once('\n')) {
        overrides.push(line.to_owned());
        text = rest;
    }
    stage.keep_executable("program");
    stage.keep("key.pem", Vec::new);
    let search = ExecutableSearch::in_folders(vec![stage.folder().to_owned()]);
    match read(Source { path: &stage.folder().join("launch.toml"), text, overrides: &overrides }, &search) {
        Ok(file) => {
            let mut reconciler = Reconciler::new(file.services, 1, 0);
            for second in 0..4 {
                reconciler.step(Event::Tick, Duration::from_secs(second * 40));
            }
            true
        }
        Err(problems) => {
            assert!(!problems.list.is_empty());
            assert!(!snippet::report(&problems, text).is_empty());
            assert_eq!(problems.lines().count(), problems.to_string().lines().count());
            false
        }
    }
}

pub(crate) fn demo_script(_: &Stage, input: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(input) else { return false };
    match script::read(Path::new("script.toml"), text) {
        Ok(_) => true,
        Err(problems) => {
            assert!(!problems.list.is_empty() && !snippet::report(&problems, text).is_empty());
            false
        }
    }
}

/// Graphs of few nodes are solved too.
pub(crate) fn graph(_: &Stage, input: &[u8]) -> bool {
    let Ok(text) = String::from_utf8(input.to_vec()) else { return false };
    let Ok(GraphFile { network, seeds, leak }) = graph_file::parse(text) else { return false };
    assert_eq!(network.len(), seeds.len());
    if network.len() <= MAX_SOLVED {
        let problem = Problem { network: &network, seeds: &seeds, leak, leaking: None };
        for solver in [Solver::Gth, Solver::Cholesky, Solver::Cg] {
            if let Ok(solution) = solve(&problem, solver.with(Precision::F64).as_ref(), None) {
                assert!([solution.p.len(), solution.q.len()] == [seeds.len(); 2]);
                assert!(solution.p.iter().chain(&solution.q).all(|p| (-1e-6..=1.0 + 1e-6).contains(p)), "{solver:?}");
            }
        }
    }
    true
}

pub(crate) fn certificate(_: &Stage, input: &[u8]) -> bool {
    CertificateContent::of_pem(input).is_ok()
}

pub(crate) fn log_line(_: &Stage, input: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(input) else { return false };
    let line = LogLine::parse(text);
    let shown = format!("{}{}{}", line.timestamp, line.time(), line.text());
    assert!(!shown.chars().any(char::is_control), "{shown:?}");
    !line.timestamp.is_empty()
}
