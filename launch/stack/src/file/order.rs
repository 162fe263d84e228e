//! Start order of services.

use std::collections::{HashMap, HashSet};

use super::model::Service;
use crate::document::{Place, Problem};

/// One condition: `from` starts after `on`.
#[derive(Debug, Clone)]
pub(super) struct Edge {
    pub(super) from: String,
    pub(super) on: String,
    pub(super) place: Place,
}

/// Most cycles that are looked for.
const MAX_CYCLES: usize = 8;

/// One problem for each cycle, at its last condition.
pub(super) fn cycles(names: &[&str], edges: &[Edge]) -> Vec<Problem> {
    let mut edges: Vec<&Edge> = edges.iter().collect();
    let mut problems = Vec::new();
    while problems.len() < MAX_CYCLES
        && let Some(cycle) = cycle(names, &edges)
    {
        let (Some(first), Some(closing)) = (cycle.first().copied(), cycle.last().copied()) else { break };
        let chain: Vec<_> = cycle.iter().map(|edge| format!("comes after `{}`", edge.on)).collect();
        let text = format!("`{}` {}: a cycle; take one `after` away", first.from, chain.join(", which "));
        problems.push(Problem { place: closing.place.clone(), text });
        edges.retain(|e| !std::ptr::eq(*e, closing));
    }
    problems
}

/// The edges of one cycle in order.
fn cycle<'a>(names: &[&'a str], edges: &[&'a Edge]) -> Option<Vec<&'a Edge>> {
    let mut from: HashMap<&str, Vec<&'a Edge>> = HashMap::new();
    for edge in edges {
        from.entry(&edge.from).or_default().push(edge);
    }
    let mut done = HashSet::new();
    names.iter().find_map(|name| visit(name, &from, &mut Vec::new(), &mut done))
}

fn visit<'a>(
    name: &'a str,
    from: &HashMap<&str, Vec<&'a Edge>>,
    path: &mut Vec<&'a Edge>,
    done: &mut HashSet<&'a str>,
) -> Option<Vec<&'a Edge>> {
    for edge in from.get(name).into_iter().flatten() {
        path.push(edge);
        if let Some(start) = path.iter().position(|e| e.from == edge.on) {
            return Some(path.split_off(start));
        }
        if !done.contains(edge.on.as_str())
            && let Some(found) = visit(&edge.on, from, path, done)
        {
            return Some(found);
        }
        path.pop();
    }
    done.insert(name);
    None
}

/// Sorts services behind their dependencies, otherwise in the order of the file. Services of a cycle stay last.
pub(super) fn sort(services: &mut Vec<Service>) {
    let mut waiting = std::mem::take(services);
    let mut sorted = HashSet::new();
    while let Some(free) = waiting.iter().position(|s| s.after.iter().all(|a| sorted.contains(a))) {
        let service = waiting.remove(free);
        sorted.insert(service.name.clone());
        services.push(service);
    }
    services.append(&mut waiting);
}
