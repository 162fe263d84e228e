//! How long a label takes: until its words find the unit, and until the embedding of its pictures is there, through the bus.
//!
//!     cargo bench --workspace --bench labels -- --rounds 5 --image-encoder FOLDER
//!
//! `--image-encoder random` makes a model of the size of ViT-B/32 with random weights. Without a folder a tiny model encodes. Drawing
//! and the bus take what they take with any model.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::panic,
    reason = "a bench fails by its helpers and prints what it measured"
)]

mod random_clip;

use std::path::Path;
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::labeling::{Embedding, EmbeddingStatus, FindRequest, Outcome};
use sg_proto::scene::command::Action;
use sg_proto::scene::{DeleteUnit, SaveUnit};
use sg_runtime::bus::{Bus, Subscription};
use sg_runtime::context::Context;
use sg_runtime::process::block_on;
use sg_tests::bench::{argument, quantile};
use sg_tests::commands::{apply, select_range};
use sg_tests::made_scene;
use sg_tests::stack::Stack;

/// Gaussians of the labelled unit.
const SIZES: [usize; 4] = [100, 1000, 10_000, 100_000];
/// Gaussians of the scene.
const SCENE: u32 = 200_000;
/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(600);
/// Time without a change of the scene after which the service begins with a saved unit, as in its source.
const SETTLED: f64 = 20.0;

fn soon() -> Context {
    Context::root().deadline_in(PATIENCE)
}

/// One label; milliseconds.
struct Round {
    /// Until the words of the label find the unit.
    found: f64,
    /// Until the embedding is there.
    embedded: f64,
    event: Embedding,
}

fn main() {
    let rounds = argument("--rounds", 5) as usize;
    let given = std::env::args().skip_while(|a| a != "--image-encoder").nth(1);
    let folder = tempfile::tempdir().unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../services/labeling/encoders/tests/fixtures");
    let model = match given.as_deref() {
        Some("random") => random_clip::write(&fixtures.join("vit-b-32"), folder.path()).display().to_string(),
        Some(model) => model.to_owned(),
        None => fixtures.join("clip-gelu").canonicalize().unwrap().display().to_string(),
    };
    let scene = made_scene::write(folder.path(), SCENE).unwrap();
    let settings = [
        format!("service.scene.params.scene={}", scene.display()),
        format!("service.labeling.params.image_encoder={model}"),
    ];
    let stack = Stack::up_with(&settings).unwrap();
    block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        let mut events = cli.subscribe(&keys::LABELING_EMBEDDING, role::LABELING, 4096).await.unwrap();
        println!("{rounds} labels of each size; milliseconds, median\n");
        println!("| Gaussians | words find it | draw | encode | fuse | bus and the rest | embedded |");
        println!("| --- | --- | --- | --- | --- | --- | --- |");
        for size in SIZES {
            let mut played = Vec::new();
            for round in 0..rounds {
                at_rest(&cli).await;
                played.push(label(&cli, &mut events, size, round).await);
            }
            let median = |of: &dyn Fn(&Round) -> f64| quantile(&mut played.iter().map(of).collect::<Vec<f64>>(), 0.5);
            let rest = |r: &Round| r.embedded - SETTLED - r.event.render_ms - r.event.encode_ms - r.event.fuse_ms;
            println!(
                "| {size} | {:.1} | {:.0} | {:.0} | {:.3} | {:.0} | {:.0} |",
                median(&|r| r.found),
                median(&|r| r.event.render_ms),
                median(&|r| r.event.encode_ms),
                median(&|r| r.event.fuse_ms),
                median(&rest),
                median(&|r| r.embedded),
            );
        }
    })
    .unwrap();
}

/// Waits until no embedding is to come.
async fn at_rest(cli: &Bus) {
    let begun = Instant::now();
    let mut calm = 0;
    while calm < 3 {
        let state = cli.newest(&keys::LABELING_STATE, &soon()).await.unwrap();
        calm = if state.pending == 0 && !state.embedded.is_empty() { calm + 1 } else { 0 };
        assert!(begun.elapsed() < PATIENCE, "{state:?}");
        tokio::time::sleep(Duration::from_millis(400)).await;
    }
}

async fn change(cli: &Bus, action: Action) -> u64 {
    apply(cli, action, &soon()).await.unwrap().revision
}

/// Labels other Gaussians in each round: the embedding of the same ones would be stored.
async fn label(cli: &Bus, events: &mut Subscription<Embedding>, size: usize, round: usize) -> Round {
    let count = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().count as usize;
    let first = (round * (size + 1)) % (count - size);
    change(cli, select_range(count, first..first + size)).await;
    let begun = Instant::now();
    let save = SaveUnit { name: "aneurysm".to_owned(), ..SaveUnit::default() };
    let revision = change(cli, Action::SaveUnit(save)).await;
    let request =
        FindRequest { text: "the aneurism".to_owned(), at_least_revision: revision, ..FindRequest::default() };
    let reply = cli.ask(&keys::LABELING_FIND, &request, &soon()).await.unwrap();
    let found = begun.elapsed().as_secs_f64() * 1e3;
    assert_eq!(reply.outcome(), Outcome::Match, "{reply:?}");
    let event = loop {
        let (event, _) = tokio::time::timeout(PATIENCE, events.next()).await.unwrap().unwrap();
        match event.status() {
            EmbeddingStatus::Ready if event.unit == "aneurysm" => break event,
            EmbeddingStatus::Failed => panic!("{event:?}"),
            _ => {}
        }
    };
    let embedded = begun.elapsed().as_secs_f64() * 1e3;
    assert!(!event.stored, "{event:?}");
    change(cli, Action::DeleteUnit(DeleteUnit { name: "aneurysm".to_owned() })).await;
    Round { found, embedded, event }
}
