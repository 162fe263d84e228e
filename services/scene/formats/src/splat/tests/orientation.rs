//! The directions and the length unit of a scene in every file that stands alone.

use sg_scene::model::Scene;
use sg_scene::orientation::{Axis, LengthUnit, Orientation, PatientFrame};
use sg_scene::synthetic::samples;

use super::{Folder, as_format};
use crate::SaveOptions;
use crate::splat::Format;

fn trained() -> Scene {
    Scene::compose(vec![samples::unit("splats", samples::harmonic(9, 1, 3))], None)
}

#[test]
fn trained_splats_have_their_y_axis_down() {
    let folder = Folder::new();
    for name in ["a.ply", "a.compressed.ply", "a.splat", "scene.toml"] {
        let loaded = folder.through(name, &trained(), &SaveOptions::default());
        assert_eq!(
            loaded.scene.orientation,
            Orientation { up: Some(Axis::MinusY), ..Orientation::default() },
            "{name}"
        );
    }
    let of_volume = folder.through("b.ply", &samples::editable(9, 1), &SaveOptions::default());
    assert_eq!(of_volume.scene.orientation, Orientation::default());
}

#[test]
fn a_file_of_a_part_of_a_patient_keeps_its_directions_and_lengths() {
    let folder = Folder::new();
    let of = |orientation| Scene { orientation, ..samples::editable(9, 1) };
    for frame in [PatientFrame::Lps, PatientFrame::Ras] {
        let patient = Orientation { patient: Some(frame), unit: Some(LengthUnit::Millimetre), up: None };
        for (name, format) in [
            ("a.ply", Format::OURS),
            ("b.ply", Format::THREE_DGS),
            ("c.compressed.ply", Format::COMPRESSED),
            ("d.ply", Format::IVRGS),
        ] {
            let loaded = folder.through(name, &of(patient), &as_format(format));
            let found = loaded.scene.orientation;
            assert_eq!((found.patient, found.unit), (patient.patient, patient.unit), "{name}");
            assert_eq!((found.up(), found.upright_patient()), (Axis::PlusZ, Some(frame)), "{name}");
        }
    }
    // Unlit Gaussians of a volume are not taken for trained splats, and a turned scene stays as it was.
    for (up, want) in [(None, Axis::PlusZ), (Some(Axis::PlusX), Axis::PlusX)] {
        let scene = of(Orientation { up, ..Orientation::default() });
        for (name, format) in [("e.ply", Format::THREE_DGS), ("f.compressed.ply", Format::COMPRESSED)] {
            assert_eq!(folder.through(name, &scene, &as_format(format)).scene.orientation.up(), want, "{name}");
        }
    }
    let turned = Scene { orientation: Orientation { up: Some(Axis::PlusZ), ..Orientation::default() }, ..trained() };
    assert_eq!(folder.through("g.ply", &turned, &SaveOptions::default()).scene.orientation, turned.orientation);
}
