//! Start order of services.

use super::model::Service;
use crate::document::{Place, Problem};

/// One condition: `from` starts after `on`.
#[derive(Debug, Clone)]
pub(super) struct Edge {
    pub(super) from: String,
    pub(super) on: String,
    pub(super) place: Place,
}

/// One problem for each cycle, at its last condition.
pub(super) fn cycles(names: &[&str], edges: &[Edge]) -> Vec<Problem> {
    let mut edges: Vec<&Edge> = edges.iter().collect();
    let mut problems = Vec::new();
    while let Some(cycle) = cycle(names, &edges) {
        let (Some(first), Some(closing)) = (cycle.first().copied(), cycle.last().copied()) else { break };
        let chain: Vec<_> = cycle.iter().map(|edge| format!("comes after `{}`", edge.on)).collect();
        let text = format!("`{}` {}: a cycle; take one `after` away", first.from, chain.join(", which "));
        problems.push(Problem { place: closing.place.clone(), text });
        edges.retain(|e| !std::ptr::eq(*e, closing));
    }
    problems
}

/// The edges of one cycle in order.
fn cycle<'a>(names: &[&str], edges: &[&'a Edge]) -> Option<Vec<&'a Edge>> {
    let mut done: Vec<&str> = Vec::new();
    for name in names {
        let mut path: Vec<&'a Edge> = Vec::new();
        if let Some(found) = visit(name, edges, &mut path, &mut done) {
            return Some(found);
        }
    }
    None
}

fn visit<'a>(
    name: &str,
    edges: &[&'a Edge],
    path: &mut Vec<&'a Edge>,
    done: &mut Vec<&'a str>,
) -> Option<Vec<&'a Edge>> {
    for edge in edges.iter().filter(|e| e.from == name) {
        path.push(edge);
        if let Some(start) = path.iter().position(|e| e.from == edge.on) {
            return Some(path.split_off(start));
        }
        if !done.contains(&edge.on.as_str())
            && let Some(found) = visit(&edge.on, edges, path, done)
        {
            return Some(found);
        }
        path.pop();
        done.push(&edge.on);
    }
    None
}

/// Sorts services behind their dependencies, otherwise in the order of the file. Services of a cycle stay last.
pub(super) fn sort(services: &mut Vec<Service>) {
    let mut waiting = std::mem::take(services);
    while !waiting.is_empty() {
        let free = waiting.iter().position(|s| s.after.iter().all(|a| services.iter().any(|d| d.name == *a)));
        let Some(free) = free else { break };
        services.push(waiting.remove(free));
    }
    services.append(&mut waiting);
}
