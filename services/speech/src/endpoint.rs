//! Endpointing: where an utterance begins and ends in a stream. A pure state machine without a clock: time is the number of
//! samples.
//!
//! Every sample that arrives while the microphone is open belongs to at most one utterance. The samples of an utterance are
//! those of the stream from its `start` on, without gaps.

use std::collections::VecDeque;
use std::time::Duration;

use crate::audio::{SPEECH_RATE, samples_in};
use crate::vad::{FRAME, VoiceDetector};

/// What opens the microphone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trigger {
    /// Speech itself.
    Voice,
    /// A button or key that is held: push-to-talk.
    Held,
}

/// What speech does while a reply is spoken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BargeIn {
    /// Nothing: the microphone is closed meanwhile. For loudspeakers that the microphone hears.
    Off,
    /// It begins an utterance after this much voice, longer than usual so that an echo does not.
    After(Duration),
}

/// Times and limits of the endpointer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndpointSettings {
    /// What opens the microphone.
    pub trigger: Trigger,
    /// What speech does while a reply is spoken.
    pub barge_in: BargeIn,
    /// Probability of speech from which a frame is voiced.
    pub on: f32,
    /// Probability below which a frame within an utterance is silent.
    pub off: f32,
    /// Voice that begins an utterance. A silent frame takes back twice its length.
    pub onset: Duration,
    /// Sound before the onset that belongs to the utterance.
    pub pre_roll: Duration,
    /// Silence that ends an utterance.
    pub hang_over: Duration,
    /// Silence after which an utterance has perhaps ended: [`Endpoint::Paused`]. Zero, or more than the hang-over, for none.
    pub pause: Duration,
    /// Voice that an utterance has at least; shorter ones are dropped.
    pub shortest: Duration,
    /// Length at which an utterance ends in any case.
    pub longest: Duration,
    /// Period of [`Endpoint::PartialDue`]; zero for none.
    pub partial_period: Duration,
    /// Time after the release of the button that still belongs to the utterance.
    pub release_tail: Duration,
}

impl Default for EndpointSettings {
    fn default() -> Self {
        Self {
            trigger: Trigger::Voice,
            barge_in: BargeIn::After(Duration::from_millis(160)),
            on: 0.5,
            off: 0.35,
            onset: Duration::from_millis(48),
            pre_roll: Duration::from_millis(320),
            hang_over: Duration::from_millis(500),
            pause: Duration::from_millis(120),
            shortest: Duration::from_millis(96),
            longest: Duration::from_secs(15),
            partial_period: Duration::from_millis(500),
            release_tail: Duration::from_millis(160),
        }
    }
}

/// Longest time of any setting, so that memory is bounded.
pub const LONGEST_SETTING: Duration = Duration::from_secs(60);

/// Why an utterance ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EndReason {
    /// Silence.
    Silence,
    /// The button was released.
    Released,
    /// It reached its longest length. The next utterance begins at once.
    TooLong,
    /// The stream ended.
    StreamEnded,
}

/// Why an utterance was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DropReason {
    /// It had too little voice.
    TooShort,
    /// The microphone was muted.
    Muted,
    /// The settings changed, or the caller gave it up.
    Cancelled,
}

/// What happened in the stream. Positions are samples since its start.
#[derive(Debug, Clone, PartialEq)]
pub enum Endpoint {
    /// An utterance has begun.
    SpeechStarted {
        /// First sample, with the pre-roll.
        start: u64,
        /// Whether a reply is being spoken: it should stop now.
        during_reply: bool,
    },
    /// A partial result would be timely. [`Endpointer::utterance`] has the samples so far.
    PartialDue {
        /// First sample of the utterance.
        start: u64,
        /// Samples so far.
        length: usize,
    },
    /// The voice has paused, and the utterance has perhaps ended. Its recognition may begin: if [`Endpoint::SpeechEnded`] follows
    /// with the same `voice_end`, nothing was said since. [`Endpointer::utterance`] has the samples so far.
    Paused {
        /// First sample of the utterance.
        start: u64,
        /// End of the last voiced frame.
        voice_end: u64,
    },
    /// An utterance is complete.
    SpeechEnded {
        /// First sample.
        start: u64,
        /// All its samples at 16 kHz.
        samples: Vec<f32>,
        /// End of the last voiced frame: what latency is measured from.
        voice_end: u64,
        /// Why it ended.
        reason: EndReason,
    },
    /// An utterance that was begun is not one.
    SpeechDropped {
        /// First sample.
        start: u64,
        /// Samples of it.
        length: usize,
        /// Why it was dropped.
        reason: DropReason,
    },
}

/// What changes beside the sound, at the present position of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Control {
    /// The button is held.
    Press,
    /// The button is released.
    Release,
    /// The microphone is closed; an utterance is dropped.
    Mute,
    /// The microphone is open again.
    Unmute,
    /// A reply begins to sound.
    ReplyStarted,
    /// The reply has ended or was stopped.
    ReplyEnded,
    /// The utterance is given up.
    Cancel,
}

#[derive(Debug)]
struct Utterance {
    start: u64,
    samples: Vec<f32>,
    voice_end: u64,
    /// Voiced samples in it.
    voiced: usize,
    /// Samples since the last voiced frame.
    silent: usize,
    next_partial: usize,
    /// Position at which a released utterance ends.
    ends_at: Option<u64>,
}

/// Finds utterances in a stream of 16 kHz samples.
pub struct Endpointer {
    detector: Box<dyn VoiceDetector>,
    settings: EndpointSettings,
    /// Samples of the frame that is being filled.
    frame: Vec<f32>,
    /// Samples before an utterance, up to the pre-roll and the onset.
    before: VecDeque<f32>,
    utterance: Option<Utterance>,
    /// Samples since the start of the stream.
    position: u64,
    /// Voice of the onset, in samples.
    onset: usize,
    held: bool,
    muted: bool,
    replying: bool,
}

impl Endpointer {
    /// An endpointer at the start of a stream. Times longer than a minute are cut to it.
    #[must_use]
    pub fn new(detector: Box<dyn VoiceDetector>, settings: EndpointSettings) -> Self {
        Self {
            detector,
            settings: bounded(settings),
            frame: Vec::with_capacity(FRAME),
            before: VecDeque::new(),
            utterance: None,
            position: 0,
            onset: 0,
            held: false,
            muted: false,
            replying: false,
        }
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> EndpointSettings {
        self.settings
    }

    /// Takes new settings. An utterance that was begun is dropped.
    pub fn set_settings(&mut self, settings: EndpointSettings) -> Vec<Endpoint> {
        let mut events = Vec::new();
        self.drop_utterance(DropReason::Cancelled, &mut events);
        self.settings = bounded(settings);
        events
    }

    /// Samples of the utterance so far; empty between utterances.
    #[must_use]
    pub fn utterance(&self) -> &[f32] {
        self.utterance.as_ref().map_or(&[], |utterance| &utterance.samples)
    }

    /// Whether an utterance is being heard.
    #[must_use]
    pub fn is_in_speech(&self) -> bool {
        self.utterance.is_some()
    }

    /// Samples since the start of the stream.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Samples that it holds now, for bounds.
    #[must_use]
    pub fn held_samples(&self) -> usize {
        self.before.len() + self.frame.len() + self.utterance().len()
    }

    /// Takes the next samples. How the stream is cut into blocks does not matter.
    pub fn step(&mut self, block: &[f32]) -> Vec<Endpoint> {
        let mut events = Vec::new();
        let mut rest = block;
        while !rest.is_empty() {
            let mut take = (FRAME - self.frame.len()).min(rest.len());
            if let Some(end) = self.utterance.as_ref().and_then(|utterance| utterance.ends_at) {
                take = take.min(usize::try_from(end.saturating_sub(self.position)).unwrap_or(take)).max(1);
            }
            let (part, after) = rest.split_at(take);
            rest = after;
            self.take(part, &mut events);
        }
        events
    }

    /// Takes samples that do not reach beyond the present frame.
    fn take(&mut self, part: &[f32], events: &mut Vec<Endpoint>) {
        self.position += part.len() as u64;
        self.frame.extend_from_slice(part);
        if let Some(utterance) = self.utterance.as_mut() {
            utterance.samples.extend_from_slice(part);
        } else if self.is_open() {
            self.before.extend(part);
            let most = samples_in(self.settings.pre_roll, SPEECH_RATE) + self.needed_onset() + FRAME;
            let surplus = self.before.len().saturating_sub(most);
            self.before.drain(..surplus);
        }
        if self.frame.len() == FRAME {
            self.frame_is_full(events);
        }
        let released = |utterance: &Utterance| utterance.ends_at.is_some_and(|end| self.position >= end);
        if self.utterance.as_ref().is_some_and(released) {
            self.end(EndReason::Released, events);
        }
    }

    fn is_open(&self) -> bool {
        let is_closed_by_reply =
            self.replying && self.settings.barge_in == BargeIn::Off && self.settings.trigger == Trigger::Voice;
        !self.muted && !is_closed_by_reply
    }

    /// Voice that begins an utterance now, in samples.
    fn needed_onset(&self) -> usize {
        let onset = match self.settings.barge_in {
            BargeIn::After(longer) if self.replying => longer.max(self.settings.onset),
            _ => self.settings.onset,
        };
        samples_in(onset, SPEECH_RATE)
    }

    fn frame_is_full(&mut self, events: &mut Vec<Endpoint>) {
        let frame: [f32; FRAME] = std::array::from_fn(|k| self.frame.get(k).copied().unwrap_or_default());
        self.frame.clear();
        if !self.is_open() {
            return;
        }
        let probability = self.detector.probability(&frame);
        let Some(utterance) = self.utterance.as_mut() else {
            self.onset =
                if probability >= self.settings.on { self.onset + FRAME } else { self.onset.saturating_sub(2 * FRAME) };
            if self.settings.trigger == Trigger::Voice && self.onset > 0 && self.onset >= self.needed_onset() {
                let voiced = self.onset;
                self.begin(voiced, events);
            }
            return;
        };
        if probability >= self.settings.off {
            utterance.voiced += FRAME;
            utterance.silent = 0;
            utterance.voice_end = self.position;
        } else {
            utterance.silent += FRAME;
            let pause = samples_in(self.settings.pause, SPEECH_RATE);
            let pauses = pause > 0 && utterance.silent >= pause && utterance.silent - FRAME < pause;
            if pauses && utterance.voiced >= samples_in(self.settings.shortest, SPEECH_RATE) {
                events.push(Endpoint::Paused { start: utterance.start, voice_end: utterance.voice_end });
            }
        }
        let (length, ends_at) = (utterance.samples.len(), utterance.ends_at);
        let silence_ends = self.settings.trigger == Trigger::Voice
            && utterance.silent >= samples_in(self.settings.hang_over, SPEECH_RATE);
        let period = samples_in(self.settings.partial_period, SPEECH_RATE);
        if silence_ends {
            self.end(EndReason::Silence, events);
        } else if length >= samples_in(self.settings.longest, SPEECH_RATE) {
            self.end(EndReason::TooLong, events);
            // The speech goes on, so the next utterance follows without a gap.
            self.begin(FRAME, events);
            if let Some(next) = self.utterance.as_mut() {
                next.ends_at = ends_at;
            }
        } else if period > 0 && length >= utterance.next_partial {
            utterance.next_partial = length + period;
            events.push(Endpoint::PartialDue { start: utterance.start, length });
        }
    }

    fn begin(&mut self, voiced: usize, events: &mut Vec<Endpoint>) {
        let kept = samples_in(self.settings.pre_roll, SPEECH_RATE) + voiced;
        let surplus = self.before.len().saturating_sub(kept);
        let samples: Vec<f32> = self.before.drain(..).skip(surplus).collect();
        let start = self.position - samples.len() as u64;
        let next_partial = samples.len() + samples_in(self.settings.partial_period, SPEECH_RATE);
        self.onset = 0;
        self.utterance = Some(Utterance {
            start,
            samples,
            voice_end: self.position,
            voiced,
            silent: 0,
            next_partial,
            ends_at: None,
        });
        events.push(Endpoint::SpeechStarted { start, during_reply: self.replying });
    }

    fn end(&mut self, reason: EndReason, events: &mut Vec<Endpoint>) {
        let Some(utterance) = self.utterance.take() else { return };
        self.onset = 0;
        let Utterance { start, samples, voice_end, .. } = utterance;
        if utterance.voiced < samples_in(self.settings.shortest, SPEECH_RATE) {
            events.push(Endpoint::SpeechDropped { start, length: samples.len(), reason: DropReason::TooShort });
        } else {
            events.push(Endpoint::SpeechEnded { start, samples, voice_end, reason });
        }
    }

    fn drop_utterance(&mut self, reason: DropReason, events: &mut Vec<Endpoint>) {
        self.onset = 0;
        self.before.clear();
        if let Some(Utterance { start, samples, .. }) = self.utterance.take() {
            events.push(Endpoint::SpeechDropped { start, length: samples.len(), reason });
        }
    }

    /// Applies a change at the present position.
    pub fn control(&mut self, control: Control) -> Vec<Endpoint> {
        let mut events = Vec::new();
        match control {
            Control::Press => {
                self.held = true;
                let resumed = self.utterance.as_mut().map(|utterance| utterance.ends_at = None).is_some();
                if self.settings.trigger == Trigger::Held && !self.muted && !resumed {
                    self.begin(0, &mut events);
                }
            }
            Control::Release => {
                let was_held = std::mem::take(&mut self.held);
                let tail = samples_in(self.settings.release_tail, SPEECH_RATE);
                if self.settings.trigger == Trigger::Held && was_held {
                    if let Some(utterance) = self.utterance.as_mut() {
                        utterance.ends_at = Some(self.position + tail as u64);
                    }
                    if tail == 0 {
                        self.end(EndReason::Released, &mut events);
                    }
                }
            }
            Control::Mute => {
                self.muted = true;
                self.drop_utterance(DropReason::Muted, &mut events);
            }
            Control::Unmute => {
                if std::mem::take(&mut self.muted) {
                    self.detector.reset();
                }
            }
            Control::ReplyStarted => {
                self.replying = true;
                if !self.is_open() {
                    self.drop_utterance(DropReason::Cancelled, &mut events);
                }
            }
            Control::ReplyEnded => {
                let was_closed = !self.is_open();
                self.replying = false;
                if was_closed && self.is_open() {
                    self.detector.reset();
                }
            }
            Control::Cancel => self.drop_utterance(DropReason::Cancelled, &mut events),
        }
        events
    }

    /// Ends the stream: an utterance that was begun is complete.
    pub fn finish(&mut self) -> Vec<Endpoint> {
        let mut events = Vec::new();
        self.end(EndReason::StreamEnded, &mut events);
        self.before.clear();
        events
    }
}

fn bounded(settings: EndpointSettings) -> EndpointSettings {
    let cut = |time: Duration| time.min(LONGEST_SETTING);
    EndpointSettings {
        barge_in: match settings.barge_in {
            BargeIn::After(time) => BargeIn::After(cut(time)),
            BargeIn::Off => BargeIn::Off,
        },
        onset: cut(settings.onset),
        pre_roll: cut(settings.pre_roll),
        hang_over: cut(settings.hang_over),
        pause: cut(settings.pause),
        shortest: cut(settings.shortest),
        longest: cut(settings.longest).max(Duration::from_millis(32)),
        release_tail: cut(settings.release_tail),
        ..settings
    }
}
