//! The clients against servers with scripted answers.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};

use sg_speech::audio::wav::{decode_wav, encode_wav};
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::recognizer::{Recognizer as _, Synthesizer as _};
use tokio::runtime::Runtime;

use super::*;

/// Environment variable of the key: cargo sets it for every test, so that no test changes the environment.
const KEY_ENV: &str = "CARGO_PKG_NAME";
const KEY: &str = env!("CARGO_PKG_NAME");

/// An answer of the server.
#[derive(Clone)]
struct Answer {
    status: u16,
    body: Vec<u8>,
    delay: Duration,
}

fn answer(status: u16, body: impl Into<Vec<u8>>) -> Answer {
    Answer { status, body: body.into(), delay: Duration::ZERO }
}

/// Head and body of each request.
type Requests = Vec<(String, Vec<u8>)>;

/// An HTTP server that answers in order, the last answer again and again. It ends with the test.
struct Scripted {
    address: SocketAddr,
    requests: Arc<Mutex<Requests>>,
}

impl Scripted {
    fn start(script: Vec<Answer>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let requests = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&requests);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let (log, script) = (Arc::clone(&log), script.clone());
                std::thread::spawn(move || serve(stream.unwrap(), &log, &script));
            }
        });
        Self { address, requests }
    }

    fn params(&self, model: &str) -> ServerParams {
        ServerParams {
            endpoint: format!("http://{}/v1", self.address),
            model: model.to_owned(),
            key_env: Some(KEY_ENV.to_owned()),
            ..ServerParams::default()
        }
    }

    fn requests(&self) -> Requests {
        self.requests.lock().unwrap().clone()
    }
}

fn serve(stream: TcpStream, log: &Mutex<Requests>, script: &[Answer]) {
    let mut from = BufReader::new(stream.try_clone().unwrap());
    let mut to = stream;
    loop {
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            if from.read_line(&mut head).unwrap_or(0) == 0 {
                return;
            }
        }
        let length = head.lines().find_map(|line| line.to_lowercase().strip_prefix("content-length: ")?.parse().ok());
        let mut body = vec![0; length.unwrap_or(0)];
        from.read_exact(&mut body).unwrap();
        let Answer { status, body, delay } = {
            let mut log = log.lock().unwrap();
            log.push((head, body));
            script[(log.len() - 1).min(script.len() - 1)].clone()
        };
        std::thread::sleep(delay);
        // Some tests disconnect during an answer.
        let _ = write!(to, "HTTP/1.1 {status} x\r\ncontent-length: {}\r\n\r\n", body.len());
        let _ = to.write_all(&body);
    }
}

fn grammar() -> PhraseGrammar {
    let mut grammar = PhraseGrammar::new();
    grammar.set_slot("unit", ["sac", "left kidney-2"]).unwrap();
    grammar.add("hide the {unit}").unwrap();
    grammar
}

/// A second of a tone with the rhythm of speech, which counts as voice.
fn voice() -> Vec<f32> {
    let sample = |i: usize| {
        let t = i as f32 / SPEECH_RATE as f32;
        let harmonics = (1..12).map(|k| (t * 140.0 * k as f32 * std::f32::consts::TAU).sin() / k as f32);
        0.3 * (t * 4.0 * std::f32::consts::TAU).sin().abs() * harmonics.sum::<f32>()
    };
    (0..SPEECH_RATE as usize).map(sample).collect()
}

fn within(time: Duration) -> Limits {
    Limits::within(time)
}

const SOON: Duration = Duration::from_secs(20);

fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
}

fn part<'a>(body: &'a str, name: &str) -> &'a str {
    let start = format!("name=\"{name}\"\r\n\r\n");
    body.split_once(&start).unwrap_or_else(|| panic!("no {name} in {body}")).1.split("\r\n").next().unwrap()
}

#[test]
fn a_server_of_openai_hears_and_knows_the_names() {
    let runtime = runtime();
    let body = r#"{"text": " Hide the left kidney two.", "segments": [{"avg_logprob": -0.1, "no_speech_prob": 0.01}]}"#;
    let silence = r#"{"text": "you", "segments": [{"avg_logprob": -1.2, "no_speech_prob": 0.9}]}"#;
    let server = Scripted::start(vec![answer(200, body), answer(200, silence), answer(200, r#"{"text": "hello"}"#)]);
    let mut openai = OpenAi::recognizer(&server.params("whisper-1"), "en", runtime.handle()).unwrap();
    let heard = openai.recognize(&voice(), &grammar(), &within(SOON)).unwrap();
    assert_eq!((heard.text.as_str(), heard.accepted), ("hide the left kidney-2", true));
    assert!((heard.confidence - 0.905).abs() < 0.001, "{heard:?}");
    assert_eq!(openai.recognize(&voice(), &grammar(), &within(SOON)).unwrap().text, "", "Whisper's rule for silence");
    let free = openai.recognize(&voice(), &grammar(), &within(SOON)).unwrap();
    assert_eq!((free.text.as_str(), free.accepted, free.confidence), ("hello", false, 1.0));

    let (head, body) = server.requests()[0].clone();
    assert!(head.starts_with("POST /v1/audio/transcriptions "), "{head}");
    assert!(head.contains(&format!("authorization: Bearer {KEY}")), "{head}");
    let at = body.windows(4).position(|w| w == b"RIFF").unwrap();
    let sound = decode_wav(&body[at..], SOON).unwrap();
    assert_eq!((sound.rate, sound.samples.len()), (SPEECH_RATE, SPEECH_RATE as usize));
    let text = String::from_utf8_lossy(&body).into_owned();
    assert_eq!(["model", "language", "prompt"].map(|n| part(&text, n)), ["whisper-1", "en", "sac, left kidney-2."]);
    assert_eq!((part(&text, "response_format"), part(&text, "temperature")), ("verbose_json", "0"));

    // Silence is not sent at all.
    assert_eq!(openai.recognize(&[0.0; 16_000], &grammar(), &within(SOON)).unwrap().text, "");
    assert_eq!(server.requests().len(), 3);
}

#[test]
fn other_models_state_the_probabilities_of_tokens() {
    let runtime = runtime();
    let body =
        r#"{"text": "hide it", "logprobs": [{"token": "hide", "logprob": -0.5}, {"token": " it", "logprob": -1.5}]}"#;
    let server = Scripted::start(vec![answer(200, body)]);
    let mut openai = OpenAi::recognizer(&server.params("gpt-4o-mini-transcribe"), "", runtime.handle()).unwrap();
    let heard = openai.recognize(&voice(), &grammar(), &within(SOON)).unwrap();
    assert!((heard.confidence - (-1.0_f32).exp()).abs() < 1e-5, "{heard:?}");
    let text = String::from_utf8_lossy(&server.requests()[0].1).into_owned();
    assert_eq!((part(&text, "response_format"), part(&text, "include[]")), ("json", "logprobs"));
    assert!(!text.contains("name=\"language\""), "{text}");
}

#[test]
fn a_server_of_openai_speaks() {
    let runtime = runtime();
    let mut streamed = encode_wav(&Recording { rate: 24_000, samples: vec![0.25; 2_400] }).unwrap();
    for at in [4, 40] {
        streamed[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    }
    let server = Scripted::start(vec![answer(503, "{}"), answer(200, streamed)]);
    let openai = OpenAi::synthesizer(&server.params("tts-1"), "", runtime.handle()).unwrap();
    let sound = openai.synthesize("It is “hidden”.", &within(SOON)).unwrap();
    assert_eq!((sound.rate, sound.samples.len()), (24_000, 2_400), "asked once more after 503");
    let (head, body) = server.requests()[1].clone();
    assert!(head.starts_with("POST /v1/audio/speech "), "{head}");
    let body: serde_json::Value = serde_json::from_slice(&body).unwrap();
    assert_eq!(
        body,
        serde_json::json!({"model": "tts-1", "voice": "alloy", "input": "It is “hidden”.", "response_format": "wav"})
    );
    assert!(openai.synthesize("…", &within(SOON)).unwrap().samples.is_empty());
    assert_eq!(server.requests().len(), 2);
}

#[test]
fn every_failure_is_one_line_without_the_key() {
    let runtime = runtime();
    let fault = |answers: Vec<Answer>, limits: &Limits| {
        let server = Scripted::start(answers);
        let mut openai = OpenAi::recognizer(&server.params("whisper-1"), "", runtime.handle()).unwrap();
        let error = openai.recognize(&voice(), &grammar(), limits).unwrap_err().to_string();
        assert!(!error.contains('\n') && !error.contains(KEY), "{error}");
        (error, server.requests().len())
    };
    let repeats_key = format!(r#"{{"error": {{"message": "wrong key {KEY}\nnext"}}}}"#);
    let (error, requests) = fault(vec![answer(401, repeats_key)], &within(SOON));
    assert!(error.contains("refused: status 401: wrong key (key) next") && requests == 1, "{error}");
    let long = format!(r#"{{"error": {{"message": "{}{KEY}"}}}}"#, "x".repeat(280));
    let (error, _) = fault(vec![answer(401, long)], &within(SOON));
    assert!(error.contains("xxx") && !error.contains(&KEY[..4]), "{error}");
    let quoted = format!(r#"{{"text": "a", "segments": "{KEY}"}}"#);
    let (error, _) = fault(vec![answer(200, quoted)], &within(SOON));
    assert!(error.contains("no transcription"), "{error}");
    let (error, requests) = fault(vec![answer(429, r#"{"error": "slow down"}"#)], &within(SOON));
    assert!(error.contains("unavailable: status 429: slow down") && requests == 2, "{error}");
    for body in [&b"<html>"[..], b"{\"text\": ", b"{}", b"{\"text\": \"\xff\"}"] {
        let (error, _) = fault(vec![answer(200, body)], &within(SOON));
        assert!(error.contains("no transcription"), "{error}");
    }
    let (error, _) = fault(vec![answer(200, vec![b' '; 2 << 20])], &within(SOON));
    assert!(error.contains("over 1048576 bytes"), "{error}");
    let slow = || vec![Answer { delay: Duration::from_secs(5), ..answer(200, "{}") }];
    let began = Instant::now();
    let (error, _) = fault(slow(), &within(Duration::from_millis(200)));
    assert!(error.contains("deadline") && began.elapsed() < Duration::from_secs(3), "{error}");
    let cancelled = within(SOON);
    let cancel = Arc::clone(&cancelled.cancel);
    std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(100));
        cancel.store(true, Ordering::Relaxed);
    });
    let began = Instant::now();
    let (error, _) = fault(slow(), &cancelled);
    assert!(error.contains("cancelled") && began.elapsed() < Duration::from_secs(3), "{error}");
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let params = ServerParams { endpoint: format!("http://{nobody}"), model: "m".into(), ..ServerParams::default() };
    let openai = OpenAi::synthesizer(&params, "", runtime.handle()).unwrap();
    let error = openai.synthesize("hello", &within(SOON)).unwrap_err().to_string();
    assert!(error.starts_with(&format!("`openai` at http://{nobody}/ failed: unavailable: ")), "{error}");
}

#[test]
fn parameters_of_servers_are_checked_in_one_line() {
    let runtime = runtime();
    let read = |text: &str| serde_json::from_str::<ServerParams>(text).map_err(|e| e.to_string());
    let refused = |text: &str| {
        let params = read(text).unwrap();
        OpenAi::recognizer(&params, "", runtime.handle()).err().unwrap().to_string()
    };
    assert!(refused("{}").contains("`endpoint` is missing"));
    assert!(refused(r#"{"endpoint": "http://127.0.0.1:1"}"#).contains("`model` is missing, for example whisper-1"));
    let model = |more: &str| refused(&format!(r#"{{"model": "m", {more}}}"#));
    assert!(model(r#""endpoint": "http://10.0.0.1""#).contains("insecure = true"));
    assert!(model(r#""endpoint": "unix:/s""#).contains("needs an HTTP address"));
    assert!(model(r#""endpoint": "http://127.0.0.1:1", "timeout": 0"#).contains("take 0.1 to 60 seconds"));
    assert!(model(r#""key_env": "SG_TEST_NO_SUCH_KEY""#).contains("SG_TEST_NO_SUCH_KEY is not set"));
    assert!(!model(r#""key_env": "sk-5ecret""#).contains("5ecret"));
    assert!(read(r#"{"endpont": "x"}"#).unwrap_err().contains("unknown field"));
    let grpc = |text: &str| Grpc::recognizer(&read(text).unwrap(), "", runtime.handle()).err().unwrap().to_string();
    assert!(grpc("{}").contains("unix:/run/speech.sock"));
    assert!(grpc(r#"{"endpoint": "https://example.com"}"#).contains("does not support TLS"));
}
