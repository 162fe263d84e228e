//! The state of the scene as JSON, with the names that the actions take and bounded lists.

use serde_json::{Value, json};
use sg_language::prompt::clip;
use sg_proto::scene::{BaseUnit, Color, Light, State, Tone, TransferFunction, Unit, Vector, View};

/// Most units of each kind.
const MAX_UNITS: usize = 100;

/// Longest text, bytes. Names are shorter.
const MAX_TEXT_BYTES: usize = 256;

/// A state as JSON.
pub(super) fn scene(state: &State) -> Value {
    let texts = |texts: &[String]| texts.iter().map(|t| text(t)).collect::<Vec<_>>();
    let left_out = |all: usize| all.saturating_sub(MAX_UNITS);
    let bounds = state.r#box.as_ref().map(|b| json!({"min": vector(b.min.as_ref()), "max": vector(b.max.as_ref())}));
    json!({
        "revision": state.revision,
        "file": text(state.scene_path.rsplit('/').next().unwrap_or_default()),
        "gaussians": state.count,
        "box": bounds,
        "base_units": state.base_units.iter().take(MAX_UNITS).map(base_unit).collect::<Vec<_>>(),
        "more_base_units": left_out(state.base_units.len()),
        "units": state.units.iter().take(MAX_UNITS).map(unit).collect::<Vec<_>>(),
        "more_units": left_out(state.units.len()),
        "selected_gaussians": state.selection.as_ref().map_or(0, |s| s.count),
        "focus": state.focus.iter().take(MAX_UNITS).map(|name| text(name)).collect::<Vec<_>>(),
        "light": state.light.as_ref().map(light),
        "shading": state.term().as_str_name(),
        "background": color(state.background.as_ref()),
        "view": state.view.as_ref().map(view),
        "kept_views": state.kept_views.iter().map(|kept| text(&kept.name)).collect::<Vec<_>>(),
        "volume": state.volume.as_ref().map(|v| json!({"least": v.least, "greatest": v.greatest})),
        "transfer_function": transfer_function(state),
        "undo": texts(&state.undo),
        "redo": texts(&state.redo),
    })
}

fn text(text: &str) -> String {
    clip(text, MAX_TEXT_BYTES).to_owned()
}

/// Four digits are enough to read, and do not show that a number was stored with 32 bits.
fn number(value: f32) -> f64 {
    (f64::from(value) * 1e4).round() / 1e4
}

fn color(color: Option<&Color>) -> Value {
    color.map_or(Value::Null, |c| json!({"red": number(c.red), "green": number(c.green), "blue": number(c.blue)}))
}

fn vector(vector: Option<&Vector>) -> Value {
    vector.map_or(Value::Null, |v| json!({"x": v.x, "y": v.y, "z": v.z}))
}

fn tone(tone: Option<&Tone>) -> Value {
    tone.map_or(Value::Null, |t| {
        json!({
            "saturation": number(t.saturation), "brightness": number(t.brightness),
            "temperature": number(t.temperature),
        })
    })
}

fn base_unit(unit: &BaseUnit) -> Value {
    json!({
        "name": text(&unit.name), "gaussians": unit.count, "deleted": unit.deleted,
        "color": color(unit.palette.as_ref()), "opacity": number(unit.opacity), "visible": unit.visible,
        "locked": unit.locked, "tone": tone(unit.tone.as_ref()),
    })
}

fn unit(unit: &Unit) -> Value {
    json!({
        "name": text(&unit.name), "gaussians": unit.count, "color": color(unit.color.as_ref()),
        "opacity": number(unit.opacity), "visible": unit.visible, "locked": unit.locked,
        "made_by_an_action": unit.derived, "tone": tone(unit.tone.as_ref()),
    })
}

fn light(light: &Light) -> Value {
    json!({
        "mode": light.mode().as_str_name(), "direction": vector(light.direction.as_ref()),
        "ambient": number(light.ambient), "diffuse": number(light.diffuse), "specular": number(light.specular),
        "shininess": number(light.shininess),
    })
}

fn view(view: &View) -> Value {
    json!({
        "eye": vector(view.eye.as_ref()), "target": vector(view.target.as_ref()), "up": vector(view.up.as_ref()),
        "fov_y_degrees": view.fov_y_degrees,
    })
}

/// The transfer function that the scene has: its own, else that of the file.
fn transfer_function(state: &State) -> Value {
    let of_file = || state.volume.as_ref().and_then(|volume| volume.function.as_ref());
    let described = |function: &TransferFunction| {
        json!({
            "low": function.low, "high": function.high, "normalized": function.normalized,
            "scale": function.scale().as_str_name(), "points": function.points.len(),
            "changed": state.transfer_function.is_some(),
        })
    };
    state.transfer_function.as_ref().or_else(of_file).map_or(Value::Null, described)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::scene::{Box as Bounds, KeptView, LightMode, Selection, ShadingTerm};

    #[test]
    fn the_state_is_told_in_the_words_of_the_actions() {
        let red = Some(Color { red: 0.8, green: 0.1, blue: 0.0 });
        let sac = BaseUnit {
            name: "sac".to_owned(),
            count: 7,
            palette: red,
            opacity: 0.2,
            visible: true,
            ..BaseUnit::default()
        };
        let state = State {
            revision: 3,
            scene_path: "/scans/patient/scene.toml".to_owned(),
            count: 9,
            r#box: Some(Bounds { min: Some(Vector::default()), max: None }),
            base_units: vec![sac],
            units: vec![Unit { name: "neck".to_owned(), ..Unit::default() }],
            selection: Some(Selection { count: 5, ..Selection::default() }),
            light: Some(Light { mode: LightMode::Headlight.into(), ambient: 1.0, ..Light::default() }),
            term: ShadingTerm::Full.into(),
            kept_views: vec![KeptView { name: "entry".to_owned(), view: None }],
            undo: vec!["set the colour of sac".to_owned()],
            ..State::default()
        };
        let told = scene(&state);
        assert_eq!(told["file"], "scene.toml", "folders are nobody's business");
        assert_eq!(told["base_units"][0]["color"], json!({"red": 0.8, "green": 0.1, "blue": 0.0}));
        assert_eq!((&told["base_units"][0]["opacity"], &told["base_units"][0]["visible"]), (&json!(0.2), &json!(true)));
        assert_eq!((&told["units"][0]["name"], &told["units"][0]["visible"]), (&json!("neck"), &json!(false)));
        assert_eq!((&told["selected_gaussians"], &told["gaussians"]), (&json!(5), &json!(9)));
        assert_eq!(
            (&told["light"]["mode"], &told["shading"]),
            (&json!("LIGHT_MODE_HEADLIGHT"), &json!("SHADING_TERM_FULL"))
        );
        assert_eq!((&told["kept_views"], &told["undo"]), (&json!(["entry"]), &json!(["set the colour of sac"])));
        assert_eq!((&told["transfer_function"], &told["view"]), (&Value::Null, &Value::Null));
    }

    #[test]
    fn the_size_of_a_state_is_limited() {
        let name = "n".repeat(128);
        let state = State {
            base_units: vec![BaseUnit { name: name.clone(), ..BaseUnit::default() }; 1000],
            units: vec![Unit { name: name.clone(), ..Unit::default() }; 1000],
            focus: vec![name.clone(); 2000],
            undo: vec!["s".repeat(10_000); 20],
            kept_views: vec![KeptView { name, view: None }; 64],
            ..State::default()
        };
        let told = scene(&state);
        assert_eq!((told["units"].as_array().unwrap().len(), &told["more_units"]), (MAX_UNITS, &json!(900)));
        assert!(told.to_string().len() < 128 << 10, "{} bytes", told.to_string().len());
    }
}
