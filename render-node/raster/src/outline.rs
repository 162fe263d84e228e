//! Outlines: lines over a picture where the cluster in front changes from one pixel to the next.

use glam::Vec3;

use crate::image::Image;
use crate::pick::FrontIds;
use crate::structure::NO_CLUSTER;

/// How outlines are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlineStyle {
    /// Colour of the lines.
    pub color: Vec3,
    /// Width of the lines in pixels, at least 1.
    pub width: u32,
}

impl Default for OutlineStyle {
    /// White, one pixel wide.
    fn default() -> Self {
        Self { color: Vec3::ONE, width: 1 }
    }
}

/// A picture that the front does not belong to.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the front Gaussians are those of {front_width} x {front_height} pixels, the picture has {width} x {height}")]
pub struct FrontSize {
    /// Width of the front, pixels.
    pub front_width: u32,
    /// Height of the front, pixels.
    pub front_height: u32,
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
}

/// Draws opaque lines over `image` where the label of the front Gaussian changes. Lines run between clusters, and around all of
/// them against pixels with no front or no cluster. A Gaussian without an entry in `labels` has no cluster.
///
/// # Errors
/// [`FrontSize`] unless both have the same size.
pub fn draw_outlines(
    image: &mut Image,
    front: &FrontIds,
    labels: &[u32],
    style: OutlineStyle,
) -> Result<(), FrontSize> {
    let (width, height) = (image.width, image.height);
    if (front.width, front.height) != (width, height) {
        return Err(FrontSize { front_width: front.width, front_height: front.height, width, height });
    }
    let label = |x: u32, y: u32| {
        front.at(x, y).and_then(|id| labels.get(id as usize)).copied().filter(|label| *label != NO_CLUSTER)
    };
    let thick = style.width.max(1);
    for y in 0..height {
        for x in 0..width {
            let here = label(x, y);
            let changes = (x + 1 < width && label(x + 1, y) != here) || (y + 1 < height && label(x, y + 1) != here);
            if !changes {
                continue;
            }
            // A square of pixels around the edge. The edge lies at the lower right of this pixel.
            let before = (thick - 1) / 2;
            for line in y.saturating_sub(before)..(y + thick - before).min(height) {
                for column in x.saturating_sub(before)..(x + thick - before).min(width) {
                    let at = 4 * (line as usize * width as usize + column as usize);
                    if let Some(pixel) = image.rgba.get_mut(at..at + 4) {
                        pixel.copy_from_slice(&style.color.extend(1.0).to_array());
                    }
                }
            }
        }
    }
    Ok(())
}
