//! Pictures against closed forms, against a second implementation, and level against level.

mod closed_form;
mod editing;
mod hard_cases;
mod oracle;
mod quality;
mod scenes;
