//! The areas of a window that differ from its frame before.
//!
//! A device made of processor cores takes tens of milliseconds for a whole window, and most frames change a part of it: the picture, or a
//! button under the mouse.

use egui::epaint::Primitive;
use egui::{ClippedPrimitive, Rect, TextureId};

/// Most areas of a frame. More are drawn as one around them.
const MOST_AREAS: usize = 6;

/// Points by which an area reaches further, so that rounding leaves no pixel out.
const MARGIN: f32 = 1.0;

/// The frame before.
#[derive(Default)]
pub(super) struct Damage {
    before: Option<Vec<ClippedPrimitive>>,
}

impl Damage {
    /// The areas, in points, that `primitives` draw differently from the frame before; `screen` where there is none. `changes` says
    /// whether the pixels of a texture are others.
    pub(super) fn areas(
        &self,
        primitives: &[ClippedPrimitive],
        changes: impl Fn(TextureId) -> bool,
        screen: Rect,
    ) -> Vec<Rect> {
        let Some(before) = &self.before else { return vec![screen] };
        let mut areas = Areas::default();
        let unchanged = |new: &ClippedPrimitive| texture(new).is_some_and(|texture| !changes(texture));
        if before.len() == primitives.len() {
            for (old, new) in before.iter().zip(primitives) {
                if !is_same(old, new) {
                    areas.add(bounds(old));
                    areas.add(bounds(new));
                } else if !unchanged(new) {
                    areas.add(bounds(new));
                }
            }
        } else {
            // Those that came or went, between equal ones.
            let most = before.len().min(primitives.len());
            let first = before.iter().zip(primitives).take_while(|(a, b)| is_same(a, b)).count();
            let ends = before.iter().rev().zip(primitives.iter().rev());
            let last = ends.take(most - first).take_while(|(a, b)| is_same(a, b)).count();
            let between = |k: usize, all: usize| (first..all - last).contains(&k);
            let gone = before.iter().enumerate().filter(|(k, _)| between(*k, before.len()));
            gone.for_each(|(_, old)| areas.add(bounds(old)));
            let drawn = |(k, new): &(usize, &ClippedPrimitive)| between(*k, primitives.len()) || !unchanged(new);
            primitives.iter().enumerate().filter(drawn).for_each(|(_, new)| areas.add(bounds(new)));
        }
        areas.0.iter().map(|area| area.expand(MARGIN).intersect(screen)).filter(Rect::is_positive).collect()
    }

    /// Keeps a drawn frame.
    pub(super) fn keep(&mut self, primitives: Vec<ClippedPrimitive>) {
        self.before = Some(primitives);
    }
}

/// Areas that hold each other are one.
#[derive(Default)]
struct Areas(Vec<Rect>);

impl Areas {
    fn add(&mut self, area: Rect) {
        if !area.is_positive() {
            return;
        }
        let mut area = area;
        // Drawing what lies between two areas must cost less than drawing their overlap twice.
        while let Some(at) = self.0.iter().position(|other| other.union(area).area() <= other.area() + area.area()) {
            area = area.union(self.0.swap_remove(at));
        }
        self.0.push(area);
        if self.0.len() > MOST_AREAS {
            let all = self.0.iter().copied().reduce(Rect::union);
            self.0 = all.into_iter().collect();
        }
    }
}

fn texture(primitive: &ClippedPrimitive) -> Option<TextureId> {
    match &primitive.primitive {
        Primitive::Mesh(mesh) => Some(mesh.texture_id),
        Primitive::Callback(_) => None,
    }
}

/// Whether two primitives have the same triangles; what a callback paints is not known.
fn is_same(a: &ClippedPrimitive, b: &ClippedPrimitive) -> bool {
    match (&a.primitive, &b.primitive) {
        (Primitive::Mesh(mesh), Primitive::Mesh(other)) => a.clip_rect == b.clip_rect && mesh == other,
        _ => false,
    }
}

/// Where a primitive can paint.
fn bounds(primitive: &ClippedPrimitive) -> Rect {
    match &primitive.primitive {
        Primitive::Mesh(mesh) => mesh.calc_bounds().intersect(primitive.clip_rect),
        Primitive::Callback(callback) => callback.rect.intersect(primitive.clip_rect),
    }
}

#[cfg(test)]
mod tests {
    use egui::epaint::Mesh;
    use egui::{Color32, Pos2, Vec2};

    use super::*;

    const SCREEN: Rect = Rect { min: Pos2::ZERO, max: Pos2::new(100.0, 80.0) };

    fn area(x: f32, y: f32, width: f32, height: f32) -> Rect {
        Rect::from_min_size(Pos2::new(x, y), Vec2::new(width, height))
    }

    fn colored(area: Rect, color: Color32) -> ClippedPrimitive {
        let mut mesh = Mesh::default();
        mesh.add_colored_rect(area, color);
        ClippedPrimitive { clip_rect: SCREEN, primitive: Primitive::Mesh(mesh) }
    }

    fn pictured(area: Rect) -> ClippedPrimitive {
        let mut mesh = Mesh::with_texture(TextureId::User(7));
        mesh.add_rect_with_uv(area, area, Color32::WHITE);
        ClippedPrimitive { clip_rect: SCREEN, primitive: Primitive::Mesh(mesh) }
    }

    /// Areas after `before`, without their margin.
    fn areas(before: &[ClippedPrimitive], after: &[ClippedPrimitive], changed: Option<TextureId>) -> Vec<Rect> {
        let mut damage = Damage::default();
        damage.keep(before.to_vec());
        let mut areas = damage.areas(after, |id| changed == Some(id), SCREEN);
        areas.iter_mut().for_each(|area| *area = area.shrink(MARGIN));
        areas
    }

    #[test]
    fn a_first_frame_is_drawn_whole_and_an_equal_one_not_at_all() {
        let frame = [colored(area(10.0, 10.0, 20.0, 20.0), Color32::RED)];
        assert_eq!(Damage::default().areas(&frame, |_| false, SCREEN), [SCREEN]);
        assert!(areas(&frame, &frame, None).is_empty());
    }

    #[test]
    fn a_change_is_drawn_where_it_was_and_where_it_is() {
        let (here, there) = (area(10.0, 10.0, 20.0, 20.0), area(60.0, 50.0, 20.0, 20.0));
        let still = colored(area(5.0, 60.0, 8.0, 8.0), Color32::GREEN);
        let before = [colored(here, Color32::RED), still.clone()];
        assert_eq!(areas(&before, &[colored(there, Color32::RED), still.clone()], None), [here, there]);
        assert_eq!(areas(&before, &[colored(here, Color32::BLUE), still.clone()], None), [here]);
        // Another one between, one less, and one in front of all.
        assert_eq!(areas(&before, &[before[0].clone(), colored(there, Color32::BLUE), still.clone()], None), [there]);
        assert_eq!(areas(&before, std::slice::from_ref(&still), None), [here]);
        assert_eq!(areas(&before, &[before[0].clone(), still, colored(there, Color32::RED)], None), [there]);
        assert!(areas(&before, &[], None).iter().any(|area| area.contains_rect(here)));
    }

    #[test]
    fn another_picture_of_a_texture_is_drawn() {
        let frame = [pictured(area(20.0, 2.0, 50.0, 70.0)), colored(area(0.0, 0.0, 15.0, 80.0), Color32::RED)];
        assert_eq!(areas(&frame, &frame, Some(TextureId::User(7))), [area(20.0, 2.0, 50.0, 70.0)]);
        assert!(areas(&frame, &frame, Some(TextureId::User(8))).is_empty());
    }

    #[test]
    fn areas_are_few_and_one_within_another_is_none() {
        let mut areas = Areas::default();
        for area in [area(0.0, 0.0, 50.0, 50.0), area(10.0, 10.0, 5.0, 5.0), area(0.0, 50.0, 50.0, 10.0), Rect::NOTHING]
        {
            areas.add(area);
        }
        assert_eq!(areas.0, [area(0.0, 0.0, 50.0, 60.0)]);
        let mut many = Areas::default();
        (0..20).for_each(|k| many.add(area(7.0 * k as f32, 7.0 * k as f32, 2.0, 2.0)));
        assert!(many.0.len() <= MOST_AREAS);
        let all = many.0.iter().copied().reduce(Rect::union).unwrap();
        assert_eq!(all, area(0.0, 0.0, 135.0, 135.0));
    }
}
