//! The report of a measurement: a table for a person, or JSON.

use serde::Serialize;
use sg_labeling::retrieval::Tally;

use super::{Measurement, Method};

/// What is measured, for a person.
pub(super) struct Subject<'s> {
    /// The model.
    pub(super) model: &'s str,
    /// Precision of its weights.
    pub(super) precision: &'s str,
    /// Pictures of a unit, at most.
    pub(super) views: usize,
    /// The scenes.
    pub(super) scenes: Vec<&'s str>,
    /// The file of the queries; `None` if names are asked for.
    pub(super) queries: Option<&'s str>,
}

/// Mark of a row whose method has the query itself.
const MARK: &str = " *";
/// What the mark says.
const NOTE: &str =
    "* the name is in the embedding, or is the label that words compare: the query itself, so the row says little";

impl Subject<'_> {
    /// Whether a method has the query itself.
    fn has_query(&self, method: Method) -> bool {
        self.queries.is_none() && method.has_name()
    }
}

/// The table, line by line.
pub(super) fn table(subject: &Subject<'_>, measured: &Measurement) -> Vec<String> {
    let header = ["method", "recall@1", "recall@5", "mean reciprocal rank", "false questions"].map(str::to_owned);
    let mut rows = vec![header];
    for (method, tally) in &measured.rows {
        let mark = if subject.has_query(*method) { MARK } else { "" };
        rows.push([
            format!("{}{mark}", method.title()),
            tally.recall_at_1().to_string(),
            tally.recall_at_5().to_string(),
            mean_of(tally.mean_reciprocal_rank(), tally.meant()),
            tally.false_answers().to_string(),
        ]);
    }
    if let Some((_, tally)) = measured.rows.first() {
        let none = || "–".to_owned();
        rows.push(["a guess".to_owned(), mean_of(tally.chance(), tally.meant()), none(), none(), none()]);
    }
    let Subject { model, precision, views, scenes, .. } = subject;
    let (scenes, units) = (number(scenes.len(), "scene"), number(measured.units, "unit"));
    let asked = subject.queries.map_or_else(|| "their names".to_owned(), |file| format!("the texts of {file}"));
    let head = format!("{model} in {precision}, at most {views} views a unit: {units} of {scenes} by {asked}");
    let mut lines = vec![head, String::new()];
    lines.extend(aligned(&rows));
    if measured.rows.iter().any(|(method, _)| subject.has_query(*method)) {
        lines.push(NOTE.to_owned());
    }
    lines.push(String::new());
    lines.push(times(measured));
    lines
}

/// A mean over a number of queries.
fn mean_of(mean: Option<f64>, queries: usize) -> String {
    mean.map_or_else(|| "–".to_owned(), |mean| format!("{mean:.2} (of {queries})"))
}

fn number(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}

fn times(measured: &Measurement) -> String {
    let (render, encode) = (measured.mean_render_ms(), measured.mean_encode_ms());
    let units = number(measured.embedded, "unit");
    format!(
        "a unit takes {render:.0} ms to choose and draw its views and {encode:.0} ms to encode, the mean of {units}"
    )
}

/// Rows whose columns begin below each other.
fn aligned<const COLUMNS: usize>(rows: &[[String; COLUMNS]]) -> Vec<String> {
    let widths: [usize; COLUMNS] = std::array::from_fn(|column| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or_default()
    });
    let line = |row: &[String; COLUMNS]| {
        let cells = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect()
}

#[derive(Serialize)]
struct Report<'r> {
    model: &'r str,
    precision: &'r str,
    /// Pictures of a unit, at most.
    views: usize,
    scenes: &'r [&'r str],
    /// The file of the queries; null if names are asked for.
    queries: Option<&'r str>,
    units: usize,
    /// Units that have an embedding.
    embedded: usize,
    /// Recall@1 of a guess; null without queries that mean a unit.
    chance: Option<f64>,
    methods: Vec<MethodReport>,
    /// Means over the units with an embedding, milliseconds.
    render_ms: f64,
    encode_ms: f64,
}

#[derive(Serialize)]
struct MethodReport {
    method: String,
    /// Whether the method has the query itself.
    has_query: bool,
    /// Queries that mean a unit, and those of them whose unit is the first, or among the first five.
    meant: usize,
    first: usize,
    among_five: usize,
    /// Null without queries that mean a unit.
    recall_at_1: Option<f64>,
    recall_at_5: Option<f64>,
    mean_reciprocal_rank: Option<f64>,
    /// Queries that mean nothing, and those of them that lead to a question or a match.
    absent: usize,
    false_questions: usize,
}

impl MethodReport {
    fn of(subject: &Subject<'_>, method: Method, tally: &Tally) -> Self {
        let (first, few, answered) = (tally.recall_at_1(), tally.recall_at_5(), tally.false_answers());
        Self {
            method: method.title(),
            has_query: subject.has_query(method),
            meant: tally.meant(),
            first: first.count,
            among_five: few.count,
            recall_at_1: first.value(),
            recall_at_5: few.value(),
            mean_reciprocal_rank: tally.mean_reciprocal_rank(),
            absent: answered.of,
            false_questions: answered.count,
        }
    }
}

/// The report as JSON.
///
/// # Errors
/// [`serde_json::Error`] for numbers that are not finite.
pub(super) fn json(subject: &Subject<'_>, measured: &Measurement) -> Result<String, serde_json::Error> {
    let methods = measured.rows.iter().map(|(method, tally)| MethodReport::of(subject, *method, tally));
    serde_json::to_string_pretty(&Report {
        model: subject.model,
        precision: subject.precision,
        views: subject.views,
        scenes: &subject.scenes,
        queries: subject.queries,
        units: measured.units,
        embedded: measured.embedded,
        chance: measured.rows.first().and_then(|(_, tally)| tally.chance()),
        methods: methods.collect(),
        render_ms: measured.mean_render_ms(),
        encode_ms: measured.mean_encode_ms(),
    })
}

#[cfg(test)]
mod tests {
    use sg_labeling::retrieval::Ranking;

    use super::*;
    use crate::region_views::ViewOrder;
    use crate::retrieval::Variant;
    use crate::unit_embeddings::FusionChoice;

    fn subject(queries: Option<&str>) -> Subject<'_> {
        Subject { model: "clip", precision: "f32", views: 5, scenes: vec!["a.toml", "b.toml"], queries }
    }

    fn measured() -> Measurement {
        let of = |fusion| Method::Embeddings(Variant { order: ViewOrder::default(), fusion, adapts: false });
        let mut tally = Tally::default();
        tally.add_meant(&Ranking::new(vec![Some(0.1), Some(0.2)]), 1);
        tally.add_meant(&Ranking::new(vec![Some(0.1), Some(0.2)]), 0);
        tally.add_absent(true);
        let rows = [Method::Words, of(FusionChoice::Pictures), of(FusionChoice::Normalized)];
        let rows = rows.map(|method| (method, tally.clone())).to_vec();
        Measurement { rows, units: 3, embedded: 2, render_ms: 30.0, encode_ms: 1000.0 }
    }

    #[test]
    fn columns_are_aligned_and_rows_with_the_answer_are_marked() {
        let lines = table(&subject(None), &measured());
        let expected = [
            "clip in f32, at most 5 views a unit: 3 units of 2 scenes by their names",
            "",
            "method        recall@1       recall@5       mean reciprocal rank  false questions",
            "words *       0.50 (1 of 2)  1.00 (2 of 2)  0.75 (of 2)           1.00 (1 of 1)",
            "pictures      0.50 (1 of 2)  1.00 (2 of 2)  0.75 (of 2)           1.00 (1 of 1)",
            "normalized *  0.50 (1 of 2)  1.00 (2 of 2)  0.75 (of 2)           1.00 (1 of 1)",
            "a guess       0.50 (of 2)    –              –                     –",
            NOTE,
            "",
            "a unit takes 15 ms to choose and draw its views and 500 ms to encode, the mean of 2 units",
        ];
        assert_eq!(lines, expected);
        let lines = table(&subject(Some("texts.tsv")), &measured());
        assert!(lines[0].ends_with("by the texts of texts.tsv"), "{}", lines[0]);
        assert!(lines.iter().all(|line| !line.contains('*')), "{lines:?}");
    }

    #[test]
    fn json_has_all_numbers() {
        let text = json(&subject(None), &measured()).unwrap();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!((&value["scenes"][1], &value["queries"]), (&"b.toml".into(), &serde_json::Value::Null));
        assert_eq!((value["render_ms"].as_f64(), value["chance"].as_f64()), (Some(15.0), Some(0.5)));
        let pictures = &value["methods"][1];
        assert_eq!((pictures["method"].as_str(), pictures["has_query"].as_bool()), (Some("pictures"), Some(false)));
        assert_eq!((pictures["mean_reciprocal_rank"].as_f64(), pictures["first"].as_u64()), (Some(0.75), Some(1)));
        assert_eq!((pictures["absent"].as_u64(), pictures["false_questions"].as_u64()), (Some(1), Some(1)));
    }
}
