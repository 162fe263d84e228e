//! Bind groups of passes over textures that come again in each frame.

use std::sync::{Arc, Mutex, PoisonError};

/// Uses by others after which bind groups are dropped: both eyes take turns.
const KEPT: u64 = 2;

/// Bound passes by the textures that they read. Those of textures that are no longer used are dropped.
#[derive(Debug)]
pub(super) struct KeptBindings<const N: usize, B>(Mutex<Kept<N, B>>);

#[derive(Debug)]
struct Kept<const N: usize, B> {
    /// Number of uses.
    uses: u64,
    entries: Vec<Entry<N, B>>,
}

#[derive(Debug)]
struct Entry<const N: usize, B> {
    textures: [wgpu::Texture; N],
    /// Number of its newest use.
    used: u64,
    bound: Arc<B>,
}

impl<const N: usize, B> Default for KeptBindings<N, B> {
    fn default() -> Self {
        Self(Mutex::new(Kept { uses: 0, entries: Vec::with_capacity(KEPT as usize + 1) }))
    }
}

impl<const N: usize, B> KeptBindings<N, B> {
    /// The passes bound to these textures; `bind` binds them to views of the textures at their first use.
    pub(super) fn get(&self, textures: [&wgpu::Texture; N], bind: impl FnOnce([wgpu::TextureView; N]) -> B) -> Arc<B> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Kept { uses, entries } = &mut *kept;
        *uses += 1;
        let found = entries.iter_mut().find(|entry| entry.textures.iter().zip(textures).all(|(a, b)| a == b));
        let bound = match found {
            Some(entry) => {
                entry.used = *uses;
                Arc::clone(&entry.bound)
            }
            None => {
                let views = textures.map(|texture| texture.create_view(&wgpu::TextureViewDescriptor::default()));
                let bound = Arc::new(bind(views));
                entries.push(Entry { textures: textures.map(Clone::clone), used: *uses, bound: Arc::clone(&bound) });
                bound
            }
        };
        let oldest = uses.saturating_sub(KEPT);
        entries.retain(|entry| entry.used >= oldest);
        bound
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;

    #[test]
    fn eyes_keep_their_bindings_and_replaced_textures_are_dropped() {
        let Some(gpu) = test_device() else { return };
        let texture =
            || gpu.texture("test", ([4, 4], 1), wgpu::TextureFormat::R32Float, wgpu::TextureUsages::TEXTURE_BINDING);
        let (kept, mut bound) = (KeptBindings::<1, u32>::default(), 0);
        let mut get = |texture: &wgpu::Texture| {
            *kept.get([texture], |_| {
                bound += 1;
                bound
            })
        };
        let [left, right] = [texture(), texture()];
        for _ in 0..5 {
            assert_eq!([get(&left), get(&right)], [1, 2]);
        }
        let [left, right] = [texture(), texture()];
        for _ in 0..5 {
            assert_eq!([get(&left), get(&right)], [3, 4]);
        }
        assert_eq!(kept.0.lock().unwrap().entries.len(), 2);
    }
}
