//! Large inputs: the time grows with their size, and no faster.

use crate::case::{Case, Ending};
use crate::readers::{self, RIGHT};

fn one(reader: &str, name: &str, text: String) -> Case {
    let reader = readers::named(reader);
    let ending = reader.mistakes();
    reader.case("sizes", name, &reader.file()).bytes(&reader.file(), text).ending(ending)
}

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let units = |count: usize, file: &str| readers::scene_file(&vec![file; count]);
    cases.push(one("scene", "200,000 units", units(200_000, "right.ply")));
    cases.push(one("scene", "90,000 units", units(90_000, "u.ply")));
    cases.push(one("scene", "4,096 units of one name", {
        "schema = 1\n".to_owned() + &"[[unit]]\nname = \"a\"\nfile = \"a.ply\"\n".repeat(4096)
    }));
    let right = RIGHT.of("ply");
    let shared = |count: usize| {
        Case::new("sizes", format!("{count} units of one file"), &["scene", "info", "in.toml"])
            .bytes("in.toml", units(count, "right.ply"))
            .bytes("right.ply", right.clone())
    };
    cases.push(shared(2000).ending(Ending::Done));
    let editable = RIGHT.of("ivrgs");
    cases.push(
        Case::new("sizes", "2000 units of one file with its palette", &["scene", "info", "in.toml", "--json"])
            .bytes("in.toml", units(2000, "right.ply"))
            .bytes("right.ply", editable)
            .ending(Ending::Done),
    );
    // Text of a megabyte becomes two thousand megabytes.
    cases.push(
        Case::new("sizes", "2000 units of one large file", &["scene", "info", "in.toml"])
            .bytes("in.toml", units(2000, "right.ply"))
            .bytes("right.ply", readers::ascii_ply(30_000)),
    );
    cases.push(one("transfer", "150,000 base units", readers::transfer(150_000)));
    cases.push(one("transfer", "300 base units", readers::transfer(300)));
    cases.push(one("strokes", "200,000 strokes", readers::strokes(200_000)));
    cases.push(one("strokes", "200,000 operations", {
        format!("{{\"strokes\":[{}]}}", vec![r#"{"operation":"grow","distance":0.1}"#; 200_000].join(","))
    }));
    cases.push(one("strokes", "a million points", {
        let points = vec!["[0,0,0]"; 1_000_001].join(",");
        format!("{{\"strokes\":[{{\"mode\":\"walk\",\"kind\":\"foreground\",\"radius\":1,\"points\":[{points}]}}]}}")
    }));
    cases.push(one("graph", "200,000 edges out of range", {
        format!("{{\"nodes\":2,\"edges\":[{}]}}", vec!["[0,2,1]"; 200_000].join(","))
    }));
    cases.push(one("camera", "two megabytes of blanks", " ".repeat(2 << 20) + "{}"));
    cases.push(one("camera path", "two megabytes of blanks", " ".repeat(2 << 20)));
    cases.push(one("scene", "five megabytes of comment", "# a\n".repeat(5 << 18)));
    cases.push(one("ply", "58,000 properties", {
        let property = |i: usize| format!("property char {i}\n");
        let element = |e: usize| format!("element e{e} 0\n") + &(0..4096).map(property).collect::<String>();
        format!("ply\nformat ascii 1.0\n{}end_header\n", (0..14).map(element).collect::<String>())
    }));
    cases.push(one(
        "ascii",
        "a row of a megabyte",
        readers::ascii_ply(0).replace("vertex 0", "vertex 1") + &"0 ".repeat(1 << 19),
    ));
    cases
}
