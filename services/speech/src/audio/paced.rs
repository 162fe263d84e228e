//! A sink that hears as fast as a person does: for pipes, whose reader plays what it gets.

use std::time::{Duration, Instant};

use super::sink::AudioSink;
use super::{AudioError, duration_of};

/// How far the samples may be ahead of what is heard.
const LEAD: Duration = Duration::from_millis(200);

/// Writes to another sink at most 200 ms ahead of the time, so that a reader with a small buffer loses nothing and a stop is
/// heard soon.
pub struct PacedSink<S> {
    sink: S,
    /// Begin of the present sound.
    begun: Option<Instant>,
    /// Samples of it so far.
    samples: usize,
}

impl<S: AudioSink> PacedSink<S> {
    /// A sink around another one.
    pub fn new(sink: S) -> Self {
        Self { sink, begun: None, samples: 0 }
    }

    fn rest(&mut self) {
        (self.begun, self.samples) = (None, 0);
    }
}

impl<S: AudioSink> AudioSink for PacedSink<S> {
    fn rate(&self) -> u32 {
        self.sink.rate()
    }

    fn write(&mut self, block: &[f32]) -> Result<(), AudioError> {
        let begun = *self.begun.get_or_insert_with(Instant::now);
        let heard = duration_of(self.samples, self.rate());
        // A pause between two sentences is no lead for the second one.
        let begun = begun.max(Instant::now().checked_sub(heard).unwrap_or(begun));
        self.begun = Some(begun);
        self.sink.write(block)?;
        self.samples += block.len();
        let ahead = duration_of(self.samples, self.rate()).saturating_sub(begun.elapsed());
        std::thread::sleep(ahead.saturating_sub(LEAD));
        Ok(())
    }

    fn stop(&mut self) {
        self.rest();
        self.sink.stop();
    }

    fn finish(&mut self) -> Result<(), AudioError> {
        if let Some(begun) = self.begun {
            std::thread::sleep(duration_of(self.samples, self.rate()).saturating_sub(begun.elapsed()));
        }
        self.rest();
        self.sink.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audio::sink::MemorySink;

    #[test]
    fn a_sound_takes_its_time_and_a_pause_gives_no_lead() {
        let mut sink = PacedSink::new(MemorySink::new(16_000));
        let begun = Instant::now();
        for _ in 0..25 {
            sink.write(&[0.1; 320]).unwrap();
        }
        assert!(begun.elapsed() >= Duration::from_millis(290), "{:?}", begun.elapsed());
        sink.finish().unwrap();
        assert!(begun.elapsed() >= Duration::from_millis(500), "{:?}", begun.elapsed());
        sink.write(&[0.1; 320]).unwrap();
        std::thread::sleep(Duration::from_millis(400));
        let second = Instant::now();
        for _ in 0..25 {
            sink.write(&[0.1; 320]).unwrap();
        }
        assert!(second.elapsed() >= Duration::from_millis(290), "{:?}", second.elapsed());
        sink.stop();
        assert_eq!((sink.sink.stops, sink.sink.samples.len()), (1, 51 * 320));
    }
}
