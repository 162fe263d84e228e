//! How well the sentence model reads an author from whom it has not learned.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test that cannot be set up fails")]

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use sg_sentence_model::{Examples, Model, Slot, Spoken};

fn files() -> Vec<(String, String)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/sentences");
    let text = |entry: std::io::Result<std::fs::DirEntry>| {
        let path = entry.unwrap().path();
        (path.file_stem().unwrap().to_string_lossy().into_owned(), std::fs::read_to_string(&path).unwrap())
    };
    let mut files: Vec<(String, String)> = std::fs::read_dir(folder).unwrap().map(text).collect();
    files.sort();
    files
}

fn examples(files: &[(String, String)]) -> Examples {
    Examples::parse(files.iter().map(|(name, text)| (name.as_str(), text.as_str()))).unwrap()
}

/// Whether a command asks for nothing.
fn is_nothing(command: &str) -> bool {
    !command.contains(char::is_lowercase)
}

/// How the sentences of an author are read by a model that has not seen them.
#[derive(Debug, Default)]
struct Score {
    sentences: usize,
    right: usize,
    /// Sentences with slots whose command is right, and those of them whose slots are all right.
    with_slots: usize,
    slots_right: usize,
    /// For each least probability: sentences that would be acted on, and wrong ones of these.
    acts: [(usize, usize); LEAST.len()],
}

const LEAST: [f32; 5] = [0.3, 0.45, 0.6, 0.7, 0.8];

fn score(model: &Model, held: &Examples) -> Score {
    let mut score = Score::default();
    for Spoken { text, command, slots } in held.spoken(&mut ChaCha8Rng::seed_from_u64(2)) {
        let names =
            ["vessels", "bone", "tissue", "sac", "clip", "halo", "disk", "leaf", "trunk", "hull", "rotor", "root"];
        let reading = model.read(&text, names).unwrap();
        let command = &held.commands()[command];
        let is_right = reading.command == command;
        score.sentences += 1;
        score.right += usize::from(is_right);
        if is_right && !slots.is_empty() && !is_nothing(command) {
            let said: Vec<(Slot, String)> =
                reading.slots.iter().map(|(slot, place)| (*slot, text[place.clone()].to_owned())).collect();
            score.with_slots += 1;
            score.slots_right += usize::from(said == slots);
        }
        for (least, (acts, wrong)) in LEAST.iter().zip(&mut score.acts) {
            let is_done = reading.probability >= *least && !is_nothing(reading.command);
            *acts += usize::from(is_done);
            *wrong += usize::from(is_done && !is_right);
        }
    }
    score
}

fn line(name: &str, score: &Score) -> String {
    let share = |part: usize, whole: usize| format!("{:.1} %", 100.0 * part as f64 / whole.max(1) as f64);
    let acts =
        score.acts.iter().map(|(acts, wrong)| format!("{} / {}", share(*acts, score.sentences), share(*wrong, *acts)));
    let acts: Vec<String> = acts.collect();
    let (right, slots) = (share(score.right, score.sentences), share(score.slots_right, score.with_slots));
    format!("| {name} | {} | {right} | {slots} | {} |", score.sentences, acts.join(" | "))
}

#[test]
fn an_author_whose_sentences_were_not_learned_is_mostly_understood() {
    let files = files();
    let all = examples(&files);
    assert!(all.len() > 10_000, "{} sentences", all.len());
    let author = files.iter().position(|(name, _)| name == "plain").unwrap();
    let (rest, held) = all.without_author(author);
    let score = score(&Model::train(&rest, 1), &held);
    println!("{}", line("plain", &score));
    assert!(score.right * 100 >= score.sentences * 75, "{score:?}");
    assert!(score.slots_right * 100 >= score.with_slots * 75, "{score:?}");
    let (acts, wrong) = score.acts[1];
    assert!(acts * 2 >= score.sentences && wrong * 20 <= acts * 2, "{score:?}");
}

/// `cargo test --release -p sg-language --test sentences -- --ignored --nocapture`
#[test]
#[ignore = "a measurement"]
fn each_author_by_the_others() {
    let files = files();
    let all = examples(&files);
    let heads: Vec<String> = LEAST.iter().map(|least| format!("acts at {least} / wrong")).collect();
    println!("| author | sentences | right command | right slots | {} |", heads.join(" | "));
    println!("| --- | --- | --- | --- |{}", " --- |".repeat(LEAST.len()));
    let mut sum = Score::default();
    for (author, (name, _)) in files.iter().enumerate() {
        let (rest, held) = all.without_author(author);
        let start = std::time::Instant::now();
        let model = Model::train(&rest, 1);
        let (seconds, bytes) = (start.elapsed().as_secs_f64(), model.encode().len());
        let score = score(&model, &held);
        println!("{} {seconds:.1} s, {bytes} bytes", line(name, &score));
        sum.sentences += score.sentences;
        sum.right += score.right;
        sum.with_slots += score.with_slots;
        sum.slots_right += score.slots_right;
        for ((acts, wrong), (more, more_wrong)) in sum.acts.iter_mut().zip(score.acts) {
            *acts += more;
            *wrong += more_wrong;
        }
    }
    println!("{}", line("all", &sum));
}
