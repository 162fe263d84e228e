//! The picture of a session, as SVG.

use std::path::Path;

use plotters::prelude::{BLACK, ChartBuilder, PathElement, RGBColor, Text, WHITE};

use super::samples::{DISKS, PICTURES, Sample};
use super::usage::ProcessUse;
use crate::plot::{Area, BLUE, Drawn, GREEN, GREY, ORANGE, PURPLE, SKY_BLUE, VERMILION, svg};

/// A line of a panel: its name, and points by minutes. `None` begins a new stretch.
type Line = (String, Vec<Option<(f64, f64)>>);

/// Most samples of a line. More do not show.
const MAX_POINTS: usize = 500;
const SIZE: (u32, u32) = (1200, 1740);
/// Colours of the lines.
const COLORS: [RGBColor; 9] = [GREY, BLACK, BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY_BLUE, RGBColor(170, 140, 40)];

/// Draws memory, descriptors, threads, files and the course of the session.
///
/// # Errors
/// A line that names the file and the failure.
pub fn draw(path: &Path, names: &[String], samples: &[Sample]) -> Result<(), String> {
    let stride = samples.len().div_ceil(MAX_POINTS).max(1);
    let samples: Vec<Sample> = samples.iter().step_by(stride).cloned().collect();
    let text = svg(SIZE, |area| draw_to(area, names, &samples)).map_err(|e| format!("{}: {e}", path.display()))?;
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

fn draw_to(area: &Area<'_>, names: &[String], samples: &[Sample]) -> Drawn {
    let panels = area.split_evenly((6, 1));
    let of_process = |value: fn(&ProcessUse) -> f64| -> Vec<Line> {
        let line = |(at, name): (usize, &String)| {
            let point = |s: &Sample| Some((s.seconds / 60.0, value(&s.processes.get(at).copied().flatten()?)));
            (name.clone(), samples.iter().map(point).collect())
        };
        names.iter().enumerate().map(line).collect()
    };
    let of_stack = |name: &str, value: &dyn Fn(&Sample) -> f64| -> Line {
        (name.to_owned(), samples.iter().map(|s| Some((s.seconds / 60.0, value(s)))).collect())
    };
    let mut counts = of_process(|u| u.descriptors as f64);
    counts.push(of_stack("processes", &|s| s.below as f64));
    let mut disks: Vec<Line> = Vec::new();
    for (at, name) in DISKS.iter().enumerate() {
        disks.push(of_stack(name, &|s| s.disks.get(at).map_or(0.0, |d| d.bytes as f64 / f64::from(1 << 20))));
    }
    // Pictures have a panel of their own, beside which the rest would be a line at its foot.
    let (mut pictures, disks): (Vec<_>, Vec<_>) = disks.into_iter().partition(|(name, _)| name == PICTURES);
    pictures.push(of_stack("their folders", &|s| s.picture_folders as f64));
    let course = [
        of_stack("thousand commands", &|s| s.commands as f64 / 1e3),
        of_stack("hundred captures", &|s| s.captures as f64 / 1e2),
        of_stack("ten restarts", &|s| s.restarts as f64 / 1e1),
    ];
    let mut panel = panels.iter();
    let mut next = |title: &str, lines: &[Line]| panel.next().map_or(Ok(()), |area| lines_of(area, title, lines));
    next("anonymous memory, MiB", &of_process(|u| u.anonymous_kib as f64 / 1024.0))?;
    next("open descriptors; processes of the stack", &counts)?;
    next("threads", &of_process(|u| u.threads as f64))?;
    next("files, MiB", &disks)?;
    next("pictures, MiB, and folders of processes, dead ones included", &pictures)?;
    next("course of the session (minutes)", &course)
}

fn lines_of(area: &Area<'_>, title: &str, lines: &[Line]) -> Drawn {
    let points = || lines.iter().flat_map(|(_, points)| points.iter().flatten());
    let right = points().map(|p| p.0).fold(0.01, f64::max);
    let top = points().map(|p| p.1).fold(1.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(8)
        .margin_right(180)
        .x_label_area_size(24)
        .y_label_area_size(60)
        .build_cartesian_2d(0.0..right, 0.0..1.05 * top)?;
    chart.configure_mesh().light_line_style(WHITE).x_labels(13).y_labels(7).draw()?;
    let left = area.dim_in_pixel().0 as i32 - 172;
    for ((name, points), (k, color)) in lines.iter().zip(COLORS.iter().cycle().enumerate()) {
        let stretches = points.split(Option::is_none).filter(|s| !s.is_empty());
        chart
            .draw_series(stretches.map(|s| PathElement::new(s.iter().flatten().copied().collect::<Vec<_>>(), color)))?;
        let height = 34 + 18 * k as i32;
        area.draw(&PathElement::new(vec![(left, height + 6), (left + 16, height + 6)], color))?;
        area.draw(&Text::new(name.clone(), (left + 22, height), ("sans-serif", 12)))?;
    }
    Ok(())
}
