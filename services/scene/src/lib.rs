//! The editable-Gaussian scene: model, file formats, edits, journal.
