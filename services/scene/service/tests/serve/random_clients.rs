//! Random commands of many clients to a scene that is killed again and again, compared with the model in memory.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use prost::Message as _;
use sg_edit::{EditState, Editor, Replica};
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::{Command, CommandResult};
use sg_runtime::bus::Bus;
use sg_runtime::scene_replica::SceneReplica;
use supergaussian_scene::project::ProjectError;

use super::support::random_actions::RandomActions;
use super::{Stack, snapshot, soon};

/// A command with its definite answer, and the revisions between which the scene gave it.
#[derive(Debug)]
struct Answered {
    command: Command,
    answer: Result<CommandResult, Code>,
    between: (u64, u64),
}

/// What all random clients share.
#[derive(Debug, Default)]
struct Clients {
    done: AtomicBool,
    /// Highest revision that any client knows of.
    newest: AtomicU64,
    answers: AtomicU64,
}

/// Clients of one test; each has one command under way at a time.
const CLIENTS: u8 = 5;

/// Sends random commands, right and wrong, each until it has a definite answer. Now and then sends an earlier one again, or
/// another one under its id.
async fn random_client(bus: Bus, client: u8, gaussians: usize, shared: Arc<Clients>) -> Vec<Answered> {
    let mut random = RandomActions::new(gaussians, client);
    let mut answered: Vec<Answered> = Vec::new();
    while !shared.done.load(Ordering::Relaxed) {
        let newest = shared.newest.load(Ordering::SeqCst);
        let expected_revision = match random.below(12) {
            0 => newest,
            1 => newest.saturating_sub(1),
            2 => newest + 1,
            _ => 0,
        };
        let id = if random.below(50) == 0 { String::new() } else { format!("{client}-{}", answered.len()) };
        let mut command = Command { id, expected_revision, action: random.next() };
        let earlier = answered.iter().filter(|a| a.answer.is_ok()).nth(random.below(40));
        let again = earlier.filter(|_| random.below(6) == 0).map(|a| (a.command.clone(), a.answer.clone().unwrap()));
        if let Some((first, _)) = &again {
            if random.below(2) == 0 {
                command = first.clone();
            } else {
                command.id.clone_from(&first.id);
            }
        }
        let answer = loop {
            match bus.ask(&keys::SCENE_APPLY, &command, &soon()).await {
                Ok(result) => break Ok(result),
                // Killed with the question in hand: the same command again.
                Err(fault) if matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded) => {}
                Err(fault) => break Err(fault.code),
            }
        };
        shared.answers.fetch_add(1, Ordering::Relaxed);
        if let Some((first, result)) = again {
            // A command without an action asks for the result of its id.
            if command == first || command.action.is_none() {
                assert_eq!(answer, Ok(CommandResult { repeated: true, ..result }), "{command:?}");
            } else {
                assert_eq!(answer, Err(Code::AlreadyExists), "{command:?} after {first:?}");
            }
            continue;
        }
        if let Ok(result) = &answer {
            shared.newest.fetch_max(result.revision, Ordering::SeqCst);
        }
        // The others may each have had one command accepted of which nobody knows yet.
        let between = (newest, shared.newest.load(Ordering::SeqCst) + u64::from(CLIENTS));
        answered.push(Answered { command, answer, between });
    }
    answered
}

/// The whole state with everything in it. Bytes compare numbers that are not numbers, too.
fn whole(editor: &Editor) -> Vec<u8> {
    editor.message(true).encode_to_vec()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn random_commands_of_many_clients_do_what_the_model_does_through_kills() {
    const GAUSSIANS: usize = 150;
    const KILLS: u64 = 5;
    const ANSWERS: u64 = 120;
    let mut stack = Stack::open(GAUSSIANS).await;
    let cli = stack.join(role::CLI).await;
    let mut scene = stack.start();
    let reader = SceneReplica::<Replica>::follow(&cli).await.unwrap();
    let opened = snapshot(&cli).await;

    let shared = Arc::new(Clients::default());
    let roles = [role::CLI, role::SELECTION, role::RENDER_VIEW, role::AGENT_FUNCTION, role::CLI];
    let mut clients = Vec::new();
    for (client, role) in (0..CLIENTS).zip(roles) {
        clients.push(tokio::spawn(random_client(stack.join(role).await, client, GAUSSIANS, Arc::clone(&shared))));
    }
    for round in 1..=KILLS {
        let limit = Instant::now() + Duration::from_secs(40);
        while shared.answers.load(Ordering::Relaxed) < round * ANSWERS {
            assert!(Instant::now() < limit, "round {round}: no progress");
            tokio::time::sleep(Duration::from_millis(3)).await;
        }
        drop(scene);
        scene = stack.start();
    }
    while shared.answers.load(Ordering::Relaxed) < (KILLS + 1) * ANSWERS {
        tokio::time::sleep(Duration::from_millis(3)).await;
    }
    shared.done.store(true, Ordering::Relaxed);
    let mut answered = Vec::new();
    for client in clients {
        answered.extend(client.await.unwrap());
    }

    // The model takes the accepted commands in the order of their revisions.
    let file = stack.path("spiral.ply");
    let loaded = Arc::new(sg_formats::load(&file, &sg_formats::LoadOptions::default()).unwrap().scene);
    let state = EditState::from_snapshot(&opened).unwrap();
    let mut models = vec![Editor::new(loaded, state)];
    let mut accepted: Vec<(&Command, &CommandResult)> =
        answered.iter().filter_map(|a| Some((&a.command, a.answer.as_ref().ok()?))).collect();
    accepted.sort_by_key(|(_, result)| result.revision);
    for (command, result) in &accepted {
        let mut model = models.last().unwrap().clone();
        let applied = model.apply(command).unwrap_or_else(|e| panic!("the scene accepted {command:?}: {e}"));
        assert_eq!(CommandResult { repeated: result.repeated, ..applied.result }, **result, "{command:?}");
        models.push(model);
    }
    let newest = snapshot(&cli).await;
    assert_eq!(newest.encode_to_vec(), whole(models.last().unwrap()), "each accepted command once, and no other");

    // A refused command is one that the model refuses for the same reason, at a revision of that time.
    let refused = answered.iter().filter_map(|a| Some((a, *a.answer.as_ref().err()?)));
    let mut refusals = 0;
    for (answered, code) in refused {
        let (from, to) = answered.between;
        let mut model = models.iter().skip(from as usize).take((to - from + 1) as usize);
        let agrees = |model: &Editor| {
            model.clone().apply(&answered.command).is_err_and(|error| ProjectError::from(error).code() == code)
        };
        assert!(model.any(agrees), "{answered:?} is not what the model says");
        refusals += 1;
    }
    assert!(accepted.len() > 75 && refusals > 100, "{} accepted, {refusals} refused", accepted.len());

    // A reader that followed through all of this, and a start from the project file, have the same.
    let followed = reader.at_least(newest.revision, soon().deadline).await.unwrap();
    let of_model = models.last().unwrap().state().state(true).encode_to_vec();
    assert_eq!(followed.replica.state().state(true).encode_to_vec(), of_model);
    drop(scene);
    let _scene = stack.start();
    assert_eq!(snapshot(&cli).await.encode_to_vec(), newest.encode_to_vec());
}
