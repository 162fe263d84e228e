//! Learning from a few sentences, and reading others.
#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

use sg_sentence_model::{Examples, Model, ModelError, Slot};

const SENTENCES: &str = "\
make {thing} {color}\tpaint {thing} {color}
make {thing} {color}\tpaint it {color}
make {thing} {color}\tcould you paint {thing} in {color}
make {thing} {color}\tgive {thing} a coat of {color}
make {thing} {color}\tI would like {thing} in {color}, please
make {thing} {color}\t{color} for {thing}
hide {thing}\tget rid of {thing}
hide {thing}\tI do not want to see {thing}
hide {thing}\tcould {thing} vanish
hide {thing}\ttake {thing} away, please
turn the view by {angle}\tspin it by {angle}
turn the view by {angle}\trotate {angle} please
CHAT\tthanks a lot
CHAT\tthat is very kind of you
CHAT\tgood morning to you
# things
the long thin one
everything at the top
the pink stuff
# colors
teal
a pale blue
";

fn model() -> Model {
    Model::train(&Examples::parse([("few", SENTENCES)]).unwrap(), 1)
}

/// The command of a sentence and its slots in words.
fn read<'m>(model: &'m Model, sentence: &str) -> (&'m str, Vec<(Slot, String)>) {
    let reading = model.read(sentence, ["dome", "inner wall"]).unwrap();
    let slots = reading.slots.iter().map(|(slot, place)| (*slot, sentence[place.clone()].to_owned())).collect();
    (reading.command, slots)
}

#[test]
fn a_sentence_between_the_examples_is_read() {
    let model = model();
    let slot = |slot: Slot, said: &str| (slot, said.to_owned());
    assert_eq!(
        read(&model, "could you give the dome a coat of dark red"),
        ("make {thing} {color}", vec![slot(Slot::Thing, "the dome"), slot(Slot::Color, "dark red")])
    );
    assert_eq!(
        read(&model, "get rid of the inner wall please"),
        ("hide {thing}", vec![slot(Slot::Thing, "the inner wall")])
    );
    assert_eq!(read(&model, "rotate 25 degrees"), ("turn the view by {angle}", vec![slot(Slot::Angle, "25 degrees")]));
    assert_eq!(read(&model, "thanks, very kind").0, "CHAT");
}

#[test]
fn probabilities_are_of_one_and_foreign_sentences_have_small_ones() {
    let model = model();
    for sentence in ["paint the dome teal", "zzz", "?!", "the quick brown fox jumps over the lazy dog"] {
        let reading = model.read(sentence, []).unwrap();
        assert!(reading.probability > 0.2 && reading.probability <= 1.0, "{sentence}: {reading:?}");
    }
    let (known, foreign) = (model.read("paint the dome teal", ["dome"]), model.read("zzz", []));
    assert!(known.unwrap().probability > foreign.unwrap().probability);
    assert_eq!(model.read("", []), None);
    assert_eq!(model.read(&"red ".repeat(300), []), None);
}

#[test]
fn what_no_slot_takes_is_counted() {
    let model = model();
    let left = |sentence: &str| model.read(sentence, ["dome", "sac"]).unwrap().numbers_left;
    assert_eq!((left("rotate 25 degrees"), left("good morning to you 25")), (0, 1));
    assert!(model.knows("paint") && !model.knows("piant") && !model.knows("teal"));
}

#[test]
fn things_are_those_of_the_examples() {
    let model = model();
    assert!(model.may_be_thing("the pink stuff") && model.may_be_thing("that long one"));
    assert!(!model.may_be_thing("the stock market") && !model.may_be_thing("the one of them"));
}

#[test]
fn training_and_bytes_are_the_same_each_time() {
    let model = model();
    let bytes = model.encode();
    assert_eq!(Model::train(&Examples::parse([("few", SENTENCES)]).unwrap(), 1).encode(), bytes);
    assert_eq!(Model::decode(&bytes).unwrap(), model);
}

#[test]
fn damaged_bytes_are_refused() {
    let bytes = model().encode();
    assert_eq!(Model::decode(b"something else").unwrap_err(), ModelError::OtherFormat);
    for length in [8, 9, 20, bytes.len() / 2, bytes.len() - 1] {
        assert!(Model::decode(&bytes[..length]).is_err(), "{length} bytes");
    }
    assert!(matches!(Model::decode(&[bytes.as_slice(), &[0]].concat()), Err(ModelError::Length(_))));
    let mut many = bytes.clone();
    many[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(matches!(Model::decode(&many), Err(ModelError::Value(_))));
}
