//! Results and errors of tools, bounded.

use rmcp::model::{CallToolResult, ContentBlock};
use serde_json::{Value, json};
use sg_language::prompt::clip;
use sg_proto::language::Reply;

use super::undo_steps::Change;

/// Longest reply of the agents in a result, bytes.
const MAX_REPLY_BYTES: usize = 16 << 10;

/// Longest error, bytes.
const MAX_ERROR_BYTES: usize = 2 << 10;

/// Most changed units that a result names.
const MAX_UNITS: usize = 64;

/// An error of a tool, as one line.
pub(super) fn error(text: &str) -> CallToolResult {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    CallToolResult::error(vec![ContentBlock::text(clipped(line.trim(), MAX_ERROR_BYTES))])
}

/// The result of actions or of a sentence.
pub(super) fn reply(reply: &Reply, change: Option<Change>) -> CallToolResult {
    CallToolResult::structured(json!({
        "reply": clipped(&reply.text, MAX_REPLY_BYTES),
        "changed_units": changed_units(reply),
        "undo_steps": change.map(|change| change.steps),
        "revision": change.map_or(reply.revision, |change| change.revision),
    }))
}

/// The result of undo or redo.
pub(super) fn history(reply: &Reply, change: Change) -> CallToolResult {
    CallToolResult::structured(json!({
        "reply": clipped(&reply.text, MAX_REPLY_BYTES), "steps": change.steps, "revision": change.revision,
    }))
}

/// The state of the scene.
pub(super) fn scene(state: Value) -> CallToolResult {
    CallToolResult::structured(state)
}

/// A picture, with a line about it.
pub(super) fn picture(about: &str, png: String) -> CallToolResult {
    CallToolResult::success(vec![ContentBlock::text(about), ContentBlock::image(png, "image/png")])
}

/// Units of the actions that changed the scene, each once.
fn changed_units(reply: &Reply) -> Vec<&str> {
    let mut units: Vec<&str> = Vec::new();
    for unit in reply.actions.iter().filter(|action| action.ok && action.command.is_some()).flat_map(|a| &a.units) {
        if units.len() < MAX_UNITS && !units.contains(&unit.as_str()) {
            units.push(unit);
        }
    }
    units
}

fn clipped(text: &str, bytes: usize) -> String {
    let short = clip(text, bytes);
    if short.len() < text.len() { format!("{short}…") } else { short.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_proto::language::ActionResult;
    use sg_proto::scene::Command;

    fn text(result: &CallToolResult) -> &str {
        &result.content[0].as_text().unwrap().text
    }

    #[test]
    fn an_error_is_one_line() {
        let result = error("one\ntwo\u{1b}[31m\n");
        assert_eq!((result.is_error, text(&result)), (Some(true), "one two [31m"));
        assert!(text(&error(&"é".repeat(MAX_ERROR_BYTES))).len() <= MAX_ERROR_BYTES + "…".len());
    }

    #[test]
    fn a_result_tells_what_changed_and_how_to_take_it_back() {
        let action = |units: &[&str], changes: bool| ActionResult {
            ok: true,
            units: units.iter().map(|unit| (*unit).to_owned()).collect(),
            command: changes.then(Command::default),
            ..ActionResult::default()
        };
        let actions = vec![action(&["sac", "body"], true), action(&["sac"], true), action(&["vessel"], false)];
        let done = Reply { text: "Done.".to_owned(), ok: true, revision: 3, actions, ..Reply::default() };
        let result = reply(&done, Some(Change { steps: 2, revision: 5 }));
        let expected = json!({"reply": "Done.", "changed_units": ["sac", "body"], "undo_steps": 2, "revision": 5});
        assert_eq!(result.structured_content, Some(expected.clone()));
        assert_eq!(serde_json::from_str::<Value>(text(&result)).unwrap(), expected);
        let asked = reply(&done, None).structured_content.unwrap();
        assert_eq!((&asked["undo_steps"], &asked["revision"]), (&Value::Null, &json!(3)));
    }

    #[test]
    fn long_replies_are_cut() {
        let long = Reply { text: "a".repeat(MAX_REPLY_BYTES + 1), ..Reply::default() };
        let result = reply(&long, None).structured_content.unwrap();
        assert!(result["reply"].as_str().unwrap().ends_with("a…"));
    }

    #[test]
    fn a_picture_is_image_content() {
        let result = picture("2 x 2 pixels", "AAAA".to_owned());
        let image = result.content[1].as_image().unwrap();
        assert_eq!((image.mime_type.as_str(), image.data.as_str()), ("image/png", "AAAA"));
    }
}
