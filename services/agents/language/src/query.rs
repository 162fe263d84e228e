//! Answers to questions about the scene and its picture.

use sg_input::number_format::significant;
use sg_proto::render::Frame;
use sg_proto::scene::{Color, LightMode, Mask, Measure, ShadingTerm, State, Target};

use crate::color;
use crate::text::{capital, factor, grouped, join, percent, the};
use crate::unit_names;

/// Largest number of units in a list.
const MAX_LINES: usize = 40;

/// Least ratio of the enclosed to the filled volume of a closed surface. Below, the grid's cells make the difference.
const ENCLOSING: f64 = 1.2;

/// What is said where no viewpoint is kept.
pub(crate) const NOTHING_KEPT: &str = "Nothing is kept yet. Say “keep this view as …”.";

/// Largest number of units in the answer about the selection.
const MAX_PARTS: usize = 8;

/// Appearance of a unit of any kind.
pub(crate) struct UnitSummary<'s> {
    pub(crate) name: &'s str,
    count: u64,
    /// Its colour; none for the original colours.
    pub(crate) color: Option<&'s Color>,
    pub(crate) opacity: f32,
    pub(crate) visible: bool,
    pub(crate) locked: bool,
    kind: &'static str,
}

/// Number of Gaussians that are not deleted.
fn existing(state: &State) -> u64 {
    let deleted = state.base_units.iter().map(|u| u.deleted).sum();
    state.count.saturating_sub(deleted)
}

/// All units of a scene, in its order.
pub(crate) fn summaries(state: &State) -> Vec<UnitSummary<'_>> {
    let base = state.base_units.iter().map(|u| UnitSummary {
        name: &u.name,
        count: u.count.saturating_sub(u.deleted),
        // The palette of a trained scene is black: its Gaussians have colours of their own.
        color: u.palette.as_ref().filter(|p| [p.red, p.green, p.blue] != [0.0; 3]),
        opacity: u.opacity,
        visible: u.visible,
        locked: u.locked,
        kind: "from the scene file",
    });
    let saved = state.units.iter().map(|u| UnitSummary {
        name: &u.name,
        count: u.count,
        color: u.color.as_ref(),
        opacity: u.opacity,
        visible: u.visible,
        locked: u.locked,
        kind: if u.derived { "made by a command" } else { "saved" },
    });
    base.chain(saved).collect()
}

/// Share of the picture that a unit covers, if it is known.
pub(crate) fn coverage(name: &str, frame: Option<&Frame>) -> Option<f64> {
    frame?.units.iter().find(|u| u.unit == name).map(|u| u.share)
}

fn line(unit: &UnitSummary<'_>, state: &State, frame: Option<&Frame>) -> String {
    let share = unit.count as f64 / existing(state).max(1) as f64;
    let color = unit.color.map_or("original colours", color::name_of);
    let covered = match coverage(unit.name, frame) {
        Some(share) if unit.visible => format!("; covers {} of the picture", percent(share)),
        _ => String::new(),
    };
    format!(
        "{}: {} Gaussians ({} of the scene), {color}, opacity {}, {}{}{covered} ({})",
        unit.name,
        grouped(unit.count),
        percent(share),
        percent(unit.opacity.into()),
        if unit.visible { "visible" } else { "hidden" },
        if unit.locked { ", locked" } else { "" },
        unit.kind,
    )
}

/// One unit: size, share of the scene, colour, opacity, visibility, coverage. `None`: no such unit.
#[must_use]
pub fn unit(name: &str, state: &State, frame: Option<&Frame>) -> Option<String> {
    summaries(state).iter().find(|l| l.name == name).map(|l| capital(&line(l, state, frame)))
}

/// All units, one per line.
#[must_use]
pub fn list(state: &State, frame: Option<&Frame>) -> String {
    let summaries = summaries(state);
    if summaries.is_empty() {
        return "The scene has no units.".to_owned();
    }
    let saved = state.units.iter().filter(|u| !u.derived).count();
    let mut lines = vec![format!(
        "{} of the scene file and {saved} saved:",
        match state.base_units.len() {
            1 => "1 unit".to_owned(),
            n => format!("{n} units"),
        }
    )];
    lines.extend(summaries.iter().take(MAX_LINES).map(|l| format!("  {}", line(l, state, frame))));
    if summaries.len() > MAX_LINES {
        lines.push(format!("  and {} more", summaries.len() - MAX_LINES));
    }
    lines.join("\n")
}

/// All kept viewpoints, oldest first.
#[must_use]
pub fn kept_views(state: &State) -> String {
    let names: Vec<String> = unit_names::kept_views(state).iter().map(|name| format!("“{name}”")).collect();
    match names.len() {
        0 => NOTHING_KEPT.to_owned(),
        1 => format!("1 viewpoint is kept: {}.", join(&names)),
        count => format!("{count} viewpoints are kept: {}.", join(&names)),
    }
}

/// The selection: number of Gaussians, share of the scene and, with masks, shares of units.
#[must_use]
pub fn selection(state: &State) -> String {
    let count = state.selection.as_ref().map_or(0, |s| s.count);
    if count == 0 {
        return "Nothing is selected.".to_owned();
    }
    let share = count as f64 / existing(state).max(1) as f64;
    let gaussians = if count == 1 { "1 Gaussian is".to_owned() } else { format!("{} Gaussians are", grouped(count)) };
    let parts = selected_parts(state);
    let of = if parts.is_empty() { String::new() } else { format!(": {}", join(&parts)) };
    format!("{gaussians} selected, {} of the scene{of}.", percent(share))
}

/// Selected share of each unit, the largest first.
fn selected_parts(state: &State) -> Vec<String> {
    let Some(selected) = state.selection.as_ref().and_then(|s| s.mask.as_ref()) else { return Vec::new() };
    let mut parts: Vec<(f64, &str)> = Vec::new();
    for base in &state.base_units {
        let last = base.first.saturating_add(base.count).min(selected.length);
        let inside = (base.first..last).filter(|i| bit(selected, *i)).count();
        parts.push((inside as f64 / base.count.saturating_sub(base.deleted).max(1) as f64, &base.name));
    }
    for unit in state.units.iter().filter(|u| !u.derived) {
        let Some(mask) = &unit.mask else { continue };
        let inside: u32 = mask.bits.iter().zip(&selected.bits).map(|(a, b)| (a & b).count_ones()).sum();
        parts.push((f64::from(inside) / unit.count.max(1) as f64, &unit.name));
    }
    parts.retain(|(share, _)| *share > 0.0);
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    let describe = |(share, name): &(f64, &str)| match *share {
        s if s >= 1.0 => format!("all of {}", the(name)),
        s => format!("{} of {}", percent(s), the(name)),
    };
    let mut descriptions: Vec<String> = parts.iter().take(MAX_PARTS).map(describe).collect();
    if parts.len() > MAX_PARTS {
        descriptions.push(format!("parts of {} more", parts.len() - MAX_PARTS));
    }
    descriptions
}

/// The size of a target in words, where the scene has a length unit: edges along x, y and z, and volume.
#[must_use]
pub fn size(target: &Target, measure: &Measure) -> Option<String> {
    let mm = measure.millimetres;
    let edges = measure.edges.as_ref().filter(|_| mm > 0.0 && measure.occupied > 0.0)?;
    let edges = [edges.x, edges.y, edges.z].map(|edge| mm * edge);
    let longest = edges.into_iter().fold(0.0, f64::max);
    let (unit, factor) = match longest {
        x if x >= 10_000.0 => ("m", 1e-3),
        x if x < 0.1 => ("µm", 1e3),
        _ => ("mm", 1.0),
    };
    let [x, y, z] = edges.map(|edge| measured(factor * edge));
    let ml = measure.enclosed * mm.powi(3) / 1000.0;
    let volume = match ml {
        v if v >= 10_000.0 => format!("{} L", measured(1e-3 * v)),
        v if v >= 0.1 => format!("{} mL", measured(v)),
        v => format!("{} mm³", measured(1e3 * v)),
    };
    let (name, plural) = crate::text::target(target);
    // A fit puts Gaussians on surfaces, and people ask for the volume within.
    let verb = if measure.enclosed > ENCLOSING * measure.occupied { "enclose" } else { "fill" };
    let s = if plural { "" } else { "s" };
    Some(format!("{} measure{s} about {x} × {y} × {z} {unit} and {verb}{s} about {volume}.", capital(&name)))
}

/// The look of a target in words: "The sac looks red, the smallest, round, on the right." `None` without words.
#[must_use]
pub fn look(target: &Target, words: &[String]) -> Option<String> {
    if words.is_empty() {
        return None;
    }
    let (name, plural) = crate::text::target(target);
    let verb = if plural { "look" } else { "looks" };
    Some(format!("{} {verb} {}.", capital(&name), words.join(", ")))
}

/// The answer to a question about size where the scene has no length unit: edges in the lengths of the file, where they are
/// known. `None` for other questions.
#[must_use]
pub fn without_unit(words: &str, target: &Target, measure: &Measure) -> Option<String> {
    const SIZES: [&str; 8] = ["big", "large", "small", "size", "volume", "long", "wide", "high"];
    let asks = words.split(|c: char| !c.is_alphabetic()).any(|word| SIZES.contains(&word.to_lowercase().as_str()));
    if !asks || measure.millimetres > 0.0 {
        return None;
    }
    let Some(edges) = measure.edges.as_ref().filter(|_| measure.occupied > 0.0) else {
        return Some("The file gives no unit of length, so its size in millimetres is not known.".to_owned());
    };
    let edges = [edges.x, edges.y, edges.z];
    let longest = edges.into_iter().fold(0.0, f64::max);
    // Lengths of a file may be of any size: two digits of the longest edge.
    let small = |edge: f64| sg_input::number_format::decimals(edge, (1.0 - longest.log10().floor()) as usize);
    let [x, y, z] = edges.map(|edge| if longest < 0.1 { small(edge) } else { measured(edge) });
    let (name, plural) = crate::text::target(target);
    let s = if plural { "" } else { "s" };
    let size = format!("{} measure{s} about {x} × {y} × {z} in the lengths of the file.", capital(&name));
    Some(format!("{size} It gives no unit, so millimetres are not known."))
}

/// A measured number: whole from 10 on, else with one or two decimals.
fn measured(x: f64) -> String {
    let decimals = match x {
        x if x >= 9.95 => 0,
        x if x >= 0.995 => 1,
        _ => 2,
    };
    sg_input::number_format::decimals(x, decimals)
}

fn bit(mask: &Mask, index: u64) -> bool {
    let byte = usize::try_from(index / 8).ok().and_then(|at| mask.bits.get(at));
    byte.is_some_and(|b| b >> (index % 8) & 1 == 1)
}

/// The whole scene: units, selection, light, background, shading.
#[must_use]
pub fn scene(state: &State, frame: Option<&Frame>) -> String {
    let deleted = match state.count - existing(state) {
        0 => String::new(),
        1 => " 1 more is deleted.".to_owned(),
        n => format!(" {} more are deleted.", grouped(n)),
    };
    let existing = grouped(existing(state));
    let mut parts = vec![format!("The scene has {existing} Gaussians.{deleted} {}", list(state, frame))];
    parts.push(selection(state));
    if let Some(volume) = &state.volume {
        let (least, greatest) = (significant(volume.least), significant(volume.greatest));
        parts.push(format!("Its volume has values from {least} to {greatest}."));
    }
    if let Some(light) = &state.light {
        let from = match light.mode() {
            LightMode::Direction => "from a fixed direction",
            LightMode::Headlight | LightMode::Unspecified => "from the eye",
        };
        parts.push(format!(
            "Light {from}: ambient × {}, diffuse × {}, specular × {}.",
            factor(light.ambient.into()),
            factor(light.diffuse.into()),
            factor(light.specular.into())
        ));
    }
    if let Some(background) = &state.background {
        parts.push(format!("The background is {}.", color::name_of(background)));
    }
    let term = term_name(state.term());
    if state.term() != ShadingTerm::Full && state.term() != ShadingTerm::Unspecified {
        parts.push(format!("The picture shows only the {term}."));
    }
    if let Some(frame) = frame {
        parts.push(format!("The scene covers {} of the picture.", percent(frame.coverage)));
    }
    parts.join("\n")
}

/// The name of a shading term.
pub(crate) fn term_name(term: ShadingTerm) -> &'static str {
    match term {
        ShadingTerm::Normal => "surface normals",
        ShadingTerm::Ambient => "ambient term",
        ShadingTerm::Diffuse => "diffuse term",
        ShadingTerm::Specular => "specular term",
        ShadingTerm::Full | ShadingTerm::Unspecified => "full shading",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::render::UnitCoverage;
    use sg_proto::scene::{BaseUnit, KeptView, Selection, Unit};

    fn scene_of_two() -> State {
        State {
            revision: 4,
            count: 1000,
            base_units: vec![BaseUnit {
                name: "vessel".into(),
                count: 1000,
                palette: Some(Color { red: 0.98, green: 0.0, blue: 0.02 }),
                opacity: 1.0,
                visible: true,
                ..BaseUnit::default()
            }],
            units: vec![Unit { name: "sac".into(), count: 25, opacity: 0.2, visible: false, ..Unit::default() }],
            selection: Some(Selection { count: 25, ..Selection::default() }),
            focus: vec!["sac".into()],
            ..State::default()
        }
    }

    #[test]
    fn a_unit_is_described_with_its_numbers() {
        let frame = Frame {
            revision: 4,
            units: vec![UnitCoverage { unit: "vessel".into(), share: 0.125, mean_color: None }],
            ..Frame::default()
        };
        let text = unit("vessel", &scene_of_two(), Some(&frame)).unwrap();
        for part in
            ["1,000 Gaussians", "100 % of the scene", "red", "opacity 100 %", "visible", "covers 13 % of the picture"]
        {
            assert!(text.contains(part), "{text} lacks {part}");
        }
        let mut trained = scene_of_two();
        trained.base_units[0].palette = Some(Color { red: 0.0, green: 0.0, blue: 0.0 });
        assert!(unit("vessel", &trained, None).unwrap().contains("original colours"));
        let hidden = unit("sac", &scene_of_two(), Some(&frame)).unwrap();
        assert!(hidden.contains("hidden") && hidden.contains("2.5 %") && !hidden.contains("covers"), "{hidden}");
        assert_eq!(unit("other", &scene_of_two(), None), None);
    }

    #[test]
    fn a_question_about_size_says_why_there_are_no_millimetres() {
        let heart = Target { units: vec!["heart".to_owned()], ..Target::default() };
        let unknown = Measure::default();
        assert!(without_unit("how big is the heart", &heart, &unknown).unwrap().contains("no unit of length"));
        assert_eq!(without_unit("describe the bigger vessel", &heart, &unknown), None);
        assert_eq!(without_unit("how big is it", &heart, &Measure { millimetres: 1.0, ..unknown }), None);
        let of = |x, y, z| Measure { edges: Some(sg_proto::scene::Vector { x, y, z }), occupied: 1.0, ..unknown };
        let small = without_unit("how big is it", &heart, &of(0.00123, 0.0004, 0.0)).unwrap();
        assert!(small.contains("0.0012 × 0.0004 × 0 in"), "{small}");
        assert_eq!(
            without_unit("how big is the heart", &heart, &of(123.4, 8.04, 0.5)).unwrap(),
            "The heart measures about 123 × 8 × 0.5 in the lengths of the file. It gives no unit, so millimetres are not known."
        );
    }

    #[test]
    fn a_size_is_told_in_millimetres_and_millilitres() {
        let edges = Some(sg_proto::scene::Vector { x: 0.123, y: 0.08, z: 0.0955 });
        let measure = |enclosed, millimetres| {
            // Of closed surfaces in metres, and of open ones.
            let occupied = if enclosed > 1e-6 { 0.3 * enclosed } else { enclosed };
            Measure { edges, occupied, enclosed, millimetres, ..Measure::default() }
        };
        let of = |name: &str| Target { units: vec![name.to_owned()], ..Target::default() };
        assert_eq!(
            size(&of("heart"), &measure(5.4e-4, 1000.0)).unwrap(),
            "The heart measures about 123 × 80 × 96 mm and encloses about 540 mL."
        );
        assert_eq!(
            size(&of("vessels"), &measure(1.2e-9, 1000.0)).unwrap(),
            "The vessels measure about 123 × 80 × 96 mm and fill about 1.2 mm³."
        );
        assert_eq!(size(&of("heart"), &measure(5.4e-4, 0.0)), None, "no unit, no size");
    }

    #[test]
    fn kept_viewpoints_are_listed_in_their_order() {
        let kept = |names: &[&str]| {
            let kept = |name: &&str| KeptView { name: (*name).to_owned(), ..KeptView::default() };
            kept_views(&State { kept_views: names.iter().map(kept).collect(), ..State::default() })
        };
        assert_eq!(kept(&[]), "Nothing is kept yet. Say “keep this view as …”.");
        assert_eq!(kept(&["entry"]), "1 viewpoint is kept: “entry”.");
        assert_eq!(kept(&["view 2", "entry", "home"]), "3 viewpoints are kept: “view 2”, “entry” and “home”.");
    }

    #[test]
    fn the_selection_is_described() {
        assert_eq!(selection(&scene_of_two()), "25 Gaussians are selected, 2.5 % of the scene.");
        assert_eq!(selection(&State::default()), "Nothing is selected.");
    }

    #[test]
    fn with_masks_the_selection_is_described_by_unit() {
        let mask = |bits: &[u8]| Some(Mask { length: 16, bits: bits.to_vec() });
        let base = |name: &str, first, count| BaseUnit { name: name.into(), first, count, ..BaseUnit::default() };
        let state = State {
            count: 16,
            base_units: vec![base("leaves", 0, 8), base("pot", 8, 8)],
            units: vec![
                Unit { name: "tip".into(), count: 2, mask: mask(&[0b11, 0]), ..Unit::default() },
                Unit { name: "saucer".into(), count: 1, mask: mask(&[0, 0b1000_0000]), ..Unit::default() },
            ],
            selection: Some(Selection { count: 5, mask: mask(&[0b1111, 0b1]), ..Selection::default() }),
            ..State::default()
        };
        assert_eq!(
            selection(&state),
            "5 Gaussians are selected, 31 % of the scene: all of the tip, 50 % of the leaves and 13 % of the pot."
        );
    }

    #[test]
    fn the_length_of_lists_is_limited() {
        let units = (0..500).map(|i| Unit { name: format!("u{i}"), ..Unit::default() }).collect();
        let text = list(&State { units, ..State::default() }, None);
        assert!(text.lines().count() <= MAX_LINES + 2 && text.contains("460 more"), "{text}");
    }
}
