//! Uploads the appearance: small tables as a whole, masks as their changed words.

use std::ops::Range;
use std::sync::Arc;

use encase::ShaderSize;
use glam::{DVec3, Vec3, Vec4};
use sg_scene::appearance::{Appearance, Clip, PixelFilter};
use sg_scene::camera::LightMode;
use sg_scene::mask::Mask;

use crate::device::Gpu;
use crate::resources::Resources;
use crate::shader_layout::{ClipSide, Edit, Unit, shading_term_number};

/// Gap of unchanged words up to which two changed ranges are uploaded as one.
const GAP: usize = 64;

/// Reserved editable units, highlight included, and reserved sides of clips.
const RESERVED: (u64, u64) = (32, 64);

/// Bytes of the tables and uniforms that one frame may change.
const UPLOAD_TABLES: u64 = 256 << 10;

/// The appearance on the device.
pub(super) struct AppearanceBuffers {
    /// [`Unit`]s.
    units: wgpu::Buffer,
    /// [`Edit`]s.
    edits: wgpu::Buffer,
    /// A bit for each Gaussian, slot by slot.
    masks: wgpu::Buffer,
    /// [`ClipSide`]s.
    clip_sides: wgpu::Buffer,
    /// Three f32 for each Gaussian: shown colors. Otherwise one f32 for each: occlusion, which nothing needs beside them.
    colors: wgpu::Buffer,
    pub(super) state: AppearanceState,
    /// The masks in the buffer, slot by slot: editable units, then the highlight.
    uploaded_masks: Vec<Arc<Mask>>,
    uploaded_colors: Option<Arc<[Vec3]>>,
    uploaded_occlusion: Option<Arc<[f32]>>,
    table: Vec<Unit>,
    edit_table: Vec<Edit>,
    side_table: Vec<ClipSide>,
    mask_words: usize,
    /// Number of replaced buffers. A change invalidates their bind groups.
    pub(super) generation: u64,
    /// Bytes of the last update.
    pub(super) uploaded_bytes: u64,
}

/// Appearance settings in shader constants and the frame uniform.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct AppearanceState {
    pub(super) edits: u32,
    pub(super) sides: u32,
    pub(super) overlay: bool,
    pub(super) colors: bool,
    pub(super) occluded: bool,
    pub(super) directional: bool,
    pub(super) term: u32,
    pub(super) highlight_color: Vec3,
    pub(super) highlight_mix: f32,
    pub(super) highlight_opacity: f32,
    pub(super) background: Vec3,
    pub(super) light: Vec3,
}

impl AppearanceBuffers {
    pub(super) fn new(gpu: &Gpu, gaussians: usize, units: &[Unit]) -> Self {
        Self {
            units: gpu.storage("units", Unit::SHADER_SIZE.get() * units.len() as u64),
            edits: gpu.storage("edits", 0),
            masks: gpu.storage("masks", 0),
            clip_sides: gpu.storage("clip sides", 0),
            colors: gpu.storage("colors", 0),
            state: AppearanceState::default(),
            uploaded_masks: Vec::new(),
            uploaded_colors: None,
            uploaded_occlusion: None,
            table: Vec::new(),
            edit_table: Vec::new(),
            side_table: Vec::new(),
            mask_words: gaussians.div_ceil(64) * 2,
            generation: 0,
            uploaded_bytes: 0,
        }
    }

    /// Makes room for the usual edits of a scene of `gaussians` Gaussians, so that they replace no buffer.
    pub(super) fn reserve(&mut self, gpu: &Gpu, gaussians: usize) {
        let (units, sides) = RESERVED;
        let mut changed = false;
        let mut grow = |buffer: &mut wgpu::Buffer, label: &str, bytes: u64| {
            if buffer.size() < bytes && bytes <= gpu.largest_binding() {
                *buffer = gpu.storage(label, bytes);
                changed = true;
            }
        };
        grow(&mut self.edits, "edits", Edit::SHADER_SIZE.get() * units);
        grow(&mut self.clip_sides, "clip sides", ClipSide::SHADER_SIZE.get() * sides);
        grow(&mut self.masks, "masks", 4 * self.mask_words as u64 * units);
        grow(&mut self.colors, "colors", 12 * gaussians as u64);
        self.edit_table.reserve(units as usize);
        self.side_table.reserve(sides as usize);
        self.uploaded_masks.reserve(units as usize);
        // Masks of a few units in each of three frames, and colors once.
        gpu.reserve_uploads(3 * (UPLOAD_TABLES + 4 * 4 * self.mask_words as u64) + 12 * gaussians as u64);
        if changed {
            self.generation += 1;
            // The new buffers are empty.
            self.uploaded_masks.clear();
            self.uploaded_colors = None;
            self.uploaded_occlusion = None;
            self.edit_table.clear();
            self.side_table.clear();
        }
    }

    /// Number of 32-bit words in one mask.
    pub(super) fn mask_words(&self) -> u32 {
        self.mask_words as u32
    }

    /// The buffers by name.
    pub(super) fn resources(&self) -> Resources<'_> {
        Resources::of([
            ("units", &self.units),
            ("edits", &self.edits),
            ("masks", &self.masks),
            ("clip_sides", &self.clip_sides),
            ("colors", &self.colors),
        ])
    }

    /// Uploads the changes from the last appearance to this one.
    pub(super) fn update(&mut self, gpu: &Gpu, scene_units: &[Unit], origin: DVec3, appearance: &Appearance) {
        self.uploaded_bytes = 0;
        let light = &appearance.light;
        let compensated = |unit: &Unit| match appearance.filter {
            PixelFilter::FromFile => unit.compensated,
            PixelFilter::Plain => 0,
            PixelFilter::Compensated => 1,
        };
        let rows = scene_units.iter().zip(&appearance.base).map(|(unit, base)| {
            let [ka, kd, ks, shininess] = base.multipliers;
            Unit {
                palette: base.palette,
                opacity: base.opacity,
                multipliers: Vec4::new(ka * light.ka, kd * light.kd, ks * light.ks, shininess * light.shininess),
                visible: u32::from(base.visible),
                compensated: compensated(unit),
                ..*unit
            }
        });
        if replace(&mut self.table, rows) {
            self.uploaded_bytes += gpu.write_table(&self.units, self.table.iter().copied());
        }
        let edits = appearance.units.iter().map(|u| Edit {
            color: u.color.unwrap_or(Vec3::ZERO),
            opacity: u.opacity,
            colored: u32::from(u.color.is_some()),
            visible: u32::from(u.visible),
            tone: Vec3::new(u.tone.saturation, u.tone.brightness, u.tone.temperature),
        });
        let mut generation = self.generation;
        if replace(&mut self.edit_table, edits) {
            let rows = &self.edit_table;
            fit(gpu, &mut self.edits, "edits", Edit::SHADER_SIZE.get() * rows.len() as u64, &mut generation);
            self.uploaded_bytes += gpu.write_table(&self.edits, rows.iter().copied());
        }
        if replace(&mut self.side_table, clip_sides(appearance, origin)) {
            let rows = &self.side_table;
            let bytes = ClipSide::SHADER_SIZE.get() * rows.len() as u64;
            fit(gpu, &mut self.clip_sides, "clip sides", bytes, &mut generation);
            self.uploaded_bytes += gpu.write_table(&self.clip_sides, rows.iter().copied());
        }
        self.generation = generation;
        self.update_masks(gpu, appearance);
        self.update_colors(gpu, appearance);
        self.update_occlusion(gpu, appearance);
        let direction = Vec3::from_array(light.direction).as_dvec3().normalize_or_zero().as_vec3();
        let overlay = appearance.overlay.as_ref();
        self.state = AppearanceState {
            edits: appearance.units.len() as u32,
            sides: self.side_table.len() as u32,
            overlay: overlay.is_some(),
            colors: appearance.colors.is_some(),
            occluded: appearance.occlusion.is_some(),
            directional: light.mode == LightMode::Direction,
            term: shading_term_number(appearance.term),
            highlight_color: overlay.map_or(Vec3::ZERO, |o| o.color),
            highlight_mix: overlay.map_or(0.0, |o| o.mix),
            highlight_opacity: overlay.map_or(1.0, |o| o.opacity),
            background: appearance.background,
            light: direction,
        };
    }

    fn update_masks(&mut self, gpu: &Gpu, appearance: &Appearance) {
        let masks = || appearance.units.iter().map(|u| &u.mask).chain(appearance.overlay.iter().map(|o| &o.mask));
        let slot = 4 * self.mask_words as u64;
        let count = masks().count();
        if self.masks.size() < slot * count as u64 {
            // Twice the room: users add units one after another.
            self.masks = gpu.storage("masks", slot * 2 * count as u64);
            self.uploaded_masks.clear();
            self.generation += 1;
        }
        for (k, mask) in masks().enumerate() {
            let old = self.uploaded_masks.get(k);
            if old.is_some_and(|old| Arc::ptr_eq(old, mask)) {
                continue;
            }
            let old = old.map(|m| m.words()).unwrap_or_default();
            let buffer = &self.masks;
            for_changed_ranges(old, mask.words(), |changed| {
                if let Some(words) = mask.words().get(changed.clone()) {
                    let bytes: &[u8] = bytemuck::cast_slice(words);
                    gpu.write(buffer, slot * k as u64 + 8 * changed.start as u64, bytes);
                    self.uploaded_bytes += bytes.len() as u64;
                }
            });
            match self.uploaded_masks.get_mut(k) {
                Some(old) => old.clone_from(mask),
                None => self.uploaded_masks.push(Arc::clone(mask)),
            }
        }
        self.uploaded_masks.truncate(count);
    }

    fn update_colors(&mut self, gpu: &Gpu, appearance: &Appearance) {
        let same = match (&self.uploaded_colors, &appearance.colors) {
            (Some(old), Some(new)) => Arc::ptr_eq(old, new),
            (_, None) => true,
            (None, Some(_)) => false,
        };
        if same {
            return;
        }
        if let Some(colors) = &appearance.colors {
            let bytes = size_of_val::<[Vec3]>(colors) as u64;
            fit(gpu, &mut self.colors, "colors", bytes, &mut self.generation);
            if colors.iter().all(|c| c.cmpge(Vec3::ZERO).all()) {
                gpu.write(&self.colors, 0, bytemuck::cast_slice(colors));
            } else {
                // Rare: colors of attributes are not negative.
                let safe: Vec<Vec3> = colors.iter().map(|c| c.max(Vec3::ZERO)).collect();
                gpu.write(&self.colors, 0, bytemuck::cast_slice(&safe));
            }
            self.uploaded_bytes += bytes;
            self.uploaded_occlusion = None;
        }
        self.uploaded_colors.clone_from(&appearance.colors);
    }

    /// Occlusion acts on shaded colors alone, so it takes the place of shown ones.
    fn update_occlusion(&mut self, gpu: &Gpu, appearance: &Appearance) {
        let Some(factors) = appearance.occlusion.as_ref().filter(|_| appearance.colors.is_none()) else { return };
        if self.uploaded_occlusion.as_ref().is_some_and(|old| Arc::ptr_eq(old, factors)) {
            return;
        }
        // Whole elements of three numbers.
        let (whole, rest) = factors.split_at(factors.len() / 3 * 3);
        let mut last = [1.0_f32; 3];
        last.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
        let [first, bytes] = [whole.len() as u64 * 4, factors.len().next_multiple_of(3) as u64 * 4];
        fit(gpu, &mut self.colors, "colors", bytes, &mut self.generation);
        gpu.write(&self.colors, 0, bytemuck::cast_slice(whole));
        if !rest.is_empty() {
            gpu.write(&self.colors, first, bytemuck::cast_slice(&last));
        }
        self.uploaded_bytes += bytes;
        self.uploaded_colors = None;
        self.uploaded_occlusion = Some(Arc::clone(factors));
    }
}

/// Replaces a buffer that is too small for so many bytes by one with twice the room.
fn fit(gpu: &Gpu, buffer: &mut wgpu::Buffer, label: &str, bytes: u64, generation: &mut u64) {
    if buffer.size() < bytes {
        *buffer = gpu.storage(label, 2 * bytes);
        *generation += 1;
    }
}

/// Makes `kept` equal to `rows` within its memory. Returns whether that changed it.
fn replace<T: PartialEq>(kept: &mut Vec<T>, rows: impl Iterator<Item = T>) -> bool {
    let (mut count, mut is_changed) = (0, false);
    for row in rows {
        match kept.get_mut(count) {
            Some(old) if *old == row => {}
            Some(old) => (*old, is_changed) = (row, true),
            None => {
                kept.push(row);
                is_changed = true;
            }
        }
        count += 1;
    }
    is_changed |= kept.len() > count;
    kept.truncate(count);
    is_changed
}

fn clip_sides(appearance: &Appearance, origin: DVec3) -> impl Iterator<Item = ClipSide> {
    let side = move |(clip, k): (&Clip, usize)| {
        // Unit length: f32 would round products of long normals away.
        let side = clip.sides.get(k)?.relative_to(origin);
        Some(ClipSide {
            normal: side.normal.as_vec3(),
            offset: side.offset as f32,
            keep_inside: u32::from(clip.keep_inside),
            last: u32::from(k + 1 == clip.sides.len()),
        })
    };
    appearance.clips.iter().flat_map(|clip| (0..clip.sides.len()).map(move |k| (clip, k))).filter_map(side)
}

/// Calls `then` with the ranges of words that differ between two masks, near ranges joined. Words missing in the old mask differ.
fn for_changed_ranges(old: &[u64], new: &[u64], mut then: impl FnMut(Range<usize>)) {
    let mut open: Option<Range<usize>> = None;
    for (k, word) in new.iter().enumerate() {
        if old.get(k) == Some(word) {
            continue;
        }
        match &mut open {
            Some(range) if k - range.end <= GAP => range.end = k + 1,
            _ => open.replace(k..k + 1).into_iter().for_each(&mut then),
        }
    }
    open.into_iter().for_each(then);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn changed_ranges(old: &[u64], new: &[u64]) -> Vec<Range<usize>> {
        let mut ranges = Vec::new();
        for_changed_ranges(old, new, |range| ranges.push(range));
        ranges
    }

    proptest! {
        #[test]
        fn ranges_cover_every_change_and_little_else(
            old in proptest::collection::vec(0_u64..2, 0..400), flips in proptest::collection::vec(0_usize..400, 0..6),
        ) {
            let mut new = old.clone();
            for k in flips {
                if let Some(word) = new.get_mut(k) {
                    *word ^= 1;
                }
            }
            let ranges = changed_ranges(&old, &new);
            let mut applied = old.clone();
            for r in &ranges {
                applied[r.clone()].copy_from_slice(&new[r.clone()]);
                prop_assert!(old[r.start] != new[r.start] && old[r.end - 1] != new[r.end - 1]);
            }
            prop_assert_eq!(applied, new);
        }
    }

    proptest! {
        #[test]
        fn a_replaced_table_is_the_new_one(
            old in proptest::collection::vec(0_u8..3, 0..6), new in proptest::collection::vec(0_u8..3, 0..6),
        ) {
            let mut kept = old.clone();
            let is_changed = replace(&mut kept, new.iter().copied());
            prop_assert_eq!(is_changed, old != new);
            prop_assert_eq!(kept, new);
        }
    }

    #[test]
    fn a_new_mask_is_uploaded_whole() {
        assert_eq!(changed_ranges(&[], &[0, 0, 1]), vec![0..3]);
        assert_eq!(changed_ranges(&[1; 500], &[1; 500]), vec![]);
    }
}
