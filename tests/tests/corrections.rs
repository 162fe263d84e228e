//! Corrections of the utterance before, through the whole stack.

#![allow(clippy::unwrap_used, reason = "a test fails by its helpers")]

use sg_proto::keys::{self, role};
use sg_proto::language::{Reply, Source, Utterance};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, Command, SetBackground, SetView, State, set_view};
use sg_runtime::bus::Bus;
use sg_runtime::process::block_on;
use sg_tests::stack::Stack;
use sg_tests::until::{scene, soon};

/// Says a sentence in the conversation of the test.
async fn say(cli: &Bus, step: u32, text: &str) -> Reply {
    let utterance = Utterance { text: text.to_owned(), source: Source::Text.into(), ..Utterance::default() };
    cli.ask(&keys::UTTER, &utterance, &soon().at_step("corrections", step)).await.unwrap()
}

/// Applies a command as a window does, and returns the revision after it.
async fn apply(cli: &Bus, action: Action) -> u64 {
    let context = soon();
    let command = Command { id: context.id.clone(), action: Some(action), ..Command::default() };
    cli.ask(&keys::SCENE_APPLY, &command, &context).await.unwrap().revision
}

/// Whether everything but the viewpoint is as it was.
fn looks_as(now: &State, then: &State) -> bool {
    now.base_units == then.base_units && now.units == then.units && now.background == then.background
}

#[test]
fn what_the_utterance_before_did_is_taken_back() {
    let stack = Stack::up().unwrap();
    block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        let first = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap();

        // Two commands of one utterance are two steps.
        assert!(say(&cli, 1, "make the body red and hide the sac").await.ok);
        let changed = scene(&cli, "two changes", |s| s.undo.len() == first.undo.len() + 2).await;
        assert!(!looks_as(&changed, &first));
        let reply = say(&cli, 2, "never mind").await;
        assert!(reply.ok && reply.text.contains("2 changes"), "{reply:?}");
        scene(&cli, "the look of before", |s| looks_as(s, &first)).await;

        // The corrected one follows what is taken back, in one plan.
        assert!(say(&cli, 3, "make the body red").await.ok);
        let reply = say(&cli, 4, "no, the sac").await;
        assert!(reply.ok && reply.text.starts_with("Took back: "), "{reply:?}");
        assert!(reply.text.contains("the sac is now red"), "{reply:?}");
        let is_sac = |s: &State| s.undo.first().is_some_and(|label| label.contains("sac"));
        scene(&cli, "one change, of the sac", |s| s.undo.len() == first.undo.len() + 1 && is_sac(s)).await;

        // A correction is corrected. The viewpoint that a window has shared since stays.
        let zoom = Action::SetView(SetView { change: Some(set_view::Change::Zoom(2.0)) });
        apply(&cli, zoom).await;
        let nearer = scene(&cli, "a nearer view", |s| s.view != first.view).await;
        let reply = say(&cli, 5, "never mind").await;
        assert!(reply.ok && reply.text.starts_with("Took back"), "{reply:?}");
        scene(&cli, "the look of before", |s| looks_as(s, &first) && s.view == nearer.view).await;

        // After a change by hand nothing of it is taken back.
        assert!(say(&cli, 6, "make the body red").await.ok);
        let white = Some(Color { red: 1.0, green: 1.0, blue: 1.0 });
        let background = Action::SetBackground(SetBackground { color: white });
        let revision = apply(&cli, background).await;
        let reply = say(&cli, 7, "never mind").await;
        assert!(!reply.text.contains("Took back"), "{reply:?}");
        scene(&cli, "the same scene", |s| s.revision == revision).await;
    })
    .unwrap();
}
