//! The tables of `one-stroke`: the mean over a group's scenes of the median over the strokes.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::super::measure::Spread;
use super::{Played, SHARES, robot};

/// The groups of scenes, in the order of the columns.
pub const GROUPS: [&str; 3] = ["A", "B", "labels"];

/// The IoU goals of clicks.
const GOALS: [f64; 3] = [0.80, 0.90, 0.95];

/// One rule: its name and the IoU that it reaches with a stroke.
type Rule = (&'static str, fn(&Played) -> f64);

fn best(of: &[f64]) -> f64 {
    of.iter().copied().fold(0.0, f64::max)
}

/// The rows of the table.
pub const RULES: [Rule; 14] = [
    ("ε = .03", |p| p.plain.iou[super::curve::LEAKS]),
    ("ε = .003", |p| p.plain.iou[super::curve::LEAKS + 1]),
    ("ε = .03, creases", |p| p.creased.iou[super::curve::LEAKS]),
    ("ε = .003, creases", |p| p.creased.iou[super::curve::LEAKS + 1]),
    ("ε = 10^-1.6, 10^-2.4, 10^-3.2, the best", |p| best(&[15, 11, 7].map(|i| p.plain.iou[i]))),
    ("ε = 10^-1.6, 10^-2.8, 10^-4, creases, the best", |p| best(&[15, 9, 3].map(|i| p.creased.iou[i]))),
    ("**first answer**", |p| p.three[1]),
    ("**best of three answers**", |p| best(&p.three)),
    ("first answer, no creases", |p| p.three_plain[1]),
    ("best of three answers, no creases", |p| best(&p.three_plain)),
    ("best ε for each stroke, no creases", |p| best(&p.plain.iou)),
    ("best ε for each stroke, creases", |p| best(&p.creased.iou)),
    ("best union of clusters", |p| p.union),
    ("best of 64 regions, without a stroke", |p| p.region),
];

/// One cell: a rule on a group of scenes with strokes of one length.
#[derive(Debug, Clone, Serialize)]
pub struct Cell {
    /// The rule.
    pub rule: &'static str,
    /// The group.
    pub group: &'static str,
    /// The strokes.
    pub length: &'static str,
    /// Mean over scenes of the median over strokes.
    pub iou: f64,
    /// The same less that of ε = .03, and the bounds that 95 % of the bootstrap samples lie within.
    pub gain: [f64; 3],
    /// The median of each scene.
    pub scenes: BTreeMap<String, f64>,
}

/// Everything that is written.
#[derive(Debug, Clone, Serialize)]
pub struct Tables {
    /// Layout of this file.
    pub schema: u32,
    /// Strokes played.
    pub strokes: usize,
    /// IoU by rule.
    pub cells: Vec<Cell>,
    /// Median clicks to a goal.
    pub clicks: Vec<Clicks>,
}

/// Clicks of one way to correct.
#[derive(Debug, Clone, Serialize)]
pub struct Clicks {
    /// The way.
    pub way: &'static str,
    /// The group.
    pub group: &'static str,
    /// Mean clicks to each of the goals; a goal that is not reached counts as one more than the most.
    pub mean: [f64; 3],
    /// Share of targets that reach each goal.
    pub reached: [f64; 3],
}

/// The ways of [`Played::clicks`].
pub const WAYS: [&str; 3] = ["ε = .03", "first answer", "first answer, or its better neighbour"];

fn by_scene<'a>(played: &'a [Played], group: &str, length: &str) -> BTreeMap<&'a str, Vec<&'a Played>> {
    let mut out: BTreeMap<&str, Vec<&Played>> = BTreeMap::new();
    for p in played.iter().filter(|p| p.group == group && p.length == length) {
        out.entry(&p.scene).or_default().push(p);
    }
    out
}

fn median(of: impl Iterator<Item = f64>) -> f64 {
    Spread::of(of.collect()).median
}

/// Makes the tables. The bootstrap is that of a seed.
#[must_use]
pub fn tables(played: &[Played], seed: u64) -> Tables {
    let mut cells = Vec::new();
    for (length, _) in SHARES {
        for group in GROUPS {
            let scenes = by_scene(played, group, length);
            if scenes.is_empty() {
                continue;
            }
            let mean = |f: &dyn Fn(&[&Played]) -> f64| scenes.values().map(|s| f(s)).sum::<f64>() / scenes.len() as f64;
            for (rule, of) in RULES {
                let of_scene = |s: &[&Played]| median(s.iter().map(|p| of(p)));
                let base = |s: &[&Played]| median(s.iter().map(|p| RULES[0].1(p)));
                let iou = mean(&of_scene);
                let mut r = ChaCha8Rng::seed_from_u64(seed);
                let mut gains: Vec<f64> = (0..300)
                    .map(|_| {
                        let drawn: Vec<Vec<&Played>> = scenes
                            .values()
                            .map(|s| (0..s.len()).map(|_| s[r.random_range(0..s.len())]).collect())
                            .collect();
                        drawn.iter().map(|s| of_scene(s) - base(s)).sum::<f64>() / drawn.len() as f64
                    })
                    .collect();
                gains.sort_by(f64::total_cmp);
                cells.push(Cell {
                    rule,
                    group,
                    length,
                    iou,
                    gain: [iou - mean(&base), gains[7], gains[292]],
                    scenes: scenes.iter().map(|(name, s)| ((*name).to_owned(), of_scene(s))).collect(),
                });
            }
        }
    }
    let mut clicks = Vec::new();
    for group in GROUPS {
        for (way, name) in WAYS.into_iter().enumerate() {
            let all: Vec<&Vec<f64>> =
                played.iter().filter(|p| p.group == group).filter_map(|p| p.clicks.as_ref().map(|c| &c[way])).collect();
            if all.is_empty() {
                continue;
            }
            let to = |goal: f64| all.iter().map(move |c| c.iter().position(|iou| *iou >= goal));
            let count = all.len() as f64;
            clicks.push(Clicks {
                way: name,
                group,
                mean: GOALS.map(|g| to(g).map(|at| at.map_or(robot::MOST, |a| a) as f64 + 1.0).sum::<f64>() / count),
                reached: GOALS.map(|g| to(g).flatten().count() as f64 / count),
            });
        }
    }
    Tables { schema: 1, strokes: played.len(), cells, clicks }
}

/// The tables as Markdown.
#[must_use]
pub fn markdown(tables: &Tables) -> String {
    let mut out = String::new();
    let groups: Vec<&str> = GROUPS.into_iter().filter(|g| tables.cells.iter().any(|c| c.group == *g)).collect();
    let _ = writeln!(out, "{} strokes. Columns: {}.\n", tables.strokes, groups.join(", "));
    out += "| rule | long strokes | short strokes | less ε = .03, long | less ε = .03, short |\n";
    out += "| --- | --- | --- | --- | --- |\n";
    for (rule, _) in RULES {
        let row = |length: &str, of: &dyn Fn(&Cell) -> String| {
            let cells = groups
                .iter()
                .filter_map(|g| tables.cells.iter().find(|c| c.rule == rule && c.group == *g && c.length == length));
            cells.map(of).collect::<Vec<_>>().join(" ")
        };
        let iou = |c: &Cell| format!("{:.2}", c.iou);
        let gain = |c: &Cell| format!("{:+.2} ({:+.2} to {:+.2})", c.gain[0], c.gain[1], c.gain[2]);
        let (long, short) = (row("long", &iou), row("short", &iou));
        let _ = writeln!(out, "| {rule} | {long} | {short} | {} | {} |", row("long", &gain), row("short", &gain));
    }
    out += "\nMedian IoU of each scene, long / short strokes:\n\n| scene | ε = .03 | ε = .003 | first answer | best of three | best union |\n";
    out += "| --- | --- | --- | --- | --- | --- |\n";
    let scenes: Vec<(&str, &String)> = tables
        .cells
        .iter()
        .filter(|c| c.rule == RULES[0].0 && c.length == "long")
        .flat_map(|c| c.scenes.keys().map(|s| (c.group, s)))
        .collect();
    for (group, scene) in scenes {
        let _ = write!(out, "| {scene} |");
        for rule in [0, 1, 6, 7, 12] {
            let of = |length: &str| {
                let cell =
                    tables.cells.iter().find(|c| c.rule == RULES[rule].0 && c.group == group && c.length == length);
                cell.and_then(|c| c.scenes.get(scene)).copied().unwrap_or(f64::NAN)
            };
            let _ = write!(out, " {:.2} / {:.2} |", of("long"), of("short"));
        }
        out += "\n";
    }
    let _ = writeln!(
        out,
        "\nMean clicks to an IoU of .80, .90, .95, of at most {} (share of targets that reach it):\n\n| way | {} |\n| --- |{}",
        robot::MOST,
        groups.join(" | "),
        " --- |".repeat(groups.len())
    );
    for way in WAYS {
        let _ = write!(out, "| {way} |");
        for group in &groups {
            if let Some(c) = tables.clicks.iter().find(|c| c.way == way && c.group == *group) {
                let cells: Vec<String> =
                    c.mean.iter().zip(c.reached).map(|(m, r)| format!("{m:.1} ({:.0} %)", 100.0 * r)).collect();
                let _ = write!(out, " {} |", cells.join(", "));
            }
        }
        out += "\n";
    }
    out
}
