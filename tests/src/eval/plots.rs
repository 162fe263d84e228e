//! The pictures of the tables, as SVG.

use std::path::Path;

use plotters::prelude::{BLACK, ChartBuilder, Color, PathElement, RGBColor, Rectangle, Text, WHITE};
use plotters::style::{IntoFont as _, TextStyle};

use super::EvalError;
use super::ablation::{Ablation, LEAKS, SIGMAS, SubjectRows};
use super::measure::{ClusterRow, Spread};
use super::report::walk_row;
use super::subject::{Origin, Parametrisation};
use crate::plot::{Area, BLUE, Drawn, GREEN, GREY, ORANGE, PURPLE, SKY_BLUE, VERMILION, svg};

/// Colours of the bars.
const COLORS: [RGBColor; 7] = [BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY_BLUE, GREY];

/// One bar: its height, and how far the values behind it spread.
struct Bar {
    height: f64,
    spread: Option<Spread>,
}

/// Draws all plots into a folder; returns their names.
///
/// # Errors
/// [`EvalError::Plot`].
pub fn draw(ablation: &Ablation, folder: &Path) -> Result<Vec<&'static str>, EvalError> {
    let coherent: Vec<&SubjectRows> =
        ablation.subjects.iter().filter(|s| s.parametrisation == Parametrisation::Coherent).collect();
    let made: Vec<&SubjectRows> = coherent.iter().copied().filter(|s| s.origin == Origin::Made).collect();
    let scrambled: Vec<&SubjectRows> =
        ablation.subjects.iter().filter(|s| s.parametrisation == Parametrisation::Scrambled).collect();
    let mut names = Vec::new();
    let mut plot = |name: &'static str, size: (u32, u32), f: &dyn Fn(&Area<'_>) -> Drawn| {
        let path = folder.join(name);
        let wrong = |why: String| EvalError::Plot { path: path.display().to_string(), why };
        let text = svg(size, f).map_err(|e| wrong(e.to_string()))?;
        sg_formats::staged_file::replace(&path, text.as_bytes()).map_err(|e| wrong(e.to_string()))?;
        names.push(name);
        Ok::<(), EvalError>(())
    };
    let walk = |r: &ClusterRow| Bar { height: r.walk.both.iou.median, spread: Some(r.walk.both.iou) };
    let distance = ["geodesic", "euclidean-feature", "euclidean", "adaptive", "fast"];
    plot("distance.svg", (1000, 860), &|area| {
        let rows = area.split_evenly((3, 1));
        let bar = |f: fn(&ClusterRow) -> f64| move |r: &ClusterRow| Bar { height: f(r), spread: None };
        let panel = |area: &Area<'_>, title: &str, f: &dyn Fn(&ClusterRow) -> Bar| {
            bars(area, title, &coherent, &distance, &|s, v| clustering(s, v).map(f))
        };
        panel(&rows[0], "boundary recall, equal number of clusters", &bar(|r| r.partition.boundary_recall))?;
        panel(&rows[1], "IoU of the best union of clusters", &bar(|r| r.best_union_iou))?;
        panel(&rows[2], "IoU of the walk, both strokes: median, 5 to 95 %", &walk)
    })?;
    let features = ["features oriented", "features invariant", "features printed"];
    plot("features.svg", (1000, 860), &|area| {
        let rows = area.split_evenly((3, 1));
        let recall = |r: &ClusterRow| Bar { height: r.partition.boundary_recall, spread: None };
        let panel = |area: &Area<'_>, title: &str, subjects: &[&SubjectRows], f: &dyn Fn(&ClusterRow) -> Bar| {
            bars(area, title, subjects, &features, &|s, v| clustering(s, v).map(f))
        };
        panel(&rows[0], "boundary recall, coherent parametrisation", &made, &recall)?;
        panel(&rows[1], "boundary recall, scrambled parametrisation", &scrambled, &recall)?;
        panel(&rows[2], "IoU of the walk, both strokes, scrambled", &scrambled, &walk)
    })?;
    let forms = ["graph contact", "graph printed", "graph all-pairs", "graph euclidean", "walk on Gaussians"];
    plot("graphs.svg", (1000, 620), &|area| {
        let rows = area.split_evenly((2, 1));
        for (row, title, both) in
            [(&rows[0], "green stroke alone: median IoU, 5 to 95 %", false), (&rows[1], "both strokes", true)]
        {
            bars(row, title, &coherent, &forms, &|s, v| {
                let spread = walk_row(s, v).map(|r| if both { r.both.iou } else { r.green.iou })?;
                Some(Bar { height: spread.median, spread: Some(spread) })
            })?;
        }
        Ok(())
    })?;
    let mut leaks: Vec<String> = LEAKS.iter().map(|l| format!("leak {l}")).collect();
    leaks.push("farthest 5 %".to_owned());
    let leaks: Vec<&str> = leaks.iter().map(String::as_str).collect();
    plot("background.svg", (1000, 620), &|area| {
        let rows = area.split_evenly((2, 1));
        for (row, title, both) in
            [(&rows[0], "green stroke alone: median IoU, 5 to 95 %", false), (&rows[1], "both strokes", true)]
        {
            bars(row, title, &coherent, &leaks, &|s, v| {
                let spread = walk_row(s, v).map(|r| if both { r.both.iou } else { r.green.iou })?;
                Some(Bar { height: spread.median, spread: Some(spread) })
            })?;
        }
        Ok(())
    })?;
    plot("sigma.svg", (1000, 260), &|area| {
        let panels = area.split_evenly((1, made.len().max(1)));
        made.iter().zip(&panels).try_for_each(|(s, panel)| heat(panel, s))
    })?;
    Ok(names)
}

fn clustering<'a>(subject: &'a SubjectRows, variant: &str) -> Option<&'a ClusterRow> {
    subject.clusterings.iter().find(|r| r.variant == variant)
}

/// Groups of bars, one group a subject.
fn bars(
    area: &Area<'_>,
    title: &str,
    subjects: &[&SubjectRows],
    variants: &[&str],
    value: &dyn Fn(&SubjectRows, &str) -> Option<Bar>,
) -> Drawn {
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(8)
        .margin_right(170)
        .x_label_area_size(24)
        .y_label_area_size(40)
        .build_cartesian_2d(0.0..subjects.len().max(1) as f64, 0.0..1.0_f64)?;
    let name = |x: &f64| {
        let place = x.floor();
        // Labels stand at the middle of each group.
        let middle = (x - place - 0.5).abs() < 1e-6;
        subjects.get(place as usize).filter(|_| middle).map_or_else(String::new, |s| s.name.clone())
    };
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(WHITE)
        .x_labels(2 * subjects.len() + 1)
        .x_label_formatter(&name)
        .y_labels(6)
        .y_label_formatter(&|y| format!("{y:.1}"))
        .draw()?;
    let width = 0.84 / variants.len() as f64;
    for (k, variant) in variants.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let found: Vec<(f64, Bar)> = subjects
            .iter()
            .enumerate()
            .filter_map(|(i, s)| Some((i as f64 + 0.08 + width * k as f64, value(s, variant)?)))
            .filter(|(_, bar)| bar.height.is_finite())
            .collect();
        chart.draw_series(
            found.iter().map(|(x, bar)| Rectangle::new([(*x, 0.0), (x + 0.9 * width, bar.height)], color.filled())),
        )?;
        chart.draw_series(found.iter().filter_map(|(x, bar)| {
            let spread = bar.spread?;
            let middle = x + 0.45 * width;
            Some(PathElement::new(vec![(middle, spread.p05), (middle, spread.p95)], BLACK.stroke_width(1)))
        }))?;
    }
    let left = area.dim_in_pixel().0 as i32 - 165;
    for (k, variant) in variants.iter().enumerate() {
        let top = 34 + 17 * k as i32;
        area.draw(&Rectangle::new([(left, top), (left + 11, top + 11)], COLORS[k % COLORS.len()].filled()))?;
        let label = variant.trim_start_matches("features ").trim_start_matches("graph ");
        area.draw(&Text::new(label.to_owned(), (left + 17, top), ("sans-serif", 12)))?;
    }
    Ok(())
}

/// The σ sweep of one subject: IoU as numbers on shades.
fn heat(area: &Area<'_>, subject: &SubjectRows) -> Drawn {
    let n = SIGMAS.len() as f64;
    let named = |x: &f64| {
        let place = x.floor();
        let middle = (x - place - 0.5).abs() < 1e-6;
        SIGMAS.get(place as usize).filter(|_| middle).map_or_else(String::new, ToString::to_string)
    };
    let mut chart = ChartBuilder::on(area)
        .caption(&subject.name, ("sans-serif", 15))
        .margin(6)
        .x_label_area_size(34)
        .y_label_area_size(40)
        .build_cartesian_2d(0.0..n, 0.0..n)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_labels(9)
        .y_labels(9)
        .x_label_formatter(&named)
        .y_label_formatter(&named)
        .x_desc("σ_f ×")
        .y_desc("σ_s ×")
        .draw()?;
    for (i, s) in SIGMAS.iter().enumerate() {
        for (j, f) in SIGMAS.iter().enumerate() {
            let Some(row) = walk_row(subject, &format!("sigma {s} {f}")) else { continue };
            let iou = row.both.iou.median;
            let shade = |full: u8| (255.0 - (255.0 - f64::from(full)) * iou.clamp(0.0, 1.0).powi(3)) as u8;
            let color = RGBColor(shade(60), shade(150), shade(200));
            let (x, y) = (j as f64, i as f64);
            chart.draw_series([Rectangle::new([(x, y), (x + 1.0, y + 1.0)], color.filled())])?;
            let font = TextStyle::from(("sans-serif", 12).into_font());
            chart.draw_series([Text::new(format!("{iou:.2}"), (x + 0.2, y + 0.6), font)])?;
        }
    }
    Ok(())
}
