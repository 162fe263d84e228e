//! Images of changing content as textures of a window.

use egui::{ColorImage, TextureHandle, TextureId, TextureOptions, Ui};

/// The texture of `image`: that of `texture` with new content, or a new one of this name.
pub(super) fn show_image(ui: &Ui, texture: &mut Option<TextureHandle>, name: &str, image: ColorImage) -> TextureId {
    match texture {
        Some(texture) => {
            texture.set(image, TextureOptions::LINEAR);
            texture.id()
        }
        None => texture.insert(ui.ctx().load_texture(name, image, TextureOptions::LINEAR)).id(),
    }
}
