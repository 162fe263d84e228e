//! Intents of the utterances in `grammar.toml`, and properties of any utterance.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

use proptest::prelude::*;
use serde::Deserialize;
use sg_language::commands;
use sg_language::grammar::{self, UtteranceError};
use sg_proto::language::movement::Kind;
use sg_proto::language::{Act, Clause, Observation, Reference};
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::{
    Axis, BaseUnit, Color, KeptView, LightMode, NamedView, Selection, SetLight, SetOperation, ShadingTerm, State, Unit,
    ValueColor, ValueRange, ValueScale, Vector, View, set_view,
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Corpus {
    scene: Vec<Scene>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Scene {
    name: String,
    units: Vec<String>,
    #[serde(default)]
    selected: bool,
    #[serde(default)]
    views: Vec<String>,
    case: Vec<Case>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Case {
    say: String,
    #[serde(default)]
    means: Vec<String>,
    #[serde(default)]
    misses: Vec<String>,
}

fn corpus() -> Corpus {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/grammar.toml");
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn observation(units: &[&str], selected: bool) -> Observation {
    let vector = |x, y, z| Some(Vector { x, y, z });
    let (base, saved) = units.split_at(units.len().min(2));
    let scene = State {
        count: 100,
        base_units: base.iter().map(|n| BaseUnit { name: (*n).to_owned(), ..BaseUnit::default() }).collect(),
        units: saved.iter().map(|n| Unit { name: (*n).to_owned(), ..Unit::default() }).collect(),
        selection: Some(Selection { count: u64::from(selected) * 7, ..Selection::default() }),
        view: Some(View {
            eye: vector(0.0, -5.0, 0.0),
            target: vector(0.0, 0.0, 0.0),
            up: vector(0.0, 0.0, 1.0),
            fov_y_degrees: 40.0,
        }),
        ..State::default()
    };
    Observation { moment: "before".into(), scene: Some(scene), ..Observation::default() }
}

impl Scene {
    fn observation(&self) -> Observation {
        let units: Vec<&str> = self.units.iter().map(String::as_str).collect();
        let mut observation = observation(&units, self.selected);
        let kept = |name: &String| KeptView { name: name.clone(), ..KeptView::default() };
        observation.scene.as_mut().unwrap().kept_views = self.views.iter().map(kept).collect();
        observation
    }
}

/// A number with at most three digits after the point.
fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn target(reference: Option<&Reference>) -> String {
    let Some(reference) = reference else { return String::new() };
    let mut parts = reference.names.clone();
    for (flag, word) in [(reference.selection, "SELECTION"), (reference.focus, "IT"), (reference.everything, "ALL")] {
        if flag {
            parts.push(word.to_owned());
        }
    }
    let named = parts.join(", ");
    match (reference.complement, named.is_empty()) {
        (false, _) => named,
        (true, true) => "ELSE".to_owned(),
        (true, false) => format!("ALL BUT {named}"),
    }
}

fn hex(color: &Color) -> String {
    let byte = |c: f32| (c * 255.0).round() as u8;
    format!("#{:02x}{:02x}{:02x}", byte(color.red), byte(color.green), byte(color.blue))
}

fn light(light: &SetLight) -> String {
    let mut text = String::from("light");
    match light.mode() {
        LightMode::Headlight => text += " headlight",
        LightMode::Direction => {
            let d = light.direction.unwrap();
            text += &format!(" from {} {} {}", number(d.x), number(d.y), number(d.z));
        }
        LightMode::Unspecified => {}
    }
    let sign = if light.relative { "x" } else { "=" };
    for (name, value) in [
        ("ambient", light.ambient),
        ("diffuse", light.diffuse),
        ("specular", light.specular),
        ("shininess", light.shininess),
    ] {
        if let Some(value) = value {
            text += &format!(" {name} {sign} {}", number(value.into()));
        }
    }
    text
}

fn view(clause: &Clause) -> String {
    let about = target(clause.target.as_ref());
    match clause.view.as_ref().unwrap().change.as_ref().unwrap() {
        set_view::Change::View(_) => "view exactly".to_owned(),
        set_view::Change::Named(name) => {
            let name =
                NamedView::try_from(*name).unwrap().as_str_name().trim_start_matches("NAMED_VIEW_").to_lowercase();
            format!("view {name}")
        }
        set_view::Change::Orbit(o) => format!("turn {} {}", number(o.azimuth_degrees), number(o.elevation_degrees)),
        set_view::Change::Zoom(factor) => format!("zoom {}", number(*factor)),
        set_view::Change::Focus(_) => format!("look at {about}"),
        set_view::Change::Up(axis) => format!("up {axis}"),
        set_view::Change::Kept(name) => format!("kept view {name}"),
    }
}

/// A change of the transfer function.
fn adjusted(clause: &Clause) -> String {
    let ends = |range: &ValueRange| {
        let end = |end: Option<f64>| end.map_or_else(String::new, number);
        format!("{}..{}", end(range.low), end(range.high))
    };
    match clause.values.as_ref().unwrap().change.as_ref().unwrap() {
        Change::Window(window) => {
            let mut text = format!("window {}", clause.name).trim_end().to_owned();
            for (name, value) in
                [("level =", window.level), ("window =", window.window), ("window x", window.window_factor)]
            {
                text += &value.map_or_else(String::new, |value| format!(" {name} {}", number(value)));
            }
            for (name, value) in [
                ("level +", window.level_change),
                ("level + share", window.level_shift),
                ("window +", window.window_change),
            ] {
                if value != 0.0 {
                    text += &format!(" {name} {}", number(value));
                }
            }
            text
        }
        Change::ShowOnly(range) => format!("values only {}", ends(range)),
        Change::Hide(range) => format!("values hide {}", ends(range)),
        Change::Color(ValueColor { range, color }) => {
            format!("values {} {}", ends(&range.unwrap()), hex(color.as_ref().unwrap()))
        }
        Change::Scale(scale) => {
            let name = ValueScale::try_from(*scale).unwrap().as_str_name();
            format!("values {}", name.trim_start_matches("VALUE_SCALE_").to_lowercase())
        }
    }
}

/// Verb and rest of a movement; `?` for a number that was not said.
fn moved(kind: &Kind) -> (&'static str, String) {
    let said = |value: Option<f64>| value.map_or("?".to_owned(), number);
    match kind {
        Kind::Shift(shift) => {
            let way = shift.way().as_str_name().trim_start_matches("WAY_").to_lowercase().replace('_', " ");
            let unit = if shift.millimetres { " mm" } else { "" };
            ("move", format!(" {way} {}{unit}", said(shift.distance)))
        }
        Kind::Rotation(rotation) => {
            let way = match rotation.axis() {
                Axis::Unspecified => rotation.way().as_str_name().trim_start_matches("WAY_").to_lowercase(),
                axis => axis.as_str_name().trim_start_matches("AXIS_PLUS_").to_lowercase(),
            };
            ("spin", format!(" {way} {}", said(rotation.degrees)))
        }
        Kind::Scale(scale) => ("scale", format!(" {}", said(scale.factor))),
        Kind::PutBack(_) => ("put back", String::new()),
    }
}

/// A clause in the notation of `grammar.toml`.
fn short(clause: &Clause) -> String {
    let about = target(clause.target.as_ref());
    let sign = if clause.relative { "x" } else { "=" };
    let amount = clause.amount.map(number).unwrap_or_default();
    match clause.act() {
        Act::Unspecified => "nothing".to_owned(),
        Act::SetColor => format!("color {about} = {}", clause.color.as_ref().map_or("own".to_owned(), hex)),
        Act::SetOpacity => format!("opacity {about} {sign} {amount}"),
        Act::Show => format!("show {about}"),
        Act::Hide => format!("hide {about}"),
        Act::ShowOnly => format!("only {about}"),
        Act::SetLight => light(clause.light.as_ref().unwrap()),
        Act::SetBackground => format!("background = {}", hex(clause.color.as_ref().unwrap())),
        Act::SetView => view(clause),
        Act::Select => {
            let sign = match clause.operation() {
                SetOperation::Add => "+",
                SetOperation::Remove => "-",
                SetOperation::Intersect => "&",
                SetOperation::Replace => "=",
                SetOperation::Unspecified => "?",
            };
            format!("select {sign} {about}")
        }
        Act::ClearSelection => "select nothing".to_owned(),
        Act::Label if clause.operation() == SetOperation::Replace => format!("update {}", clause.name),
        Act::Label => format!("label {}", clause.name),
        Act::Rename => format!("rename {about} -> {}", clause.name),
        Act::Delete => format!("unname {about}"),
        Act::Lock => format!("lock {about}"),
        Act::Unlock => format!("unlock {about}"),
        Act::DeleteGaussians => format!("delete {about}"),
        Act::Export => {
            format!("export {} -> {}", if clause.target.is_none() { "VISIBLE" } else { &about }, clause.file)
        }
        Act::SavePicture => {
            let transparent = if clause.transparent { " transparent" } else { "" };
            format!("picture {amount}{transparent} -> {}", clause.file)
        }
        Act::SaveCopy => format!("copy -> {}", clause.file),
        Act::Open => format!("open {}", clause.file),
        Act::Transform => {
            let kind = clause.movement.as_ref().unwrap().kind.as_ref().unwrap();
            format!("{} {about}{}", moved(kind).0, moved(kind).1)
        }
        Act::AdjustTransferFunction => adjusted(clause),
        Act::Merge => format!("merge {about} -> {}", clause.name),
        Act::BestView => format!("best view {about}").trim_end().to_owned(),
        Act::Tour => {
            let step = clause.tour().as_str_name().trim_start_matches("TOUR_STEP_").to_lowercase();
            format!("tour {step} {about}").trim_end().to_owned()
        }
        Act::KeepView => format!("keep view -> {}", clause.name),
        Act::ForgetView => format!("forget view {}", clause.name),
        Act::Duplicate => format!("duplicate {about} -> {}", clause.name),
        Act::SetTone => {
            let tone = clause.tone.as_ref().unwrap();
            let sign = if tone.relative { "x" } else { "=" };
            let terms =
                [("saturation", tone.saturation), ("brightness", tone.brightness), ("temperature", tone.temperature)];
            let terms =
                terms.into_iter().filter_map(|(name, value)| Some(format!(" {name} {sign} {}", number(value?.into()))));
            format!("tone {about}{}", terms.collect::<String>())
        }
        Act::Describe => format!("describe {about}"),
        Act::QuerySelection => "selection?".to_owned(),
        Act::Undo => format!("undo {amount}"),
        Act::Redo => format!("redo {amount}"),
        Act::TakeAnswer => {
            format!("answer {}", clause.answer().as_str_name().trim_start_matches("ANSWER_STEP_").to_lowercase())
        }
        Act::SetTerm => {
            let term: ShadingTerm = clause.term();
            format!("term {}", term.as_str_name().trim_start_matches("SHADING_TERM_").to_lowercase())
        }
        // An act without fields is its own name.
        act => act.as_str_name().trim_start_matches("ACT_").to_lowercase().replace('_', " "),
    }
}

#[test]
fn every_utterance_of_the_corpus_has_its_intent() {
    let corpus = corpus();
    let mut wrong = Vec::new();
    let mut utterances = 0;
    let mut refusals = 0;
    for scene in &corpus.scene {
        let observation = scene.observation();
        for case in &scene.case {
            utterances += 1;
            refusals += usize::from(case.means.is_empty());
            let intent = grammar::parse(&case.say, &observation).unwrap();
            let means: Vec<String> = intent.clauses.iter().map(short).collect();
            if means != case.means || intent.not_understood != case.misses {
                wrong.push(format!(
                    "{} · “{}”\n     means {means:?}\n  expected {:?}\n    misses {:?}\n  expected {:?}",
                    scene.name, case.say, case.means, intent.not_understood, case.misses
                ));
            }
            // Every suggestion is understood.
            if !intent.not_understood.is_empty() {
                assert!(!intent.suggestions.is_empty(), "“{}” is refused without a suggestion", case.say);
                for suggestion in &intent.suggestions {
                    let again = grammar::parse(suggestion, &observation).unwrap();
                    assert!(
                        again.not_understood.is_empty(),
                        "“{}” suggests “{suggestion}”, which is not understood",
                        case.say
                    );
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {utterances} are wrong:\n{}", wrong.len(), wrong.join("\n"));
    assert!(utterances >= 150 && refusals >= 25, "{utterances} utterances, {refusals} refusals");
}

/// "It" is the unit of the last command, so it turns; without one "it" is the picture.
#[test]
fn it_turns_after_a_command_on_a_unit() {
    let mut observation = observation(&["sac", "vessel"], false);
    let means = |observation: &Observation, said: &str| {
        grammar::parse(said, observation).unwrap().clauses.iter().map(short).collect::<Vec<_>>()
    };
    assert_eq!(means(&observation, "rotate it 90° to the right"), ["turn -90 0"]);
    observation.scene.as_mut().unwrap().focus = vec!["sac".to_owned()];
    assert_eq!(means(&observation, "rotate it 90° to the right"), ["spin IT right 90"]);
    assert_eq!(means(&observation, "turn it up"), ["turn 0 -30"], "without an angle it is the picture");
    assert_eq!(means(&observation, "enlarge it by 50 %"), ["scale IT 1.5"]);
    assert_eq!(means(&observation, "enlarge it"), ["zoom 1.5"]);
}

#[test]
fn politeness_and_capitals_do_not_change_the_intent() {
    for scene in &corpus().scene {
        let observation = scene.observation();
        for case in scene.case.iter().filter(|c| !c.means.is_empty() && c.misses.is_empty()) {
            for said in [
                format!("Please {}", case.say),
                format!("could you {}", case.say),
                format!("{}, please", case.say.trim_end_matches(['?', '.', '!'])),
            ] {
                let intent = grammar::parse(&said, &observation).unwrap();
                let means: Vec<String> = intent.clauses.iter().map(short).collect();
                assert_eq!((means, intent.not_understood), (case.means.clone(), Vec::new()), "“{said}”");
            }
        }
    }
}

#[test]
fn every_clause_quotes_the_utterance() {
    let said = "Make the Sac red,  and fade everything else to 20 percent; then zoom in.";
    let intent = grammar::parse(said, &observation(&["sac"], false)).unwrap();
    let words: Vec<&str> = intent.clauses.iter().map(|c| c.words.as_str()).collect();
    assert_eq!(words, ["Make the Sac red", "fade everything else to 20 percent", "zoom in"]);
}

#[test]
fn a_misspelt_verb_gets_a_suggestion() {
    let intent = grammar::parse("hdie the soil", &observation(&["soil", "pot"], false)).unwrap();
    assert!(intent.clauses.is_empty());
    assert_eq!(intent.suggestions.first().map(String::as_str), Some("hide the soil"));
}

#[test]
fn an_utterance_that_is_too_long_or_empty_is_refused() {
    let observation = observation(&["sac"], false);
    assert_eq!(grammar::parse(&"a".repeat(5000), &observation), Err(UtteranceError::TooLong(5000)));
    assert_eq!(grammar::parse(" \n\t ", &observation), Err(UtteranceError::Empty));
}

#[test]
fn the_longest_utterances_are_parsed_quickly() {
    let observation = observation(&["sac", "red vessel", "left renal artery"], true);
    for piece in [
        "make the red red ",
        "all but all but ",
        "hide the a, ",
        "and and , ",
        "set the colour of ",
        "the sac and ",
        "zoom in ",
        "one ",
    ] {
        let said: String = piece.repeat(4096 / piece.len());
        let start = std::time::Instant::now();
        assert!(grammar::parse(&said, &observation).is_ok());
        assert!(start.elapsed() < std::time::Duration::from_secs(5), "“{piece}…” took {:?}", start.elapsed());
    }
}

/// A list of names that no command takes was once read again from each of its names: 250 bytes took seconds.
#[test]
fn a_list_without_a_verb_is_read_a_bounded_number_of_times() {
    let observation = observation(&["sac", "vessel"], true);
    for text in ["sac and ", "sac, ", "the sac and the bag and it, "].map(|part| part.repeat(4096 / part.len())) {
        let intent = grammar::parse(&text, &observation).unwrap();
        assert!(!intent.not_understood.is_empty() && intent.clauses.is_empty(), "{intent:?}");
    }
    let list = ["sac", "vessel"].repeat(12).join(" and ");
    let intent = grammar::parse(&format!("hide the {list}"), &observation).unwrap();
    assert_eq!((intent.clauses.len(), intent.not_understood.len()), (1, 0), "{intent:?}");
}

#[test]
fn help_names_the_units_of_the_scene() {
    let help = commands::help(&["leaves", "pot"]);
    assert!(help.contains("make the leaves red") && !help.contains("{unit}"), "{help}");
    assert!(commands::examples(&["leaves"]).contains(&"how big are the leaves?".to_owned()));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_parsed(text in any::<String>(), units in prop::collection::vec(any::<String>(), 0..4)) {
        let units: Vec<&str> = units.iter().map(String::as_str).collect();
        let observation = observation(&units, true);
        if let Ok(intent) = grammar::parse(&text, &observation) {
            for clause in &intent.clauses {
                prop_assert!(clause.act() != Act::Unspecified);
                prop_assert!(!clause.words.is_empty());
            }
            prop_assert!(intent.suggestions.len() <= 3);
            prop_assert_eq!(intent.backend, "grammar");
        }
    }

    #[test]
    fn any_sequence_of_known_words_is_parsed(words in prop::collection::vec(prop::sample::select(VOCABULARY.to_vec()), 0..14)) {
        let observation = observation(&["sac", "red vessel", "light"], true);
        let text = words.join(" ");
        if let Ok(intent) = grammar::parse(&text, &observation) {
            let again = grammar::parse(&text, &observation).unwrap();
            prop_assert_eq!(&intent, &again);
            for clause in &intent.clauses {
                if let Some(amount) = clause.amount {
                    prop_assert!(amount.is_finite() && amount >= 0.0);
                }
                if let Some(c) = &clause.color {
                    prop_assert!([c.red, c.green, c.blue].iter().all(|v| (0.0..=1.0).contains(v)));
                }
            }
        }
    }

    #[test]
    fn a_known_name_is_found_in_any_case(name in "[a-z]{3,9}( [a-z]{3,9}){0,2}", shout in any::<bool>()) {
        let said = if shout { name.to_uppercase() } else { name.clone() };
        let observation = observation(&[&name], false);
        let intent = grammar::parse(&format!("hide \"{said}\""), &observation).unwrap();
        prop_assert_eq!(intent.clauses.len(), 1);
        prop_assert_eq!(&intent.clauses[0].target.as_ref().unwrap().names, &vec![said]);
    }
}

const VOCABULARY: [&str; 84] = [
    "make",
    "the",
    "sac",
    "red",
    "vessel",
    "vessels",
    "and",
    ",",
    "then",
    "fade",
    "everything",
    "else",
    "to",
    "20",
    "percent",
    "%",
    "by",
    "half",
    "show",
    "only",
    "hide",
    "all",
    "but",
    "set",
    "opacity",
    "of",
    "colour",
    "light",
    "from",
    "left",
    "above",
    "brighter",
    "more",
    "less",
    "specular",
    "background",
    "white",
    "view",
    "look",
    "at",
    "rotate",
    "30",
    "degrees",
    "zoom",
    "in",
    "out",
    "twice",
    "select",
    "add",
    "selection",
    "call",
    "this",
    "it",
    "'left root'",
    "rename",
    "delete",
    "what",
    "is",
    "selected",
    "undo",
    "last",
    "3",
    "changes",
    "reset",
    "help",
    "don't",
    "not",
    "please",
    "a",
    "bit",
    "transparent",
    "opaque",
    "#ff8800",
    "rgb(1,2,3)",
    "two",
    "thirds",
    "'s",
    "?",
    "-",
    "normals",
    "on",
    "off",
    "be",
    "describe",
];
