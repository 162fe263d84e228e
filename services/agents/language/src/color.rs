//! Colours of messages by name: [`sg_color`] with the type of the messages.

use sg_proto::scene::Color;

pub(crate) use sg_color::{MAX_WORDS, is_emphasis, is_word};

fn message([red, green, blue]: sg_color::Color) -> Color {
    Color { red, green, blue }
}

/// A colour from three channels, clamped to 0 to 1.
#[must_use]
pub fn from_rgb(channels: [f32; 3]) -> Color {
    message(sg_color::from_rgb(channels))
}

/// As [`sg_color::from_words`].
#[must_use]
pub fn from_words(words: &[&str]) -> Option<(Color, usize)> {
    sg_color::from_words(words).map(|(color, length)| (message(color), length))
}

/// As [`sg_color::from_phrase`].
#[must_use]
pub fn from_phrase(phrase: &str) -> Option<Color> {
    sg_color::from_phrase(phrase).map(message)
}

/// As [`sg_color::name_of`].
#[must_use]
pub fn name_of(color: &Color) -> &'static str {
    sg_color::name_of([color.red, color.green, color.blue])
}
