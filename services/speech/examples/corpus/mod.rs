//! What the measurements speak: voices, noise, and the sentences of a table of commands.

#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "each example uses a part; a measurement may stop"
)]

pub(crate) mod calibration;
pub(crate) mod report;

use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sg_speech::audio::resample::resample;
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::child_process::Limits;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::Synthesizer;
use sg_speech::synthesis::{Espeak, Flite};

/// Templates of commands, in the words of the examples in the table of `sg-language`.
const TEMPLATES: [&str; 66] = [
    "make the {unit} {color}",
    "(paint | color | turn) the {unit} {color}",
    "make the {unit} {color} and the {other} {color}",
    "set the color of the {unit} to {color}",
    "give the {unit} a {color} color",
    "restore the color of the {unit}",
    "fade (the {unit} | everything else | everything) to {percent} percent",
    "set the opacity of the {unit} to {percent} percent",
    "make the {unit} half transparent",
    "make (it | the {unit}) (more | less) transparent",
    "dim the {unit} by {percent} percent",
    "make the {unit} opaque",
    "(hide | show) (the {unit} | everything | everything else)",
    "hide the {unit} and the {other}",
    "show only the {unit}",
    "isolate the {unit}",
    "show the {unit} alone",
    "bring back the {unit}",
    "switch off the {unit}",
    "make the {unit} (visible | invisible)",
    "frame (the {unit} | the selection)",
    "look at the {unit}",
    "zoom to the selection",
    "zoom (in | out) [twice | a bit]",
    "zoom to two hundred percent",
    "rotate (left | right | up | down) {degrees} degrees",
    "turn it (left | right | up | down)",
    "view from the (top | front | left | right | back)",
    "show it from below",
    "reset the view",
    "undo [twice]",
    "redo [twice]",
    "take back the last three changes",
    "reset the appearance",
    "start over",
    "select the {unit}",
    "add the {other} to the selection",
    "remove the {other} from the selection",
    "invert the selection",
    "clear the selection",
    "deselect",
    "call this the {unit}",
    "save the selection as {unit}",
    "update the {unit}",
    "rename the {unit} to {name}",
    "merge the {unit} (and | with) the {other}",
    "duplicate the {unit}",
    "delete the (selection | {unit})",
    "(lock | unlock) the {unit}",
    "unlock everything",
    "move the {unit} (up | down | left | right)",
    "rotate the {unit} by {degrees} degrees",
    "make the {unit} twice as big",
    "put the {unit} back",
    "make the background (black | white | grey)",
    "make the {unit} (brighter | darker | warmer)",
    "use a headlight",
    "light from the (left | right)",
    "(more | less) (specular | ambient)",
    "save a picture",
    "save a copy",
    "list the units",
    "what is (selected | the {unit})",
    "how big is the (selection | {unit})",
    "describe the scene",
    "(help | what can i say)",
];

const COLORS: [&str; 12] = [
    "red",
    "green",
    "blue",
    "yellow",
    "orange",
    "white",
    "grey",
    "brown",
    "purple",
    "light blue",
    "dark red",
    "forest green",
];

/// The grammar that a process would make for a scene with these labels.
pub(crate) fn grammar(labels: &[&str]) -> PhraseGrammar {
    let mut grammar = PhraseGrammar::new();
    grammar.set_slot("unit", labels).unwrap();
    grammar.set_slot("other", labels).unwrap();
    grammar.set_slot("color", COLORS).unwrap();
    grammar.set_slot("name", ["dome", "aneurysm", "neck", "root"]).unwrap();
    grammar.set_slot("percent", (1..=20).map(|n| (n * 5).to_string())).unwrap();
    grammar.set_slot("degrees", ["10", "15", "20", "30", "45", "60", "90", "180"]).unwrap();
    for template in TEMPLATES {
        grammar.add(template).unwrap();
    }
    grammar
}

/// A voice by name.
pub(crate) struct Voice {
    pub(crate) name: &'static str,
    pub(crate) synthesizer: Box<dyn Synthesizer>,
}

/// flite's `slt` (female) and `rms` (male), and espeak-ng. The calibration has other voices where there are some.
pub(crate) fn voices() -> Vec<Voice> {
    let path = std::env::var_os("PATH");
    let flite = |voice| Box::new(Flite::find(path.as_deref(), voice).expect("flite"));
    vec![
        Voice { name: "slt", synthesizer: flite("slt") },
        Voice { name: "rms", synthesizer: flite("rms") },
        Voice {
            name: "espeak",
            synthesizer: Box::new(Espeak::find(path.as_deref(), "en-us", 165).expect("espeak-ng")),
        },
    ]
}

/// Voices that no report uses.
pub(crate) fn calibration_voices() -> Vec<Voice> {
    let path = std::env::var_os("PATH");
    let flite = |voice| Box::new(Flite::find(path.as_deref(), voice).expect("flite"));
    let espeak = |voice| Box::new(Espeak::find(path.as_deref(), voice, 155).expect("espeak-ng"));
    vec![
        Voice { name: "awb", synthesizer: flite("awb") },
        Voice { name: "kal16", synthesizer: flite("kal16") },
        Voice { name: "slt", synthesizer: flite("slt") },
        Voice { name: "espeak +f2", synthesizer: espeak("en-us+f2") },
    ]
}

/// A sentence at 16 kHz at a peak of 0.4, with silence around it as an endpointer leaves it.
pub(crate) fn say(voice: &Voice, sentence: &str) -> Vec<f32> {
    let sound = voice.synthesizer.synthesize(sentence, &Limits::within(Duration::from_secs(30))).expect(sentence);
    let samples = resample(&sound, SPEECH_RATE).expect("resampling").samples;
    let peak = samples.iter().fold(1e-6_f32, |peak, s| peak.max(s.abs()));
    // The programs add silence of their own; it is cut so that all voices have the same.
    let loud = |s: &f32| s.abs() > 0.02 * peak;
    let (first, last) = (samples.iter().position(loud).unwrap_or(0), samples.iter().rposition(loud).unwrap_or(0));
    let silence = vec![0.0; (SPEECH_RATE as usize) * 3 / 10];
    let speech: Vec<f32> = samples[first..=last].iter().map(|s| s * 0.4 / peak).collect();
    [silence.clone(), speech, silence].concat()
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Noise {
    None,
    White,
    Babble,
}

/// Babble of many sentences at once.
pub(crate) fn babble(voices: &[Voice], sentences: &[&str], seconds: usize) -> Recording {
    let mut samples = vec![0.0_f32; seconds * SPEECH_RATE as usize];
    let mut rng = ChaCha8Rng::seed_from_u64(77);
    for talker in 0..6 {
        let voice = &voices[talker % voices.len()];
        let mut at = rng.random_range(0..SPEECH_RATE as usize);
        while at < samples.len() {
            let said = say(voice, sentences[rng.random_range(0..sentences.len())]);
            // Lower, so that no talker stands out.
            for (sum, sample) in samples[at..].iter_mut().zip(&said) {
                *sum += sample;
            }
            at += said.len() * 3 / 4;
        }
    }
    Recording { rate: SPEECH_RATE, samples }
}

fn power(samples: &[f32]) -> f64 {
    samples.iter().map(|s| f64::from(s * s)).sum::<f64>() / samples.len().max(1) as f64
}

/// Adds noise at a ratio in decibels to the power of the speech alone, `speech` samples of the sound.
pub(crate) fn add_noise(
    sound: &mut [f32],
    speech_power: f64,
    noise: Noise,
    snr_db: f64,
    babble: &Recording,
    seed: u64,
) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let raw: Vec<f32> = match noise {
        Noise::None => return,
        Noise::White => (0..sound.len()).map(|_| rng.random_range(-1.0_f32..1.0)).collect(),
        Noise::Babble => {
            let at = rng.random_range(0..babble.samples.len().saturating_sub(sound.len()).max(1));
            babble.samples[at..].iter().copied().take(sound.len()).collect()
        }
    };
    let gain = (speech_power / power(&raw).max(1e-12) / 10_f64.powf(snr_db / 10.0)).sqrt() as f32;
    for (sample, noise) in sound.iter_mut().zip(&raw) {
        *sample = (*sample + gain * noise).clamp(-1.0, 1.0);
    }
}

/// Power of the speech in a sound of [`say`], without the silence around it.
pub(crate) fn speech_power(sound: &[f32]) -> f64 {
    let around = SPEECH_RATE as usize * 3 / 10;
    power(&sound[around..sound.len() - around])
}

/// A sentence in noise.
pub(crate) fn noisy(sound: &[f32], noise: Noise, snr_db: f64, babble: &Recording, seed: u64) -> Vec<f32> {
    let mut mixed = sound.to_vec();
    add_noise(&mut mixed, speech_power(sound), noise, snr_db, babble, seed);
    mixed
}
