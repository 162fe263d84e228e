//! Questions about the state of the scene, answered from the observation: "is the bone hidden?", "which colour has the clip?".

use sg_proto::language::{Act, Observation};
use sg_proto::scene::State;

use super::Reader;
use super::sentence::Sentence;
use super::word_pattern::{core, matched, words};
use crate::state_answer::{self, Quality};
use crate::syntax::token::{Token, text_of};
use crate::unit_names::{self, Lookup};

/// What is asked of a unit.
#[derive(Debug, Clone, Copy)]
enum OfUnit {
    Is(Quality),
    /// Whether it is seen. What is hidden is asked for by such a question, so that there is an answer only if it is visible.
    Seen,
    Color,
    Opacity,
}

/// What is asked of the scene.
#[derive(Debug, Clone, Copy)]
enum OfScene {
    Background,
    Light,
    Count,
    With(Quality),
}

/// Questions about a unit X.
const UNIT_QUESTIONS: [(&str, OfUnit); 29] = [
    ("is/are/isn't/aren't X visible/shown/displayed/drawn", OfUnit::Is(Quality::Visible)),
    ("is/are/isn't/aren't X hidden/invisible", OfUnit::Is(Quality::Hidden)),
    ("is/are/isn't/aren't X locked/protected", OfUnit::Is(Quality::Locked)),
    ("is/are/isn't/aren't X unlocked/editable", OfUnit::Is(Quality::Unlocked)),
    ("is/are/isn't/aren't X transparent/translucent", OfUnit::Is(Quality::Transparent)),
    ("is/are/isn't/aren't X see through", OfUnit::Is(Quality::Transparent)),
    ("is/are/isn't/aren't X opaque/solid", OfUnit::Is(Quality::Opaque)),
    ("whether/if X is/are visible/shown/displayed/drawn", OfUnit::Is(Quality::Visible)),
    ("whether/if X is/are hidden/invisible", OfUnit::Is(Quality::Hidden)),
    ("whether/if X is/are locked/protected", OfUnit::Is(Quality::Locked)),
    ("whether/if X is/are unlocked/editable", OfUnit::Is(Quality::Unlocked)),
    ("whether/if X is/are transparent/translucent", OfUnit::Is(Quality::Transparent)),
    ("whether/if X is/are opaque/solid", OfUnit::Is(Quality::Opaque)),
    ("can/could/do i/we/you/one still see X", OfUnit::Is(Quality::Visible)),
    ("do i/we/you see X", OfUnit::Is(Quality::Visible)),
    ("can/could i/we/you/one see X", OfUnit::Seen),
    ("which/what colour/color/colours/colors does/do X have", OfUnit::Color),
    ("which/what colour/color/colours/colors has/have X", OfUnit::Color),
    ("which/what colour/color is/are/'s X", OfUnit::Color),
    ("what is/are/'s the colour/color/colours/colors of X", OfUnit::Color),
    ("what is/are/'s X 's colour/color", OfUnit::Color),
    ("how is/are X coloured/colored", OfUnit::Color),
    ("how transparent/opaque/solid/translucent is/are X", OfUnit::Opacity),
    ("how see through is/are X", OfUnit::Opacity),
    ("what is/'s the opacity/transparency/alpha of X", OfUnit::Opacity),
    ("what is/'s X 's opacity/transparency/alpha", OfUnit::Opacity),
    ("which/what opacity/transparency does/do X have", OfUnit::Opacity),
    ("which/what opacity/transparency has/have X", OfUnit::Opacity),
    ("at which/what opacity is/are X", OfUnit::Opacity),
];

/// Questions about the scene.
const SCENE_QUESTIONS: [(&str, OfScene); 27] = [
    ("which/what colour/color is/has the background", OfScene::Background),
    ("which/what colour/color does the background have", OfScene::Background),
    ("what is/'s the colour/color of the background", OfScene::Background),
    ("what is/'s the background colour/color", OfScene::Background),
    ("which/what background colour/color is it/this/that/there", OfScene::Background),
    ("which/what background colour/color do i/we have", OfScene::Background),
    ("what is/'s the background", OfScene::Background),
    ("where does the light come from", OfScene::Light),
    ("from where does the light come", OfScene::Light),
    ("where is/'s the light coming from", OfScene::Light),
    ("where is/'s the light", OfScene::Light),
    ("where is/'s the light source", OfScene::Light),
    ("from which/what direction/side does the light come", OfScene::Light),
    ("which/what direction/side does the light come from", OfScene::Light),
    ("what is/'s the light direction", OfScene::Light),
    ("what is/'s the direction of the light", OfScene::Light),
    ("how many units/structures/parts/labels/objects/segments are there", OfScene::Count),
    ("how many units/structures/parts/labels/objects/segments are/exist", OfScene::Count),
    ("how many units/structures/parts/labels/objects/segments do i/we/you have", OfScene::Count),
    ("how many units/structures/parts/labels/objects/segments does the scene have", OfScene::Count),
    ("how many units/structures/parts/labels/objects/segments has the scene", OfScene::Count),
    ("what/which is/are/'s hidden/invisible", OfScene::With(Quality::Hidden)),
    ("what/which units/structures/parts/objects is/are hidden/invisible", OfScene::With(Quality::Hidden)),
    ("is/are anything/something/any hidden/invisible", OfScene::With(Quality::Hidden)),
    ("what/which is/are/'s locked/protected", OfScene::With(Quality::Locked)),
    ("what/which units/structures/parts/objects is/are locked/protected", OfScene::With(Quality::Locked)),
    ("is/are anything/something/any locked/protected", OfScene::With(Quality::Locked)),
];

/// Questions and the command that answers them.
const REWORDED: [(&str, &str); 9] = [
    ("what did i/we brush/mark/paint/pick/select", "what is selected"),
    ("what have i/we brushed/marked/painted/picked/selected", "what is selected"),
    ("what do/did i/we have selected/brushed/marked", "what is selected"),
    ("how much/many did i/we brush/mark/select", "how big is the selection"),
    ("describe the scene/picture/view for X", "describe the scene"),
    ("what can/could/should/may i/we say/ask to you", "help"),
    ("what can/could/should/may i/we say/ask/do here", "help"),
    ("what can/could/should/may i/we do with you/this", "help"),
    ("what should/could i/we do", "help"),
];

/// Acts that answer questions.
const ANSWERING: [Act; 5] = [Act::List, Act::ListViews, Act::QuerySelection, Act::Describe, Act::Help];

/// Words before a question.
const LEADS: [&str; 34] = [
    "please",
    "can you tell me",
    "could you tell me",
    "can you say",
    "could you say",
    "can you please tell me",
    "could you please tell me",
    "tell me",
    "do you know",
    "i would like to know",
    "i'd like to know",
    "i want to know",
    "i need to know",
    "i wonder",
    "i was wondering",
    "excuse me",
    "sorry",
    "hey",
    "hi",
    "hello",
    "help",
    "ok",
    "okay",
    "so",
    "and",
    "but",
    "well",
    "now",
    "then",
    "wait",
    "quick question",
    "one question",
    "remind me",
    "actually",
];

/// Words behind a question.
const TAILS: [&str; 26] = [
    "or not",
    "right now",
    "at the moment",
    "at present",
    "at all",
    "currently",
    "presently",
    "now",
    "here",
    "please",
    "still",
    "already",
    "yet",
    "anyway",
    "then",
    "exactly",
    "actually",
    "again",
    "today",
    "in here",
    "in this scene",
    "in the scene",
    "in the picture",
    "on the screen",
    "on my screen",
    "thanks",
];

/// Words between a unit and what is asked of it.
const SOFTENERS: [&str; 11] =
    ["currently", "now", "still", "already", "really", "actually", "completely", "fully", "totally", "partly", "also"];

/// Words for the unit of the last command.
const PRONOUNS: [&str; 5] = ["it", "this", "that", "them", "they"];

/// First words of a name that the labeling service may know.
const ARTICLES: [&str; 5] = ["the", "this", "that", "my", "our"];

/// Most words of such a name, with its article.
const MOST_NAME_WORDS: usize = 4;

/// The answer to a question about the state of the scene.
pub(super) fn answer(source: &str, tokens: &[Token], observation: &Observation) -> Option<String> {
    let scene = observation.scene.as_ref()?;
    let frame = observation.frame.as_ref().filter(|frame| frame.revision == scene.revision);
    let words = words(tokens);
    let question = core(&words, &LEADS, &TAILS);
    let of_unit = |(pattern, asked): &(&str, OfUnit)| {
        let name = unit_of(source, matched(question, pattern)?, scene)?;
        match asked {
            OfUnit::Is(quality) => state_answer::yes_or_no(name, *quality, scene, frame),
            OfUnit::Seen if !state_answer::is_visible(name, scene) => None,
            OfUnit::Seen => state_answer::yes_or_no(name, Quality::Visible, scene, frame),
            OfUnit::Color => state_answer::color_of(name, scene),
            OfUnit::Opacity => state_answer::opacity_of(name, scene),
        }
    };
    UNIT_QUESTIONS.iter().find_map(of_unit).or_else(|| {
        let (_, asked) = SCENE_QUESTIONS.iter().find(|(pattern, _)| matched(question, pattern).is_some())?;
        Some(match asked {
            OfScene::Background => state_answer::background(scene),
            OfScene::Light => state_answer::light(scene),
            OfScene::Count => state_answer::count(scene),
            OfScene::With(quality) => state_answer::all_with(*quality, scene),
        })
    })
}

/// The unit that some words name.
fn unit_of<'s>(source: &str, words: &[Token], scene: &'s State) -> Option<&'s str> {
    let end = words.iter().rposition(|t| !SOFTENERS.contains(&t.text.as_str()))? + 1;
    let said = words.get(..end)?;
    let names = unit_names::all(scene);
    match said {
        [only] if PRONOUNS.contains(&only.text.as_str()) => match scene.focus.as_slice() {
            [name] => names.into_iter().find(|known| known == name),
            _ => None,
        },
        _ => match unit_names::lookup(text_of(source, said), &names) {
            Lookup::Unique(name) => Some(name),
            Lookup::Ambiguous(_) | Lookup::Missing(_) => None,
        },
    }
}

/// The reading of a question in words that the table of commands has.
pub(super) fn reworded(reader: &Reader<'_>, source: &str, tokens: &[Token]) -> Option<Sentence> {
    let words = words(tokens);
    let question = core(&words, &LEADS, &TAILS);
    let is_answer = |sentence: &Sentence| {
        sentence.not_understood.is_empty()
            && !sentence.clauses.is_empty()
            && sentence.clauses.iter().all(|clause| ANSWERING.contains(&clause.act()))
    };
    if let Some((_, command)) = REWORDED.iter().find(|(pattern, _)| matched(question, pattern).is_some()) {
        return Some(reader.read(command)).filter(is_answer);
    }
    let shorter = (question.len() < words.len()).then(|| reader.read(text_of(source, question)));
    shorter.filter(|sentence| sentence.is_certain() && is_answer(sentence)).or_else(|| {
        // The labeling service may know the name.
        let questions = UNIT_QUESTIONS.iter().filter(|(_, asked)| !matches!(asked, OfUnit::Seen));
        let object = questions.filter_map(|(pattern, _)| matched(question, pattern)).next()?;
        let has_article = object.first().is_some_and(|t| ARTICLES.contains(&t.text.as_str()));
        let is_name = has_article && (2..=MOST_NAME_WORDS).contains(&object.len());
        let described = is_name.then(|| reader.read(&format!("describe {}", text_of(source, object))));
        described.filter(|sentence| sentence.unknown <= 1 && is_answer(sentence))
    })
}
