//! The executable: exit status, output of each stream, files left on disk, and the numbers in it.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use sg_formats::npy::{read_floats, read_labels, read_mask, write_array, write_labels, write_mask};

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_supergaussian-selection")).current_dir(folder).args(arguments).output().unwrap()
}

/// Runs a command that must succeed and returns its output.
fn succeed(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Runs a command that must fail with one line that holds all the given words, leaving nothing behind.
fn refuse(folder: &Path, status: i32, arguments: &[&str], words: &[&str]) {
    let before = names(folder);
    let output = run(folder, arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "{message}");
    let line = message.lines().find(|l| l.starts_with("error: ")).unwrap_or_default();
    assert!(!line.is_empty(), "{message}");
    for word in words {
        assert!(message.contains(word), "{message:?} lacks {word:?}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert_eq!(names(folder), before, "a failed run leaves no file");
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn report(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// Two balls of Gaussians side by side as a 3DGS file, joined by a thin bridge; the last Gaussian has no position.
fn two_balls(folder: &Path, each: usize) -> Vec<bool> {
    let mut r = ChaCha8Rng::seed_from_u64(1);
    let mut rows = String::new();
    let mut left = Vec::new();
    let mut put = |p: [f64; 3], is_left: bool| {
        writeln!(rows, "{} {} {} 0 0 0 2 -3 -3 -3.5 1 0 0 0", p[0], p[1], p[2]).unwrap();
        left.push(is_left);
    };
    for i in 0..2 * each {
        let p: [f64; 3] = loop {
            let p: [f64; 3] = std::array::from_fn(|_| r.random_range(-1.0..1.0));
            if p.iter().map(|x| x * x).sum::<f64>() < 1.0 {
                break p;
            }
        };
        let is_left = i % 2 == 0;
        put([p[0] + if is_left { -1.2 } else { 1.2 }, p[1], p[2]], is_left);
    }
    for i in 0..10 {
        put([-0.2 + 0.04 * f64::from(i), 0.0, 0.0], i < 5);
    }
    put([f64::NAN, 0.0, 0.0], false);
    let names = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
        "rot_2", "rot_3",
    ];
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", left.len());
    names.iter().for_each(|n| writeln!(text, "property float {n}").unwrap());
    text += "end_header\n";
    text += &rows;
    std::fs::write(folder.join("balls.ply"), text).unwrap();
    left
}

fn strokes(folder: &Path, name: &str, list: &Value) {
    std::fs::write(folder.join(name), json!({ "strokes": list }).to_string()).unwrap();
}

#[test]
fn clusters_are_written_reported_and_used_again() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let left = two_balls(at, 1500);
    let n = left.len();
    let printed = succeed(
        at,
        &["cluster", "balls.ply", "--out", "labels.npy", "--max-clusters", "120", "--report", "r.json", "--json"],
    );
    assert_eq!(printed, std::fs::read_to_string(at.join("r.json")).unwrap());
    let r = report(&printed);
    for key in ["clusters", "mean_size", "size_cv", "compactness", "same_label_knn", "objective", "seconds", "dropped"]
    {
        assert!(!r[key].is_null(), "the report lacks {key}");
    }
    let labels = read_labels(&at.join("labels.npy")).unwrap();
    let count = r["clusters"].as_u64().unwrap() as i32;
    assert!(count > 60 && count <= 120 && r["dropped"] == 1);
    assert_eq!(labels.len(), n);
    assert_eq!((labels.iter().max(), labels[n - 1]), (Some(&(count - 1)), -1));
    assert!(labels[..n - 1].iter().all(|l| *l >= 0));

    // Paint the left ball, then remove the right one by a background walk.
    strokes(
        at,
        "s.json",
        &json!([
            {"mode": "walk", "kind": "foreground", "radius": 0.06, "points": [[0.1, 0.5, 0.5], [0.4, 0.5, 0.5]]},
            {"mode": "walk", "kind": "background", "radius": 0.06, "points": [[0.65, 0.5, 0.5], [0.9, 0.5, 0.5]]},
        ]),
    );
    write_mask(&at.join("truth.npy"), &sg_scene::mask::Mask::from_fn(n, |i| left[i])).unwrap();
    let base = ["select", "balls.ply", "--strokes", "s.json", "--clusters", "labels.npy", "--out", "mask.npy"];
    let more = ["--probabilities", "p.npy", "--truth", "truth.npy", "--leak", "0.001", "--json"];
    let r = report(&succeed(at, &[&base[..], &more].concat()));
    for key in
        ["selected", "seeds_foreground", "seeds_background", "conflicts", "auto_background", "unreached", "seconds"]
    {
        assert!(r[key].is_number(), "the report lacks {key}: {r}");
    }
    for key in ["acc", "mcc", "f1", "iou", "precision", "recall"] {
        assert!(r[key].as_f64().unwrap() > 0.9, "{key}: {r}");
    }
    let mask = read_mask(&at.join("mask.npy"), n).unwrap();
    assert_eq!(mask.count() as u64, r["selected"].as_u64().unwrap());
    assert!(!mask.get(n - 1));
    let (shape, p) = read_floats(&at.join("p.npy")).unwrap();
    assert_eq!(shape, [count as usize]);
    for (g, &l) in labels[..n - 1].iter().enumerate() {
        assert!(mask.get(g) == (p[l as usize] > 0.5) || (p[l as usize] - 0.5).abs() < 1e-9);
    }
    // Places for the next stroke: clusters that are open, in the box, best first and each once.
    succeed(at, &[&base[..], &["--proposals", "next.json", "--proposal-count", "5", "--leak", "0.001"]].concat());
    let next = report(&std::fs::read_to_string(at.join("next.json")).unwrap());
    let next = next["proposals"].as_array().unwrap();
    assert_eq!(next.len(), 5);
    for key in ["cluster", "gaussians", "p", "q", "uncertainty", "expected_shift", "expected_change"] {
        assert!(next.iter().all(|n| n[key].is_number()), "a proposal lacks {key}");
    }
    let distinct: std::collections::BTreeSet<u64> = next.iter().map(|n| n["cluster"].as_u64().unwrap()).collect();
    assert_eq!(distinct.len(), 5);
    let most = next.iter().map(|n| n["expected_change"].as_f64().unwrap()).fold(0.0, f64::max);
    assert!(next[0]["expected_change"].as_f64() == Some(most) && most > 0.0);
    assert!(
        next.iter().all(|n| n["point"].as_array().unwrap().iter().all(|x| (0.0..=1.0).contains(&x.as_f64().unwrap())))
    );
    refuse(at, 2, &[&base[..], &["--proposals", "x.json", "--method", "gaussian"]].concat(), &["--method cluster"]);
    // Sharper at the boundary.
    let r =
        report(&succeed(at, &[&base[..], &["--truth", "truth.npy", "--leak", "0.001", "--json", "--refine"]].concat()));
    assert!(r["iou"].as_f64().unwrap() > 0.9 && r["refined"]["band"].as_u64().unwrap() > 0, "{r}");
    assert!(r["refined"]["estimate"].as_f64().unwrap() <= 1e-3 && r["stage_seconds"]["refine"].is_number(), "{r}");
    refuse(at, 2, &[&base[..], &["--refine", "3", "--method", "gaussian"]].concat(), &["--method cluster"]);
    // Every form, and walks on single Gaussians.
    for extra in [
        ["--graph", "printed"],
        ["--graph", "all-pairs"],
        ["--graph", "euclidean"],
        ["--background", "farthest"],
        ["--method", "gaussian"],
    ] {
        let r = report(&succeed(
            at,
            &[&base[..], &["--truth", "truth.npy", "--leak", "0.0001", "--json"], &extra].concat(),
        ));
        assert!(r["iou"].as_f64().unwrap() > 0.8, "{extra:?}: {r}");
    }
}

#[test]
fn one_stroke_is_answered_at_every_scale() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let n = two_balls(at, 900).len();
    let green =
        json!({"mode": "walk", "kind": "foreground", "radius": 0.06, "points": [[0.1, 0.5, 0.5], [0.4, 0.5, 0.5]]});
    strokes(at, "s.json", &json!([green]));
    let base = ["select", "balls.ply", "--strokes", "s.json", "--out", "m.npy", "--json"];
    let of = |more: &[&str]| {
        let r = report(&succeed(at, &[&base[..], more].concat()));
        (r, read_mask(&at.join("m.npy"), n).unwrap())
    };
    let (first, mask) = of(&[]);
    let answers = &first["answers"];
    let family = answers["family"].as_array().unwrap();
    let (steps, taken) = (answers["steps"].as_array().unwrap(), answers["taken"].as_u64().unwrap());
    assert_eq!((family.len(), Some(taken)), (12, answers["first"].as_u64()));
    let own = &family[steps[taken as usize].as_u64().unwrap() as usize];
    assert_eq!((&own["gaussians"], &own["leak"]), (&first["selected"], &first["leak"]));
    let column = |key: &str| family.iter().map(|a| a[key].as_f64().unwrap()).collect::<Vec<f64>>();
    assert!(column("gaussians").is_sorted() && column("leak").is_sorted_by(|a, b| a > b), "{answers}");
    assert!(column("conductance").iter().all(|c| (0.0..=1.0).contains(c)), "{answers}");
    // The neighbours in scale hold the first answer, or are held by it. The same leak as a step selects the same.
    let mut chosen = 0;
    for (scale, to) in [("narrower", taken.checked_sub(1)), ("default", Some(taken)), ("wider", Some(taken + 1))] {
        let (r, other) = of(&["--scale", scale]);
        match to.and_then(|to| steps.get(to as usize)) {
            None => assert_eq!(other, mask, "no clear step lies there"),
            Some(step) => {
                chosen += 1;
                assert_eq!(r["selected"], family[step.as_u64().unwrap() as usize]["gaussians"], "{scale}");
                assert!(if scale == "wider" { mask.is_subset_of(&other) } else { other.is_subset_of(&mask) });
                strokes(at, "tuned.json", &json!([green, {"leak": r["leak"], "threshold": 0}]));
                let tuned = ["select", "balls.ply", "--strokes", "tuned.json", "--out", "m.npy"];
                succeed(at, &tuned);
                assert_eq!(read_mask(&at.join("m.npy"), n).unwrap(), other, "{scale}");
            }
        }
    }
    assert!(chosen >= 2, "{answers}");
    // A leak of one's own is the walk without creases and without a family.
    let (plain, _) = of(&["--leak", "0.03"]);
    assert!(plain["answers"].is_null() && plain["leak"] == 0.03);
    refuse(at, 2, &[&base[..], &["--leak", "0.03", "--scale", "wider"]].concat(), &["--scale"]);
    refuse(at, 2, &[&base[..], &["--crease", "-1"]].concat(), &["--crease is -1"]);
}

#[test]
fn a_cache_is_found_again_and_its_damage_is_repaired() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    two_balls(at, 600);
    strokes(at, "s.json", &json!([{"mode": "cluster", "kind": "toggle", "radius": 0.1, "points": [[0.2, 0.5, 0.5]]}]));
    let select = || {
        let output =
            run(at, &["select", "balls.ply", "--strokes", "s.json", "--out", "m.npy", "--cache", "kept", "--json"]);
        assert!(output.status.success());
        let warned = String::from_utf8_lossy(&output.stderr).contains("computed again");
        (std::fs::read(at.join("m.npy")).unwrap(), report(&String::from_utf8(output.stdout).unwrap()), warned)
    };
    let (first, made, _) = select();
    assert!(made["stage_seconds"]["clusters"].is_number() && made["selected"].as_u64().unwrap() > 0);
    let (second, found, warned) = select();
    assert!(first == second && found["stage_seconds"]["clusters"].is_null() && !warned);
    let entry = at.join("kept").join(&names(&at.join("kept"))[0]);
    let mut bytes = std::fs::read(&entry).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&entry, bytes).unwrap();
    let (third, _, warned) = select();
    assert!(first == third && warned);
    assert!(!select().2, "the entry was written anew");
}

#[test]
fn seeds_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    two_balls(at, 400);
    write_labels(&at.join("seeds.npy"), &[0, 1, 2, 3, 4, 5]).unwrap();
    let seeded = [
        "cluster",
        "balls.ply",
        "--out",
        "l.npy",
        "--seeds",
        "seeds.npy",
        "--cell",
        "0.8",
        "--rounds",
        "1",
        "--no-merge",
    ];
    let r = report(&succeed(at, &[&seeded[..], &["--json"]].concat()));
    assert_eq!((r["clusters"].as_u64(), r["objective"].as_array().unwrap().len()), (Some(6), 1));
    let labels = read_labels(&at.join("l.npy")).unwrap();
    assert_eq!(labels[..6], [0, 1, 2, 3, 4, 5], "a seed belongs to its own cluster");
    refuse(at, 2, &["cluster", "balls.ply", "--out", "x.npy", "--seeds", "seeds.npy"], &["--cell"]);
    write_labels(&at.join("far.npy"), &[0, 5000]).unwrap();
    refuse(
        at,
        2,
        &["cluster", "balls.ply", "--out", "x.npy", "--seeds", "far.npy", "--cell", "1"],
        &["far.npy", "5000"],
    );
    write_labels(&at.join("nan.npy"), &[810]).unwrap();
    refuse(at, 2, &["cluster", "balls.ply", "--out", "x.npy", "--seeds", "nan.npy", "--cell", "1"], &["810", "finite"]);
}

#[test]
fn wrong_input_is_one_line_and_status_2() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let n = two_balls(at, 50).len();
    strokes(at, "s.json", &json!([{"mode": "walk", "kind": "foreground", "radius": 0.1, "points": [[0.2, 0.5, 0.5]]}]));
    strokes(
        at,
        "toggle.json",
        &json!([{"mode": "walk", "kind": "toggle", "radius": 0.1, "points": [[0.2, 0.5, 0.5]]}]),
    );
    std::fs::write(at.join("cut.json"), "{\"strokes\": [").unwrap();
    write_labels(&at.join("short.npy"), &[0; 3]).unwrap();
    write_array(&at.join("floats.npy"), &[n], &vec![0.0_f32; n]).unwrap();
    let cluster = |more: &[&'static str]| [&["cluster", "balls.ply", "--out", "x.npy"][..], more].concat();
    refuse(at, 2, &["cluster", "none.ply", "--out", "x.npy"], &["none.ply"]);
    refuse(at, 2, &cluster(&["--max-clusters", "0"]), &["clusters is 0"]);
    refuse(at, 2, &cluster(&["--neighbours", "0"]), &["neighbours is 0"]);
    refuse(at, 2, &cluster(&["--compactness", "-1"]), &["-1"]);
    refuse(at, 2, &cluster(&["--compactness", "NaN"]), &["NaN"]);
    refuse(at, 2, &cluster(&["--method", "manhattan"]), &["manhattan"]);
    refuse(at, 2, &cluster(&["--method", "euclidean", "--level", "fast"]), &["fast"]);
    refuse(at, 2, &["cluster", "balls.ply"], &["required"]);
    let select = |strokes: &'static str, more: &[&'static str]| {
        [&["select", "balls.ply", "--out", "x.npy", "--strokes", strokes][..], more].concat()
    };
    refuse(at, 2, &select("none.json", &[]), &["none.json"]);
    refuse(at, 2, &select("toggle.json", &[]), &["toggle.json", "stroke 1", "cluster mode"]);
    refuse(at, 2, &select("cut.json", &[]), &["cut.json", "line 1"]);
    refuse(at, 2, &select("s.json", &["--leak", "-0.1"]), &["leak", "-0.1"]);
    refuse(at, 2, &select("s.json", &["--sigma-s", "0"]), &["sigma-s"]);
    refuse(at, 2, &select("s.json", &["--clusters", "short.npy"]), &["short.npy", "3 labels for"]);
    refuse(at, 2, &select("s.json", &["--clusters", "floats.npy"]), &["floats.npy"]);
    refuse(at, 2, &select("s.json", &["--truth", "short.npy"]), &["short.npy"]);
    refuse(at, 1, &["cluster", "balls.ply", "--out", "none/x.npy"], &["none/x.npy"]);
}

fn solve(folder: &Path, graph: &Value, more: &[&str]) -> Value {
    std::fs::write(folder.join("g.json"), graph.to_string()).unwrap();
    succeed(folder, &[&["solve", "g.json", "--out", "s.json"][..], more].concat());
    report(&std::fs::read_to_string(folder.join("s.json")).unwrap())
}

#[test]
fn a_graph_is_solved_to_the_last_digit() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // 0 — 1 — 2 — 3 with conductances 1, ½ + ½ (named twice), 2; node 4 hangs on nothing, 5 is named in both lists.
    let graph = json!({
        "nodes": 7,
        "edges": [[0, 1, 1], [1, 2, 0.5], [2, 1, 0.5], [2, 3, 2.0], [1, 1, 9], [0, 2, 0], [5, 6, 1.5]],
        "foreground": [0, 5], "background": [3, 5], "leak": 0
    });
    for solver in ["gth", "cholesky", "cg"] {
        for precision in ["f64", "f32"] {
            let s = solve(at, &graph, &["--solver", solver, "--precision", precision]);
            let close = |key: &str, want: [f64; 7]| {
                let limit = if precision == "f64" { 1e-14 } else { 1e-6 };
                let got = s[key].as_array().unwrap();
                assert_eq!(got.len(), 7);
                let off = got.iter().zip(want).map(|(g, w)| (g.as_f64().unwrap() - w).abs()).fold(0.0, f64::max);
                assert!(off <= limit, "{solver} {precision} {key}: {off}");
            };
            close("p", [1.0, 0.6, 0.2, 0.0, 0.0, 0.0, 0.0]);
            close("q", [0.0, 0.4, 0.8, 1.0, 0.0, 0.0, 0.0]);
            assert_eq!(s["reached"], json!([true, true, true, true, false, false, false]));
            assert_eq!(s["selected"], json!([true, true, false, false, false, false, false]));
        }
    }
    // Numbers come back bit for bit.
    let s =
        solve(at, &json!({"nodes": 3, "edges": [[0, 1, 0.1], [1, 2, 0.2]], "foreground": [0], "background": [2]}), &[]);
    let p = s["p"][1].as_f64().unwrap();
    assert_eq!(p, 0.1 / (0.1 + 0.2));
    // A tie is not selected; a leak of 1e-100 still leaks.
    let tie = solve(
        at,
        &json!({"nodes": 3, "edges": [[0, 1, 1], [1, 2, 1]], "foreground": [0], "background": [2], "leak": 0}),
        &[],
    );
    assert_eq!((tie["p"][1].as_f64(), tie["selected"][1].as_bool()), (Some(0.5), Some(false)));
    let leak =
        solve(at, &json!({"nodes": 2, "edges": [[0, 1, 1]], "foreground": [0], "background": [], "leak": 1e-100}), &[]);
    assert_eq!((leak["q"][1].as_f64(), leak["selected"][1].as_bool()), (Some(1e-100), Some(true)));
    assert_eq!(solve(at, &json!({"nodes": 0, "edges": []}), &[])["p"], json!([]));
}

#[test]
fn graphs_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for (text, words) in [
        (r#"{"nodes":2,"edges":[[0,1,-1]]}"#, &["edge 0", "-1"][..]),
        (r#"{"nodes":2,"edges":[[0,1,1e999]]}"#, &["line 1"]),
        (r#"{"nodes":2,"edges":[[0,1,NaN]]}"#, &["line 1"]),
        (r#"{"nodes":2,"edges":[[0,2,1]]}"#, &["edge 0", "2"]),
        (r#"{"nodes":2,"edges":[],"foreground":[2]}"#, &["foreground", "2"]),
        (r#"{"nodes":2,"edges":[],"leak":-1}"#, &["leak is -1"]),
        (r#"{"nodes":2,"edges":[],"leek":0}"#, &["leek"]),
        (r#"{"edges":[]}"#, &["nodes"]),
        (r#"{"nodes":1e15,"edges":[]}"#, &["line 1"]),
        (r#"{"nodes":99999999999,"edges":[]}"#, &["99999999999"]),
        (r#"{"nodes":2,"edges":[[0,1"#, &["line 1"]),
    ] {
        std::fs::write(at.join("g.json"), text).unwrap();
        let mut all = vec!["g.json"];
        all.extend(words);
        refuse(at, 2, &["solve", "g.json", "--out", "s.json"], &all);
    }
    refuse(at, 2, &["solve", "none.json", "--out", "s.json"], &["none.json"]);
    // A graph that f32 cannot hold: the work fails, and the line names the remedy.
    let chain: Vec<Value> = (0..57).map(|i| json!([i, i + 1, 10.0_f64.powi(-i)])).collect();
    let graph = json!({"nodes": 58, "edges": chain, "foreground": [0], "background": [57]});
    std::fs::write(at.join("g.json"), graph.to_string()).unwrap();
    refuse(at, 1, &["solve", "g.json", "--out", "s.json", "--precision", "f32"], &["f32", "--precision f64"]);
}

#[test]
fn help_shows_one_example() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["cluster", "select", "solve"] {
        let help = succeed(folder.path(), &[command, "--help"]);
        assert!(help.contains(&format!("Example: supergaussian selection {command} ")), "{help}");
    }
}
