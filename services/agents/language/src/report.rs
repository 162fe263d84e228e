//! Sentences about executed commands.

use std::path::Path;

use sg_input::{printable, short_path};
use sg_proto::language::Clause;
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{OpenReply, OpenRequest, SaveReply};
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    CommandResult, LightMode, NamedView, SetLight, SetOpacity, SetOperation, State, Target, set_view,
};
use sg_proto::selection::StrokesReply;

use crate::color;
use crate::commands::{movement, tone, transfer_function};
use crate::query;
use crate::text::{capital, factor, grouped, is_plural, join, percent, target, the};

/// Share of a target from which on nothing hides it.
const UNHIDDEN: f64 = 0.995;

/// Stops of a tour that are named at its beginning.
const NAMED_STOPS: usize = 6;

fn subject(of: Option<&Target>) -> (String, &'static str) {
    let nothing = Target::default();
    let (name, plural) = target(of.unwrap_or(&nothing));
    (capital(&name), if plural { "are" } else { "is" })
}

/// One sentence about an executed command. `before` is the scene before the command.
///
/// Undo, redo and kept viewpoints use the summary of the scene.
#[must_use]
pub fn action(clause: &Clause, action: &Action, before: &State, result: &CommandResult) -> String {
    match action {
        Action::SetColor(set) => {
            let (what, verb) = subject(set.target.as_ref());
            match &set.color {
                None => format!("{what} {verb} now in the original colours."),
                Some(color) => {
                    let spoken = clause.color_name.trim().to_lowercase();
                    let name = if spoken.is_empty() { color::name_of(color).to_owned() } else { spoken };
                    format!("{what} {verb} now {name}.")
                }
            }
        }
        Action::SetOpacity(set) => opacity(set, before),
        Action::SetVisibility(set) => {
            let (what, verb) = subject(set.target.as_ref());
            format!("{what} {verb} now {}.", if set.visible { "shown" } else { "hidden" })
        }
        Action::ShowOnly(set) => {
            let (what, verb) = subject(set.target.as_ref());
            format!("Only {} {verb} shown now.", lower(&what))
        }
        Action::SetLight(set) => light(set),
        Action::SetBackground(set) => {
            let spoken = clause.color_name.trim().to_lowercase();
            let name = if spoken.is_empty() {
                set.color.as_ref().map_or("changed", color::name_of).to_owned()
            } else {
                spoken
            };
            format!("The background is now {name}.")
        }
        Action::SetTerm(set) => format!("The picture now shows the {}.", query::term_name(set.term())),
        Action::SetView(set) => set.change.as_ref().map_or_else(String::new, |change| view(change, &result.summary)),
        Action::KeepView(_) | Action::ForgetView(_) => sentence(&result.summary),
        Action::Select(select) => match &select.target {
            None => "Nothing is selected now.".to_owned(),
            Some(of) if of.selection && of.complement => "The selection is inverted.".to_owned(),
            Some(of) => {
                let (what, plural) = target(of);
                let (what, verb) = (capital(&what), if plural { "are" } else { "is" });
                match select.operation() {
                    SetOperation::Add => format!("{what} {verb} added to the selection."),
                    SetOperation::Remove => format!("{what} {verb} removed from the selection."),
                    SetOperation::Intersect => {
                        format!("The selection is now limited to {}.", lower(&what))
                    }
                    SetOperation::Replace | SetOperation::Unspecified => format!("{what} {verb} selected."),
                }
            }
        },
        Action::SaveUnit(save) => {
            let count = before.selection.as_ref().map_or(0, |s| s.count);
            let verb = if save.replace { "Updated" } else { "Saved" };
            format!("{verb} “{}” with {} Gaussians.", save.name, grouped(count))
        }
        Action::DeleteGaussians(delete) => {
            let (what, verb) = subject(delete.target.as_ref());
            format!("{what} {verb} deleted. “undo” brings it back.")
        }
        Action::SetLock(set) => {
            let (what, verb) = subject(set.target.as_ref());
            format!("{what} {verb} {} now.", if set.locked { "locked" } else { "unlocked" })
        }
        Action::RestoreGaussians(_) => "Everything deleted is back.".to_owned(),
        Action::DeleteUnit(delete) => {
            format!("Removed the name “{}”. Its Gaussians stay; “undo” restores the name.", delete.name)
        }
        Action::RenameUnit(rename) => format!("“{}” is now named “{}”.", rename.name, rename.new_name),
        Action::Reset(_) => "The appearance is reset. Units and selection are unchanged.".to_owned(),
        Action::TransformGaussians(set) => {
            movement::report(clause, set.target.as_ref()).unwrap_or_else(|| sentence(&result.summary))
        }
        Action::DuplicateGaussians(_) => {
            format!("{} The copy lies in the place of the original and is selected.", sentence(&result.summary))
        }
        Action::MergeUnits(_) => format!("{} Ctrl+Z takes it back.", sentence(&result.summary)),
        Action::SetTone(set) => tone::report(set, before),
        Action::SetTransferFunction(_) => sentence(&result.summary),
        Action::AdjustTransferFunction(adjust) => transfer_function::report(clause, adjust, &result.summary),
        Action::Undo(_) | Action::Redo(_) | Action::CommitSelection(_) => sentence(&result.summary),
    }
}

/// The reason why there is no best view.
pub const NO_BEST_VIEW: &str = "The best view needs the labeling service, and this session has none.";

/// One sentence about the view that shows most of a target, of which `unhidden` is the share that nothing hides.
#[must_use]
pub fn best_view(of: &Target, unhidden: f64) -> String {
    let (what, plural) = target(of);
    if of.everything {
        return "This view shows most of the scene.".to_owned();
    }
    let it = if plural { "them" } else { "it" };
    if unhidden >= UNHIDDEN {
        format!("This view shows most of {what}, and nothing hides {it}.")
    } else {
        format!("This view shows most of {what}; {} of {it} is not hidden by anything.", percent(unhidden))
    }
}

/// One sentence about a tour that begins; none for a change of one.
#[must_use]
pub fn tour_begins(stops: &[String]) -> String {
    let names: Vec<String> = stops.iter().take(NAMED_STOPS).map(|stop| the(stop)).collect();
    let more = stops.len() - names.len();
    let first = match (stops.len(), more) {
        (0, _) => return String::new(),
        (1, _) => format!("A tour with one stop: {}.", join(&names)),
        (count, 0) => format!("A tour of {count} stops: {}.", join(&names)),
        (count, more) => format!("A tour of {count} stops: {} and {more} more.", names.join(", ")),
    };
    format!("{first} Say “next”, “pause” or “stop the tour”.")
}

/// One sentence about a saved file.
#[must_use]
pub fn saved(content: Option<&Content>, reply: &SaveReply) -> String {
    let path = short_path(Path::new(&reply.path));
    match content {
        Some(Content::Gaussians(_)) if reply.gaussians == 1 => format!("Saved 1 splat to {path}."),
        Some(Content::Gaussians(_)) => format!("Saved {} splats to {path}.", grouped(reply.gaussians)),
        Some(Content::Project(_)) => format!("Saved a copy of the project to {path}."),
        Some(Content::Picture(_)) => format!("Saved the picture to {path}."),
        None => format!("Saved {path}."),
    }
}

/// One sentence about a file that opens.
#[must_use]
pub fn opens(request: &OpenRequest, reply: &OpenReply) -> String {
    let name = Path::new(&request.path).file_name().unwrap_or_default().to_string_lossy().into_owned();
    let first = if reply.volume { ", as soon as Gaussians are made of it" } else { "" };
    format!("{} opens in a window of its own{first}.", printable(&name))
}

/// One sentence about another answer to the strokes.
#[must_use]
pub fn other_answer(reply: &StrokesReply) -> String {
    let selected = sentence(&reply.summary);
    let Some(answers) = reply.answers.as_ref().filter(|answers| !answers.steps.is_empty()) else { return selected };
    let (taken, count) = (answers.taken as usize, answers.steps.len());
    let place = match (taken, count) {
        (_, 1) => "there is no other answer to the strokes".to_owned(),
        (0, count) => format!("this is the narrowest of {count} answers"),
        (taken, count) if taken + 1 == count => format!("this is the widest of {count} answers"),
        (taken, count) => format!("this is answer {} of {count}, from the narrowest", taken + 1),
    };
    format!("{}; {place}.", selected.strip_suffix('.').unwrap_or(&selected))
}

/// A summary of the scene as a sentence.
#[must_use]
pub fn sentence(summary: &str) -> String {
    let summary = capital(summary.trim());
    if summary.is_empty() {
        "Done.".to_owned()
    } else if summary.ends_with(['.', '!', '?', '”']) {
        summary
    } else {
        summary + "."
    }
}

pub(crate) fn lower(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_lowercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}

/// Current opacity of a unit.
fn opacity_of(name: &str, state: &State) -> Option<f32> {
    let base = state.base_units.iter().find(|u| u.name == name).map(|u| u.opacity);
    base.or_else(|| state.units.iter().find(|u| u.name == name).map(|u| u.opacity))
}

fn opacity(set: &SetOpacity, before: &State) -> String {
    let nothing = Target::default();
    let of = set.target.as_ref().unwrap_or(&nothing);
    let (what, verb) = subject(Some(of));
    if !set.relative {
        return format!("{what} {verb} now at {} opacity.", percent(set.factor.into()));
    }
    // The new opacity is known only for a single unit.
    if let ([name], false, false) = (of.units.as_slice(), of.complement, of.selection)
        && let Some(old) = opacity_of(name, before)
    {
        let verb = if is_plural(name) { "are" } else { "is" };
        return format!(
            "{} {verb} now at {} opacity.",
            capital(&the(name)),
            percent(f64::from(old) * f64::from(set.factor))
        );
    }
    format!("{what} {verb} now {} times as opaque.", factor(set.factor.into()))
}

fn light(set: &SetLight) -> String {
    let mut parts = Vec::new();
    match set.mode() {
        LightMode::Headlight => parts.push("the light comes from the eye".to_owned()),
        LightMode::Direction => {
            let d = set.direction.unwrap_or_default();
            parts.push(format!("the light comes from direction ({}, {}, {})", factor(d.x), factor(d.y), factor(d.z)));
        }
        LightMode::Unspecified => {}
    }
    let numbers = [
        ("ambient light", set.ambient),
        ("diffuse light", set.diffuse),
        ("specular light", set.specular),
        ("shininess", set.shininess),
    ];
    for (name, value) in numbers {
        if let Some(value) = value {
            let value = factor(value.into());
            parts.push(if set.relative {
                format!("{name} is {value} times what it was")
            } else {
                format!("{name} is at {value}")
            });
        }
    }
    if parts.is_empty() { "The light is as it was.".to_owned() } else { format!("{}.", capital(&join(&parts))) }
}

fn view(change: &set_view::Change, summary: &str) -> String {
    match change {
        set_view::Change::View(_) => "The view has changed.".to_owned(),
        set_view::Change::Named(name) => match NamedView::try_from(*name).unwrap_or_default() {
            NamedView::Front => "This is the view from the front.",
            NamedView::Back => "This is the view from the back.",
            NamedView::Left => "This is the view from the left.",
            NamedView::Right => "This is the view from the right.",
            NamedView::Top => "This is the view from the top.",
            NamedView::Bottom => "This is the view from below.",
            NamedView::Initial => "This is the initial view.",
            NamedView::Unspecified => "The view has changed.",
        }
        .to_owned(),
        set_view::Change::Orbit(orbit) => {
            let mut parts = Vec::new();
            for (degrees, positive, negative) in [
                (orbit.azimuth_degrees, "to the right", "to the left"),
                (orbit.elevation_degrees, "upwards", "downwards"),
            ] {
                if degrees != 0.0 {
                    let way = if degrees > 0.0 { positive } else { negative };
                    parts.push(format!("{}° {way}", factor(degrees.abs())));
                }
            }
            format!("The camera moved {}.", join(&parts))
        }
        set_view::Change::Zoom(by) if *by < 1.0 => format!("Zoomed out by a factor of {}.", factor(1.0 / by)),
        set_view::Change::Zoom(by) => format!("Zoomed in by a factor of {}.", factor(*by)),
        set_view::Change::Kept(_) => sentence(summary),
        set_view::Change::Up(_) => "Another side of the scene is up.".to_owned(),
        set_view::Change::Focus(of) => {
            let (what, _) = target(of);
            format!("The view frames {what}.")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::scene::{Color, ForgetView, KeepView, Select, SetColor, SetView, Unit};

    fn units(names: &[&str]) -> Option<Target> {
        Some(Target { units: names.iter().map(|n| (*n).to_owned()).collect(), ..Target::default() })
    }

    fn report(action: &Action) -> String {
        let before =
            State { units: vec![Unit { name: "sac".into(), opacity: 0.5, ..Unit::default() }], ..State::default() };
        let result = CommandResult { summary: "undid: made the sac red".into(), ..CommandResult::default() };
        super::action(&Clause::default(), action, &before, &result)
    }

    #[test]
    fn files_are_told_with_their_place() {
        let reply = |gaussians| SaveReply { gaussians, path: "/data/sac.ply".into() };
        let splats = Content::Gaussians(sg_proto::launch::GaussianChoice::default());
        assert_eq!(saved(Some(&splats), &reply(12_345)), "Saved 12,345 splats to /data/sac.ply.");
        assert_eq!(saved(Some(&splats), &reply(1)), "Saved 1 splat to /data/sac.ply.");
        let request = OpenRequest { path: "~/scans/head.nrrd".into(), ..OpenRequest::default() };
        let volume = OpenReply { volume: true, ..OpenReply::default() };
        let said = "head.nrrd opens in a window of its own, as soon as Gaussians are made of it.";
        assert_eq!(opens(&request, &volume), said);
    }

    #[test]
    fn kept_viewpoints_are_told_by_the_scene() {
        let told = |action: Action, summary: &str| {
            let result = CommandResult { summary: summary.to_owned(), ..CommandResult::default() };
            super::action(&Clause::default(), &action, &State::default(), &result)
        };
        let keep = Action::KeepView(KeepView::default());
        assert_eq!(told(keep, "kept the view as view 1"), "Kept the view as view 1.");
        let forget = Action::ForgetView(ForgetView { name: "entry".to_owned() });
        assert_eq!(told(forget, "forgot the view entry"), "Forgot the view entry.");
        let go = Action::SetView(SetView { change: Some(set_view::Change::Kept("entry".to_owned())) });
        assert_eq!(told(go, "went to the view entry"), "Went to the view entry.");
    }

    #[test]
    fn reports_are_sentences() {
        let red = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
        let cases = [
            (Action::SetColor(SetColor { target: units(&["sac"]), color: red }), "The sac is now red."),
            (Action::SetColor(SetColor { target: units(&["leaves"]), color: red }), "The leaves are now red."),
            (
                Action::SetColor(SetColor { target: units(&["sac", "pot"]), color: red }),
                "The sac and the pot are now red.",
            ),
            (
                Action::SetOpacity(SetOpacity {
                    target: Some(Target { units: vec!["sac".into()], complement: true, ..Target::default() }),
                    factor: 0.2,
                    relative: false,
                }),
                "Everything but the sac is now at 20 % opacity.",
            ),
            (
                Action::SetOpacity(SetOpacity { target: units(&["sac"]), factor: 0.5, relative: true }),
                "The sac is now at 25 % opacity.",
            ),
            (Action::SetView(SetView { change: Some(set_view::Change::Zoom(1.5)) }), "Zoomed in by a factor of 1.5."),
            (Action::Select(Select { target: None, operation: 1 }), "Nothing is selected now."),
            (Action::Undo(sg_proto::scene::Undo { steps: 1 }), "Undid: made the sac red."),
        ];
        for (action, text) in cases {
            assert_eq!(report(&action), text);
        }
    }
}
