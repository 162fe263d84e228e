//! Checks of the role that draws pictures on request.

use std::path::Path;
use std::time::Duration;

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::render::{CaptureRequest, Clip, DisplayMode, Frame, HalfSpace, PickRequest, Quality, Ray};
use sg_proto::scene::command::Action;
use sg_proto::scene::{DeleteGaussians, RestoreGaussians, SetVisibility, Undo, Vector};

use super::question::{Question, hold, refused_as, soon};
use super::scene::{named, shift, show_from};
use super::stage::{Stage, decode};
use super::{Checks, Subject, content};
use crate::Picture;

pub(super) const ROLE: &str = role::RENDER_CAPTURE;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[role::SCENE], question, essence };

fn small() -> CaptureRequest {
    CaptureRequest { width: 48, height: 32, quality: Quality::Standard.into(), ..CaptureRequest::default() }
}

fn question(_id: &str) -> Question {
    Question::of(&keys::CAPTURE, &small())
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let frame: Frame = decode(payload)?;
    Ok(format!("revision {}, picture {}", frame.revision, frame.hash))
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("draws what was asked for", draws(stage).await);
    checks.note("shows at least the revision asked for", at_least(stage).await);
    checks.note("does not draw what is deleted", deleted(stage).await);
    checks.note("draws Gaussians where they are", moved(stage).await);
    checks.note("draws what a transfer function shows", transfer_function(stage).await);
    checks.note("measures what units cover", measures(stage).await);
    checks.note("keeps to clips", clips(stage).await);
    checks.note("leaves the background out where asked", transparent(stage).await);
    checks.note("shows the structure in place of the scene", structure(stage).await);
    checks.note("says what is in front", picks(stage).await);
    checks.note("refuses pictures that cannot be", misfits(stage).await);
    checks.note("sends its pictures to other machines", sends(stage).await);
}

async fn capture(stage: &Stage<'_>, request: &CaptureRequest) -> Result<Frame, String> {
    stage.cli.ask(&keys::CAPTURE, request, &soon()).await.map_err(|f| format!("cmd/capture: {f}"))
}

async fn draws(stage: &Stage<'_>) -> Result<(), String> {
    let frame = capture(stage, &small()).await?;
    hold((frame.width, frame.height) == (48, 32), || format!("{} x {} pixels", frame.width, frame.height))?;
    let bytes = std::fs::read(&frame.npy_path).map_err(|e| format!("{}: {e}", frame.npy_path))?;
    let hash = blake3::hash(&bytes).to_hex();
    hold(hash.as_str() == frame.hash, || format!("the file's hash is {hash}, the frame says {}", frame.hash))?;
    let picture = Picture::read(Path::new(&frame.npy_path)).map_err(|e| e.to_string())?;
    hold(picture.pixels().count() == 48 * 32, || "another number of pixels in the file".to_owned())?;
    hold(Path::new(&frame.png_path).is_file(), || format!("{}: no file", frame.png_path))?;
    hold(frame.coverage > 0.0 && frame.camera.is_some(), || format!("coverage {}", frame.coverage))
}

async fn sends(stage: &Stage<'_>) -> Result<(), String> {
    let frame = capture(stage, &small()).await?;
    for (path, hash) in [(&frame.npy_path, &frame.hash), (&frame.png_path, &frame.png_hash)] {
        let kept = std::fs::read(path).map_err(|e| format!("{path}: {e}"))?;
        let sent = content::whole(stage, &keys::CAPTURE_CONTENT, hash).await?;
        hold(sent == kept, || format!("{path}: other bytes are sent than are kept"))?;
    }
    content::unknown(stage, &keys::CAPTURE_CONTENT).await
}

async fn at_least(stage: &mut Stage<'_>) -> Result<(), String> {
    let before = capture(stage, &small()).await?;
    let hide = SetVisibility { target: named("body"), visible: false };
    let revision = stage.change(Action::SetVisibility(hide)).await?.revision;
    let frame = capture(stage, &CaptureRequest { at_least_revision: revision, ..small() }).await?;
    hold(frame.revision >= revision, || format!("revision {} instead of {revision}", frame.revision))?;
    hold(frame.hash != before.hash, || "a hidden unit is still in the picture".to_owned())?;
    stage.change(Action::SetVisibility(SetVisibility { target: named("body"), visible: true })).await?;
    // The role reports in time that a revision never comes.
    let future = CaptureRequest { at_least_revision: revision + 1000, ..small() };
    let late = soon().deadline_in(Duration::from_millis(500));
    let fault = stage.cli.ask(&keys::CAPTURE, &future, &late).await.err().map(|f| f.code);
    hold(fault == Some(Code::DeadlineExceeded), || format!("a revision of the future: {fault:?}"))
}

async fn deleted(stage: &mut Stage<'_>) -> Result<(), String> {
    let whole = capture(stage, &small()).await?;
    let hide = SetVisibility { target: named("body"), visible: false };
    let revision = stage.change(Action::SetVisibility(hide)).await?.revision;
    let hidden = capture(stage, &CaptureRequest { at_least_revision: revision, ..small() }).await?;
    stage.change(Action::Undo(Undo { steps: 1 })).await?;
    let delete = DeleteGaussians { target: named("body") };
    let revision = stage.change(Action::DeleteGaussians(delete)).await?.revision;
    let deleted = capture(stage, &CaptureRequest { at_least_revision: revision, ..small() }).await?;
    hold(deleted.hash == hidden.hash && deleted.hash != whole.hash, || {
        "a picture without a deleted unit is not one where it is hidden".to_owned()
    })?;
    let all = DeleteGaussians { target: named("sac") };
    let revision = stage.change(Action::DeleteGaussians(all)).await?.revision;
    let empty = capture(stage, &CaptureRequest { at_least_revision: revision, ..small() }).await?;
    hold(empty.coverage == 0.0, || format!("coverage {} of nothing", empty.coverage))?;
    let revision = stage.change(Action::RestoreGaussians(RestoreGaussians {})).await?.revision;
    let back = capture(stage, &CaptureRequest { at_least_revision: revision, ..small() }).await?;
    hold(back.hash == whole.hash, || "restored Gaussians are not in the picture".to_owned())
}

async fn moved(stage: &mut Stage<'_>) -> Result<(), String> {
    let picture = async |stage: &Stage<'_>, at_least_revision| {
        capture(stage, &CaptureRequest { at_least_revision, ..small() }).await
    };
    let whole = picture(stage, 0).await?;
    let revision = stage.change(shift("sac", 0.1)).await?.revision;
    let beside = picture(stage, revision).await?;
    hold(beside.hash != whole.hash, || "a moved unit is where it was".to_owned())?;
    let revision = stage.change(shift("sac", 1e3)).await?.revision;
    let away = picture(stage, revision).await?;
    let hide = SetVisibility { target: named("sac"), visible: false };
    let revision = stage.change(Action::SetVisibility(hide)).await?.revision;
    let hidden = picture(stage, revision).await?;
    hold(away.hash == hidden.hash, || "a unit that is far away is still in the picture".to_owned())?;
    let revision = stage.change(Action::Undo(Undo { steps: 3 })).await?.revision;
    hold(picture(stage, revision).await?.hash == whole.hash, || "undo does not bring the picture back".to_owned())
}

async fn transfer_function(stage: &mut Stage<'_>) -> Result<(), String> {
    let picture = async |stage: &Stage<'_>, at_least_revision| {
        capture(stage, &CaptureRequest { at_least_revision, ..small() }).await
    };
    let whole = picture(stage, 0).await?;
    let revision = stage.change(show_from(300.0)).await?.revision;
    let nothing = picture(stage, revision).await?;
    hold(nothing.coverage == 0.0, || format!("coverage {} where the function hides all values", nothing.coverage))?;
    let revision = stage.change(show_from(100.0)).await?.revision;
    let sac = picture(stage, revision).await?;
    hold(sac.coverage > 0.0 && sac.coverage < whole.coverage, || {
        format!("coverage {} of one ball of two, which cover {}", sac.coverage, whole.coverage)
    })?;
    let revision = stage.change(Action::Undo(Undo { steps: 2 })).await?.revision;
    hold(picture(stage, revision).await?.hash == whole.hash, || "undo does not bring the picture back".to_owned())
}

async fn measures(stage: &Stage<'_>) -> Result<(), String> {
    let request = CaptureRequest { only_units: vec!["sac".to_owned()], measure_units: true, ..small() };
    let frame = capture(stage, &request).await?;
    let mut units: Vec<_> = frame.units.iter().map(|u| u.unit.as_str()).collect();
    units.sort_unstable();
    hold(units == ["body", "sac"] && frame.units.iter().all(|u| u.share > 0.0), || format!("{:?}", frame.units))?;
    let whole = capture(stage, &small()).await?;
    hold(frame.coverage < whole.coverage, || "one unit alone covers as much as both".to_owned())
}

async fn clips(stage: &Stage<'_>) -> Result<(), String> {
    // Everything has x ≥ −1e9, and nothing has x ≤ −1e9.
    let side = |x: f64| HalfSpace { normal: vec![x, 0.0, 0.0], offset: x * -1e9 };
    let whole = capture(stage, &small()).await?;
    for (x, hide_inside, coverage) in [(1.0, false, whole.coverage), (1.0, true, 0.0), (-1.0, false, 0.0)] {
        let clips = vec![Clip { sides: vec![side(x)], hide_inside }];
        let frame = capture(stage, &CaptureRequest { clips, ..small() }).await?;
        hold(frame.coverage == coverage, || format!("coverage {} instead of {coverage}", frame.coverage))?;
    }
    Ok(())
}

/// PNG files hold their colour type in byte 25: 6 stands for RGBA.
async fn transparent(stage: &Stage<'_>) -> Result<(), String> {
    for (transparent, kind) in [(false, 2), (true, 6)] {
        let frame = capture(stage, &CaptureRequest { transparent, ..small() }).await?;
        let png = std::fs::read(&frame.png_path).map_err(|e| format!("{}: {e}", frame.png_path))?;
        hold(png.get(25) == Some(&kind), || format!("transparent {transparent}: colour type {:?}", png.get(25)))?;
    }
    Ok(())
}

async fn structure(stage: &Stage<'_>) -> Result<(), String> {
    let scene = capture(stage, &small()).await?;
    let shown =
        async |mode: DisplayMode| capture(stage, &CaptureRequest { display_mode: mode.into(), ..small() }).await;
    let opacity = shown(DisplayMode::Opacity).await?;
    hold(opacity.hash != scene.hash, || "opacities look as the scene does".to_owned())?;
    let legend = opacity.legend.ok_or("no legend of opacities")?;
    hold((legend.low, legend.high, legend.logarithmic) == (0.0, 1.0, false), || format!("{legend:?}"))?;
    let scale = shown(DisplayMode::Scale).await?.legend.ok_or("no legend of scales")?;
    hold(scale.logarithmic && 0.0 < scale.low && scale.low <= scale.high, || format!("{scale:?}"))?;
    hold(shown(DisplayMode::Scene).await?.hash == scene.hash, || {
        "the scene is another one when it is named".to_owned()
    })?;
    // Nothing is clustered here. The role says so, and does not wait until the deadline.
    let request = CaptureRequest { display_mode: DisplayMode::Clusters.into(), ..small() };
    let late = soon().deadline_in(Duration::from_secs(2));
    let fault = stage.cli.ask(&keys::CAPTURE, &request, &late).await.err().map(|f| f.code);
    let codes = [Code::Unavailable, Code::DeadlineExceeded];
    hold(fault.is_some_and(|code| codes.contains(&code)), || format!("clusters without a selection: {fault:?}"))
}

async fn picks(stage: &mut Stage<'_>) -> Result<(), String> {
    let ask = async |request: &PickRequest| {
        // Nothing is clustered here. The role still reports the front surface, long before the deadline.
        let late = soon().deadline_in(Duration::from_secs(3));
        stage.cli.ask(&keys::PICK, request, &late).await.map_err(|f| format!("cmd/pick: {f}"))
    };
    let frame = capture(stage, &small()).await?;
    let picture = Picture::read(Path::new(&frame.npy_path)).map_err(|e| e.to_string())?;
    let opaque = picture.pixels().position(|p| p[3] > 0.9).ok_or("nothing opaque in the picture")?;
    let (x, y) = (opaque % 48, opaque / 48);
    let at = PickRequest { width: 48, height: 32, x: x as f64 + 0.5, y: y as f64 + 0.5, ..PickRequest::default() };
    let hit = ask(&at).await?;
    hold(hit.hit && hit.depth > 0.0 && !hit.units.is_empty(), || format!("at ({x}, {y}): {hit:?}"))?;
    let point = hit.point.ok_or("a hit that is nowhere")?;
    // The ray from the eye through that point meets it too.
    let camera = frame.camera.ok_or("a picture without a camera")?;
    let m = &camera.world_to_camera;
    let eye = |row: usize| -(0..3).map(|k| m[4 * k + row] * m[4 * k + 3]).sum::<f64>();
    let origin = Vector { x: eye(0), y: eye(1), z: eye(2) };
    let direction = Vector { x: point.x - origin.x, y: point.y - origin.y, z: point.z - origin.z };
    let ray = Some(Ray { origin: Some(origin), direction: Some(direction), spread: 0.3_f64.sqrt() / camera.fy });
    let along = ask(&PickRequest { ray, ..PickRequest::default() }).await?;
    let to = along.point.ok_or("nothing along the ray")?;
    let away = ((to.x - point.x).powi(2) + (to.y - point.y).powi(2) + (to.z - point.z).powi(2)).sqrt();
    hold(along.hit && away < 0.1 * hit.depth, || format!("{away} from {point:?} along the ray, depth {}", hit.depth))?;
    let beside = ask(&PickRequest { x: -1e6, ..at.clone() }).await?;
    hold(!beside.hit && beside.cluster == -1 && beside.units.is_empty(), || format!("beside the picture: {beside:?}"))?;
    for (what, request) in [
        ("no picture", PickRequest { width: 0, ..at.clone() }),
        ("nowhere", PickRequest { x: f64::NAN, ..at.clone() }),
        ("a level above 1", PickRequest { level: 1.5, ..at.clone() }),
        ("a ray without a direction", PickRequest { ray: Some(Ray::default()), ..at.clone() }),
    ] {
        let id = stage.new_id();
        let codes = &[Code::InvalidArgument, Code::OutOfRange];
        refused_as(stage.put(&Question::of(&keys::PICK, &request), &id).await, codes)
            .map_err(|why| format!("{what}: {why}"))?;
    }
    Ok(())
}

async fn misfits(stage: &mut Stage<'_>) -> Result<(), String> {
    let wrong = &[Code::InvalidArgument, Code::OutOfRange][..];
    let nowhere = Clip { sides: vec![HalfSpace { normal: vec![0.0; 3], offset: 0.0 }], hide_inside: false };
    for (what, request, codes) in [
        ("no width", CaptureRequest { width: 0, ..small() }, wrong),
        ("too high", CaptureRequest { height: 1 << 20, ..small() }, wrong),
        ("a clip of no direction", CaptureRequest { clips: vec![nowhere], ..small() }, wrong),
        ("an unknown unit", CaptureRequest { only_units: vec!["none".to_owned()], ..small() }, &[Code::NotFound]),
        ("a camera of nothing", CaptureRequest { camera: Some(sg_proto::render::Camera::default()), ..small() }, wrong),
    ] {
        let id = stage.new_id();
        let question = Question::of(&keys::CAPTURE, &request);
        refused_as(stage.put(&question, &id).await, codes).map_err(|why| format!("{what}: {why}"))?;
    }
    Ok(())
}
