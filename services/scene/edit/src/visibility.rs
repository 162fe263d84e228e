//! Which Gaussians are shown, and how opaque and in which colour edits leave those of a unit.

use glam::Vec3;
use sg_reclassify::sources;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;

use super::state::{EditState, UnitRef};

/// Most Gaussians of a unit that its mean opacity factor and its colour are taken over.
const SAMPLES: usize = 512;

impl EditState {
    /// The Gaussians that no edit hides or deletes. A hidden unit, and one with an opacity factor of 0, hides all of its own.
    #[must_use]
    pub fn visible(&self) -> Mask {
        let mut visible = Mask::empty(self.count());
        for base in self.base_units().iter().filter(|base| base.visible && base.opacity > 0.0) {
            visible.select_range(base.range());
        }
        for unit in self.units().filter(|unit| !unit.visible || unit.opacity == 0.0) {
            visible.subtract(&unit.mask);
        }
        visible.subtract(self.deleted());
        visible
    }

    /// The Gaussians that no edit and no transfer function hides. `scene` is that of this state.
    #[must_use]
    pub fn visible_in(&self, scene: &Scene) -> Mask {
        let mut visible = self.visible();
        let hidden = sources::hidden(scene);
        if hidden.len() == visible.len() {
            visible.subtract(&hidden);
        }
        visible
    }

    /// The mean factor on the opacity of a unit's Gaussians: that of their base unit times those of all units that hold them. It
    /// is 0 where one of these is hidden. A larger unit is sampled at 512 Gaussians, evenly in the order of the scene. `None`
    /// for a unit without Gaussians.
    #[must_use]
    pub fn mean_opacity(&self, unit: UnitRef) -> Option<f32> {
        let samples = self.members(unit).samples(SAMPLES);
        let factor = |visible: bool, opacity: f32| if visible { f64::from(opacity) } else { 0.0 };
        // Most units change no opacity, and a panel asks for each row in each frame.
        let factors = self.units().map(|unit| (&unit.mask, factor(unit.visible, unit.opacity)));
        let changing: Vec<_> = factors.filter(|(_, factor)| *factor != 1.0).collect();
        let of_gaussian = |i: &usize| {
            let base = self.base_units().iter().find(|base| base.range().contains(i));
            let of_base = base.map_or(1.0, |base| factor(base.visible, base.opacity));
            let holding = changing.iter().filter(|(mask, _)| mask.get(*i));
            holding.fold(of_base, |product, (_, factor)| product * factor)
        };
        let sum: f64 = samples.iter().map(of_gaussian).sum();
        (!samples.is_empty()).then(|| (sum / samples.len() as f64) as f32)
    }

    /// The colour that one editable unit gives to all Gaussians of a unit: the latest one with a colour, of those that hold a
    /// Gaussian. A larger unit is sampled as for [`EditState::mean_opacity`]. `None` where several or none do.
    #[must_use]
    pub fn covering_color(&self, unit: UnitRef) -> Option<Vec3> {
        // Most scenes have no such unit, and a panel asks for each row in each frame.
        let colored: Vec<_> = self.units().filter(|unit| unit.color.is_some()).collect();
        if colored.is_empty() {
            return None;
        }
        let latest = |i: &usize| colored.iter().rev().find(|unit| unit.mask.get(*i));
        let samples = self.members(unit).samples(SAMPLES);
        let covering = latest(samples.first()?)?;
        let covers = |i| latest(i).is_some_and(|unit| unit.id == covering.id);
        samples.iter().all(covers).then_some(covering.color)?
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use sg_proto::scene::command::Action;
    use sg_proto::scene::{Color, Command, Select, SetColor, SetOpacity, SetOperation, SetVisibility, Target};
    use sg_scene::synthetic::test_scene;

    use super::*;
    use crate::Editor;

    fn editor() -> Editor {
        let scene = Arc::new(test_scene(&[("bone", 5), ("skin", 700)]));
        let opened = EditState::of_scene(&scene, "scene.toml", "");
        Editor::new(scene, opened)
    }

    fn apply(editor: &mut Editor, number: u32, action: Action) {
        let command = Command { id: number.to_string(), expected_revision: 0, action: Some(action) };
        editor.apply(&command).unwrap();
    }

    fn target(name: &str) -> Option<Target> {
        Some(Target { units: vec![name.to_owned()], ..Target::default() })
    }

    #[test]
    fn what_a_unit_hides_is_not_visible() {
        let mut editor = editor();
        assert_eq!(editor.state().visible().count(), 705);
        apply(&mut editor, 1, Action::SetVisibility(SetVisibility { target: target("bone"), visible: false }));
        assert_eq!(editor.state().visible().ones().next(), Some(5));
        assert_eq!(editor.state().mean_opacity(UnitRef::Base(0)), Some(0.0));
        assert_eq!(editor.state().mean_opacity(UnitRef::Base(1)), Some(1.0));
    }

    #[test]
    fn a_colour_that_covers_a_unit_is_told() {
        let mut editor = editor();
        let red = Color { red: 1.0, green: 0.0, blue: 0.0 };
        let paint = |target| Action::SetColor(SetColor { target, color: Some(red) });
        let selection = || Some(Target { selection: true, ..Target::default() });
        let select = |name| Action::Select(Select { target: target(name), operation: SetOperation::Replace.into() });
        apply(&mut editor, 1, select("bone"));
        apply(&mut editor, 2, paint(selection()));
        let covering = |editor: &Editor| [0, 1].map(|k| editor.state().covering_color(UnitRef::Base(k)));
        assert_eq!(covering(&editor), [Some(Vec3::X), None]);
        // A colour of the unit itself takes the place of the other.
        let own = Color { red: 0.0, green: 1.0, blue: 0.0 };
        apply(&mut editor, 3, Action::SetColor(SetColor { target: target("bone"), color: Some(own) }));
        assert_eq!(covering(&editor), [None, None]);
        assert_eq!(editor.state().base_units()[0].palette, Vec3::Y);
    }

    #[test]
    fn factors_of_all_units_multiply() {
        let mut editor = editor();
        let opacity = |name, factor| Action::SetOpacity(SetOpacity { target: target(name), factor, relative: false });
        apply(&mut editor, 1, opacity("skin", 0.5));
        assert_eq!(editor.state().mean_opacity(UnitRef::Base(1)), Some(0.5));
        apply(&mut editor, 2, opacity("skin", 0.0));
        assert_eq!(editor.state().visible().count(), 5);
        assert_eq!(editor.state().mean_opacity(UnitRef::Editable(77)), None);
    }
}
