//! What people say beside commands: small talk, questions about the scene, what is missing, what is out of scope.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use sg_language::{grammar, reply};
use sg_proto::language::{Act, Clause, Intent, IntentRequest, Observation, Turn};
use sg_proto::scene::{BaseUnit, Color, Selection, State, Unit};

fn scene() -> State {
    let base = |name: &str, opacity, visible, locked| BaseUnit {
        name: name.to_owned(),
        count: 100,
        opacity,
        visible,
        locked,
        ..BaseUnit::default()
    };
    let saved = |name: &str, red| Unit {
        name: name.to_owned(),
        count: 10,
        opacity: 1.0,
        visible: true,
        color: Some(Color { red, green: 0.0, blue: 0.0 }),
        ..Unit::default()
    };
    State {
        count: 300,
        base_units: vec![
            base("vessels", 1.0, true, false),
            base("bone", 1.0, false, false),
            base("tissue", 0.4, true, true),
        ],
        units: vec![saved("sac", 1.0), saved("clip", 0.0)],
        selection: Some(Selection::default()),
        background: Some(Color::default()),
        undo: vec!["made the sac red".to_owned()],
        ..State::default()
    }
}

fn after(text: &str, before: &[(&str, &str)]) -> Intent {
    let turn = |(said, answered): &(&str, &str)| Turn {
        utterance: (*said).to_owned(),
        reply: (*answered).to_owned(),
        ..Turn::default()
    };
    let request = IntentRequest {
        text: text.to_owned(),
        observation: Some(Observation { scene: Some(scene()), ..Observation::default() }),
        conversation: before.iter().map(turn).collect(),
    };
    grammar::interpret(&request).unwrap()
}

fn interpret(text: &str) -> Intent {
    after(text, &[])
}

fn acts(intent: &Intent) -> Vec<Act> {
    intent.clauses.iter().map(Clause::act).collect()
}

/// The answer to an utterance that does nothing.
#[track_caller]
fn answer(text: &str) -> String {
    let intent = interpret(text);
    assert!(intent.clauses.is_empty(), "“{text}” does {:?}", intent.clauses);
    let reply = reply::without_clauses(&intent, 0);
    assert!(reply.ok, "“{text}”: {reply:?}");
    intent.answer
}

/// The question back, or the refusal.
#[track_caller]
fn refused(text: &str) -> String {
    let intent = interpret(text);
    assert!(intent.clauses.is_empty(), "“{text}” does {:?}", intent.clauses);
    let reply = reply::without_clauses(&intent, 0);
    assert!(!reply.ok, "“{text}”: {reply:?}");
    intent.answer
}

#[test]
fn small_talk_gets_a_short_answer() {
    for (said, answered) in [
        ("thanks", "You're welcome."),
        ("Thank you so much!", "You're welcome."),
        ("Great, thanks a lot.", "You're welcome."),
        ("hello", "Hello. Say “help” for examples."),
        ("Good morning everybody", "Hello. Say “help” for examples."),
        ("bye", "Goodbye."),
        ("well done", "Glad you like it."),
        ("That looks great!", "Glad you like it."),
        ("ok", "OK."),
        ("never mind", "OK, nothing was changed."),
    ] {
        assert_eq!(answer(said), answered, "“{said}”");
    }
    assert_eq!(acts(&interpret("thanks, now hide the vessels")), [Act::Hide]);
    assert_eq!(acts(&interpret("hello, hide the vessels please")), [Act::Hide]);
}

#[test]
fn questions_about_the_scene_are_answered_from_its_state() {
    for (said, answered) in [
        ("is the bone hidden?", "Yes: the bone is hidden."),
        ("is the bone hidden or not?", "Yes: the bone is hidden."),
        ("Is the sac visible, or not?", "Yes: the sac is visible."),
        ("are the vessels still visible?", "Yes: the vessels are visible."),
        ("Can you tell me whether the tissue is locked?", "Yes: the tissue is locked."),
        ("is the sac locked", "No, the sac is not locked."),
        ("can I see the clip?", "Yes: the clip is visible."),
        ("can I still see the bone?", "No, the bone is hidden. Say “show the bone” to see it."),
        ("which colour does the sac have?", "The sac is red."),
        ("which colour has the clip", "The clip is black."),
        ("what colour are the vessels?", "The vessels have their original colours."),
        ("how transparent is the tissue at the moment?", "The tissue is 60 % transparent (40 % opacity)."),
        ("what is the background colour?", "The background is black."),
        ("how many units are there?", "5: the vessels, the bone, the tissue, the sac and the clip."),
        ("what is hidden?", "Hidden: the bone."),
        ("where does the light come from?", "The light comes from your eye, and moves with the view."),
    ] {
        assert_eq!(answer(said), answered, "“{said}”");
    }
}

#[test]
fn other_questions_reach_the_command_that_answers_them() {
    for (said, act) in [
        ("what do I have selected at the moment?", Act::QuerySelection),
        ("what did I brush?", Act::QuerySelection),
        ("what can I see here?", Act::List),
        ("Describe the scene for someone who can't see the screen", Act::Describe),
        ("help, what can I say to you", Act::Help),
        ("how big is the sac?", Act::Describe),
        ("is the aneurysm locked?", Act::Describe),
        // What is hidden is asked for by this.
        ("can I see the bone?", Act::Show),
    ] {
        assert_eq!(acts(&interpret(said)), [act], "“{said}”");
    }
}

#[test]
fn how_to_gives_examples_and_changes_nothing() {
    let said = answer("How do I make something transparent?");
    assert!(said.starts_with("Say “make the vessels transparent”") && said.contains("half transparent"), "{said}");
    let said = answer("how can I hide the clip and make the sac red?");
    assert!(said.contains("hide the clip"), "{said}");
    let said = answer("how do I change the colour of a structure?");
    assert!(said.contains("colour") && said.contains("vessels"), "{said}");
    assert!(!answer("How to measure the sac?").is_empty());
}

#[test]
fn the_last_utterance_is_explained() {
    let last = [("hide the vessels", "The vessels are now hidden.")];
    for said in ["why did you do that?", "What did you just do?", "why did you hide the vessels?"] {
        let intent = after(said, &last);
        let expected = "You said “hide the vessels”, which was read as “hide”: The vessels are now hidden. Say “undo” to take it \
                        back.";
        assert_eq!((intent.answer.as_str(), intent.clauses.len()), (expected, 0), "“{said}”");
    }
    let asked = [("how big is the sac?", "Sac: 10 Gaussians."), ("what did you do?", "…")];
    let intent = after("why?", &asked);
    assert!(intent.answer.contains("“describe”") && !intent.answer.contains("undo"), "{}", intent.answer);
    assert_eq!(answer("what happened?"), "Nothing was said before, so nothing was done.");
}

#[test]
fn what_is_out_of_scope_is_said_as_such() {
    for (said, part) in [
        ("book me a flight to Lisbon on Friday", "I can't book or buy anything. I can colour,"),
        ("Is this aneurysm going to rupture?", "I can't give medical advice."),
        ("which treatment would you recommend for this patient, clipping or coiling", "I can't give medical advice."),
        ("what's the weather like tomorrow", "I can't tell the weather or the news."),
        ("send a screenshot of this to Dr. Meier", "I can't send messages."),
        ("play some relaxing music", "I can't play music or videos."),
        ("set a timer for ten minutes", "I can't set timers or reminders."),
        ("automatically segment all the veins and separate them from the arteries", "I can't segment by myself."),
        ("what a marvellous giraffe", "I can't do that here. I can colour,"),
    ] {
        let refusal = refused(said);
        assert!(
            refusal.starts_with(part) && refusal.contains("hide") && !refusal.contains('\n'),
            "“{said}”: {refusal}"
        );
    }
    // A unit may be called so, and a command is no refusal.
    let unread = interpret("florble the sac");
    assert!(unread.answer.is_empty() && unread.suggestions.iter().any(|s| s.contains("sac")), "{unread:?}");
}

#[test]
fn a_missing_piece_is_asked_for() {
    for (said, question) in [
        ("change the colour", "Which structure, and which colour?"),
        ("give one of them another colour", "Which structure, and which colour?"),
        ("I'd like another colour for the bone", "Which colour should the bone be?"),
        ("change the opacity of the clip", "How opaque should the clip be, in percent?"),
        ("thirty percent", "Thirty percent of what?"),
        ("30 %", "30 % of what?"),
        ("could you rename that one", "Which unit, and what should it be called?"),
        ("rename the clip", "What should the clip be called?"),
        ("hide one of them", "Which structure should I hide: vessels, bone, tissue, sac or clip?"),
    ] {
        assert_eq!(refused(said), question, "“{said}”: {:?}", interpret(said));
    }
}

#[test]
fn the_answer_to_a_question_completes_the_command() {
    for (before, said, plain) in [
        ("I'd like another colour for the bone", "green", "make the bone green"),
        ("thirty percent", "the tissue", "set the opacity of the tissue to thirty percent"),
        ("change the opacity of the clip", "40 percent", "set the opacity of the clip to 40 percent"),
        ("hide one of them", "the clip", "hide the clip"),
        ("rename the clip", "Yasargil", "rename the clip to Yasargil"),
    ] {
        let meaning = |intent: Intent| {
            intent.clauses.into_iter().map(|c| Clause { words: String::new(), ..c }).collect::<Vec<_>>()
        };
        let expected = meaning(interpret(plain));
        assert!(!expected.is_empty(), "“{plain}”");
        assert_eq!(meaning(after(said, &[(before, "Which?")])), expected, "“{said}” after “{before}”");
    }
}

#[test]
fn negated_and_imagined_commands_do_nothing() {
    for said in [
        "don't hide the vessels",
        "please do not touch the background, it is fine black",
        "I never asked you to turn the tissue green",
        "leave the vessels as they are",
        "leave the sac the way it is",
    ] {
        assert_eq!(answer(said), "Nothing was changed.", "“{said}”");
    }
    for said in [
        "what would happen if I deleted the clip?",
        "what would happen if I deleted the clip and made the sac green?",
        "If the vessels were transparent, would I see the sac better?",
        "Suppose I made the tissue opaque, would I still see the sac?",
    ] {
        assert!(answer(said).starts_with("Nothing was changed."), "“{said}”");
    }
    assert_eq!(acts(&interpret("don't show the vessels")), [Act::Hide]);
    assert_eq!(acts(&interpret("if it's not too much trouble, hide the vessels")), [Act::Hide]);
    assert_eq!(acts(&interpret("Do not touch the bone. Make the sac green.")), [Act::SetColor]);
}

#[test]
fn an_answer_is_quick() {
    for said in ["how do I make something transparent?", "is the bone hidden or not?", "what a marvellous giraffe"] {
        let _ = interpret(said);
        let start = std::time::Instant::now();
        let _ = interpret(said);
        assert!(start.elapsed() < std::time::Duration::from_millis(500), "“{said}” took {:?}", start.elapsed());
    }
}
