//! Several units as one: rows pressed with Ctrl join the chosen one, and a button merges them.

use egui::{Button, Ui};
use sg_edit::{EditState, UnitRef};

use super::commands;
use super::output::{Output, PanelHost};
use super::state::Panels;

/// Names for the merge of units: those of the units, the one first that the others join, and a name of its own for a unit of
/// the file alone.
fn names(scene: &EditState, units: &[UnitRef]) -> (Vec<String>, String) {
    let (saved, base): (Vec<UnitRef>, Vec<UnitRef>) =
        units.iter().copied().partition(|unit| matches!(unit, UnitRef::Editable(_)));
    let is_of_file = saved.is_empty();
    // A unit of the file keeps its Gaussians, so a saved one takes them all.
    let ordered = saved.into_iter().chain(base);
    let names: Vec<String> = ordered.filter_map(|unit| scene.name_of(unit)).map(str::to_owned).collect();
    let name = if is_of_file { names.join(" + ") } else { String::new() };
    (names, name)
}

impl Panels {
    /// Takes a press with Ctrl on the row of a unit: it joins the chosen one, or leaves it.
    pub(super) fn join(&mut self, unit: UnitRef) {
        if self.chosen == Some(unit) {
            return;
        }
        match self.joined.iter().position(|joined| *joined == unit) {
            Some(at) => {
                self.joined.remove(at);
            }
            None => self.joined.push(unit),
        }
    }

    /// The button of the chosen unit that merges it with the joined ones.
    pub(super) fn merge_button(&mut self, ui: &mut Ui, scene: &EditState, output: &mut Output) {
        let Some(chosen) = self.chosen else { return };
        self.joined.retain(|unit| scene.name_of(*unit).is_some());
        if self.joined.is_empty() {
            if self.host == PanelHost::Window && scene.names().nth(1).is_some() {
                ui.weak("Ctrl+click on more names to merge them.");
            }
            return;
        }
        let units: Vec<UnitRef> = std::iter::once(chosen).chain(self.joined.iter().copied()).collect();
        let (names, name) = names(scene, &units);
        let into = if name.is_empty() { names.first().cloned().unwrap_or_default() } else { name.clone() };
        let locked = units.iter().any(|unit| scene.is_locked(*unit));
        let does = format!("one unit {into} of {}; undo takes it apart", names.join(", "));
        let button = ui
            .add_enabled(!locked, Button::new(format!("Merge {} units", units.len())))
            .on_hover_text(does)
            .on_disabled_hover_text("one of them is locked; press its lock first");
        if button.clicked() {
            output.change(commands::merge(names, name));
            self.joined.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::synthetic::test_scene;

    #[test]
    fn units_of_the_file_alone_get_a_name_of_their_own() {
        let scene = EditState::of_scene(&test_scene(&[("bone", 5), ("skin", 7)]), "", "");
        let (units, name) = names(&scene, &[UnitRef::Base(1), UnitRef::Base(0)]);
        assert_eq!((units, name.as_str()), (vec!["skin".to_owned(), "bone".to_owned()], "skin + bone"));
    }
}
