//! How large a target is.

use sg_proto::scene::{Measure, MeasureRequest};
use sg_scene::orientation::LengthUnit;
use sg_scene::size::size;

use super::editor::Editor;
use super::error::EditError;
use super::wire::encode_vector;

impl Editor {
    /// Measures a target, hidden Gaussians too.
    ///
    /// # Errors
    /// [`EditError`] for a target that does not exist or has no Gaussians of finite place and size.
    pub fn measure(&self, request: &MeasureRequest) -> Result<Measure, EditError> {
        let target = self.state().resolve(request.target.as_ref())?;
        let scene = self.scene();
        let found = size(&scene, &target.members).ok_or(EditError::EmptyTarget(target.phrase))?;
        Ok(Measure {
            revision: self.state().revision(),
            count: target.members.count() as u64,
            edges: Some(encode_vector(found.extent)),
            occupied: found.occupied,
            enclosed: found.enclosed,
            millimetres: scene.orientation.unit.map_or(0.0, LengthUnit::millimetres),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use sg_proto::scene::Target;
    use sg_scene::model::Scene;
    use sg_scene::orientation::Orientation;
    use sg_scene::synthetic::test_scene;

    use super::*;
    use crate::EditState;

    #[test]
    fn a_unit_is_measured_in_the_unit_of_its_file() {
        let orientation = Orientation { unit: Some(LengthUnit::Metre), ..Orientation::default() };
        let scene = Arc::new(Scene { orientation, ..test_scene(&[("bone", 5), ("skin", 7)]) });
        let opened = EditState::of_scene(&scene, "scene.toml", "");
        let editor = Editor::new(scene, opened);
        let of = |name: &str| {
            let target = Some(Target { units: vec![name.to_owned()], ..Target::default() });
            editor.measure(&MeasureRequest { target })
        };
        let bone = of("Bone").unwrap();
        assert_eq!((bone.count, bone.millimetres), (5, 1000.0));
        let edges = bone.edges.unwrap();
        assert!(edges.x > 0.0 && bone.occupied > 0.0 && bone.occupied <= bone.enclosed, "{bone:?}");
        assert!(matches!(of("liver"), Err(EditError::UnknownUnit { .. })));
    }
}
