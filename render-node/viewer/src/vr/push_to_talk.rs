//! A controller's button that talks while it is held, and keeps its other function when it is tapped.

use sg_proto::speech::Control;

/// Longest tap, seconds. The microphone is open meanwhile, so that no syllable is lost; so short a sound is no utterance.
const TAP: f64 = 0.3;

/// The button in one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Pressed {
    /// What the microphone is told.
    pub(super) control: Option<Control>,
    /// Whether the button's other function is wanted.
    pub(super) tapped: bool,
}

/// The button over time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PushToTalk {
    was_down: bool,
    /// Seconds that it has been held, if it talks.
    talks: Option<f64>,
}

impl PushToTalk {
    /// Takes in the button after `seconds`. `waits`: the microphone waits for a button.
    pub(super) fn step(&mut self, is_down: bool, waits: bool, seconds: f64) -> Pressed {
        let was_down = std::mem::replace(&mut self.was_down, is_down);
        match (was_down, is_down) {
            (false, true) if waits => {
                self.talks = Some(0.0);
                Pressed { control: Some(Control::Press), tapped: false }
            }
            (false, true) => Pressed { control: None, tapped: true },
            (true, true) => {
                self.talks = self.talks.map(|held| held + seconds.max(0.0));
                Pressed::default()
            }
            (true, false) => {
                let talked = self.talks.take();
                Pressed { control: talked.map(|_| Control::Release), tapped: talked.is_some_and(|held| held < TAP) }
            }
            (false, false) => Pressed::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What happens in the frames of a hundredth of a second in which the button is held, and in the one after.
    fn held(frames: usize, waits: bool) -> Vec<Pressed> {
        let mut button = PushToTalk::default();
        let down = (0..frames).map(|_| true).chain([false]);
        down.map(|is_down| button.step(is_down, waits, 0.01)).filter(|p| *p != Pressed::default()).collect()
    }

    #[test]
    fn a_held_button_talks_and_a_tapped_one_has_its_other_function() {
        let press = Pressed { control: Some(Control::Press), tapped: false };
        let release = |tapped| Pressed { control: Some(Control::Release), tapped };
        assert_eq!(held(100, true), [press, release(false)]);
        assert_eq!(held(10, true), [press, release(true)]);
        let tapped = Pressed { control: None, tapped: true };
        assert_eq!(held(100, false), [tapped]);
        assert_eq!(held(0, true), []);
    }

    #[test]
    fn a_microphone_that_goes_away_is_released() {
        let mut button = PushToTalk::default();
        button.step(true, true, 0.01);
        button.step(true, false, 1.0);
        assert_eq!(button.step(false, false, 0.01), Pressed { control: Some(Control::Release), tapped: false });
    }
}
