use std::time::Duration;

use proptest::prelude::*;

use crate::endpoint::{
    BargeIn, Control, DropReason, EndReason, Endpoint, EndpointSettings, Endpointer, LONGEST_SETTING, Trigger,
};
use crate::vad::{FRAME, VoiceDetector};

/// Speech is what is louder than 0.5.
struct Loud;

impl VoiceDetector for Loud {
    fn probability(&mut self, frame: &[f32; FRAME]) -> f32 {
        if frame.iter().filter(|s| s.abs() > 0.5).count() * 2 >= FRAME { 1.0 } else { 0.0 }
    }

    fn reset(&mut self) {}
}

/// A stream whose samples tell their position, in runs of voice and silence of these numbers of frames.
fn stream(runs: &[usize]) -> Vec<f32> {
    let mut samples = Vec::new();
    for (k, run) in runs.iter().enumerate() {
        for _ in 0..run * FRAME {
            let ramp = (samples.len() % 4_000) as f32 * 1e-5;
            samples.push(if k % 2 == 0 { ramp } else { 0.6 + ramp });
        }
    }
    samples
}

/// Events of a stream that is cut into blocks, with controls at positions.
fn events(
    settings: EndpointSettings,
    samples: &[f32],
    cuts: &[usize],
    controls: &[(usize, Control)],
) -> (Vec<Endpoint>, usize) {
    let mut endpointer = Endpointer::new(Box::new(Loud), settings);
    let (mut events, mut at, mut most) = (Vec::new(), 0, 0);
    let (mut cuts, mut controls) = (cuts.iter().cycle(), controls.iter().peekable());
    while at < samples.len() {
        while let Some((_, control)) = controls.next_if(|(when, _)| *when <= at) {
            events.extend(endpointer.control(*control));
        }
        let next = controls.peek().map_or(samples.len(), |(when, _)| (*when).min(samples.len()));
        let end = (at + cuts.next().unwrap()).min(next);
        events.extend(endpointer.step(&samples[at..end]));
        most = most.max(endpointer.held_samples());
        at = end;
    }
    events.extend(endpointer.finish());
    (events, most)
}

fn settings() -> EndpointSettings {
    EndpointSettings {
        hang_over: Duration::from_millis(160),
        pause: Duration::ZERO,
        longest: Duration::from_secs(3),
        partial_period: Duration::from_millis(200),
        ..EndpointSettings::default()
    }
}

fn control() -> impl Strategy<Value = Control> {
    use Control::{Cancel, Mute, Press, Release, ReplyEnded, ReplyStarted, Unmute};
    proptest::sample::select(vec![Press, Release, Mute, Unmute, Unmute, ReplyStarted, ReplyEnded, ReplyEnded, Cancel])
}

fn any_settings() -> impl Strategy<Value = EndpointSettings> {
    let ms = |range: std::ops::Range<u64>| range.prop_map(Duration::from_millis);
    (any::<bool>(), any::<bool>(), ms(0..300), ms(0..300), ms(16..400), ms(0..200), ms(0..1_500), ms(0..300)).prop_map(
        |(held, off, onset, pre_roll, hang_over, shortest, longest, release_tail)| EndpointSettings {
            trigger: if held { Trigger::Held } else { Trigger::Voice },
            barge_in: if off { BargeIn::Off } else { BargeIn::After(2 * onset) },
            onset,
            pre_roll,
            hang_over,
            shortest,
            longest,
            pause: hang_over / 2,
            partial_period: hang_over / 2,
            release_tail,
            ..EndpointSettings::default()
        },
    )
}

proptest! {
    #[test]
    fn any_blocks_give_the_same_events_and_each_sample_at_most_once(
        settings in any_settings(),
        runs in proptest::collection::vec(1_usize..40, 1..12),
        cuts in proptest::collection::vec(1_usize..1_500, 1..9),
        mut controls in proptest::collection::vec((0_usize..60_000, control()), 0..8),
    ) {
        controls.sort_by_key(|(when, _)| *when);
        let samples = stream(&runs);
        let (whole, _) = events(settings, &samples, &[samples.len()], &controls);
        let (parts, most) = events(settings, &samples, &cuts, &controls);
        prop_assert_eq!(&whole, &parts);

        // Started and ended in turn, each utterance a piece of the stream behind the one before.
        let (mut open, mut free, mut paused) = (None, 0, None);
        for event in &whole {
            match event {
                Endpoint::SpeechStarted { start, .. } => {
                    prop_assert!(open.is_none() && *start >= free, "{event:?} before {free}");
                    (open, paused) = (Some(*start), None);
                }
                Endpoint::PartialDue { start, .. } => prop_assert_eq!(open, Some(*start)),
                Endpoint::Paused { start, voice_end } => {
                    prop_assert!(open == Some(*start) && paused < Some(*voice_end), "{event:?} after {paused:?}");
                    paused = Some(*voice_end);
                }
                Endpoint::SpeechEnded { start, samples: said, voice_end, .. } => {
                    prop_assert_eq!(open.take(), Some(*start));
                    prop_assert!(paused <= Some(*voice_end));
                    let at = usize::try_from(*start).unwrap();
                    prop_assert_eq!(&said[..], &samples[at..at + said.len()]);
                    free = start + said.len() as u64;
                    prop_assert!(*voice_end >= *start && *voice_end <= free);
                }
                Endpoint::SpeechDropped { start, length, .. } => {
                    prop_assert_eq!(open.take(), Some(*start));
                    free = start + *length as u64;
                }
            }
        }
        prop_assert!(open.is_none() && free <= samples.len() as u64);
        let bound = settings.longest.max(Duration::from_millis(32)) + settings.pre_roll + 2 * settings.onset;
        prop_assert!(most <= crate::audio::samples_in(bound, 16_000) + settings.release_tail.as_millis() as usize * 16 + 4 * FRAME,
            "{most} samples held");
    }

    #[test]
    fn a_cut_utterance_goes_on_without_a_gap(voiced in 60_usize..300) {
        let samples = stream(&[20, voiced, 40]);
        let short = EndpointSettings { longest: Duration::from_millis(800), ..settings() };
        let (events, _) = events(short, &samples, &[999], &[]);
        let ended: Vec<_> = events.iter().filter_map(|e| match e {
            Endpoint::SpeechEnded { start, samples, reason, .. } => Some((*start, samples.len() as u64, *reason)),
            _ => None,
        }).collect();
        prop_assert!(ended.len() >= 2);
        for pair in ended.windows(2) {
            prop_assert_eq!(pair[0].0 + pair[0].1, pair[1].0);
            prop_assert_eq!(pair[0].2, EndReason::TooLong);
        }
    }
}

fn names(events: &[Endpoint]) -> String {
    let name = |event: &Endpoint| match event {
        Endpoint::SpeechStarted { during_reply: true, .. } => "barge-in".to_owned(),
        Endpoint::SpeechStarted { .. } => "started".to_owned(),
        Endpoint::PartialDue { .. } => "partial".to_owned(),
        Endpoint::Paused { .. } => "paused".to_owned(),
        Endpoint::SpeechEnded { reason, .. } => format!("{reason:?}"),
        Endpoint::SpeechDropped { reason, .. } => format!("{reason:?}"),
    };
    events.iter().map(name).collect::<Vec<_>>().join(" ")
}

#[test]
fn speech_between_silence_is_one_utterance_with_its_pre_roll() {
    let samples = stream(&[60, 30, 40]);
    let (events, _) = events(settings(), &samples, &[160], &[]);
    assert_eq!(names(&events), "started partial partial Silence");
    let Some(Endpoint::SpeechEnded { start, samples, voice_end, .. }) = events.last() else { panic!("{events:?}") };
    // 320 ms before the voice, and one frame of slack.
    assert!((60 * FRAME as u64 - start).abs_diff(5_120) <= FRAME as u64, "{start}");
    assert_eq!(*voice_end, 90 * FRAME as u64);
    assert_eq!(start + samples.len() as u64, 100 * FRAME as u64);
}

#[test]
fn each_pause_is_reported_once_and_the_last_one_at_the_end_of_the_voice() {
    let pausing = EndpointSettings { pause: Duration::from_millis(80), partial_period: Duration::ZERO, ..settings() };
    // A pause of 6 frames, or 96 ms, and one of 3.
    let (events, _) = events(pausing, &stream(&[30, 20, 6, 20, 3, 20, 30]), &[160], &[]);
    assert_eq!(names(&events), "started paused paused Silence");
    let ends: Vec<u64> = events
        .iter()
        .filter_map(|event| match event {
            Endpoint::Paused { voice_end, .. } | Endpoint::SpeechEnded { voice_end, .. } => Some(*voice_end),
            _ => None,
        })
        .collect();
    assert_eq!(ends, [50, 99, 99].map(|frame| frame * FRAME as u64));
}

#[test]
fn a_click_starts_nothing_and_a_short_noise_is_dropped() {
    assert_eq!(names(&events(settings(), &stream(&[30, 2, 30]), &[160], &[]).0), "");
    let strict = EndpointSettings { shortest: Duration::from_millis(200), ..settings() };
    assert_eq!(names(&events(strict, &stream(&[30, 6, 30]), &[160], &[]).0), "started TooShort");
}

#[test]
fn a_held_button_decides_alone() {
    let held = EndpointSettings { trigger: Trigger::Held, partial_period: Duration::ZERO, ..settings() };
    let samples = stream(&[20, 40, 20, 20, 40]);
    let at = |frame: usize| frame * FRAME + 77;
    let say = |controls: &[(usize, Control)]| names(&events(held, &samples, &[160], controls).0);
    assert_eq!(say(&[]), "");
    assert_eq!(say(&[(at(30), Control::Press), (at(45), Control::Release)]), "started Released");
    assert_eq!(
        say(&[(at(30), Control::Press), (at(40), Control::Release), (at(45), Control::Press)]),
        "started StreamEnded"
    );
    assert_eq!(say(&[(at(30), Control::Press), (at(40), Control::Mute), (at(45), Control::Release)]), "started Muted");
    assert_eq!(say(&[(at(1), Control::Press), (at(10), Control::Release)]), "started TooShort");
    assert_eq!(say(&[(at(10), Control::Release)]), "");
    let short = EndpointSettings { longest: Duration::from_millis(400), ..held };
    let released = [(at(24), Control::Press), (at(53), Control::Release)];
    let (cut, _) = events(short, &samples, &[160], &released);
    assert_eq!(names(&cut), "started TooLong started TooLong started Released", "the release holds for what follows");
}

#[test]
fn a_reply_is_interrupted_only_if_that_is_wanted() {
    let samples = stream(&[20, 8, 30, 20, 40]);
    let reply = [(10, Control::ReplyStarted)];
    let say = |barge_in| {
        names(
            &events(
                EndpointSettings { barge_in, partial_period: Duration::ZERO, ..settings() },
                &samples,
                &[160],
                &reply,
            )
            .0,
        )
    };
    assert_eq!(say(BargeIn::Off), "");
    assert_eq!(say(BargeIn::After(Duration::from_millis(200))), "barge-in Silence", "the first noise is too short");
    assert_eq!(say(BargeIn::After(Duration::from_millis(64))), "barge-in Silence barge-in Silence");
}

#[test]
fn a_mute_drops_what_was_said_and_hears_nothing() {
    let samples = stream(&[20, 30, 20, 20, 40]);
    let muted = [(30 * FRAME, Control::Mute), (65 * FRAME, Control::Unmute)];
    let (events, _) =
        events(EndpointSettings { partial_period: Duration::ZERO, ..settings() }, &samples, &[160], &muted);
    assert_eq!(names(&events), "started Muted started Silence");
    let Some(Endpoint::SpeechStarted { start, .. }) = events.get(2) else { panic!("{events:?}") };
    assert!(*start >= 65 * FRAME as u64, "heard while muted");
}

#[test]
fn new_settings_drop_an_utterance_and_are_bounded() {
    let mut endpointer = Endpointer::new(Box::new(Loud), settings());
    assert_eq!(endpointer.step(&stream(&[0, 10])).len(), 1);
    let dropped = endpointer.set_settings(EndpointSettings { longest: Duration::MAX, ..settings() });
    assert!(matches!(dropped[..], [Endpoint::SpeechDropped { reason: DropReason::Cancelled, .. }]));
    assert_eq!(endpointer.settings().longest, LONGEST_SETTING);
}
