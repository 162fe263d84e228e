//! The order of keys and mouse buttons that reach the window between two frames.
//!
//! Within a frame the window reads all keys before it reads the mouse. A slow frame collects more than one step of a person's work,
//! for example the corners of a polygon and the Enter that closes it. So a frame gets the events up to the next change between
//! keyboard and buttons, and the next frame gets the rest.

use egui::Event;

/// Most events that wait for another frame. Beyond it all are handed on at once: their order within the frame is lost, no event is.
const MOST: usize = 2048;

/// Device of an event whose order matters.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Device {
    Keyboard,
    Buttons,
}

/// Events that wait for the next frames.
#[derive(Debug, Default)]
pub(super) struct InputOrder {
    waiting: Vec<Event>,
}

impl InputOrder {
    /// The events of this frame, given those that arrived since the last one.
    pub(super) fn next(&mut self, arrived: Vec<Event>) -> Vec<Event> {
        let mut events = std::mem::take(&mut self.waiting);
        events.extend(arrived);
        let mut devices = events.iter().enumerate().filter_map(|(k, event)| Some((k, device(event)?)));
        let change = devices.next().and_then(|(_, first)| devices.find(|(_, device)| *device != first));
        if let Some((change, _)) = change
            && events.len() - change <= MOST
        {
            self.waiting = events.split_off(change);
        }
        events
    }

    /// Whether events wait, so that another frame is due.
    pub(super) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }
}

/// The device of an event; `None` if it can be in either part, as the pointer's motion.
fn device(event: &Event) -> Option<Device> {
    match event {
        Event::Key { .. }
        | Event::ModifiersChanged(_)
        | Event::Text(_)
        | Event::Ime(_)
        | Event::Copy
        | Event::Cut
        | Event::Paste(_) => Some(Device::Keyboard),
        Event::PointerButton { .. } | Event::MouseWheel { .. } => Some(Device::Buttons),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use egui::{Key, Modifiers, PointerButton, Pos2};

    use super::*;

    fn key(key: Key) -> [Event; 2] {
        [true, false].map(|pressed| Event::Key {
            key,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        })
    }

    fn click(x: f32) -> [Event; 3] {
        let pos = Pos2::new(x, 10.0);
        let button =
            |pressed| Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE };
        [Event::PointerMoved(pos), button(true), button(false)]
    }

    #[test]
    fn a_slow_frame_keeps_the_order_of_keys_and_clicks() {
        let corners: Vec<Event> = [1.0, 2.0, 3.0].into_iter().flat_map(click).collect();
        let all: Vec<Event> = key(Key::J).into_iter().chain(corners).chain(key(Key::Enter)).collect();
        let mut order = InputOrder::default();
        let mut parts = vec![order.next(all.clone())];
        while order.is_waiting() {
            parts.push(order.next(Vec::new()));
        }
        assert_eq!(parts.concat(), all, "nothing is lost");
        let pressed: Vec<usize> = parts.iter().map(|p| p.iter().filter_map(device).count()).collect();
        assert_eq!(pressed, [2, 6, 2], "a key, the clicks, a key");
    }

    #[test]
    fn later_events_come_behind_those_that_wait() {
        let mut order = InputOrder::default();
        let shift = Event::ModifiersChanged(Modifiers::SHIFT);
        let released = Event::ModifiersChanged(Modifiers::NONE);
        assert_eq!(order.next([vec![shift.clone()], click(1.0).to_vec()].concat()).len(), 2, "Shift, and the motion");
        assert_eq!(order.next(vec![released.clone()]).len(), 2, "the click with Shift held");
        assert_eq!(order.next(click(2.0).to_vec()).first(), Some(&released));
        assert_eq!(order.next(Vec::new()).len(), 2);
        assert!(!order.is_waiting());
    }

    #[test]
    fn typing_and_a_flood_take_one_frame() {
        let mut order = InputOrder::default();
        let text: Vec<Event> = "left lobe".chars().map(|c| Event::Text(c.into())).collect();
        assert_eq!(order.next(text.clone()), text);
        let flood: Vec<Event> = (0..3000).flat_map(|_| [key(Key::A).to_vec(), click(1.0).to_vec()].concat()).collect();
        assert_eq!(order.next(flood.clone()).len(), flood.len());
        assert!(!order.is_waiting() && order.next(Vec::new()).is_empty());
    }
}
