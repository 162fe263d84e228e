//! Files: export Gaussians, save a picture or a copy of the project, open a file.

use sg_proto::language::{Act, Clause, Reference};
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{GaussianChoice, GaussianPart, OpenRequest, ProjectCopy, SaveRequest};
use winnow::Parser;
use winnow::combinator::{alt, opt, repeat};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field};
use crate::resolution::{PictureWish, Refusal, Step, missing, selected_count, target};
use crate::syntax::number::{plain_number, times};
use crate::syntax::phrase::{Input, Outcome, advance, article, end, exactly, mark, one_of, peek_at, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{Target, target_then};
use crate::syntax::token::{Kind, has_known_ending, is_file};

/// The command "save a picture".
pub(super) const SAVE_PICTURE: Command = Command {
    act: Act::SavePicture,
    title: "save a picture",
    constructs: &[
        Construct::new("save | take | make | export | store | capture | grab | keep", picture),
        Construct::new("screenshot | snapshot", picture_words),
    ],
    examples: &["save a picture", "save a picture as front.png", "take a screenshot at twice the size"],
    fields: &[Field::optional("file"), Field::optional("amount"), Field::optional("transparent")],
    effect: Effect::None,
    resolve: resolve_picture,
};

/// The command "save a copy".
pub(super) const SAVE_COPY: Command = Command {
    act: Act::SaveCopy,
    title: "save a copy",
    constructs: &[Construct::new("save | export | store | back up | backup", copy)],
    examples: &["save a copy", "save a copy as monday.sgproj"],
    fields: &[Field::optional("file")],
    effect: Effect::None,
    resolve: resolve_copy,
};

/// The command "export".
pub(super) const EXPORT: Command = Command {
    act: Act::Export,
    title: "export",
    constructs: &[Construct::new("export | save | write | store | download", export)],
    examples: &["export the {unit}", "export the selection as part.ply", "export what is visible as all.splat"],
    fields: &[Field::optional("target"), Field::optional("file")],
    effect: Effect::None,
    resolve: resolve_export,
};

/// The command "open".
pub(super) const OPEN: Command = Command {
    act: Act::Open,
    title: "open a file",
    constructs: &[Construct::new("open | load | import", open)],
    examples: &["open heart.nrrd", "open ~/scans/head.nii.gz"],
    fields: &[Field::required("file")],
    effect: Effect::None,
    resolve: resolve_open,
};

/// Largest factor on the size of a picture.
const MAX_SCALE: f64 = 4.0;

/// Ending of pictures that are written.
const PICTURE: &str = ".png";

/// Endings of pictures that people ask for.
const PICTURES: [&str; 6] = [PICTURE, ".jpg", ".jpeg", ".webp", ".tif", ".tiff"];

/// Most phrases about one picture.
const MAX_PICTURE_WORDS: usize = 4;

/// Ending of projects.
const PROJECT: &str = ".sgproj";

/// Phrases for what is visible.
const VISIBLE: &str = "what is visible | what 's visible | what i see | what is shown | everything visible | \
     everything that is visible | everything shown | all visible | all that is visible | the visible | visible | \
     the visible part | the visible splats | the visible gaussians | all visible splats | all visible gaussians";

/// Parses "as sac.ply", "to the file 'my sac.ply'": the file's name.
fn file_name(input: &mut Input<'_>) -> Outcome<String> {
    skip("as | to | in | into | under | under the name | with the name | called | named").parse_next(input)?;
    article(input)?;
    skip("file | new file | file called | file named").parse_next(input)?;
    file(input)
}

/// Parses a file alone.
fn file(input: &mut Input<'_>) -> Outcome<String> {
    let token = peek_at(input, 0).ok_or(EmptyError)?;
    let is_one = token.kind == Kind::File || (token.kind == Kind::Quoted && is_file(&token.text));
    if !is_one {
        return Err(EmptyError);
    }
    advance(input, 1);
    Ok(token.text.clone())
}

/// Parses "a picture", "the screenshot", "this view", and the words after it.
fn picture(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    alt((exactly("this | that").void(), article)).parse_next(input)?;
    skip("new | current").parse_next(input)?;
    exactly("picture | image | screenshot | snapshot | photo | view | render | rendering").parse_next(input)?;
    skip("of this | of it | of the scene | of the view | of the window | of what i see").parse_next(input)?;
    picture_words(verb, input)
}

/// Words about a picture to save.
enum PictureWord {
    File(String),
    Scale(f64),
    Transparent,
}

/// Parses "as front.png", "at twice the size", "with a transparent background".
fn picture_words(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let word = alt((
        file_name.verify(|name: &String| is_picture(name)).map(PictureWord::File),
        size.map(PictureWord::Scale),
        backdrop.map(|()| PictureWord::Transparent),
    ));
    let words: Vec<PictureWord> = repeat(0..=MAX_PICTURE_WORDS, word).parse_next(input)?;
    end(input)?;
    Ok(words.into_iter().fold(Reading::plain(verb.act), |reading, word| {
        reading.map(|clause| match &word {
            PictureWord::File(name) => clause.file.clone_from(name),
            PictureWord::Scale(scale) => clause.amount = Some(*scale),
            PictureWord::Transparent => clause.transparent = true,
        })
    }))
}

/// Parses "at twice the size", "4 times as large", "at 2x": a factor.
fn size(input: &mut Input<'_>) -> Outcome<f64> {
    skip("and | at | in | with").parse_next(input)?;
    let factor = alt((
        exactly("double | doubled").value(2.0),
        exactly("quadruple").value(4.0),
        times,
        (plain_number, mark('\u{d7}')).map(|(n, _)| n),
    ))
    .parse_next(input)?;
    skip("the size | the resolution | its size | size | resolution | as large | as big | larger | bigger | the normal size")
        .parse_next(input)?;
    Ok(factor)
}

/// Parses "with a transparent background", "without background".
fn backdrop(input: &mut Input<'_>) -> Outcome<()> {
    skip("and").parse_next(input)?;
    one_of(
        "with a transparent background | with transparent background | on a transparent background | transparent | \
         with transparency | without background | without a background | without the background | with no background",
    )
    .void()
    .parse_next(input)
}

fn has_ending(name: &str, ending: &str) -> bool {
    name.to_lowercase().ends_with(ending)
}

fn is_picture(name: &str) -> bool {
    PICTURES.iter().any(|ending| has_ending(name, ending))
}

/// Parses "a copy as monday.sgproj", "the project", "as monday.sgproj".
fn copy(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let what = opt((
        article,
        one_of(
            "copy | backup | copy of the project | backup of the project | copy of my work | copy of everything | \
             project | whole project | work | session",
        ),
    ))
    .parse_next(input)?;
    let name = opt(file_name).parse_next(input)?;
    end(input)?;
    let is_project = name.as_deref().is_none_or(|name| has_ending(name, PROJECT));
    // "back up" alone says enough, "save" does not.
    let is_said = what.is_some() || name.is_some() || matches!(verb.phrase, "back up" | "backup");
    if !is_project || !is_said {
        return Err(EmptyError);
    }
    Ok(Reading::plain(verb.act).map(|c| c.file = name.clone().unwrap_or_default()))
}

/// Parses "the sac", "the selection as sac.ply", "what is visible", "as all.ply". Other verbs than "export" need the file.
fn export(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let whole = |name: Option<String>| match name {
        Some(name) if has_ending(&name, PROJECT) || is_picture(&name) => Err(EmptyError),
        None if verb.phrase != "export" => Err(EmptyError),
        name => Ok(name.unwrap_or_default()),
    };
    let mut visible = *input;
    let seen: Outcome<usize> = one_of(VISIBLE).parse_next(&mut visible);
    if seen.is_ok() {
        skip("splats | gaussians").parse_next(&mut visible)?;
        let name = whole(opt(file_name).parse_next(&mut visible)?)?;
        end(&mut visible)?;
        *input = visible;
        return Ok(Reading::plain(verb.act).map(|c| c.file.clone_from(&name)));
    }
    let mut alone = *input;
    let name = opt(file_name).parse_next(&mut alone)?;
    if end(&mut alone).is_ok() {
        let name = whole(name)?;
        // As Ctrl+E does: the selection, and what is visible without one.
        let reference = Reference { selection: input.state.has_selection, ..Reference::default() };
        *input = alone;
        return Ok(Reading::of(verb.act, Target { reference, unknown: 0 }).map(|c| c.file.clone_from(&name)));
    }
    let (target, name) = target_then(input, |rest, _| {
        skip("splats | gaussians").parse_next(rest)?;
        let name = whole(opt(file_name).parse_next(rest)?)?;
        end(rest)?;
        Ok(name)
    })?;
    Ok(Reading::of(verb.act, target).map(|c| c.file.clone_from(&name)))
}

/// Parses "the file heart.nrrd".
fn open(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    skip("file | volume | scene | project | scan").parse_next(input)?;
    let name = file(input)?;
    skip("in a new window | in a window of its own | beside this").parse_next(input)?;
    end(input)?;
    Ok(Reading::plain(verb.act).map(|c| c.file.clone_from(&name)))
}

/// The file of a clause, with an ending of its kind: the usual one for a name without any.
fn checked_file(clause: &Clause, ending: &str) -> Result<String, Refusal> {
    let file = clause.file.trim();
    let name = file.rsplit('/').next().unwrap_or_default();
    if file.is_empty() || has_ending(name, ending) {
        return Ok(file.to_owned());
    }
    if !name.contains('.') && !name.is_empty() {
        return Ok(format!("{file}{ending}"));
    }
    Err(Refusal::invalid(format!("End the name with {ending}.")))
}

fn resolve_picture(clause: &Clause, _: &Context<'_>) -> Result<Step, Refusal> {
    let scale = clause.amount.unwrap_or(1.0);
    if !(1.0..=MAX_SCALE).contains(&scale) || scale.fract() != 0.0 {
        return Err(Refusal::invalid("A picture has 1, 2, 3 or 4 times its size in the window."));
    }
    let file = checked_file(clause, PICTURE)?;
    Ok(Step::Picture(PictureWish { file, scale: scale as u32, transparent: clause.transparent }))
}

fn resolve_copy(clause: &Clause, _: &Context<'_>) -> Result<Step, Refusal> {
    let path = checked_file(clause, PROJECT)?;
    let request = SaveRequest { path, replace: false, content: Some(Content::Project(ProjectCopy {})) };
    Ok(Step::Save { request, units: Vec::new() })
}

fn resolve_export(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let state = context.state;
    let one = || {
        Refusal::precondition(
            "One file holds one structure, the selection, or what is visible. Hide the rest, and say “export what is visible”.",
        )
    };
    let (part, unit) = match &clause.target {
        None => (GaussianPart::Visible, String::new()),
        Some(reference) if reference.everything && !reference.complement => (GaussianPart::Everything, String::new()),
        Some(reference) => {
            let target = target(reference, state)?;
            match (target.complement, target.units.as_slice(), target.selection) {
                (false, [], true) => (GaussianPart::Selection, String::new()),
                (false, [name], false) => (GaussianPart::Unit, name.clone()),
                _ => return Err(one()),
            }
        }
    };
    if part == GaussianPart::Selection && selected_count(state) == 0 {
        return Err(one());
    }
    let units = Some(unit.clone()).filter(|name| !name.is_empty()).into_iter().collect();
    let content = Content::Gaussians(GaussianChoice { part: part.into(), unit });
    let file = clause.file.trim().to_owned();
    // Without an ending the name would choose no format.
    let path = if file.is_empty() || has_known_ending(&file) { file } else { format!("{file}.ply") };
    Ok(Step::Save { request: SaveRequest { path, replace: false, content: Some(content) }, units })
}

fn resolve_open(clause: &Clause, _: &Context<'_>) -> Result<Step, Refusal> {
    let path = clause.file.trim().to_owned();
    if path.is_empty() {
        return Err(missing("file"));
    }
    Ok(Step::Open(OpenRequest { path, spacing: Vec::new() }))
}
