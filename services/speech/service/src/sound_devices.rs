//! Microphones and loudspeakers of the machine (cpal). Only with the feature `devices`.

use std::collections::VecDeque;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, SyncSender};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use cpal::traits::{DeviceTrait as _, HostTrait as _, StreamTrait as _};
use cpal::{Device, FromSample, Sample as _, SampleFormat, SizedSample, Stream, SupportedStreamConfig};
use sg_speech::audio::sink::AudioSink;
use sg_speech::audio::source::{AudioSource, Block};
use sg_speech::audio::{AudioError, duration_of, samples_in};

/// Most blocks of a microphone that wait. A block is some milliseconds.
const QUEUE: usize = 256;
/// Pause before a microphone that is gone is looked for again.
const RETRY: Duration = Duration::from_secs(1);
/// Most sound that waits for a loudspeaker, so that a stop is heard soon.
const LEAD: Duration = Duration::from_millis(120);
/// Longest time in which a microphone gives no sample, or a loudspeaker takes none. Some systems do not report a device that is gone.
const STUCK: Duration = Duration::from_secs(3);

fn problem(name: Option<&str>, what: impl std::fmt::Display) -> AudioError {
    let path = name.unwrap_or("the default device").into();
    AudioError::File { path, problem: format!("{what}; `supergaussian speech devices` lists what is there") }
}

/// Whether a stream goes on after an error: cpal recovers from a gap in the sound by itself.
fn goes_on(error: &cpal::Error) -> bool {
    use cpal::ErrorKind::{DeviceChanged, RealtimeDenied, Xrun};
    matches!(error.kind(), Xrun | RealtimeDenied | DeviceChanged)
}

/// Which way sound goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    In,
    Out,
}

fn name_of(device: &Device) -> String {
    device.id().map(|id| id.to_string()).unwrap_or_default()
}

/// A device by its name, or the default one.
fn find(name: Option<&str>, way: Way) -> Result<Device, AudioError> {
    let host = cpal::default_host();
    let Some(wanted) = name else {
        let found = if way == Way::In { host.default_input_device() } else { host.default_output_device() };
        return found.ok_or_else(|| problem(None, "there is none"));
    };
    let mut all = host.devices().map_err(|e| problem(name, e))?;
    let is_it = |device: &Device| {
        let id = name_of(device);
        id == wanted || id.split_once(':').is_some_and(|(_, name)| name == wanted) || device.to_string() == wanted
    };
    all.find(is_it).ok_or_else(|| problem(name, "no device has this name"))
}

/// The names of all devices, microphones before loudspeakers.
///
/// # Errors
/// One line: the system's sound does not answer.
pub(crate) fn names() -> Result<Vec<String>, String> {
    let host = cpal::default_host();
    let all: Vec<Device> = host.devices().map_err(|e| e.to_string())?.collect();
    let line = |kind: &str, device: &Device| format!("{kind}\t{}\t{device}", name_of(device));
    let inputs = all.iter().filter(|device| device.supports_input()).map(|device| line("input", device));
    let outputs = all.iter().filter(|device| device.supports_output()).map(|device| line("output", device));
    Ok(inputs.chain(outputs).collect())
}

/// A microphone. One that is unplugged is silent until it is there again.
pub(crate) struct DeviceSource {
    name: Option<String>,
    rate: u32,
    open: Option<OpenInput>,
    tried: Instant,
}

struct OpenInput {
    blocks: Receiver<Result<Vec<f32>, String>>,
    /// When the last block came.
    heard: Instant,
    _stream: Stream,
}

impl DeviceSource {
    /// Opens a microphone by its name, or the default one.
    ///
    /// # Errors
    /// [`AudioError`]: no such device, or one that cannot be opened.
    pub(crate) fn open(name: Option<&str>) -> Result<Self, AudioError> {
        let (open, rate) = open_input(name)?;
        Ok(Self { name: name.map(str::to_owned), rate, open: Some(open), tried: Instant::now() })
    }
}

fn open_input(name: Option<&str>) -> Result<(OpenInput, u32), AudioError> {
    let device = find(name, Way::In)?;
    let config = device.default_input_config().map_err(|e| problem(name, e))?;
    let (sender, blocks) = mpsc::sync_channel(QUEUE);
    let stream = match config.sample_format() {
        SampleFormat::I16 => listen::<i16>(&device, &config, sender),
        SampleFormat::I32 => listen::<i32>(&device, &config, sender),
        SampleFormat::U8 => listen::<u8>(&device, &config, sender),
        _ => listen::<f32>(&device, &config, sender),
    };
    let stream = stream.and_then(|stream| stream.play().map(|()| stream)).map_err(|e| problem(name, e))?;
    Ok((OpenInput { blocks, heard: Instant::now(), _stream: stream }, config.sample_rate()))
}

fn listen<T>(
    device: &Device,
    config: &SupportedStreamConfig,
    blocks: SyncSender<Result<Vec<f32>, String>>,
) -> Result<Stream, cpal::Error>
where
    T: SizedSample,
    f32: FromSample<T>,
{
    let channels = usize::from(config.channels()).max(1);
    let failed = blocks.clone();
    let heard = move |data: &[T], _: &cpal::InputCallbackInfo| {
        let mean = |frame: &[T]| frame.iter().map(|s| f32::from_sample(*s)).sum::<f32>() / channels as f32;
        // A reader that is behind loses the newest block.
        let _ = blocks.try_send(Ok(data.chunks_exact(channels).map(mean).collect()));
    };
    let lost = move |error: cpal::Error| {
        if !goes_on(&error) {
            // With a full queue the next error is another chance, and a silent device is lost too.
            let _ = failed.try_send(Err(error.to_string()));
        }
    };
    device.build_input_stream(config.config(), heard, lost, None)
}

impl AudioSource for DeviceSource {
    fn rate(&self) -> u32 {
        self.rate
    }

    fn read(&mut self, wait: Duration) -> Result<Block, AudioError> {
        let Some(open) = &mut self.open else {
            if self.tried.elapsed() < RETRY {
                std::thread::sleep(wait);
                return Ok(Block::Silent);
            }
            self.tried = Instant::now();
            if let Ok((open, rate)) = open_input(self.name.as_deref()) {
                if rate != self.rate {
                    return Err(problem(
                        self.name.as_deref(),
                        format!("it has {rate} Hz now, and had {} Hz", self.rate),
                    ));
                }
                tracing::info!(device = self.name, "the microphone is there again");
                self.open = Some(open);
            }
            return Ok(Block::Silent);
        };
        let lost = match open.blocks.recv_timeout(wait) {
            Ok(Ok(block)) => {
                open.heard = Instant::now();
                return Ok(if block.is_empty() { Block::Silent } else { Block::Samples(block) });
            }
            Err(RecvTimeoutError::Timeout) if open.heard.elapsed() < STUCK => return Ok(Block::Silent),
            Err(RecvTimeoutError::Timeout) => "it gives no sound".to_owned(),
            Err(RecvTimeoutError::Disconnected) => "its stream has ended".to_owned(),
            Ok(Err(lost)) => lost,
        };
        tracing::warn!(device = self.name, lost, "the microphone is lost; it is looked for every second");
        (self.open, self.tried) = (None, Instant::now());
        Ok(Block::Silent)
    }
}

/// A loudspeaker, for one reply.
pub(crate) struct DeviceSink {
    name: Option<String>,
    rate: u32,
    waiting: Arc<Mutex<VecDeque<f32>>>,
    /// Why it has failed. A device that is gone reports that again and again.
    failed: Arc<OnceLock<String>>,
    _stream: Stream,
}

impl DeviceSink {
    /// Opens a loudspeaker by its name, or the default one.
    ///
    /// # Errors
    /// [`AudioError`]: no such device, or one that cannot be opened.
    pub(crate) fn open(name: Option<&str>) -> Result<Self, AudioError> {
        let device = find(name, Way::Out)?;
        let config = device.default_output_config().map_err(|e| problem(name, e))?;
        let waiting: Arc<Mutex<VecDeque<f32>>> = Arc::default();
        let failed: Arc<OnceLock<String>> = Arc::default();
        let lost = {
            let failed = Arc::clone(&failed);
            // Only the first cause counts.
            move |error: cpal::Error| {
                if !goes_on(&error) {
                    let _ = failed.set(error.to_string());
                }
            }
        };
        let stream = match config.sample_format() {
            SampleFormat::I16 => play::<i16>(&device, &config, Arc::clone(&waiting), lost),
            SampleFormat::I32 => play::<i32>(&device, &config, Arc::clone(&waiting), lost),
            SampleFormat::U8 => play::<u8>(&device, &config, Arc::clone(&waiting), lost),
            _ => play::<f32>(&device, &config, Arc::clone(&waiting), lost),
        };
        let stream = stream.and_then(|stream| stream.play().map(|()| stream)).map_err(|e| problem(name, e))?;
        Ok(Self { name: name.map(str::to_owned), rate: config.sample_rate(), waiting, failed, _stream: stream })
    }

    fn waiting(&self) -> std::sync::MutexGuard<'_, VecDeque<f32>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until at most this many samples wait.
    fn wait_for(&self, most: usize) -> Result<(), AudioError> {
        let (mut left, mut moved) = (usize::MAX, Instant::now());
        loop {
            if let Some(failed) = self.failed.get() {
                return Err(problem(self.name.as_deref(), failed));
            }
            let now = self.waiting().len();
            if now <= most {
                return Ok(());
            }
            if now < left {
                (left, moved) = (now, Instant::now());
            } else if moved.elapsed() > STUCK {
                return Err(problem(self.name.as_deref(), "it takes no sound"));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

fn play<T>(
    device: &Device,
    config: &SupportedStreamConfig,
    waiting: Arc<Mutex<VecDeque<f32>>>,
    lost: impl FnMut(cpal::Error) + Send + 'static,
) -> Result<Stream, cpal::Error>
where
    T: SizedSample + FromSample<f32>,
{
    let channels = usize::from(config.channels()).max(1);
    let fill = move |data: &mut [T], _: &cpal::OutputCallbackInfo| {
        let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
        for frame in data.chunks_mut(channels) {
            frame.fill(T::from_sample(waiting.pop_front().unwrap_or_default()));
        }
    };
    device.build_output_stream(config.config(), fill, lost, None)
}

impl AudioSink for DeviceSink {
    fn rate(&self) -> u32 {
        self.rate
    }

    fn write(&mut self, block: &[f32]) -> Result<(), AudioError> {
        self.wait_for(samples_in(LEAD, self.rate))?;
        self.waiting().extend(block);
        Ok(())
    }

    fn stop(&mut self) {
        self.waiting().clear();
    }

    fn finish(&mut self) -> Result<(), AudioError> {
        self.wait_for(0)?;
        // What the device itself holds is heard before it is closed.
        std::thread::sleep(duration_of(samples_in(LEAD, self.rate), self.rate));
        Ok(())
    }
}
