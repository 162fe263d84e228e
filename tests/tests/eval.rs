//! The short form of the evaluation: numbers that must hold for all shapes, and the same numbers twice.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking and tells what it measured")]

use std::collections::BTreeSet;

use serde_json::Value;
use sg_tests::eval::ablation::{Ablation, SubjectRows, run};
use sg_tests::eval::measure::{Medians, Spread};
use sg_tests::eval::shapes::{REPORTED, TUNING, shape};
use sg_tests::eval::subject::Parametrisation;
use sg_tests::eval::{Options, language, one_stroke, plots, report};

fn small() -> Options {
    let shapes = vec!["aneurysm".to_owned()];
    Options { shapes, gaussians: 4000, clusters: 150, trials: 5, gaussian_trials: 1, ..Options::quick(3) }
}

fn quick() -> Ablation {
    run(&small(), &|_| ()).unwrap()
}

/// The numbers without those that are times.
fn without_times(value: &mut Value) {
    match value {
        Value::Object(entries) => {
            entries.retain(|key, _| !(key.ends_with("_seconds") || key.ends_with("_ms")));
            entries.values_mut().for_each(without_times);
        }
        Value::Array(entries) => entries.iter_mut().for_each(without_times),
        _ => {}
    }
}

fn shares(s: &Spread) {
    let all = [s.p05, s.p25, s.median, s.p75, s.p95];
    assert!(all.iter().all(|x| (0.0..=1.0).contains(x)) && all.is_sorted(), "{s:?}");
}

/// A law of medians of agreements: each is monotone in the other if one determines the other.
fn medians(m: &Medians) {
    shares(&m.iou);
    let iou = m.iou.median;
    // F1 = 2·IoU / (1 + IoU): the median is carried along by a monotone function of an odd number of values.
    assert!((m.f1 - 2.0 * iou / (1.0 + iou)).abs() < 1e-12 && m.f1 >= iou);
    assert!((0.0..=1.0).contains(&m.acc) && (-1.0..=1.0).contains(&m.mcc));
    assert!(m.precision >= iou && m.recall >= iou && m.precision <= 1.0 && m.recall <= 1.0);
    // Missed and added Gaussians are at most 1 − IoU of the union. The union is no larger than the scene.
    assert!(m.acc >= iou - 1e-12, "{m:?}");
}

fn rows(subject: &SubjectRows, clusters: usize) {
    for row in &subject.clusterings {
        let off = row.clusters as f64 / clusters as f64 - 1.0;
        assert!(off.abs() <= 0.02, "{}: {} clusters for {clusters}", row.variant, row.clusters);
        let p = &row.partition;
        for x in [p.achievable_accuracy, p.boundary_recall, row.best_union_iou, row.same_label_knn] {
            assert!((0.0..=1.0).contains(&x), "{row:?}");
        }
        // Every Gaussian outside its right cluster is astray in two parts.
        assert!(p.under_segmentation >= 1.0 - p.achievable_accuracy - 1e-12);
        assert!((row.mean_size * row.clusters as f64 - subject.gaussians as f64).abs() < 0.5);
        // No selection of whole clusters is better than the best one.
        assert!(
            row.walk.both.iou.p95 <= row.best_union_iou + 1e-12 && row.walk.green.iou.p95 <= row.best_union_iou + 1e-12
        );
        medians(&row.walk.both);
        assert_eq!(row.walk.failed, 0);
    }
    for row in &subject.walks {
        assert_eq!(row.failed, 0, "{}", row.variant);
        medians(&row.green);
        medians(&row.both);
    }
}

#[test]
fn evaluation_invariants_hold_and_a_seed_repeats() {
    let first = quick();
    assert_eq!(first.subjects.len(), 2);
    for subject in &first.subjects {
        rows(subject, first.clusters_wanted);
        let walk = |name: &str| report::walk_row(subject, name).map(|r| (r.green, r.both));
        if subject.parametrisation == Parametrisation::Coherent {
            // The same walk by three names.
            assert_eq!(walk("walk"), walk("graph contact"));
            assert_eq!(walk("walk"), walk("leak 0.03"));
            assert_eq!(walk("walk"), walk("sigma 1 1"));
            // Without a leak and without red, everything that is reached is selected: all of a connected scene.
            let (green, _) = walk("leak 0").unwrap();
            assert!((green.recall - 1.0).abs() < 1e-12 && green.precision < 0.5);
        }
    }
    // Some features do not depend on the way a scene is written down. They do not change with it, nor does any row that uses
    // them.
    let [coherent, scrambled] = &first.subjects[..] else { unreachable!("two subjects") };
    let invariant = |s: &SubjectRows| s.clusterings.iter().find(|r| r.variant == "features invariant").unwrap().clone();
    let (a, b) = (invariant(coherent), invariant(scrambled));
    assert!((a.partition.boundary_recall - b.partition.boundary_recall).abs() < 0.02, "{a:?} {b:?}");

    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = pool.install(quick);
    let [mut a, mut b] = [&first, &again].map(|x| serde_json::to_value(x).unwrap());
    without_times(&mut a);
    without_times(&mut b);
    assert_eq!(a, b);
    assert_eq!(report::markdown(&first, true), report::markdown(&again, true));

    let folder = tempfile::tempdir().unwrap();
    for name in plots::draw(&first, folder.path()).unwrap() {
        let text = std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(text.starts_with("<svg") && text.contains("aneurysm") && text.trim_end().ends_with("</svg>"), "{name}");
    }
}

#[test]
fn every_shape_has_its_target_and_other_parts() {
    let mut sizes = BTreeSet::new();
    for name in REPORTED.into_iter().chain(TUNING) {
        let made = shape(name, 3000, 1).unwrap();
        let share = made.wanted() as f64 / 3000.0;
        println!("{name}: {share:.3} wanted");
        assert_eq!((made.scene.len(), made.part.len()), (3000, 3000));
        assert!((0.01..0.5).contains(&share), "{name}: {share}");
        assert!(made.scene.units[0].gaussians.check_lengths().is_ok());
        assert_eq!(shape(name, 3000, 1).unwrap().scene, made.scene, "the same for a seed");
        assert_ne!(shape(name, 3000, 2).unwrap().scene, made.scene);
        sizes.insert(made.wanted());
    }
    assert!(sizes.len() > 1 && shape("sphere", 10, 1).is_none());
}

#[test]
fn one_stroke_repeats_for_a_seed_and_no_answer_beats_the_best_union_of_clusters() {
    let options = one_stroke::Options { tuning: false, gaussians: 2500, strokes: 1, clicks: true, seed: 3, data: None };
    let first = one_stroke::run(&options, &|_| ()).unwrap();
    assert!(first.len() > 60 && first.iter().any(|p| p.length == "short"));
    for p in &first {
        let all = p.plain.iou.iter().chain(&p.creased.iou).chain(&p.three).chain(&p.three_plain);
        for iou in all.chain(p.clicks.iter().flatten().flatten()) {
            assert!((0.0..=p.union + 1e-12).contains(iou), "{}, part {}: {iou} of {}", p.scene, p.part, p.union);
        }
        // A larger leak selects less, among the rising ones.
        for curve in [&p.plain, &p.creased] {
            assert!(curve.gaussians[..one_stroke::LEAKS].is_sorted_by(|a, b| a >= b));
        }
    }
    let tables = one_stroke::tables(&first, 3);
    assert!(one_stroke::markdown(&tables).contains("**best of three answers**"));
    let of = |rule: &str| tables.cells.iter().filter(|c| c.rule.contains(rule)).map(|c| c.iou).sum::<f64>();
    assert!(of("best of three answers**") >= of("**first answer**") && of("**first answer**") > of("ε = .03, creases"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let again = pool.install(|| one_stroke::run(&options, &|_| ()).unwrap());
    assert_eq!(serde_json::to_value(&first).unwrap(), serde_json::to_value(&again).unwrap());
    assert_eq!(serde_json::to_value(&tables).unwrap(), serde_json::to_value(one_stroke::tables(&again, 3)).unwrap());
}

#[test]
fn utterances_are_judged_by_the_state_in_which_the_scene_ends() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set.toml");
    let utterances = [
        (r#"["make the sac red"]"#, r#"["sac.color = red"]"#),
        (r#"["hide the bone", "undo"]"#, r#"["unchanged"]"#),
        (r#"["hide everything but the sac"]"#, r#"["vessels, bone, tissue, clip.visible = false"]"#),
        (r#"["select the clip", "keep this view as front"]"#, r#"["selection = clip", "kept front"]"#),
        (r#"["start a tour"]"#, r#"["tour on"]"#),
        (r#"["undo"]"#, r#"["selection = clip"]"#),
        // These two are wrong.
        (r#"["make the sac red"]"#, r#"["sac.color = green"]"#),
        (r#"["make the sac red and hide the bone"]"#, r#"["sac.color = red"]"#),
        (r#"["what is there?"]"#, r#"["unchanged"]"#),
    ];
    let text: String = utterances
        .iter()
        .map(|(say, expect)| format!("[[utterance]]\nkind = \"any\"\nsay = {say}\nexpect = {expect}\n"))
        .collect();
    std::fs::write(&set, text).unwrap();
    let options = language::Options { sets: vec![set], settings: Vec::new(), every: 1 };
    let measured = language::run(&options, &|_| ()).unwrap();
    let found: Vec<(bool, bool)> =
        measured[0].played.iter().map(|played| (played.problems.is_empty(), played.is_false_action)).collect();
    let (right, wrong, more) = ((true, false), (false, false), (false, true));
    // Undo at the start takes back that the selection was cleared.
    let expected = [right, right, right, right, right, right, wrong, more, right];
    println!("{measured:#?}");
    assert_eq!(found, expected);
}
