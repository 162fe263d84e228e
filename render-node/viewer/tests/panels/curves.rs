//! The transfer functions behind base units.

use sg_reclassify::functions;
use sg_viewer::panels::transfer::Curve;
use sg_volume::transfer::{BaseUnitRange, ControlPoint, Scale, TransferFunction, Units};

use crate::stage::scene;

fn function(scale: Scale, domain: [f64; 2]) -> TransferFunction {
    let point = |value: f64, opacity: f32| ControlPoint { value, color: [opacity, 0.0, 1.0], opacity };
    TransferFunction {
        domain,
        units: Units::Raw,
        scale,
        variable: Some("density".to_owned()),
        points: vec![point(domain[0], 0.0), point(domain[1], 1.0)],
        base_units: vec![BaseUnitRange { name: "vessel".to_owned(), range: [10.0, 100.0] }],
    }
}

#[test]
fn a_curve_runs_evenly_over_the_scaled_domain() {
    for (scale, domain) in
        [(Scale::Linear, [-5.0, 20.0]), (Scale::Log10, [1.0, 1e4]), (Scale::Symlog, [-1000.0, 1000.0])]
    {
        let curve = Curve::of(&function(scale, domain), "vessel").unwrap();
        let last = (curve.samples.len() - 1) as f32;
        for (k, (color, opacity)) in curve.samples.iter().enumerate() {
            // Between two points colour and opacity are linear in the scaled value.
            let want = k as f32 / last;
            assert!((opacity - want).abs() < 1e-5 && (color.x - want).abs() < 1e-5, "{scale:?} {k}: {opacity}");
        }
        assert_eq!((curve.domain, curve.range), (domain, Some([10.0, 100.0])));
        assert_eq!(Curve::of(&function(scale, domain), "tissue").unwrap().range, None);
    }
}

#[test]
fn an_unreadable_transfer_function_is_reported_and_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let (none, problems) = functions(&scene(), &folder.path().join("scene.toml"));
    assert_eq!(none, [None, None]);
    assert_eq!(problems.len(), 2);
    assert!(problems[0].contains("vessel") && problems[0].contains("tf.json"), "{problems:?}");
    std::fs::write(folder.path().join("tf.json"), function(Scale::Linear, [0.0, 1.0]).to_json().unwrap()).unwrap();
    // The scene may be named by its folder.
    let (some, problems) = functions(&scene(), folder.path());
    assert!(some.iter().all(Option::is_some) && problems.is_empty());
}
