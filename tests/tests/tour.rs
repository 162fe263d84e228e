//! The best view of a unit, kept views and tours by words, through the whole stack.

#![allow(clippy::unwrap_used, reason = "a test fails by its helpers")]

use std::time::Duration;

use sg_language::grammar;
use sg_proto::keys::{self, role};
use sg_proto::language::{Act, Reply, Tour, TourStep, Utterance};
use sg_runtime::bus::{Bus, Subscription};
use sg_runtime::process::block_on;
use sg_tests::stack::Stack;
use sg_tests::until::{PATIENCE, scene, soon};
use sg_viewer::display::tour_sentence;

/// Says a sentence; whether it was carried out, and the reply.
fn say(stack: &Stack, sentence: &str) -> (bool, String) {
    let (status, text, all) = tokio::task::block_in_place(|| stack.run(&["say", sentence])).unwrap();
    (status == Some(0), if text.is_empty() { all } else { text })
}

fn done(stack: &Stack, sentence: &str) -> String {
    let (ok, text) = say(stack, sentence);
    assert!(ok, "{sentence}: {text}");
    text
}

async fn tour(cli: &Bus) -> Option<Tour> {
    cli.newest(&keys::CORE_STATE, &soon()).await.unwrap().tour
}

/// The next stop that is shown: what it is called, and what is said about it.
async fn stop(utterances: &mut Subscription<Utterance>, replies: &mut Subscription<Reply>) -> (String, Reply) {
    let (title, id) = loop {
        let (utterance, context) = tokio::time::timeout(PATIENCE, utterances.next()).await.unwrap().unwrap();
        if utterance.text.starts_with("Tour") {
            break (utterance.text, context.conversation);
        }
    };
    loop {
        let (reply, context) = tokio::time::timeout(PATIENCE, replies.next()).await.unwrap().unwrap();
        if context.conversation == id {
            return (title, reply);
        }
    }
}

#[test]
fn views_are_found_kept_and_toured_by_words() {
    let stack = Stack::up().unwrap();
    block_on(async {
        let cli = stack.join(role::CLI).await.unwrap();
        let mut utterances = cli.subscribe(&keys::UTTERANCE, role::AGENT_CORE, 64).await.unwrap();
        let mut replies = cli.subscribe(&keys::REPLY, role::AGENT_CORE, 64).await.unwrap();
        let first = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap();

        // Views have names.
        done(&stack, "keep this view as entry");
        let said = done(&stack, "show me the best view of the sac");
        assert!(said.contains("This view shows most of the sac"), "{said}");
        let best = scene(&cli, "another view", |s| s.view != first.view).await;
        done(&stack, "keep this view as sac side");
        done(&stack, "go to the entry view");
        scene(&cli, "the first view", |s| s.view == first.view && s.kept_views.len() == 2).await;
        let said = done(&stack, "which views are kept?");
        assert!(said.contains("entry") && said.contains("sac side"), "{said}");
        done(&stack, "forget the view entry");
        scene(&cli, "one kept view", |s| s.kept_views.len() == 1).await;

        // Without a tour nothing of one can be changed.
        let (ok, said) = say(&stack, "next stop");
        assert!(!ok && said.contains("No tour is under way"), "{said}");

        // The tour shows each unit in its best view, and waits where somebody does something else.
        let said = done(&stack, "give me a tour");
        assert!(said.contains("A tour of 2 stops: the body and the sac."), "{said}");
        let (title, reply) = stop(&mut utterances, &mut replies).await;
        assert_eq!(title, "Tour, stop 1 of 2: body");
        assert!(reply.ok && reply.text.contains("This view shows most of the body"), "{reply:?}");
        let said = done(&stack, "make the body white");
        assert!(said.contains("The tour waits"), "{said}");
        let told = reply_with("The tour waits", &mut replies).await;
        assert!(told.facts.contains("The tour waits"), "{told:?}");
        until_tour(&cli, |tour| tour.as_ref().is_some_and(|tour| tour.paused && tour.at == 0)).await;
        done(&stack, "next");
        let (title, reply) = stop(&mut utterances, &mut replies).await;
        assert_eq!(title, "Tour, stop 2 of 2: sac");
        assert!(reply.ok, "{reply:?}");
        scene(&cli, "the view of before", |s| s.view == best.view).await;
        done(&stack, "previous stop");
        let (title, _) = stop(&mut utterances, &mut replies).await;
        assert_eq!(title, "Tour, stop 1 of 2: body");
        done(&stack, "pause");
        until_tour(&cli, |tour| tour.as_ref().is_some_and(|tour| tour.paused)).await;
        done(&stack, "go on");
        let (title, _) = stop(&mut utterances, &mut replies).await;
        assert_eq!(title, "Tour, stop 2 of 2: sac");
        // It goes on by itself, here to its end.
        let (title, reply) = stop(&mut utterances, &mut replies).await;
        assert_eq!((title.as_str(), reply.text.as_str()), ("Tour", "The tour ends here."));
        assert_eq!(tour(&cli).await, None);
        done(&stack, "start a tour of the sac");
        let (title, _) = stop(&mut utterances, &mut replies).await;
        assert_eq!(title, "Tour, stop 1 of 1: sac");
        done(&stack, "stop the tour");
        until_tour(&cli, Option::is_none).await;
    })
    .unwrap();
}

/// The next reply that says something.
async fn reply_with(text: &str, replies: &mut Subscription<Reply>) -> Reply {
    loop {
        let (reply, _) = tokio::time::timeout(PATIENCE, replies.next()).await.unwrap().unwrap();
        if reply.text.contains(text) {
            return reply;
        }
    }
}

/// Waits until the tour is as it should be.
async fn until_tour(cli: &Bus, holds: impl Fn(&Option<Tour>) -> bool) {
    let waiting = async {
        loop {
            let newest = tour(cli).await;
            if holds(&newest) {
                return;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(PATIENCE, waiting).await.unwrap();
}

#[test]
fn the_buttons_of_a_tour_say_what_the_grammar_reads() {
    let observation = grammar::sample_observation(&["bone", "sac"]);
    for step in [TourStep::Start, TourStep::Pause, TourStep::Resume, TourStep::Next, TourStep::Previous, TourStep::End]
    {
        let sentence = tour_sentence(step);
        let intent = grammar::parse(sentence, &observation).unwrap();
        let read: Vec<_> = intent.clauses.iter().map(|clause| (clause.act(), clause.tour())).collect();
        assert_eq!(read, [(Act::Tour, step)], "{sentence}");
    }
}
