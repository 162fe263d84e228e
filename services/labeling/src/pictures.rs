//! What an image-text model sees in pictures of units.
//!
//! The model is the caller's: this library reads none. Its shares are not calibrated on scenes as those of
//! [`crate::meaning`] are. So they lead to questions, and never to a match.

/// How well one text fits the pictures of each item.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureShares {
    /// The model, for a person.
    pub model: String,
    /// For each item, in their order: the probability of the text among texts of all kinds, 0 to 1. `None` without pictures.
    pub units: Vec<Option<f64>>,
}

/// Pictures of items that texts are compared with.
pub trait UnitPictures {
    /// The shares of a text. `None` if it can't be encoded, or no item has pictures.
    fn shares(&self, text: &str) -> Option<PictureShares>;
}
