//! Commands by voice through the whole stack: text, voice, pipe, text, agents, scene, reply, voice, text.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test fails by its helpers and says what it skips"
)]

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use sg_proto::keys::{self, role};
use sg_proto::scene::State;
use sg_proto::speech::{Control, ControlRequest, Phase, SpeakRequest};
use sg_runtime::bus::Bus;
use sg_runtime::process::block_on;
use sg_speech::audio::wav::{MAX_DURATION, read_wav};
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::synthesis::Flite;
use sg_tests::stack::Stack;
use sg_tests::until::{self, PATIENCE, recognized, scene, soon};
use sg_tests::voice::spoken;

/// Silence around a sentence, long enough to end it.
const SILENCE: Duration = Duration::from_millis(900);

/// Whether speech can be tried here: a voice, and a model or program that recognises it. Skips loudly without.
fn is_here() -> bool {
    let path = std::env::var_os("PATH");
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let models = Path::new(sg_speech::sphinx::MODELS);
    let parts = [
        ("flite", Flite::find(path.as_deref(), "slt").is_ok()),
        ("pocketsphinx", sg_speech::sphinx::Sphinx::find(path.as_deref(), models).is_ok()),
        ("whisper-tiny.en", cache.join("models/whisper-tiny.en/model.bin").is_file()),
        ("piper-en_US-joe-medium", cache.join("models/piper-en_US-joe-medium/en_US-joe-medium.onnx").is_file()),
    ];
    let missing: Vec<&str> = parts.iter().filter(|(_, there)| !there).map(|(name, _)| *name).collect();
    let is_required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
    assert!(missing.is_empty() || !is_required, "missing: {missing:?}; run ops/setup-debian.sh and ops/models.sh");
    if !missing.is_empty() {
        println!("SKIPPED: {missing:?} are missing, run ops/setup-debian.sh and ops/models.sh");
    }
    missing.is_empty()
}

/// A stack whose microphone is a pipe and whose loudspeaker is a file.
struct Room {
    stack: Stack,
    folder: tempfile::TempDir,
}

impl Room {
    fn open(more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        mkfifo(&folder.path().join("microphone"), Mode::S_IRWXU).unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        let own = [
            format!("service.speech.params.input={}", at("microphone")),
            format!("service.speech.params.output={}", at("reply.wav")),
        ];
        let settings: Vec<String> = own.into_iter().chain(more.iter().map(|s| (*s).to_owned())).collect();
        Self { stack: Stack::up_with(&settings).unwrap(), folder }
    }

    fn reply(&self) -> PathBuf {
        self.folder.path().join("reply.wav")
    }

    /// Plays sound into the microphone, as fast as it takes it.
    fn play(&self, sound: &Recording) {
        let bytes: Vec<u8> =
            sound.samples.iter().flat_map(|sample| ((sample * 32_767.0) as i16).to_le_bytes()).collect();
        let mut pipe = std::fs::OpenOptions::new().write(true).open(self.folder.path().join("microphone")).unwrap();
        pipe.write_all(&bytes).unwrap();
    }

    fn say(&self, sentence: &str) {
        self.play(&between_silence(sentence));
    }

    /// The text of the newest reply, as the recognizer hears it.
    fn heard_reply(&self) -> String {
        let begun = Instant::now();
        while !self.reply().exists() {
            assert!(begun.elapsed() < PATIENCE, "no reply was spoken");
            std::thread::sleep(Duration::from_millis(50));
        }
        let sound = read_wav(&self.reply(), MAX_DURATION).unwrap();
        assert!(sound.duration() > Duration::from_millis(400), "{:?}", sound.duration());
        let path = self.reply().display().to_string();
        let (_, text, all) = self.stack.run(&["speech", "listen", &path, "--unit", "sac", "--unit", "body"]).unwrap();
        std::fs::remove_file(self.reply()).unwrap();
        assert!(!text.is_empty(), "{all}");
        text.to_lowercase()
    }
}

/// A sentence between silence, at the rate of the pipe.
fn between_silence(sentence: &str) -> Recording {
    let silence = vec![0.0; (SILENCE.as_millis() * 16) as usize];
    Recording { rate: SPEECH_RATE, samples: [&silence[..], &spoken(sentence).samples, &silence].concat() }
}

async fn control(bus: &Bus, control: Control) {
    bus.ask(&keys::SPEECH_CONTROL, &ControlRequest { control: control.into() }, &soon()).await.unwrap();
}

fn blue(state: &State, unit: &str) -> bool {
    let palette = state.base_units.iter().find(|u| u.name == unit).and_then(|u| u.palette);
    palette.is_some_and(|palette| palette.blue > 0.8 && palette.red < 0.3)
}

fn red(state: &State, unit: &str) -> bool {
    let palette = state.base_units.iter().find(|u| u.name == unit).and_then(|u| u.palette);
    palette.is_some_and(|palette| palette.red > 0.8 && palette.blue < 0.3)
}

#[test]
fn whisper_hears_commands_and_the_reply_sounds() {
    if !is_here() {
        return;
    }
    let room = Room::open(&["service.speech.params.recognizer=whisper", "service.speech.params.synthesizer=flite"]);
    block_on(async {
        let cli = room.stack.join(role::CLI).await.unwrap();
        let mut texts = cli.subscribe(&keys::SPEECH_RECOGNITION, role::SPEECH, 256).await.unwrap();
        let idle = until::speech(&cli, "a microphone", |s| s.phase() == Phase::Idle && !s.input.is_empty()).await;
        assert_eq!((idle.recognizer.as_str(), idle.synthesizer.as_str()), ("whisper", "flite"));

        // A command changes the scene, and its reply is spoken so that it is understood again.
        room.say("make the sac blue");
        let text = recognized(&cli, &mut texts).await;
        assert!(text.accepted && text.text.to_lowercase().contains("make the sac blue"), "{text:?}");
        scene(&cli, "the sac is blue", |s| blue(s, "sac")).await;
        let reply = tokio::task::block_in_place(|| room.heard_reply());
        assert!(reply.contains("sac") && reply.contains("blue"), "{reply}");
        until::speech(&cli, "the reply has ended", |s| s.phase() == Phase::Idle).await;

        // What is no command changes nothing and is not answered.
        let before = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision;
        room.say("my brother just bought a new bicycle");
        let text = recognized(&cli, &mut texts).await;
        assert!(!text.accepted, "{text:?}");
        let shown = until::speech(&cli, "a notice", |s| s.notice.contains("is no command")).await;
        assert_eq!(shown.phase(), Phase::Idle, "{shown:?}");

        // What takes something away needs a yes.
        for (answer, gone) in [("no", false), ("yes please", true)] {
            room.say("delete the body");
            let text = recognized(&cli, &mut texts).await;
            assert!(text.accepted, "{text:?}");
            until::speech(&cli, "a question", |s| s.question.contains("delete the body") && s.phase() == Phase::Idle)
                .await;
            let now = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap();
            assert_eq!(now.revision, before, "nothing happens before the answer");
            room.say(answer);
            let text = recognized(&cli, &mut texts).await;
            assert!(text.accepted, "{answer}: {text:?}");
            if gone {
                scene(&cli, "the body is deleted", |s| s.revision > before).await;
            } else {
                until::speech(&cli, "no question", |s| s.question.is_empty() && s.phase() == Phase::Idle).await;
                assert_eq!(cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision, before);
            }
            until::speech(&cli, "the reply has ended", |s| s.phase() == Phase::Idle).await;
        }

        // A closed microphone hears nothing, and a restart opens it again.
        control(&cli, Control::Mute).await;
        let before = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision;
        room.say("make the sac red");
        tokio::time::sleep(Duration::from_secs(2)).await;
        assert_eq!(cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision, before);
        let (status, _, all) = tokio::task::block_in_place(|| room.stack.run(&["restart", "speech"])).unwrap();
        assert_eq!(status, Some(0), "{all}");
        until::speech(&cli, "an open microphone", |s| !s.muted && !s.input.is_empty()).await;
        room.say("undo");
        let text = recognized(&cli, &mut texts).await;
        assert!(text.accepted && text.text.to_lowercase().starts_with("undo"), "{text:?}");
        scene(&cli, "the deletion is undone", |s| s.revision > before).await;

        // A text is spoken on request, and a person can stop it.
        until::speech(&cli, "the reply has ended", |s| s.phase() == Phase::Idle).await;
        let text = "The aneurysm is seven millimetres wide. It lies beside the vessel.".to_owned();
        let spoken = cli.ask(&keys::SPEECH_SPEAK, &SpeakRequest { text }, &soon()).await.unwrap();
        assert!(spoken.sentences == 2 && !spoken.stopped && spoken.first_sound_ms.is_some(), "{spoken:?}");
    })
    .unwrap();
}

#[test]
fn sphinx_hears_while_a_button_is_held() {
    if !is_here() {
        return;
    }
    let room = Room::open(&[
        "service.speech.params.recognizer=sphinx",
        "service.speech.params.trigger=held",
        "service.speech.params.synthesizer=piper",
    ]);
    block_on(async {
        let cli = room.stack.join(role::CLI).await.unwrap();
        let mut texts = cli.subscribe(&keys::SPEECH_RECOGNITION, role::SPEECH, 256).await.unwrap();
        let idle = until::speech(&cli, "a microphone", |s| !s.input.is_empty()).await;
        assert_eq!((idle.recognizer.as_str(), idle.synthesizer.as_str()), ("sphinx", "piper"));
        // Nobody holds the button.
        let before = cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision;
        room.say("hide the sac");
        tokio::time::sleep(Duration::from_secs(1)).await;
        assert_eq!(cli.newest(&keys::SCENE_STATE, &soon()).await.unwrap().revision, before);

        control(&cli, Control::Press).await;
        until::speech(&cli, "listening", |s| s.held && s.phase() == Phase::Listening).await;
        room.say("make the sac red");
        // All of it has been read before the release.
        tokio::time::sleep(Duration::from_millis(500)).await;
        // No sound comes after the release, as of a writer that stops with the button.
        control(&cli, Control::Release).await;
        let text = recognized(&cli, &mut texts).await;
        assert!(text.accepted, "{text:?}");
        assert_eq!(text.text, "make the sac red");
        scene(&cli, "the sac is red", |s| red(s, "sac")).await;
        assert!(tokio::task::block_in_place(|| room.heard_reply()).contains("sac"));
    })
    .unwrap();
}
