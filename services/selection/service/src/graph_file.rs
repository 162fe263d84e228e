//! Graphs with seeds for one random walk, as JSON.

use serde::Deserialize;
use sg_walk::{Conductance, Network, Seed};

/// Most nodes of a graph of any size.
const MAX_NODES: usize = 50_000_000;
/// Nodes that a file of any length may have.
const FREE_NODES: usize = 10_000;

/// A graph with its seeds.
#[derive(Debug)]
pub struct GraphFile {
    /// The graph.
    pub network: Network,
    /// One for each node.
    pub seeds: Vec<Seed>,
    /// Conductance to the background, a multiple of a node's degree; not checked.
    pub leak: f64,
}

/// A text that is no graph. It does not name the file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct GraphFileError(String);

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

/// Most nodes of a graph in a file of `length` bytes. A node that takes part takes a few bytes.
fn most_nodes(length: usize) -> usize {
    length.saturating_add(FREE_NODES).min(MAX_NODES)
}

/// Parses and checks a graph: nodes within the file's length, edges and seeds within the nodes, weights of at least 0.
///
/// # Errors
/// [`GraphFileError`] with the place.
pub fn parse(text: String) -> Result<GraphFile, GraphFileError> {
    let graph: Graph = serde_json::from_str(&text).map_err(|e| GraphFileError(e.to_string()))?;
    let most = most_nodes(text.len());
    // Both at once would double the memory.
    drop(text);
    let (network, seeds) = check(&graph, most).map_err(GraphFileError)?;
    Ok(GraphFile { network, seeds, leak: graph.leak })
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
