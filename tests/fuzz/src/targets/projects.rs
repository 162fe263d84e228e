//! Project files.

use std::sync::{Arc, LazyLock};

use sg_proto::scene::command::Action;
use sg_proto::scene::{ChangesRequest, Command, Undo};
use sg_scene::model::Scene;
use supergaussian_scene::project::Project;

use crate::seeds;
use crate::stage::Stage;

static SCENE: LazyLock<Arc<Scene>> = LazyLock::new(|| Arc::new(seeds::project_scene()));

pub(crate) fn project(stage: &Stage, input: &[u8]) -> bool {
    for beside in ["in.sgproj-wal", "in.sgproj-shm", "in.sgproj-journal"] {
        stage.remove(beside);
    }
    let path = stage.write("in.sgproj", input);
    let mut project = match Project::open(&path, Arc::clone(&SCENE), "") {
        Ok(project) => project,
        Err(error) => {
            assert!(error.to_string().contains("in.sgproj"), "{error}");
            return false;
        }
    };
    // A damaged page can show late: each of these may fail, and none may panic or hang.
    let undo = Command { id: "fuzz".into(), expected_revision: 0, action: Some(Action::Undo(Undo { steps: 1 })) };
    let _ = project.apply(&undo);
    let _ = project.changes(&ChangesRequest { from: 0, snapshot: false });
    let _ = project.last_event();
    let _ = project.checkpoint();
    true
}
