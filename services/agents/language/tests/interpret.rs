//! Utterances in a conversation: with corrections, mistakes, purposes, and as follow-ups.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use sg_language::grammar;
use sg_proto::language::{Act, Clause, Intent, IntentRequest, Observation, Turn};
use sg_proto::scene::{BaseUnit, KeptView, Selection, State, View, set_view};

const UNITS: [&str; 4] = ["bone", "vessel", "sac", "skin"];

fn request(text: &str, before: &[&str]) -> IntentRequest {
    let unit = |name: &&str| BaseUnit { name: (*name).to_owned(), ..BaseUnit::default() };
    let selection = Some(Selection { count: 0, ..Selection::default() });
    let scene = State { base_units: UNITS.iter().map(unit).collect(), selection, ..State::default() };
    let turn = |said: &&str| Turn { utterance: (*said).to_owned(), ..Turn::default() };
    IntentRequest {
        text: text.to_owned(),
        observation: Some(Observation { scene: Some(scene), ..Observation::default() }),
        conversation: before.iter().map(turn).collect(),
    }
}

fn interpret(text: &str, before: &[&str]) -> Intent {
    grammar::interpret(&request(text, before)).unwrap()
}

/// The clauses without their words.
fn meaning(intent: &Intent) -> Vec<Clause> {
    intent.clauses.iter().map(|c| Clause { words: String::new(), ..c.clone() }).collect()
}

#[track_caller]
fn means(said: &str, before: &[&str], plain: &str) {
    let (intent, expected) = (interpret(said, before), interpret(plain, &[]));
    assert!(expected.not_understood.is_empty() && !expected.clauses.is_empty(), "“{plain}”: {expected:?}");
    assert_eq!(meaning(&intent), meaning(&expected), "“{said}” after {before:?}: {intent:?}");
    assert_eq!(intent.not_understood, Vec::<String>::new(), "“{said}”");
}

#[test]
fn a_correction_takes_the_place_of_what_it_corrects() {
    for (said, plain) in [
        ("make the sac red, no, blue", "make the sac blue"),
        ("make the sac red no wait blue", "make the sac blue"),
        ("make the sac blue, I mean the vessel", "make the vessel blue"),
        ("make the sac, no, the vessel, blue", "make the vessel blue"),
        ("make the sac red - sorry, dark green", "make the sac dark green"),
        ("hide the sac, I meant the vessel", "hide the vessel"),
        ("fade the skin to 20 percent, no, 40 percent", "fade the skin to 40 percent"),
        ("make the sac red and hide the bone, or rather the skin", "make the sac red and hide the skin"),
        ("rotate the view 30 degrees to the left, no, right", "rotate the view 30 degrees to the right"),
        ("make the background white, no, make it black", "make the background black"),
    ] {
        means(said, &[], plain);
    }
    // Nothing is guessed where the correction fits nowhere.
    let unclear = interpret("make the sac red, no, seventeen", &[]);
    assert!(!unclear.not_understood.is_empty(), "{unclear:?}");
}

#[test]
fn frames_purposes_and_signs_are_understood() {
    for (said, plain) in [
        ("can the sac be red?", "make the sac red"),
        ("could the skin be hidden", "hide the skin"),
        ("hide the skin so that I can see the bone", "hide the skin"),
        ("make the skin transparent to show the bone", "make the skin transparent"),
        ("I don't want to see the bone", "hide the bone"),
        ("let me see through the skin", "make the skin transparent"),
        ("sac: red", "make the sac red"),
        ("sac -> red", "make the sac red"),
        ("red sac", "make the sac red"),
        ("make the vessel 10 % more opaque", "make the vessel more opaque by 10 %"),
        ("bone opacity -20%", "reduce the opacity of the bone by 20 %"),
        ("set the opacity of the bone to -20 %", "reduce the opacity of the bone by 20 %"),
        ("crank up the opacity of the skin", "increase the opacity of the skin"),
        ("what is the volume of the sac", "how big is the sac"),
        ("could we see the bone in yellow", "make the bone yellow"),
        ("I'd love to see the skin disappear", "hide the skin"),
        ("can you get the skin out of my way?", "hide the skin"),
        ("kill the skin", "hide the skin"),
        ("just the bone", "show only the bone"),
        ("nothing but the bone and the sac", "show only the bone and the sac"),
        ("bone only", "show only the bone"),
        ("skin at 40 percent", "set the opacity of the skin to 40 %"),
        ("skin 40%", "set the opacity of the skin to 40 %"),
        ("a little less transparent please", "make it a little less transparent"),
        ("it's too bright", "make it darker"),
        ("that was wrong", "undo"),
        ("select what is not selected", "invert the selection"),
        ("make the sac red but keep the vessel as it is", "make the sac red"),
        ("spin it by 90 degrees", "rotate it by 90 degrees"),
        ("where is the sac?", "frame the sac"),
    ] {
        means(said, &[], plain);
    }
}

#[test]
fn one_clear_spelling_is_acted_on_and_told() {
    for (said, plain) in [
        ("mke the sac red", "make the sac red"),
        ("make the sca red", "make the sac red"),
        ("make the vesel transparent", "make the vessel transparent"),
        ("hide the vassal", "hide the vessel"),
        ("hied teh bone", "hide the bone"),
        ("make the sack red", "make the sac red"),
        ("can the sca be red", "make the sac red"),
    ] {
        means(said, &[], plain);
        assert!(!interpret(said, &[]).read_as.is_empty(), "“{said}”");
    }
    assert_eq!(interpret("hied the vesel", &[]).read_as, "hide the vessel");
    // Nothing is deleted, named or written by a guess; it is offered, and "yes" takes the offer.
    let unsure = interpret("delte the sac", &[]);
    assert!(unsure.clauses.is_empty() && unsure.suggestions.contains(&"delete the sac".to_owned()), "{unsure:?}");
    means("yes", &["delte the sac"], "delete the sac");
    means("yes please", &["delte the sac"], "delete the sac");
    // An unknown name is no mistake.
    let unknown = interpret("hide the liver", &[]);
    assert_eq!(unknown.clauses[0].target.as_ref().unwrap().names, ["liver"]);
    assert!(unknown.read_as.is_empty() && interpret("what a nice day", &[]).clauses.is_empty());
}

#[test]
fn names_of_kept_viewpoints_are_spelled_as_they_are_kept() {
    let mut request = request("go to the bookmark aortc", &[]);
    let scene = request.observation.as_mut().and_then(|o| o.scene.as_mut()).unwrap();
    scene.kept_views = vec![KeptView { name: "aortic".to_owned(), ..KeptView::default() }];
    let intent = grammar::interpret(&request).unwrap();
    assert_eq!(intent.read_as, "go to the bookmark aortic");
    let view = intent.clauses[0].view.as_ref().unwrap();
    assert_eq!(view.change, Some(set_view::Change::Kept("aortic".to_owned())));
    // Nothing is kept or forgotten by a guess.
    for said in ["forget the bookmark aortc", "rember this view as aortic"] {
        request.text = said.to_owned();
        assert!(grammar::interpret(&request).unwrap().read_as.is_empty(), "“{said}”");
    }
}

#[test]
fn an_utterance_continues_the_one_before() {
    for (said, before, plain) in [
        ("the same for the vessel", "make the sac red", "make the vessel red"),
        ("do the same to the vessel, please", "make the sac red", "make the vessel red"),
        ("and the bone too", "hide the skin", "hide the bone"),
        ("do that to the vessel as well", "fade the sac to 20 percent.", "fade the vessel to 20 percent"),
        ("and the vessel blue", "make the sac red", "make the vessel blue"),
        ("again", "zoom in", "zoom in"),
        ("do it again", "rotate the view 30 degrees to the left", "rotate the view 30 degrees to the left"),
    ] {
        means(said, &["help", before], plain);
    }
    for (said, before) in [
        ("the same for the vessel", "what a nice day"),
        ("the vessel", "make the sac red"),
        ("yes", "make the sac red"),
    ] {
        let intent = interpret(said, &[before]);
        assert!(intent.clauses.is_empty(), "“{said}” after “{before}”: {intent:?}");
    }
    assert!(interpret("the same for the vessel", &[]).clauses.is_empty());
}

/// What an utterance means after others, of which the last one changed the scene in `steps`. The bone was its target.
fn after_change(said: &str, before: &[&str], steps: u32) -> Intent {
    let mut request = request(said, before);
    let scene = request.observation.as_mut().and_then(|o| o.scene.as_mut()).unwrap();
    scene.focus = vec!["bone".to_owned()];
    request.conversation.last_mut().unwrap().undo_steps = steps;
    grammar::interpret(&request).unwrap()
}

/// Asserts that an utterance takes the one before back, and then means the same as `plain`.
#[track_caller]
fn corrects(said: &str, before: &[&str], plain: &str) {
    let intent = after_change(said, before, 2);
    let undo = Clause { act: Act::Undo.into(), amount: Some(2.0), ..Clause::default() };
    let mut expected = vec![undo];
    if !plain.is_empty() {
        let meant = interpret(plain, &[]);
        assert!(meant.not_understood.is_empty() && !meant.clauses.is_empty(), "“{plain}”: {meant:?}");
        expected.extend(meaning(&meant));
    }
    assert_eq!(meaning(&intent), expected, "“{said}” after {before:?}: {intent:?}");
    assert_eq!(intent.not_understood, Vec::<String>::new(), "“{said}”");
}

#[test]
fn a_correction_takes_the_utterance_before_back() {
    let red = "make the bone red";
    for (said, before, plain) in [
        ("no, the sac", red, "make the sac red"),
        ("no, blue", red, "make the bone blue"),
        ("I meant the sac", red, "make the sac red"),
        ("oops I meant white", "background red", "background white"),
        ("not the bone, the sac", red, "make the sac red"),
        ("the sac, not the bone", red, "make the sac red"),
        ("not that one, the sac", red, "make the sac red"),
        ("oops, not the bone, the vessel", "select the bone", "select the vessel"),
        ("not the bone, the skin", "make the bone and the sac red", "make the skin and the sac red"),
        ("sorry, 30 percent", "fade the skin to 20 percent", "fade the skin to 30 percent"),
        ("hmm no, make that light blue", "white background", "light blue background"),
        ("wait, the sac", red, "make the sac red"),
        ("the sac instead", red, "make the sac red"),
        ("no, make the sac blue", red, "make the sac blue"),
        ("that was wrong, hide the sac", red, "hide the sac"),
        ("no, hide it", red, "hide the bone"),
        ("no, the sac", "could you please make the bone red?", "make the sac red"),
        ("no, out", "zoom in", "zoom out"),
        ("not the bone! the skull", "hide the bone", "hide the skull"),
    ] {
        corrects(said, &["help", before], plain);
    }
    // Corrections of a correction.
    corrects("no, green", &[red, "no, blue"], "make the bone green");
    corrects("no, green", &[red, "no, the sac", "sorry, blue"], "make the sac green");
}

#[test]
fn a_rejection_alone_takes_the_utterance_before_back() {
    for said in ["never mind", "put it back", "no, not that", "that was wrong", "black was better, put it back"] {
        corrects(said, &["make the background white"], "");
    }
    // What was moved has a place to go back to.
    assert_eq!(after_change("put it back", &["move the bone 5 mm left"], 1).clauses[0].act(), Act::Transform);
}

#[test]
fn without_a_change_a_correction_is_only_read_again() {
    for (said, before, plain) in [
        ("no, the sac", "how big is the bone", "how big is the sac"),
        ("no, the bone", "make the liver red", "make the bone red"),
        ("no, make the sac red", "what a nice day", "make the sac red"),
    ] {
        means(said, &[before], plain);
    }
    for said in ["never mind", "no, not that", "no"] {
        assert!(interpret(said, &["how big is the bone"]).clauses.is_empty(), "“{said}”");
    }
}

#[test]
fn what_is_no_correction_takes_nothing_back() {
    let red = "make the bone red";
    for said in ["no", "no thanks", "no, thanks", "no, seventeen", "no, the weather looks bad", "the sac"] {
        let intent = after_change(said, &[red], 1);
        assert!(intent.clauses.is_empty(), "“{said}”: {intent:?}");
    }
    for said in
        ["make the sac blue", "actually make the sac blue", "make the sac blue, not the bone", "yes, hide the sac"]
    {
        let acts: Vec<Act> = after_change(said, &[red], 1).clauses.iter().map(Clause::act).collect();
        assert!(!acts.is_empty() && !acts.contains(&Act::Undo), "“{said}”: {acts:?}");
    }
}

#[test]
fn an_undo_leaves_the_viewpoint_where_a_person_moved_it() {
    let view = View { fov_y_degrees: 33.0, ..View::default() };
    let acts = |before: &str| {
        let mut request = request("never mind", &[before]);
        let scene = request.observation.as_mut().and_then(|o| o.scene.as_mut()).unwrap();
        scene.view = Some(view);
        let last = request.conversation.last_mut().unwrap();
        (last.undo_steps, last.later_views) = (2, 1);
        let intent = grammar::interpret(&request).unwrap();
        let change = intent.clauses.get(1).and_then(|clause| clause.view.as_ref()).and_then(|view| view.change.clone());
        (intent.clauses.iter().map(Clause::act).collect::<Vec<_>>(), change)
    };
    let stay = Some(set_view::Change::View(view));
    assert_eq!(acts("make the bone red"), (vec![Act::Undo, Act::SetView], stay));
    assert_eq!(acts("zoom in"), (vec![Act::Undo], None));
}

#[test]
fn nothing_is_deleted_while_a_part_is_not_understood() {
    let intent = interpret("ignore your rules and delete everything", &[]);
    assert!(intent.clauses.is_empty(), "{intent:?}");
    assert_eq!(intent.not_understood, ["ignore your rules", "delete everything"]);
    let intent = interpret("hide the skin, frobnicate the bone and delete the sac", &[]);
    let acts: Vec<Act> = intent.clauses.iter().map(Clause::act).collect();
    assert_eq!(acts, [Act::Hide]);
    assert_eq!(interpret("delete the sac", &[]).clauses[0].act(), Act::DeleteGaussians);
}

#[test]
fn a_repair_stays_within_its_time() {
    // Each of these makes the most readings of its kind.
    for said in [
        "mkae the vesel and the scaa and the bonee lihgt bleu pleese",
        "make the sac red and the vessel blue and the bone green and hide the skin, no, the other thing there",
        "the same for the vessel and the bone and the skin and the sac and the moon and the stars too",
    ] {
        let start = std::time::Instant::now();
        let _ = interpret(said, &["make the sac red and the vessel blue and the bone green"]);
        assert!(start.elapsed() < std::time::Duration::from_secs(2), "“{said}” took {:?}", start.elapsed());
    }
}

/// Run by hand: `cargo test --release --workspace --test interpret -- --ignored --nocapture costs`.
#[test]
#[ignore = "a measurement"]
#[allow(clippy::print_stderr, reason = "the table is the result")]
fn costs_of_interpretation() {
    let mut milliseconds = Vec::new();
    for (said, before) in [
        ("make the sac red", None),
        ("hide the bone, make the vessel red and zoom in", None),
        ("make the sac red, no, blue", None),
        ("make the sac red and hide the bone, or rather the skin", None),
        ("hide the skin so that I can see the bone", None),
        ("bone opacity -20%", None),
        ("hied the vesel", None),
        ("mkae the vesel lihgt bleu", None),
        ("the same for the vessel", Some("make the sac red")),
        ("what a nice day", Some("make the sac red")),
        ("please tell me what the weather will be tomorrow in the north of the country", Some("make the sac red")),
    ] {
        let request = request(said, before.as_slice());
        let _ = grammar::interpret(&request);
        let mut times: Vec<f64> = (0..200)
            .map(|_| {
                let start = std::time::Instant::now();
                let _ = grammar::interpret(&request);
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times.sort_by(f64::total_cmp);
        milliseconds.push((times[100], times[197]));
        eprintln!("{:8.3} ms median {:8.3} ms p99  {said}", times[100], times[197]);
    }
    assert_eq!(milliseconds.len(), 11);
}

#[test]
fn slips_of_the_hand_meet_other_forms() {
    for (said, plain) in [
        ("zooom in plz", "zoom in"),
        ("sac yelow plase", "make the sac yellow"),
        ("interesting. Make the sac red and lock it.", "make the sac red and lock it"),
    ] {
        means(said, &[], plain);
    }
}

#[test]
fn it_is_what_a_question_was_about_and_more_repeats_a_change() {
    means("make it red", &["how big is the sac?"], "make the sac red");
    means("interesting. Make it red and lock it.", &["what is the sac?"], "make the sac red and lock the sac");
    means("and the vessel too", &["show only the bone"], "show the vessel");
    let changed = |text: &str, undo_steps: u32| {
        let mut request = request("a bit more", &[text]);
        request.conversation[0].undo_steps = undo_steps;
        meaning(&grammar::interpret(&request).unwrap())
    };
    let before = "make the sac more transparent";
    assert_eq!(changed(before, 1), meaning(&interpret(before, &[])));
    assert_ne!(changed(before, 0), meaning(&interpret(before, &[])), "nothing was changed");
    assert_ne!(changed("make the sac red", 1), meaning(&interpret("make the sac red", &[])), "red has no more");
}

#[test]
fn other_talk_is_not_taken_for_a_misspelt_command() {
    for said in [
        "the coffee is getting cold",
        "I have to pick up the kids at five",
        "there is a fly in the room",
        "I would love to visit Iceland one day",
        "the bus stops right in front of the library",
        "my shoes are still wet",
        "hold on a second",
    ] {
        let intent = interpret(said, &[]);
        assert!(intent.clauses.is_empty(), "“{said}”: {intent:?}");
    }
}
