//! Checks of the role that draws the shared viewpoint whenever the scene changes.

use std::time::Duration;

use prost::Message as _;
use sg_proto::bus::{Health, StatusRequest};
use sg_proto::keys::{self, role};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, Select, SetBackground, Target, Undo};
use sg_proto::selection::Preview;

use super::question::{Question, hold, soon};
use super::stage::{Stage, next_of};
use super::{Checks, Subject, content};
use crate::Picture;

pub(super) const ROLE: &str = role::RENDER_VIEW;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[role::SCENE], question, essence };

/// The role answers only the requests common to all roles.
fn question(_id: &str) -> Question {
    Question::of(&keys::STATUS, &StatusRequest {})
}

fn essence(payload: &[u8]) -> Result<String, String> {
    Health::decode(payload).map(|h| h.role).map_err(|e| format!("malformed answer: {e}"))
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("draws a changed scene", draws(stage).await);
    checks.note("shows the newest of many changes", newest(stage).await);
    checks.note("shows what is selected before it is durable", previews(stage).await);
    checks.note("draws again after kill -9", again(stage).await);
}

fn background(red: f32) -> Action {
    Action::SetBackground(SetBackground { color: Some(Color { red, green: 0.5, blue: 0.25 }) })
}

/// A change is made; a frame shows it, and its files are pictures.
async fn draws(stage: &mut Stage<'_>) -> Result<(), String> {
    let mut frames = stage.cli.subscribe(&keys::VIEW_FRAME, ROLE, 64).await.map_err(|e| e.to_string())?;
    let revision = stage.change(background(0.125)).await?.revision;
    let (frame, _) = next_of(&mut frames, "event/frame of the change", |f, _| f.revision >= revision).await?;
    let picture = Picture::read(std::path::Path::new(&frame.npy_path)).map_err(|e| e.to_string())?;
    let pixels = picture.pixels().count();
    hold(pixels == (frame.width * frame.height) as usize, || {
        format!("{pixels} pixels in a picture of {} x {}", frame.width, frame.height)
    })?;
    let corner = picture.pixels().next().copied().unwrap_or_default();
    hold((corner[0] - 0.125).abs() < 0.05, || format!("the picture's corner is {corner:?}, not the background"))?;
    hold(std::path::Path::new(&frame.png_path).is_file(), || format!("{}: no file", frame.png_path))?;
    content::whole(stage, &keys::VIEW_CONTENT, &frame.hash).await.map(drop)
}

async fn newest(stage: &mut Stage<'_>) -> Result<(), String> {
    let mut frames = stage.cli.subscribe(&keys::VIEW_FRAME, ROLE, 256).await.map_err(|e| e.to_string())?;
    let mut revision = 0;
    for n in 0_u8..12 {
        revision = stage.change(background(f32::from(n) / 12.0)).await?.revision;
    }
    next_of(&mut frames, "event/frame of the last of 12 changes", |f, _| f.revision >= revision).await?;
    let state = stage.cli.newest(&keys::VIEW_STATE, &soon()).await.map_err(|f| f.to_string())?;
    hold(state.revision >= revision && state.frames > 0 && state.gaussians > 0, || format!("{state:?}"))
}

/// A preview of the selection is drawn; taken back, the picture is the one before. One of another selection is not drawn.
async fn previews(stage: &mut Stage<'_>) -> Result<(), String> {
    let mut frames = stage.cli.subscribe(&keys::VIEW_FRAME, ROLE, 64).await.map_err(|e| e.to_string())?;
    let revision = stage.change(background(0.4)).await?.revision;
    let (before, _) = next_of(&mut frames, "event/frame of the change", |f, _| f.revision >= revision).await?;
    let state = stage.scene_state().await?;
    let selection = stage.join(role::SELECTION).await?;
    // So that every router on the way knows the subscribers.
    tokio::time::sleep(Duration::from_millis(100)).await;
    let tell = async |changed: Vec<u32>, hash: &str, revision: u64| {
        let selection_hash = hash.to_owned();
        let preview = Preview { selected: 1, changed, selection_hash, revision, answers: None };
        selection.publish(&keys::SELECTION_PREVIEW, &preview, &soon()).await.map_err(|f| f.to_string())
    };
    let (all, selected) = (state.count as u32, state.selection.unwrap_or_default());
    let hash = selected.hash.as_str();
    for (changed, hash, shown) in [(vec![0, all], hash, true), (vec![], hash, false), (vec![0, all], "another", false)]
    {
        tell(changed, hash, state.revision).await?;
        let (frame, _) = next_of(&mut frames, "event/frame of a preview", |_, _| true).await?;
        hold((frame.hash != before.hash) == shown, || format!("shown: {}, not {shown}", frame.hash != before.hash))?;
    }
    // Another selection is committed and taken back: that of the preview is there again, and the preview is not.
    tell(vec![0, all], hash, state.revision).await?;
    let everything = Some(Target { everything: true, ..Target::default() });
    stage.change(Action::Select(Select { target: everything, ..Select::default() })).await?;
    let revision = stage.change(Action::Undo(Undo { steps: 1 })).await?.revision;
    let (frame, _) = next_of(&mut frames, "event/frame after undo", |f, _| f.revision >= revision).await?;
    hold(frame.hash == before.hash, || "a preview of what was taken back is drawn".to_owned())
}

async fn again(stage: &mut Stage<'_>) -> Result<(), String> {
    stage.kill_and_serve().await?;
    let mut frames = stage.cli.subscribe(&keys::VIEW_FRAME, ROLE, 64).await.map_err(|e| e.to_string())?;
    let revision = stage.change(background(0.9)).await?.revision;
    next_of(&mut frames, "event/frame after the restart", |f, _| f.revision >= revision).await.map(drop)
}
