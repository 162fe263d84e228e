//! Sequences of commands to the scene.

use std::sync::{Arc, LazyLock};

use sg_edit::{EditState, Editor, HistoryMove, Replica};
use sg_proto::prost::Message as _;
use sg_proto::replica::Replica as _;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Command, Redo, State, Undo};
use sg_reclassify::sources::{Source, store};
use sg_scene::model::Scene;
use sg_scene::synthetic::test_scene;

use crate::parts::Parts;
use crate::stage::Stage;

/// Most commands of one input.
const MAX_COMMANDS: usize = 24;

static OPENED: LazyLock<(Arc<Scene>, EditState)> = LazyLock::new(|| {
    let scene = scene();
    let state = EditState::of_scene(&scene, "scene.toml", "hash");
    (scene, state)
});

/// Three base units, of which `bone` keeps values of a volume.
pub(crate) fn scene() -> Arc<Scene> {
    let mut units = test_scene(&[("bone", 20), ("skin", 15), ("Vessel", 25)]).units;
    if let Some(bone) = units.first_mut() {
        let source = |i: u8| Source { value: 50.0 * f64::from(i), depth: 1.0, ..Source::default() };
        store(&(0..20).map(source).collect::<Vec<_>>(), &mut bone.gaussians);
        bone.values = Some([0.0, 1000.0]);
    }
    Arc::new(Scene::compose(units, None))
}

/// Every block is a command.
pub(crate) fn commands(_: &Stage, input: &[u8]) -> bool {
    let (scene, opened) = &*OPENED;
    let mut editor = Editor::new(Arc::clone(scene), opened.clone());
    let mut stored = editor.clone();
    let mut replica = Replica::new(opened.clone());
    let mut parts = Parts(input);
    let mut accepted = 0;
    for _ in 0..MAX_COMMANDS {
        if parts.is_empty() {
            break;
        }
        let Ok(command) = Command::decode(parts.block()) else { continue };
        let before = bytes(&editor);
        let Ok(applied) = editor.apply(&command) else {
            assert_eq!(bytes(&editor), before, "a refused command changes nothing");
            continue;
        };
        accepted += 1;
        // Readers follow by events, and a restart repeats what is stored.
        assert!(replica.apply(&applied.event).is_ok(), "{command:?}");
        assert_eq!(encoded(&replica.state().state(true)), encoded(&editor.state().state(true)));
        assert!(stored.replay(&applied.event, &applied.inverse, applied.history).is_ok(), "{command:?}");
        assert_eq!(bytes(&stored), bytes(&editor));
        // A new reader begins with a snapshot.
        let snapshot = Replica::from_snapshot(&editor.message(true)).unwrap();
        assert_eq!(encoded(&snapshot.state().state(true)), encoded(&editor.state().state(true)));
        // Undo takes exactly this back, and redo brings it back.
        if applied.history == HistoryMove::Push {
            let mut other = editor.clone();
            other.apply(&taken(Action::Undo(Undo { steps: 1 }))).unwrap();
            other.apply(&taken(Action::Redo(Redo { steps: 1 }))).unwrap();
            assert_eq!(content(&other), content(&editor), "{command:?}");
        }
    }
    accepted > 0
}

fn taken(action: Action) -> Command {
    Command { id: "again".to_owned(), expected_revision: 0, action: Some(action) }
}

/// Everything that a reader sees. Bytes compare NaN too.
fn bytes(editor: &Editor) -> Vec<u8> {
    encoded(&editor.message(true))
}

fn encoded(state: &State) -> Vec<u8> {
    state.encode_to_vec()
}

/// What a reader sees, without what every command changes.
fn content(editor: &Editor) -> Vec<u8> {
    encoded(&State { revision: 0, ..editor.message(true) })
}
