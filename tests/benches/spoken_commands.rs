//! The time from the end of a spoken command to its text, to its effect on the scene, and to the first sound of the reply, in a
//! running stack. The microphone and the loudspeaker are named pipes at the pace of real time.
//!
//!     cargo bench --workspace --bench spoken_commands
//!     cargo bench --workspace --bench spoken_commands -- --recognizer whisper --model FOLDER --rounds 3
//!
//! Needs flite, and what recognises.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench fails by its helpers and prints what it measured"
)]

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use sg_proto::keys::{self, role};
use sg_proto::speech::Phase;
use sg_runtime::bus::{Bus, Subscription};
use sg_speech::audio::Recording;
use sg_tests::bench::{argument, quantile};
use sg_tests::stack::Stack;
use sg_tests::until::{self, PATIENCE, recognized};
use sg_tests::voice::spoken;

/// Commands with an effect on the scene, whatever came before.
const COMMANDS: [&str; 10] = [
    "make the sac red",
    "hide the body",
    "show the body",
    "make the body blue",
    "hide the sac",
    "show everything",
    "make the sac half transparent",
    "make the sac green",
    "show only the sac",
    "show everything",
];

/// Samples that are played or read at once: 10 ms.
const BLOCK: usize = 160;
/// A sample above this is heard.
const AUDIBLE: f32 = 0.01;

/// The value behind a name on the command line.
fn text_argument(name: &str) -> Option<String> {
    std::env::args().skip_while(|argument| argument != name).nth(1)
}

/// A microphone that hears silence, and the sounds that are sent to it. Each sound is answered with the time at which its last
/// audible sample was written.
struct Microphone {
    sounds: Sender<Vec<f32>>,
    ends: Receiver<Instant>,
}

impl Microphone {
    fn start(path: PathBuf) -> Self {
        let (sounds, queue) = channel::<Vec<f32>>();
        let (end, ends) = channel();
        std::thread::spawn(move || {
            let mut pipe = std::fs::OpenOptions::new().write(true).open(path).unwrap();
            let (mut sound, mut at, mut last): (Vec<f32>, usize, Option<usize>) = (Vec::new(), 0, None);
            let mut due = Instant::now();
            loop {
                if at >= sound.len()
                    && let Ok(next) = queue.try_recv()
                {
                    last = next.iter().rposition(|sample| sample.abs() > AUDIBLE);
                    (sound, at) = (next, 0);
                }
                let block: Vec<f32> =
                    sound.iter().skip(at).copied().chain(std::iter::repeat(0.0)).take(BLOCK).collect();
                let bytes: Vec<u8> = block.iter().flat_map(|s| ((s * 32_767.0) as i16).to_le_bytes()).collect();
                if pipe.write_all(&bytes).is_err() {
                    return;
                }
                if last.is_some_and(|last| (at..at + BLOCK).contains(&last)) && end.send(Instant::now()).is_err() {
                    return;
                }
                at += BLOCK;
                due += Duration::from_millis(10);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        });
        Self { sounds, ends }
    }

    /// Says a sentence, and returns when its last sound was played.
    fn say(&self, sentence: &Recording) -> Instant {
        self.sounds.send(sentence.samples.clone()).unwrap();
        self.ends.recv_timeout(PATIENCE).unwrap()
    }
}

/// A loudspeaker that notes when sound began after silence.
struct Loudspeaker {
    sounded: Arc<Mutex<Option<Instant>>>,
}

impl Loudspeaker {
    fn start(path: &Path) -> Self {
        let sounded = Arc::new(Mutex::new(None));
        // Open for both, so that there is a reader before the service begins.
        let mut pipe = std::fs::OpenOptions::new().read(true).write(true).open(path).unwrap();
        let noted = sounded.clone();
        std::thread::spawn(move || {
            let mut bytes = [0_u8; 4_096];
            while let Ok(count) = pipe.read(&mut bytes) {
                let samples = bytes[..count].chunks_exact(2).map(|pair| i16::from_le_bytes([pair[0], pair[1]]));
                if samples.into_iter().any(|sample| f32::from(sample).abs() / 32_767.0 > AUDIBLE) {
                    noted.lock().unwrap().get_or_insert_with(Instant::now);
                }
            }
        });
        Self { sounded }
    }
}

/// Times of all commands, milliseconds.
#[derive(Default)]
struct Times {
    text: Vec<f64>,
    action: Vec<f64>,
    sound: Vec<f64>,
    recognition: Vec<f64>,
    missed: Vec<String>,
}

/// Waits until nothing sounds.
async fn quiet(bus: &Bus) {
    until::speech(bus, "an idle microphone", |state| state.phase() == Phase::Idle && !state.input.is_empty()).await;
    // The last blocks of a reply are on their way.
    tokio::time::sleep(Duration::from_millis(700)).await;
}

/// Takes what is left of the command before.
async fn drain<M: Clone>(stream: &mut Subscription<M>) {
    while tokio::time::timeout(Duration::from_millis(20), stream.next()).await.is_ok_and(|next| next.is_some()) {}
}

async fn measure(stack: &Stack, microphone: &Microphone, loudspeaker: &Loudspeaker, rounds: u32) -> Times {
    let cli = stack.join(role::CLI).await.unwrap();
    let mut texts = cli.subscribe(&keys::SPEECH_RECOGNITION, role::SPEECH, 256).await.unwrap();
    let mut commits = cli.subscribe(&keys::SCENE_EVENT, role::SCENE, 256).await.unwrap();
    let mut times = Times::default();
    let sentences: Vec<(&str, Recording)> = COMMANDS.iter().map(|sentence| (*sentence, spoken(sentence))).collect();
    for (sentence, sound) in (0..rounds).flat_map(|_| &sentences) {
        quiet(&cli).await;
        drain(&mut texts).await;
        drain(&mut commits).await;
        *loudspeaker.sounded.lock().unwrap() = None;
        let ended = tokio::task::block_in_place(|| microphone.say(sound));
        let since = |instant: Instant| instant.saturating_duration_since(ended).as_secs_f64() * 1e3;
        let text = recognized(&cli, &mut texts).await;
        times.text.push(since(Instant::now()));
        times.recognition.push(text.elapsed_ms);
        let committed = async {
            if text.accepted { tokio::time::timeout(Duration::from_secs(5), commits.next()).await.ok() } else { None }
        };
        if committed.await.is_none() {
            times.missed.push(format!("{sentence} -> {}", text.text));
            continue;
        }
        times.action.push(since(Instant::now()));
        let begun = Instant::now();
        let first = loop {
            let first = *loudspeaker.sounded.lock().unwrap();
            if first.is_some() || begun.elapsed() > Duration::from_secs(5) {
                break first;
            }
            tokio::time::sleep(Duration::from_millis(2)).await;
        };
        times.sound.extend(first.map(since));
    }
    times
}

fn main() {
    let rounds = argument("--rounds", 2);
    let chosen =
        text_argument("--recognizer").map_or_else(|| vec!["whisper".to_owned(), "sphinx".to_owned()], |r| vec![r]);
    println!("| recognizer | commands | with effect | recognition | text | effect | first sound |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    for recognizer in chosen {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        ["microphone", "loudspeaker"].iter().for_each(|name| mkfifo(&at(name), Mode::S_IRWXU).unwrap());
        let loudspeaker = Loudspeaker::start(&at("loudspeaker"));
        let mut settings = vec![
            format!("service.speech.params.input={}", at("microphone").display()),
            format!("service.speech.params.output={}", at("loudspeaker").display()),
            format!("service.speech.params.recognizer={recognizer}"),
        ];
        settings.extend(text_argument("--model").map(|model| format!("service.speech.params.model={model}")));
        let stack = Stack::up_with(&settings).unwrap();
        let microphone = Microphone::start(at("microphone"));
        let mut times = runtime.block_on(measure(&stack, &microphone, &loudspeaker, rounds));
        let commands = times.text.len();
        let effects = times.action.len();
        let shown = |list: &mut Vec<f64>| format!("{:.0} ({:.0})", quantile(list, 0.5), quantile(list, 0.9));
        let columns = [&mut times.recognition, &mut times.text, &mut times.action, &mut times.sound].map(shown);
        println!("| {recognizer} | {commands} | {effects} | {} |", columns.join(" | "));
        times.missed.iter().for_each(|missed| println!("    {missed}"));
    }
    println!("Milliseconds from the end of the voice, of the recognition by itself: median (90 %).");
}
