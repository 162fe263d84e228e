//! Plots as SVG: the area to draw on, and colours.

use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, IntoDrawingArea, RGBColor, SVGBackend, WHITE};

/// Area of a plot.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// Outcome of drawing.
pub type Drawn = Result<(), Box<dyn std::error::Error>>;

// Colours that stay apart for most kinds of colour blindness (Okabe and Ito 2008), and a grey.
/// Blue.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// Orange.
pub const ORANGE: RGBColor = RGBColor(230, 159, 0);
/// Bluish green.
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
/// Vermilion.
pub const VERMILION: RGBColor = RGBColor(213, 94, 0);
/// Reddish purple.
pub const PURPLE: RGBColor = RGBColor(204, 121, 167);
/// Sky blue.
pub const SKY_BLUE: RGBColor = RGBColor(86, 180, 233);
/// Grey.
pub const GREY: RGBColor = RGBColor(90, 90, 90);

/// The text of a plot of this width and height in pixels, on white.
///
/// # Errors
/// That of `draw`, or of the SVG.
pub fn svg(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<String, Box<dyn std::error::Error>> {
    let mut text = String::new();
    let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
    area.fill(&WHITE)?;
    draw(&area)?;
    area.present()?;
    drop(area);
    Ok(text)
}
