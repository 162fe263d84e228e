//! The tables as Markdown.

use std::fmt::Write as _;

use super::ablation::{Ablation, LEAKS, SIGMAS, SubjectRows};
use super::measure::{ClusterRow, WalkRow};
use super::subject::{Origin, Parametrisation};

/// All tables, without times where `timeless`, so that two runs of a seed give the same text.
#[must_use]
pub fn markdown(ablation: &Ablation, timeless: bool) -> String {
    let mut out = String::new();
    let coherent: Vec<&SubjectRows> = of(ablation, Parametrisation::Coherent);
    let made: Vec<&SubjectRows> = coherent.iter().copied().filter(|s| s.origin == Origin::Made).collect();
    let scrambled = of(ablation, Parametrisation::Scrambled);

    section(&mut out, "Scenes");
    table(
        &mut out,
        &["scene", "Gaussians", "wanted", "parts"],
        coherent
            .iter()
            .map(|s| vec![s.name.clone(), s.gaussians.to_string(), s.wanted.to_string(), s.parts.to_string()]),
    );

    section(&mut out, "Distance: how clusters are made");
    cluster_table(
        &mut out,
        &coherent,
        &["geodesic", "euclidean-feature", "euclidean", "adaptive", "windowed", "fast"],
        timeless,
    );
    section(&mut out, "Features, coherent parametrisation");
    let features = ["features oriented", "features invariant", "features printed"];
    cluster_table(&mut out, &coherent, &features, timeless);
    section(&mut out, "Features, scrambled parametrisation");
    cluster_table(&mut out, &scrambled, &features, timeless);

    section(&mut out, "Cluster statistics");
    statistics(&mut out, &coherent);

    section(&mut out, "What selects");
    walk_table(
        &mut out,
        &coherent,
        &[
            "walk",
            "walk, no features",
            "walk, no distance",
            "walk, three green strokes",
            "walk on Gaussians",
            "clusters hit",
            "Gaussians hit",
        ],
        timeless,
    );
    section(&mut out, "Graph forms");
    let forms = ["graph contact", "graph printed", "graph all-pairs", "graph euclidean"];
    walk_table(&mut out, &coherent, &forms, timeless);

    section(&mut out, "Automatic background: median IoU after the green stroke alone / after both");
    let mut columns: Vec<String> = LEAKS.iter().map(|l| format!("leak {l}")).collect();
    columns.push("farthest 5 %".to_owned());
    matrix(&mut out, &coherent, &columns, |row| {
        format!("{} / {}", digits(row.green.iou.median), digits(row.both.iou.median))
    });

    section(&mut out, "σ sweep: median IoU after both strokes, multipliers of σ_s / σ_f");
    let columns: Vec<String> =
        SIGMAS.iter().flat_map(|s| SIGMAS.iter().map(move |f| format!("sigma {s} {f}"))).collect();
    matrix(&mut out, &made, &columns, |row| digits(row.both.iou.median));

    section(&mut out, "Seeds: IoU over jittered strokes");
    seeds(&mut out, &coherent);
    out
}

fn of(ablation: &Ablation, parametrisation: Parametrisation) -> Vec<&SubjectRows> {
    ablation.subjects.iter().filter(|s| s.parametrisation == parametrisation).collect()
}

fn section(out: &mut String, title: &str) {
    let _ = write!(out, "\n### {title}\n\n");
}

fn digits(x: f64) -> String {
    if x.is_finite() { format!("{x:.3}") } else { "–".to_owned() }
}

fn table(out: &mut String, head: &[&str], rows: impl Iterator<Item = Vec<String>>) {
    let _ = writeln!(out, "| {} |", head.join(" | "));
    let _ = writeln!(out, "|{}", " --- |".repeat(head.len()));
    for row in rows {
        let _ = writeln!(out, "| {} |", row.join(" | "));
    }
}

fn cluster_row<'a>(subject: &'a SubjectRows, variant: &str) -> Option<&'a ClusterRow> {
    subject.clusterings.iter().find(|r| r.variant == variant)
}

/// A row of the walk tables by its name.
#[must_use]
pub fn walk_row<'a>(subject: &'a SubjectRows, variant: &str) -> Option<&'a WalkRow> {
    subject.walks.iter().find(|r| r.variant == variant)
}

fn time(x: f64, timeless: bool) -> String {
    if timeless { "–".to_owned() } else { format!("{x:.2}") }
}

fn cluster_table(out: &mut String, subjects: &[&SubjectRows], variants: &[&str], timeless: bool) {
    let rows = subjects.iter().flat_map(|s| {
        variants.iter().filter_map(move |v| {
            let r = cluster_row(s, v)?;
            Some(vec![
                s.name.clone(),
                (*v).to_owned(),
                r.clusters.to_string(),
                digits(r.partition.achievable_accuracy),
                digits(r.partition.boundary_recall),
                digits(r.partition.under_segmentation),
                digits(r.best_union_iou),
                digits(r.walk.green.iou.median),
                digits(r.walk.both.iou.median),
                time(r.cluster_seconds, timeless),
            ])
        })
    });
    let head = [
        "scene",
        "clusters by",
        "K",
        "achievable accuracy",
        "boundary recall",
        "under-segm. error",
        "best union IoU",
        "walk IoU, green",
        "walk IoU, both",
        "s",
    ];
    table(out, &head, rows);
}

fn statistics(out: &mut String, subjects: &[&SubjectRows]) {
    let rows = subjects.iter().flat_map(|s| {
        s.clusterings.iter().filter(|r| !r.variant.starts_with("features")).map(|r| {
            vec![
                s.name.clone(),
                r.variant.clone(),
                r.clusters.to_string(),
                format!("{:.1}", r.mean_size),
                digits(r.size_cv),
                format!("{:.5}", r.compactness_box_share),
                digits(r.same_label_knn),
            ]
        })
    });
    let head = ["scene", "clusters by", "count", "mean size", "size CV", "compactness / box", "same-label kNN"];
    table(out, &head, rows);
}

fn walk_table(out: &mut String, subjects: &[&SubjectRows], variants: &[&str], timeless: bool) {
    let rows = subjects.iter().flat_map(|s| {
        variants.iter().filter_map(move |v| {
            let r = walk_row(s, v)?;
            Some(vec![
                s.name.clone(),
                (*v).to_owned(),
                time(r.stroke_ms, timeless),
                digits(r.both.iou.median),
                digits(r.both.iou_by_opacity),
                digits(r.both.acc),
                digits(r.both.f1),
                digits(r.both.precision),
                digits(r.both.recall),
                digits(r.both.mcc),
                digits(r.green.iou.median),
            ])
        })
    });
    let head = [
        "scene",
        "variant",
        "ms",
        "IoU",
        "IoU by opacity",
        "acc",
        "F1",
        "precision",
        "recall",
        "MCC",
        "IoU, green alone",
    ];
    table(out, &head, rows);
}

fn matrix(out: &mut String, subjects: &[&SubjectRows], columns: &[String], cell: impl Fn(&WalkRow) -> String) {
    let short: Vec<String> =
        columns.iter().map(|c| c.strip_prefix("sigma ").map_or_else(|| c.clone(), |s| s.replace(' ', " / "))).collect();
    let mut head = vec!["scene"];
    head.extend(short.iter().map(String::as_str));
    let rows = subjects.iter().map(|s| {
        let cells = columns.iter().map(|c| walk_row(s, c).map_or_else(String::new, &cell));
        std::iter::once(s.name.clone()).chain(cells).collect()
    });
    table(out, &head, rows);
}

fn seeds(out: &mut String, subjects: &[&SubjectRows]) {
    let rows = subjects.iter().flat_map(|s| {
        let spread = |name: &str, row: &WalkRow| {
            let mut cells = vec![s.name.clone(), name.to_owned(), row.trials.to_string()];
            for side in [row.green.iou, row.both.iou] {
                cells.push(format!("{} ({}–{})", digits(side.median), digits(side.p05), digits(side.p95)));
            }
            cells
        };
        let clusters = ["geodesic", "euclidean-feature", "euclidean", "adaptive"]
            .into_iter()
            .filter_map(|v| Some(spread(&format!("clusters {v}"), &cluster_row(s, v)?.walk)))
            .collect::<Vec<_>>();
        let walks = ["walk, three green strokes", "graph printed", "graph all-pairs", "farthest 5 %"]
            .into_iter()
            .filter_map(|v| Some(spread(v, walk_row(s, v)?)))
            .collect::<Vec<_>>();
        clusters.into_iter().chain(walks)
    });
    let head = ["scene", "what", "trials", "green alone: median (5 %–95 %)", "both: median (5 %–95 %)"];
    table(out, &head, rows);
}
