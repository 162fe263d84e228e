//! Masks of one step of a series for a later one.

use std::path::{Component, Path, PathBuf};

use clap::Args;
use serde::Deserialize;
use sg_fit::series::carried;
use sg_formats::{npy, staged_file};
use sg_input::number_format::grouped;
use sg_input::print::status as print_line;
use sg_input::{file, limits};

use crate::failure::{Failure, input, work};

#[derive(Args)]
pub(crate) struct CarryArgs {
    /// The series.toml of a fit.
    #[arg(value_name = "series.toml")]
    series: PathBuf,
    /// Mask of a step: uint8 0/1, one for each Gaussian in scene order.
    #[arg(long, value_name = "mask.npy")]
    mask: PathBuf,
    /// Step of the mask, from 0.
    #[arg(long, value_name = "K", default_value_t = 0)]
    from: usize,
    /// Step to carry it to, after that one.
    #[arg(long, value_name = "K")]
    to: usize,
    /// File for the mask of that step.
    #[arg(long, value_name = "mask.npy")]
    out: PathBuf,
}

/// What is needed of a series file.
#[derive(Deserialize)]
struct Steps {
    step: Vec<Step>,
}

#[derive(Deserialize)]
struct Step {
    previous: PathBuf,
    gaussians: usize,
}

/// Carries a mask from step to step.
pub(crate) fn carry(args: &CarryArgs) -> Result<(), Failure> {
    let CarryArgs { series, mask, from, to, out } = args;
    let wrong = |what: &dyn std::fmt::Display| input(format!("{}: {what}", series.display()));
    let text = file::read_text(series, limits::TEXT_BYTES).map_err(|e| wrong(&e))?;
    limits::check_toml_parts(&text).map_err(|e| wrong(&e))?;
    let Steps { step } = toml::from_str(&text).map_err(|e| wrong(&e.to_string().replace('\n', " ")))?;
    let (Some(first), Some(later)) = (step.get(*from), step.get(from + 1..=*to).filter(|later| !later.is_empty()))
    else {
        let last = step.len().saturating_sub(1);
        return Err(wrong(&format!("no way from step {from} to {to}; give an earlier and a later one of 0 to {last}")));
    };
    staged_file::check_outputs([out.as_path()], [series.as_path(), mask.as_path()]).map_err(input)?;
    let mut current = npy::read_mask(mask, first.gaussians).map_err(input)?;
    let before = current.count();
    for Step { previous, gaussians } in later {
        let is_below = previous.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        if !is_below {
            return Err(wrong(&format!("`{}` leads out of the folder of the series", previous.display())));
        }
        let path = series.parent().unwrap_or(Path::new("")).join(previous);
        let map = npy::read_labels(&path).map_err(input)?;
        if map.len() != *gaussians {
            let what = format!("{} numbers for {gaussians} Gaussians; fit the series again", map.len());
            return Err(input(format!("{}: {what}", path.display())));
        }
        current = carried(&current, &map);
    }
    npy::write_mask(out, &current).map_err(work)?;
    print_line(&format!(
        "{}: {} of {} Gaussians of step {to}, from {} of step {from}",
        out.display(),
        grouped(current.count() as u64),
        grouped(current.len() as u64),
        grouped(before as u64)
    ));
    Ok(())
}
