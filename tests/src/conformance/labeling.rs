//! Checks of the role that finds the units that a text means.

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::labeling::{DescribeReply, DescribeRequest, FindReply, FindRequest, Outcome, ViewsReply, ViewsRequest};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, SaveUnit, Select, SetColor};

use super::question::{Question, hold, soon};
use super::scene::{named, shift};
use super::stage::{Stage, decode};
use super::{Checks, Subject};

pub(super) const ROLE: &str = role::LABELING;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[role::SCENE], question, essence };

fn question(_id: &str) -> Question {
    Question::of(&keys::LABELING_FIND, &FindRequest { text: "the sac".to_owned(), ..FindRequest::default() })
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let reply: FindReply = decode(payload)?;
    let units: Vec<&str> = reply.units.iter().map(|found| found.unit.as_str()).collect();
    Ok(format!("{:?} {units:?}", reply.outcome()))
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("knows the units of the scene", state(stage).await);
    checks.note("finds units by other names and by their looks", finds(stage).await);
    checks.note("says when nothing matches", nothing(stage).await);
    checks.note("follows names and looks as they change", follows(stage).await);
    checks.note("describes units and the selection", describes(stage).await);
    checks.note("finds the views that show most of a unit", views(stage).await);
    checks.note("refuses what it cannot answer", refuses(stage).await);
}

async fn find(stage: &Stage<'_>, text: &str) -> Result<FindReply, String> {
    let at_least_revision = stage.scene_state().await?.revision;
    let request = FindRequest { text: text.to_owned(), at_least_revision, ..FindRequest::default() };
    stage.cli.ask(&keys::LABELING_FIND, &request, &soon()).await.map_err(|f| format!("cmd/find {text}: {f}"))
}

/// A text means exactly these units.
async fn means(stage: &Stage<'_>, text: &str, expected: &[&str]) -> Result<(), String> {
    let reply = find(stage, text).await?;
    let mut units: Vec<&str> = reply.units.iter().map(|found| found.unit.as_str()).collect();
    units.sort_unstable();
    let well_formed =
        reply.units.iter().all(|found| (0.0..=1.0).contains(&found.score) && !found.explanation.is_empty());
    hold(reply.outcome() == Outcome::Match && units == expected && well_formed, || format!("“{text}”: {reply:?}"))
}

async fn describe(stage: &Stage<'_>, unit: &str) -> Result<DescribeReply, String> {
    let request = DescribeRequest { unit: unit.to_owned(), at_least_revision: stage.scene_state().await?.revision };
    stage.cli.ask(&keys::LABELING_DESCRIBE, &request, &soon()).await.map_err(|f| format!("cmd/describe {unit}: {f}"))
}

async fn state(stage: &Stage<'_>) -> Result<(), String> {
    let state = stage.cli.newest(&keys::LABELING_STATE, &soon()).await.map_err(|f| f.to_string())?;
    hold(state.units == 2 && !state.method.is_empty(), || format!("{state:?} of a scene of two units"))
}

async fn finds(stage: &Stage<'_>) -> Result<(), String> {
    means(stage, "the sack", &["sac"]).await?;
    means(stage, "everything but the sac", &["body"]).await?;
    // The scene lies along x, which the first view has from left to right.
    means(stage, "the one on the right", &["sac"]).await?;
    let both = find(stage, "the thing").await?;
    hold(both.outcome() == Outcome::Ambiguous && both.units.len() == 2, || format!("two things: {both:?}"))
}

async fn nothing(stage: &Stage<'_>) -> Result<(), String> {
    for text in ["the liver", "", "???"] {
        let reply = find(stage, text).await?;
        hold(reply.outcome() == Outcome::NoMatch && !reply.reason.is_empty(), || format!("“{text}”: {reply:?}"))?;
    }
    Ok(())
}

async fn follows(stage: &mut Stage<'_>) -> Result<(), String> {
    let blue = Some(Color { red: 0.1, green: 0.2, blue: 0.9 });
    stage.change(Action::SetColor(SetColor { target: named("body"), color: blue })).await?;
    means(stage, "the blue part", &["body"]).await?;
    stage.change(Action::Select(Select { target: named("body"), ..Select::default() })).await?;
    stage.change(Action::SaveUnit(SaveUnit { name: "skull".to_owned(), ..SaveUnit::default() })).await?;
    means(stage, "the cranium", &["skull"]).await?;
    let edges = stage.scene_state().await?.r#box.ok_or("no box")?;
    let width = edges.max.unwrap_or_default().x - edges.min.unwrap_or_default().x;
    stage.change(shift("sac", -4.0 * width)).await?;
    means(stage, "the leftmost one", &["sac"]).await?;
    stage.change(shift("sac", 4.0 * width)).await?;
    Ok(())
}

async fn describes(stage: &mut Stage<'_>) -> Result<(), String> {
    let body = describe(stage, "body").await?;
    let look = body.look.ok_or("no look of the body")?;
    hold(
        look.gaussians > 0 && look.deviations.len() == 3 && body.words.iter().any(|word| word.contains("blue")),
        || format!("{:?}, {look:?}", body.words),
    )?;
    stage.change(Action::Select(Select { target: named("sac"), ..Select::default() })).await?;
    let (selection, sac) = (describe(stage, "").await?, describe(stage, "sac").await?);
    let center = |reply: &DescribeReply| reply.look.clone().and_then(|look| look.center);
    hold(center(&selection) == center(&sac) && center(&sac).is_some(), || format!("{selection:?}, {sac:?}"))
}

async fn view_request(stage: &Stage<'_>, unit: &str, count: u32) -> Result<ViewsReply, String> {
    let at_least_revision = stage.scene_state().await?.revision;
    let request = ViewsRequest { unit: unit.to_owned(), at_least_revision, count, ..ViewsRequest::default() };
    stage.cli.ask(&keys::LABELING_VIEWS, &request, &soon()).await.map_err(|f| format!("cmd/views {unit}: {f}"))
}

async fn views(stage: &Stage<'_>) -> Result<(), String> {
    let reply = view_request(stage, "body", 3).await?;
    let falls = reply.views.windows(2).all(|pair| pair[0].entropy >= pair[1].entropy);
    let in_range = reply.views.iter().all(|found| {
        let shares = [found.entropy, found.visible_area, found.unhidden];
        found.view.is_some() && found.entropy > 0.0 && shares.iter().all(|share| (0.0..=1.0).contains(share))
    });
    let is_whole = reply.views.len() == 3 && reply.measured > 3 && reply.radius > 0.0 && reply.center.is_some();
    hold(falls && in_range && is_whole, || format!("{reply:?}"))?;
    // The sac is selected since the check before.
    let (selection, sac) = (view_request(stage, "", 0).await?, view_request(stage, "sac", 0).await?);
    hold(selection.views == sac.views && !sac.views.is_empty(), || format!("{selection:?}, {sac:?}"))?;
    let at_least_revision = stage.scene_state().await?.revision;
    let target = ViewsRequest { target: named("sac"), at_least_revision, ..ViewsRequest::default() };
    let target = stage.cli.ask(&keys::LABELING_VIEWS, &target, &soon()).await.map_err(|f| format!("cmd/views: {f}"))?;
    hold(target.views == sac.views, || format!("the target sac: {target:?}, the unit: {sac:?}"))?;
    let unknown = ViewsRequest { unit: "liver".to_owned(), ..ViewsRequest::default() };
    let reply = stage.cli.ask(&keys::LABELING_VIEWS, &unknown, &soon()).await;
    let code = reply.as_ref().err().map(|fault| fault.code);
    hold(code == Some(Code::NotFound), || format!("views of a unit that does not exist: {reply:?}"))?;
    let many = ViewsRequest { unit: "sac".to_owned(), count: 33, ..ViewsRequest::default() };
    let reply = stage.cli.ask(&keys::LABELING_VIEWS, &many, &soon()).await;
    let code = reply.as_ref().err().map(|fault| fault.code);
    hold(code == Some(Code::InvalidArgument), || format!("33 views: {reply:?}"))
}

async fn refuses(stage: &Stage<'_>) -> Result<(), String> {
    let unknown = DescribeRequest { unit: "liver".to_owned(), at_least_revision: 0 };
    let reply = stage.cli.ask(&keys::LABELING_DESCRIBE, &unknown, &soon()).await;
    let code = reply.as_ref().err().map(|fault| fault.code);
    hold(code == Some(Code::NotFound), || format!("a unit that does not exist: {reply:?}"))?;
    let long = FindRequest { text: "a".repeat(513), ..FindRequest::default() };
    let reply = stage.cli.ask(&keys::LABELING_FIND, &long, &soon()).await;
    let code = reply.as_ref().err().map(|fault| fault.code);
    hold(code == Some(Code::InvalidArgument), || format!("a text of 513 bytes: {reply:?}"))?;
    let both = FindRequest { text: "the sac".to_owned(), picture: vec![0; 8], ..FindRequest::default() };
    let reply = stage.cli.ask(&keys::LABELING_FIND, &both, &soon()).await;
    let code = reply.as_ref().err().map(|fault| fault.code);
    hold(code == Some(Code::InvalidArgument), || format!("a text and a picture: {reply:?}"))
}
