//! Labels through the whole stack: things that are like one another by words, and embeddings of units by their pictures.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by its helpers")]

use std::path::Path;

use sg_edit::wire::decode_mask;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::labeling::{Embedding, EmbeddingStatus, FindRequest, Outcome, ViewsRequest};
use sg_proto::scene::ChangesRequest;
use sg_runtime::bus::{Bus, Subscription};
use sg_runtime::process::block_on;
use sg_tests::small_scene::{self, GAUSSIANS};
use sg_tests::stack::Stack;
use sg_tests::until::{self, PATIENCE, scene, selected, soon};

/// A model with tiny random weights in the layout of published ones. Its embeddings mean nothing, and take no time.
fn model() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../services/labeling/encoders/tests/fixtures/clip-gelu");
    folder.canonicalize().unwrap().display().to_string()
}

/// The next event about a unit that is not its start.
async fn outcome(events: &mut Subscription<Embedding>, unit: &str) -> Embedding {
    loop {
        let (event, _) = tokio::time::timeout(PATIENCE, events.next()).await.unwrap().unwrap();
        if event.unit == unit && event.status() != EmbeddingStatus::Started {
            return event;
        }
    }
}

async fn find(cli: &Bus, text: &str) -> (Outcome, Vec<String>) {
    let revision = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision;
    let request = FindRequest { text: text.to_owned(), at_least_revision: revision, ..FindRequest::default() };
    let reply = cli.ask(&keys::LABELING_FIND, &request, &soon()).await.unwrap();
    (reply.outcome(), reply.units.iter().map(|found| found.unit.clone()).collect())
}

#[test]
fn units_get_embeddings_that_follow_their_looks_and_outlive_the_service() {
    let params =
        [format!("service.labeling.params.image_encoder={}", model()), "service.labeling.params.views=3".to_owned()];
    let stack = Stack::up_with(&params).unwrap();
    block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        let mut events = cli.subscribe(&keys::LABELING_EMBEDDING, role::LABELING, 256).await.unwrap();
        let ready =
            until::labeling(&cli, "embeddings of both units", |s| s.embedded.len() == 2 && s.pending == 0).await;
        assert_eq!((ready.image_encoder.as_str(), ready.embedded.concat().as_str()), ("clip-gelu", "bodysac"));

        // Another colour makes other pictures of this unit alone.
        stack_says(&stack, "make the sac blue");
        let event = outcome(&mut events, "sac").await;
        assert_eq!((event.status(), event.views, event.stored), (EmbeddingStatus::Ready, 3, false), "{event:?}");
        assert!(event.render_ms > 0.0 && event.encode_ms > 0.0 && event.fuse_ms > 0.0, "{event:?}");
        until::labeling(&cli, "both again", |s| s.embedded.len() == 2 && s.pending == 0).await;

        // A new label is of use at once, and its embedding follows. What was meant by words stays as it was.
        stack_says(&stack, "select the sac");
        scene(&cli, "a selection", |s| selected(s) > 0).await;
        stack_says(&stack, "label this aneurysm");
        let (found, units) = find(&cli, "the aneurysm").await;
        assert_eq!((found, units.concat().as_str()), (Outcome::Match, "aneurysm"));
        let event = outcome(&mut events, "aneurysm").await;
        assert_eq!(event.status(), EmbeddingStatus::Ready, "{event:?}");
        until::labeling(&cli, "three units", |s| s.embedded.len() == 3 && s.pending == 0).await;

        // The embeddings are stored: a restart draws nothing.
        let (status, _, all) = stack.run(&["restart", "labeling"]).unwrap();
        assert_eq!(status, Some(0), "{all}");
        for unit in ["aneurysm", "body", "sac"] {
            let event = outcome(&mut events, unit).await;
            assert!(event.status() == EmbeddingStatus::Ready && event.stored, "{event:?}");
        }
        until::labeling(&cli, "three units", |s| s.embedded.len() == 3 && s.pending == 0).await;
        // By random pictures no unit is meant for sure.
        let (found, _) = find(&cli, "the carburettor").await;
        assert_ne!(found, Outcome::Match);

        // A picture is compared with the pictures of all units, and is a question even if it is one of them.
        let view = ViewsRequest { unit: "sac".to_owned(), count: 1, pictures: true, ..ViewsRequest::default() };
        let view = cli.ask(&keys::LABELING_VIEWS, &view, &soon()).await.unwrap().views.remove(0);
        let request = |picture: &[u8]| FindRequest { picture: picture.to_vec(), ..FindRequest::default() };
        let alike = cli.ask(&keys::LABELING_FIND, &request(&view.picture), &soon()).await.unwrap();
        assert_eq!((alike.outcome(), alike.units.len()), (Outcome::Ambiguous, 3), "{alike:?}");
        for found in &alike.units {
            assert!(
                found.inferred && found.explanation.starts_with("pictures: alike by clip-gelu (cosine "),
                "{alike:?}"
            );
        }
        assert!(alike.units.windows(2).all(|pair| pair[0].score >= pair[1].score), "{alike:?}");
        let damaged = cli.ask(&keys::LABELING_FIND, &request(&view.picture[..40]), &soon()).await.unwrap_err();
        assert!(damaged.code == Code::InvalidArgument && damaged.message.contains("PNG"), "{damaged}");
    })
    .unwrap();
}

#[test]
fn things_like_this_are_found_by_their_looks() {
    let stack = Stack::up().unwrap();
    block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        // A copy of the sac looks more like it than the body does.
        stack_says(&stack, "select the sac");
        let one = scene(&cli, "a selection", |s| selected(s) > 0).await;
        stack_says(&stack, "duplicate the selection as twin");
        scene(&cli, "a copy", |s| s.base_units.len() + s.units.len() > one.base_units.len() + one.units.len()).await;
        let (found, units) = find(&cli, "things like the sac").await;
        assert_eq!((found, units.first().map(String::as_str)), (Outcome::Match, Some("twin")));
        assert!(!units.contains(&"sac".to_owned()), "{units:?}");
        let said = stack_says(&stack, "find things like the sac");
        assert!(said.contains("“things like the sac”") && said.contains("twin"), "{said}");
        stack_says(&stack, "hide the sac");
        let said = stack_says(&stack, "what looks like it?");
        assert!(said.contains("twin"), "{said}");
        // What is like nothing else is no name to give.
        stack_says(&stack, "clear the selection");
        let (status, said, _) = stack.run(&["say", "find things like this"]).unwrap();
        assert_ne!(status, Some(0));
        assert!(!said.contains("Brush it, press"), "{said}");
    })
    .unwrap();
}

#[test]
fn a_part_that_nobody_has_named_is_selected_by_its_color() {
    let folder = tempfile::tempdir().unwrap();
    let thing = small_scene::write_two_colored(folder.path()).unwrap();
    let stack = Stack::up_with(&[format!("service.scene.params.scene={}", thing.display())]).unwrap();
    block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        let said = stack_says(&stack, "select the red part");
        assert!(said.contains("No unit is “red part”") && said.contains("nobody has named"), "{said}");
        let state = scene(&cli, "a selection", |s| selected(s) > 0).await;
        let whole = ChangesRequest { from: 0, snapshot: true };
        let changes = cli.ask(&keys::SCENE_CHANGES, &whole, &soon()).await.unwrap();
        let mask = changes.snapshot.and_then(|s| s.selection).and_then(|s| s.mask).unwrap();
        let mask = decode_mask(&mask, 2 * GAUSSIANS, "mask").unwrap();
        // The red ball comes second. Nearly all of it is selected, and nearly nothing else.
        let red = mask.ones().filter(|i| *i >= GAUSSIANS).count();
        let others = mask.count() - red;
        assert!(red >= GAUSSIANS * 9 / 10 && others <= GAUSSIANS / 20, "{red} red and {others} other Gaussians");
        // It becomes a unit like any other.
        stack_says(&stack, "label this berry");
        stack_says(&stack, "clear the selection");
        stack_says(&stack, "hide the berry");
        let hidden = scene(&cli, "a hidden unit", |s| s.units.iter().any(|u| u.name == "berry" && !u.visible)).await;
        assert!(hidden.revision > state.revision);
        // What no region looks like is still unknown, and other commands ask.
        let (status, said, _) = stack.run(&["say", "select the blue part"]).unwrap();
        assert!(status != Some(0) && !said.contains("nobody has named"), "{said}");
        stack_says(&stack, "undo");
        stack_says(&stack, "undo");
        stack_says(&stack, "undo");
        let (status, said, _) = stack.run(&["say", "make the red part blue"]).unwrap();
        assert!(status != Some(0) && said.contains("select the red part"), "{said}");
    })
    .unwrap();
}

/// Says a sentence and returns the reply.
fn stack_says(stack: &Stack, sentence: &str) -> String {
    let (status, text, all) = tokio::task::block_in_place(|| stack.run(&["say", sentence])).unwrap();
    assert_eq!(status, Some(0), "{sentence}: {all}");
    text
}
