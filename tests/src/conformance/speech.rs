//! Checks of the role that recognises speech and speaks replies.

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::speech::{Control, ControlReply, ControlRequest, Phase, SpeakRequest, State, Trigger};

use super::question::{Question, hold, soon};
use super::stage::{Stage, decode};
use super::{Checks, Subject};

pub(super) const ROLE: &str = role::SPEECH;

pub(super) const SUBJECT: Subject = Subject { role: ROLE, needs: &[role::SCENE], question, essence };

fn question(_id: &str) -> Question {
    Question::of(&keys::SPEECH_CONTROL, &ControlRequest { control: Control::Unmute.into() })
}

fn essence(payload: &[u8]) -> Result<String, String> {
    let reply: ControlReply = decode(payload)?;
    let state = reply.state.ok_or("no state")?;
    Ok(format!("muted: {}, {:?}", state.muted, state.phase()))
}

pub(super) async fn checks(stage: &mut Stage<'_>, checks: &mut Checks<'_>) {
    checks.note("says what it does and what it lacks", state(stage).await);
    checks.note("closes and opens the microphone", mutes(stage).await);
    checks.note("refuses what it cannot do", refuses(stage).await);
}

async fn newest(stage: &Stage<'_>) -> Result<State, String> {
    stage.cli.newest(&keys::SPEECH_STATE, &soon()).await.map_err(|f| f.to_string())
}

async fn control(stage: &Stage<'_>, control: Control) -> Result<State, String> {
    let request = ControlRequest { control: control.into() };
    let reply =
        stage.cli.ask(&keys::SPEECH_CONTROL, &request, &soon()).await.map_err(|f| format!("{control:?}: {f}"))?;
    reply.state.ok_or_else(|| format!("{control:?}: no state"))
}

async fn state(stage: &Stage<'_>) -> Result<(), String> {
    let state = newest(stage).await?;
    let is_whole = state.phase() != Phase::Unspecified && state.trigger() != Trigger::Unspecified;
    let is_clear = !state.input.is_empty() || !state.notice.is_empty();
    hold(is_whole && is_clear, || format!("{state:?}"))
}

async fn mutes(stage: &Stage<'_>) -> Result<(), String> {
    let muted = control(stage, Control::Mute).await?;
    hold(muted.muted && muted.phase() == Phase::Muted, || format!("after mute: {muted:?}"))?;
    let published = newest(stage).await?;
    hold(published.muted, || format!("published after mute: {published:?}"))?;
    let open = control(stage, Control::Unmute).await?;
    hold(!open.muted && open.phase() == Phase::Idle, || format!("after unmute: {open:?}"))
}

async fn refuses(stage: &Stage<'_>) -> Result<(), String> {
    let unspecified = ControlRequest { control: Control::Unspecified.into() };
    let reply = stage.cli.ask(&keys::SPEECH_CONTROL, &unspecified, &soon()).await;
    let code = reply.as_ref().err().map(|fault| fault.code);
    hold(code == Some(Code::InvalidArgument), || format!("no control: {reply:?}"))?;
    for text in [String::new(), "a".repeat(4_001)] {
        let length = text.len();
        let reply = stage.cli.ask(&keys::SPEECH_SPEAK, &SpeakRequest { text }, &soon()).await;
        let code = reply.as_ref().err().map(|fault| fault.code);
        hold(code == Some(Code::InvalidArgument), || format!("a text of {length} bytes: {reply:?}"))?;
    }
    Ok(())
}
