//! A controller's button that talks while it is held, and keeps its other function when it is tapped.

use sg_proto::speech::Control;

/// Longest tap, seconds. The microphone is open meanwhile, so that no syllable is lost; so short a sound is no utterance.
const TAP: f64 = 0.3;

/// The button in one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct TalkOutput {
    /// A control of the microphone.
    pub(super) control: Option<Control>,
    /// Whether the button's other function is wanted.
    pub(super) tapped: bool,
}

/// The button over time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PushToTalk {
    was_down: bool,
    /// Seconds that it has been held, if it talks.
    talking_for: Option<f64>,
}

impl PushToTalk {
    /// Ends talking, such as where a session shows nothing. A button that is still held has to be pressed again.
    pub(super) fn interrupt(&mut self) -> Option<Control> {
        self.talking_for.take().map(|_| Control::Release)
    }

    /// Takes in the button after `seconds`. `waits`: the microphone waits for a button.
    pub(super) fn step(&mut self, is_down: bool, waits: bool, seconds: f64) -> TalkOutput {
        let was_down = std::mem::replace(&mut self.was_down, is_down);
        match (was_down, is_down) {
            (false, true) if waits => {
                self.talking_for = Some(0.0);
                TalkOutput { control: Some(Control::Press), tapped: false }
            }
            (false, true) => TalkOutput { control: None, tapped: true },
            (true, true) => {
                self.talking_for = self.talking_for.map(|held| held + seconds.max(0.0));
                TalkOutput::default()
            }
            (true, false) => {
                let talked = self.talking_for.take();
                TalkOutput { control: talked.map(|_| Control::Release), tapped: talked.is_some_and(|held| held < TAP) }
            }
            (false, false) => TalkOutput::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What happens in the frames of a hundredth of a second in which the button is held, and in the one after.
    fn held(frames: usize, waits: bool) -> Vec<TalkOutput> {
        let mut button = PushToTalk::default();
        let down = (0..frames).map(|_| true).chain([false]);
        down.map(|is_down| button.step(is_down, waits, 0.01)).filter(|p| *p != TalkOutput::default()).collect()
    }

    #[test]
    fn a_held_button_talks_and_a_tapped_one_has_its_other_function() {
        let press = TalkOutput { control: Some(Control::Press), tapped: false };
        let release = |tapped| TalkOutput { control: Some(Control::Release), tapped };
        assert_eq!(held(100, true), [press, release(false)]);
        assert_eq!(held(10, true), [press, release(true)]);
        let tapped = TalkOutput { control: None, tapped: true };
        assert_eq!(held(100, false), [tapped]);
        assert_eq!(held(0, true), []);
    }

    #[test]
    fn an_interruption_ends_talking_once() {
        let mut button = PushToTalk::default();
        assert_eq!(button.interrupt(), None);
        button.step(true, true, 0.01);
        assert_eq!((button.interrupt(), button.interrupt()), (Some(Control::Release), None));
        assert_eq!(button.step(false, true, 0.01), TalkOutput::default());
    }

    #[test]
    fn a_microphone_that_goes_away_is_released() {
        let mut button = PushToTalk::default();
        button.step(true, true, 0.01);
        button.step(true, false, 1.0);
        assert_eq!(button.step(false, false, 0.01), TalkOutput { control: Some(Control::Release), tapped: false });
    }
}
