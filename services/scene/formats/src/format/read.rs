//! Telling PLY files apart by their content, and reading them.

use crate::format::ply::{PlyFile, Scalar, Table};
use crate::format::problem::{Problem, Warning, WarningCode};
use crate::format::unit_comments::{UnitComments, convention_name};
use crate::format::{Format, activation, compressed, ivrgs, ivrgs_quantised, three_dgs};
use sg_scene::model::{Convention, Gaussians};

/// One file's Gaussians, with shading columns as used.
#[derive(Debug)]
pub(crate) struct Decoded {
    pub(crate) gaussians: Gaussians,
    pub(crate) format: Format,
    pub(crate) convention: Convention,
    pub(crate) comments: UnitComments,
}

/// Reads a PLY file; `forced` is the convention to use whatever the file says.
pub(crate) fn read_ply(
    bytes: Vec<u8>,
    forced: Option<Convention>,
    warnings: &mut Vec<Warning>,
) -> Result<Decoded, Problem> {
    let file = PlyFile::parse(bytes)?;
    let comments = UnitComments::parse(&file.comments, warnings);
    let (mut gaussians, format, used) = read_elements(&file, warnings)?;
    gaussians.antialiased = file.comments.iter().any(|c| says_antialiased(c));
    warn_of_the_rest(&file, used, warnings);
    let Some(stored) = &mut gaussians.shading else {
        return Ok(Decoded { gaussians, format, convention: Convention::Ours, comments });
    };
    let convention = match (forced, comments.convention) {
        (Some(forced), said) => {
            if let Some(said) = said.filter(|said| *said != forced) {
                let (said, forced) = (convention_name(said), convention_name(forced));
                let message = format!("the file says convention `{said}`, it is read as `{forced}` as asked");
                warnings.push(Warning::new(WarningCode::Convention, message));
            }
            forced
        }
        (None, Some(said)) => said,
        (None, None) => {
            let (guess, why) = activation::guess(stored, format == Format::IvrGsQuantised);
            let name = convention_name(guess);
            let message =
                format!("the file names no convention; `{name}` was taken because {why}; --convention says otherwise");
            warnings.push(Warning::new(WarningCode::Convention, message));
            guess
        }
    };
    activation::activate(stored, convention);
    let format = if format == Format::IvrGs && convention == Convention::Ours { Format::Ours } else { format };
    Ok(Decoded { gaussians, format, convention, comments })
}

type Elements = (Gaussians, Format, &'static [&'static str]);

fn read_elements(file: &PlyFile, warnings: &mut Vec<Warning>) -> Result<Elements, Problem> {
    if let Some(table) = file.table("gaussians")? {
        if let Some(centres) = file.table("codebook_centers")? {
            let gaussians = ivrgs_quantised::read(&table, &centres)?;
            return Ok((gaussians, Format::IvrGsQuantised, &["gaussians", "codebook_centers"]));
        }
        warn_of_narrowing(&table, warnings);
        return Ok((ivrgs::read(&table)?, Format::IvrGs, &["gaussians"]));
    }
    if let (Some(chunks), Some(vertices)) = (file.table("chunk")?, file.table("vertex")?) {
        let gaussians = compressed::read(&chunks, &vertices, file.table("sh")?.as_ref())?;
        return Ok((gaussians, Format::CompressedPly, &["chunk", "vertex", "sh"]));
    }
    if let Some(table) = file.table("vertex")? {
        warn_of_narrowing(&table, warnings);
        return Ok((three_dgs::read(&table, warnings)?, Format::ThreeDgs, &["vertex"]));
    }
    let names: Vec<_> = file.element_names().collect();
    let what = if names.iter().any(|n| n.starts_with("vertex_")) {
        "its Gaussians are divided by harmonic degree (a reduced 3DGS file)".to_owned()
    } else {
        format!("there is no element `vertex` or `gaussians`, only: {}", names.join(", ").escape_debug())
    };
    Err(Problem::new("header", what, "give a 3DGS, compressed, iVR-GS or Super-Gaussian PLY"))
}

fn warn_of_narrowing(table: &Table<'_>, warnings: &mut Vec<Warning>) {
    let known = |name: &str| three_dgs::is_known(name) || ivrgs::PROPERTIES.contains(&name);
    let wide: Vec<_> =
        table.columns.iter().filter(|c| c.scalar == Scalar::F64 && known(&c.name)).map(|c| c.name.as_str()).collect();
    if !wide.is_empty() {
        let message = format!("double columns are held as float: {}", wide.join(", "));
        warnings.push(Warning::new(WarningCode::Narrowed, message));
    }
}

fn warn_of_the_rest(file: &PlyFile, used: &[&str], warnings: &mut Vec<Warning>) {
    let unused: Vec<_> = file.element_names().filter(|n| !used.contains(n)).collect();
    if !unused.is_empty() {
        let message = format!("elements that are not kept: {}", unused.join(", ").escape_debug());
        warnings.push(Warning::new(WarningCode::Ignored, message));
    }
    if file.trailing > 0 {
        let message = format!("{} bytes after the last element are not read", file.trailing);
        warnings.push(Warning::new(WarningCode::Ignored, message));
    }
}

/// The comment of Brush and of our own files, or Postshot's.
fn says_antialiased(comment: &str) -> bool {
    let words: Vec<_> = comment.split_ascii_whitespace().collect();
    matches!(words.as_slice(), ["SplatRenderMode:", "mip"] | ["antialiased", "1"])
}
