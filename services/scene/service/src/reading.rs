//! Options on how scene files are read.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::Vec3;
use sg_formats::{Format, LoadOptions};
use sg_scene::model::{Convention, ShadingModel};

/// Properties that override those of the files.
#[derive(Debug, Args)]
pub(crate) struct Reading {
    /// Activation of the input's shading columns; by default the file names it, or it is guessed.
    #[arg(long, value_parser = conventions())]
    convention: Option<Convention>,
    /// Shading model of all units.
    #[arg(long, value_parser = shadings())]
    shading: Option<ShadingModel>,
    /// Palette colour of all units with shading columns, three numbers from 0 to 1.
    #[arg(long, value_name = "R,G,B", value_parser = palette)]
    palette: Option<Vec3>,
}

impl Reading {
    pub(crate) fn options(&self) -> LoadOptions {
        LoadOptions { convention: self.convention, shading: self.shading, palette: self.palette }
    }

    /// Whether a property of the files is overridden.
    pub(crate) fn changes_files(&self) -> bool {
        self.options() != LoadOptions::default()
    }
}

pub(crate) fn input_help() -> String {
    format!("A scene ({}), or an output folder of iVR-GS", Format::all_extensions().join(", "))
}

pub(crate) fn conventions() -> impl TypedValueParser<Value = Convention> {
    let names = ["ours", "legacy", "head-raw", "head-activated"];
    PossibleValuesParser::new(names).try_map(|name| serde_json::from_value(serde_json::Value::String(name)))
}

fn shadings() -> impl TypedValueParser<Value = ShadingModel> {
    let names = ["paper", "ivrgs-train", "ivrgs-viewer"];
    PossibleValuesParser::new(names).try_map(|name| serde_json::from_value(serde_json::Value::String(name)))
}

fn palette(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers.as_slice() {
        [r, g, b] if numbers.iter().all(|x| (0.0..=1.0).contains(x)) => Ok(Vec3::new(*r, *g, *b)),
        _ => Err("give three numbers from 0 to 1, as 0.8,0.2,0.1".to_owned()),
    }
}
