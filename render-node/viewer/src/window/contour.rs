//! Contour of the highlighted Gaussians, over a window's picture.

use std::sync::Arc;

use egui::{Color32, ColorImage, TextureHandle, TextureId, Ui};
use glam::Vec3;
use sg_raster::pick::FrontIds;
use sg_scene::appearance::Overlay;
use sg_scene::mask::Mask;

use super::image_texture::show_image;
use crate::panels::transfer::to_color32;

/// Dark pixels beside the contour, so that it shows on every background.
const RIM: Color32 = Color32::from_black_alpha(110);

/// A contour's texture, drawn again only where its input differs.
#[derive(Default)]
pub(super) struct Contour {
    texture: Option<TextureHandle>,
    drawn: Option<Drawn>,
}

/// The input of the texture.
struct Drawn {
    /// Number of the front surface.
    front: u64,
    mask: Arc<Mask>,
    color: Vec3,
}

impl Contour {
    /// The texture of the contour of `overlay` on the front surface with this number. The texture covers the whole picture.
    pub(super) fn texture(&mut self, ui: &Ui, (number, front): (u64, &FrontIds), overlay: &Overlay) -> TextureId {
        let is_same = |drawn: &Drawn| {
            drawn.front == number && Arc::ptr_eq(&drawn.mask, &overlay.mask) && drawn.color == overlay.color
        };
        if let Some(texture) = self.texture.as_ref().filter(|_| self.drawn.as_ref().is_some_and(is_same)) {
            return texture.id();
        }
        self.drawn = Some(Drawn { front: number, mask: Arc::clone(&overlay.mask), color: overlay.color });
        let image = contour(front, &overlay.mask, to_color32(overlay.color));
        show_image(ui, &mut self.texture, "contour", image)
    }

    /// Makes the texture anew, for another context.
    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }
}

/// A line of `color` along the inside of the edge between front Gaussians of `mask` and all others, with a dark rim outside. The
/// picture's own edge is none. All other pixels are transparent.
fn contour(front: &FrontIds, mask: &Mask, color: Color32) -> ColorImage {
    let (width, height) = (front.width as usize, front.height as usize);
    let inside: Vec<bool> = front.ids.iter().map(|id| id.is_some_and(|id| mask.get(id as usize))).collect();
    let inside = without_specks(&inside, width);
    let pixel = |(k, here): (usize, &bool)| match (is_at_edge(&inside, width, k), here) {
        (false, _) => Color32::TRANSPARENT,
        (true, true) => color,
        (true, false) => RIM,
    };
    ColorImage::new([width, height], inside.iter().enumerate().map(pixel).collect())
}

/// Whether one of the up to four neighbours of pixel `k` differs from it.
fn is_at_edge(inside: &[bool], width: usize, k: usize) -> bool {
    let differs = |other: usize| inside.get(other).is_some_and(|there| *there != inside[k]);
    let column = k % width;
    (column > 0 && differs(k - 1))
        || (column + 1 < width && differs(k + 1))
        || (k >= width && differs(k - width))
        || differs(k + width)
}

/// A mask of pixels without single ones: selected pixels with fewer than three selected neighbours of eight are left out, others
/// with more than five are taken in. Faint Gaussians in front of others would else scatter dots over a picture.
fn without_specks(inside: &[bool], width: usize) -> Vec<bool> {
    let height = inside.len().checked_div(width).unwrap_or(0);
    let neighbours = |x: usize, y: usize| {
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let near = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        near.filter(|at| *at != (x, y) && inside[at.1 * width + at.0]).count()
    };
    let kept = |(k, here): (usize, &bool)| {
        let (x, y) = (k % width, k / width);
        // Four neighbours that agree decide, and most pixels have them.
        let has_four = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
        if has_four && !is_at_edge(inside, width, k) {
            return *here;
        }
        let near = neighbours(x, y);
        if *here { near >= 3 } else { near > 5 }
    };
    inside.iter().enumerate().map(kept).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_contour_encloses_the_selected_front() {
        // A square of 4 x 4 selected Gaussians, each in front at one pixel, and a background to the right.
        let (width, height) = (8_u32, 6_u32);
        let ids = (0..width * height).map(|k| (k % width < 6).then_some(k)).collect();
        let front = FrontIds { width, height, ids };
        let is_selected = |k: usize| (1..5).contains(&(k % 8)) && (1..5).contains(&(k / 8));
        let mask = Mask::from_fn((width * height) as usize, is_selected);
        let image = contour(&front, &mask, Color32::YELLOW);
        for (k, pixel) in image.pixels.iter().enumerate() {
            let (x, y) = (k % 8, k / 8);
            let on_ring = is_selected(k) && (x == 1 || x == 4 || y == 1 || y == 4);
            assert_eq!(*pixel == Color32::YELLOW, on_ring, "{x} {y}");
            let beside = |x: usize, y: usize| (x == 0 || x == 5) && (1..5).contains(&y);
            assert_eq!(*pixel == RIM, beside(x, y) || ((y == 0 || y == 5) && (1..5).contains(&x)), "{x} {y}");
        }
    }

    #[test]
    fn single_pixels_have_no_contour() {
        let front = FrontIds { width: 9, height: 9, ids: (0..81).map(Some).collect() };
        let square = |k: usize| (3..8).contains(&(k % 9)) && (3..8).contains(&(k / 9));
        let clean = contour(&front, &Mask::from_fn(81, square), Color32::YELLOW);
        // A dot outside, and a hole inside.
        let specks = Mask::from_fn(81, |k| k == 10 || (square(k) && k != 50));
        assert_eq!(contour(&front, &specks, Color32::YELLOW).pixels, clean.pixels);
    }

    #[test]
    fn the_edge_of_the_picture_is_no_contour() {
        let front = FrontIds { width: 3, height: 2, ids: (0..6).map(Some).collect() };
        let image = contour(&front, &Mask::full(6), Color32::YELLOW);
        assert!(image.pixels.iter().all(|pixel| *pixel == Color32::TRANSPARENT));
    }
}
