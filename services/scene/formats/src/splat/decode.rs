//! Decoding the file of one unit: a PLY by its layout, another file by its format.

use crate::splat::activation;
use crate::splat::format::{Decoded, Format, PlyLayout, Source};
use crate::splat::ply::{MAX_HEADER, PlyFile};
use crate::splat::problem::{Problem, Warning, WarningCode};
use crate::splat::unit_comments::{UnitComments, convention_name};
use sg_scene::model::Convention;

/// Bytes at the start of a file that [`needed`] looks at.
pub(crate) const HEAD_LENGTH: u64 = MAX_HEADER as u64;

/// The bytes of a unit's file of `length` bytes that [`decode_unit`] needs, from its first [`HEAD_LENGTH`] bytes.
///
/// # Errors
/// The content is of no format that stores a unit, or its header does not fit its length.
pub(crate) fn needed(source: &Source, start: &[u8], length: u64) -> Result<u64, Problem> {
    if source.is_ply() { PlyFile::needed(start, length) } else { Format::detect(source).map(|_| length) }
}

/// Decodes the needed bytes of a unit's file of `length` bytes. `forced` is the convention to use instead of the file's own.
///
/// # Errors
/// The content is of no format that stores a unit, or it is damaged.
pub(crate) fn decode_unit(
    source: &Source,
    (bytes, length): (Vec<u8>, u64),
    forced: Option<Convention>,
    warnings: &mut Vec<Warning>,
) -> Result<Decoded, Problem> {
    if source.is_ply() {
        return decode_ply(&PlyFile::parse(bytes, length)?, forced, warnings);
    }
    let format = Format::detect(source)?;
    let gaussians = format.0.decode(&bytes, warnings)?;
    Ok(Decoded { gaussians, format, convention: Convention::Ours, comments: UnitComments::default() })
}

fn decode_ply(file: &PlyFile, forced: Option<Convention>, warnings: &mut Vec<Warning>) -> Result<Decoded, Problem> {
    let comments = UnitComments::parse(&file.comments, warnings);
    let (row, layout) = layout_of(file)?;
    let format = |convention| match layout.as_used {
        Some(as_used) if convention == Convention::Ours => as_used,
        _ => row,
    };
    let mut gaussians = (layout.read)(file, warnings)?;
    gaussians.antialiased = file.comments.iter().any(|c| is_antialiased_comment(c));
    warn_of_the_rest(file, layout.elements, warnings);
    let Some(stored) = &mut gaussians.shading else {
        let convention = Convention::Ours;
        return Ok(Decoded { gaussians, format: format(convention), convention, comments });
    };
    let convention = match (forced, comments.convention) {
        (Some(forced), said) => {
            if let Some(said) = said.filter(|said| *said != forced) {
                let (said, forced) = (convention_name(said), convention_name(forced));
                let message = format!("the file has convention `{said}`; it is read as `{forced}` on request");
                warnings.push(Warning::new(WarningCode::Convention, message));
            }
            forced
        }
        (None, Some(said)) => said,
        (None, None) => {
            let (guess, why) = activation::guess(stored, layout.is_quantised);
            let name = convention_name(guess);
            let message =
                format!("the file names no convention; `{name}` is used because {why}; --convention overrides it");
            warnings.push(Warning::new(WarningCode::Convention, message));
            guess
        }
    };
    activation::activate(stored, convention);
    Ok(Decoded { gaussians, format: format(convention), convention, comments })
}

/// The layout of a file, and the format with this layout.
fn layout_of(file: &PlyFile) -> Result<(Format, PlyLayout), Problem> {
    let mut layouts = Format::all().filter_map(|f| Some((f, f.0.ply()?)));
    layouts.find(|(_, layout)| (layout.matches)(file)).ok_or_else(|| {
        let names: Vec<_> = file.element_names().collect();
        let what = if names.iter().any(|n| n.starts_with("vertex_")) {
            "it is a reduced 3DGS file, with Gaussians divided by harmonic degree".to_owned()
        } else {
            format!("there is no element `vertex` or `gaussians`, only: {}", short_list(&names))
        };
        let known: Vec<_> = Format::all().filter(|f| f.extensions().contains(&".ply")).map(Format::name).collect();
        Problem::new("header", what, format!("give a PLY of one of the formats {}", known.join(", ")))
    })
}

fn warn_of_the_rest(file: &PlyFile, used: &[&str], warnings: &mut Vec<Warning>) {
    let unused: Vec<_> = file.element_names().filter(|n| !used.contains(n)).collect();
    if !unused.is_empty() {
        let message = format!("elements that are not kept: {}", short_list(&unused));
        warnings.push(Warning::new(WarningCode::Ignored, message));
    }
    if file.trailing > 0 {
        let message = format!("{} bytes after the last element are not read", file.trailing);
        warnings.push(Warning::new(WarningCode::Ignored, message));
    }
}

/// The comment of Brush and of our own files, or Postshot's.
fn is_antialiased_comment(comment: &str) -> bool {
    let words: Vec<_> = comment.split_ascii_whitespace().collect();
    matches!(words.as_slice(), ["SplatRenderMode:", "mip"] | ["antialiased", "1"])
}

/// Names of a file for a message.
fn short_list(names: &[&str]) -> String {
    let names: String = names.join(", ").chars().take(400).collect();
    sg_input::printable(&names).into_owned()
}
