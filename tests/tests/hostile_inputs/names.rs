//! Names that would act on a terminal.

use crate::case::{Case, Ending};
use crate::readers::{self, READERS, RIGHT};

/// Names of files. None holds a slash.
const NAMES: [(&str, &str); 6] = [
    ("escape", "\u{1b}[2J\u{1b}]0;owned\u{7}"),
    ("line ends", "a\nerror: b\r\tc"),
    ("eight bit controls", "\u{9b}31m\u{90}\u{85}"),
    ("reordered", "\u{202e}ylp.x\u{2066}"),
    ("hidden", "a\u{200b}\u{feff}\u{e0041}\u{2028}b"),
    ("delete", "\u{7f}\u{8}\u{8}ok"),
];

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for reader in READERS.into_iter().filter(|r| r.takes_any_name()) {
        for (at, (name, text)) in NAMES.into_iter().enumerate() {
            let file = format!("{text}{}", reader.ending);
            // A file that is not there, and one of a wrong content.
            let case = reader.case("names", name, &file);
            let wrong = if reader.shows_lines { "= \u{1b}[31m\n" } else { "\u{1b}[2Jwrong \u{202e}" };
            let ending = reader.mistakes();
            cases.push(if at % 2 == 0 { case.bytes(&file, wrong).ending(ending) } else { case });
        }
    }
    cases.extend(in_files());
    cases
}

/// Names inside of files.
fn in_files() -> Vec<Case> {
    let mut cases = Vec::new();
    let escape = "\u{1b}[2J\u{9b}31m\u{202e}";
    let mut add = |reader: &str, name: &str, text: String| {
        let reader = readers::named(reader);
        let ending = reader.mistakes();
        cases.push(reader.case("names inside", name, &reader.file()).bytes(&reader.file(), text).ending(ending));
    };
    let ply = |header: &str| format!("ply\nformat ascii 1.0\n{header}end_header\n");
    add("ply", "keyword", ply(&format!("{escape} 3\n")));
    add("ply", "element", ply(&format!("element {escape} 3\nproperty float x\n")));
    add("ply", "count", ply(&format!("element vertex {escape}\n")));
    add("ply", "type", ply(&format!("element vertex 1\nproperty {escape} x\n")));
    add("ply", "format", format!("ply\nformat {escape} 1.0\nend_header\n"));
    add("ply", "property twice", ply(&format!("element vertex 1\nproperty float {escape}\nproperty float {escape}\n")));
    add("ply", "value", ply("element vertex 1\nproperty float x\n") + escape + "\n");
    add("ply", "only other elements", ply(&format!("element {escape} 0\nproperty float x\n")));
    add("scene", "unit twice", {
        let unit = "[[unit]]\nname = \"\\u001b[2J\\u202e\\u009b\"\nfile = \"a.ply\"\n";
        format!("schema = 1\n{unit}{unit}")
    });
    add("scene", "key", "schema = 1\n\"\\u001b[2J\" = 1\n".to_owned());
    add("scene", "file", "schema = 1\n[[unit]]\nname = \"a\"\nfile = \"\\u001b[2J\\n\\u202e.ply\"\n".to_owned());
    add("scene", "convention", {
        "schema = 1\n[[unit]]\nname = \"a\"\nfile = \"a.ply\"\nconvention = \"\\u001b[2J\\n\"\n".to_owned()
    });
    add(
        "transfer",
        "unit twice",
        readers::transfer(2).replace("\"u1\"", "\"\\u001b[2J\"").replace("\"u0\"", "\"\\u001b[2J\""),
    );
    add("transfer", "scale", "{\"domain\":[0,1],\"scale\":\"\\u001b[2J\\u202e\",\"points\":[]}".to_owned());
    add("camera", "key", "{\"\\u001b[2J\\u202e\\n\":1}".to_owned());
    add("camera path", "key", "\u{1b}[2J\u{202e} 1\n".to_owned());
    add("strokes", "mode", "{\"strokes\":[{\"mode\":\"\\u001b[2J\\n\"}]}".to_owned());
    add("strokes", "operation", "{\"strokes\":[{\"operation\":\"\\u001b[2J\\n\\u202e\"}]}".to_owned());
    add("strokes", "key", "{\"\\u001b[2J\\n\":[]}".to_owned());
    add("graph", "key", "{\"\\u001b[2J\\n\":[]}".to_owned());
    add("metaimage", "type", readers::metaimage("8 8 8", escape, ""));
    add("metaimage", "sizes", readers::metaimage(escape, "MET_UCHAR", ""));
    add("metaimage", "line", format!("NDims = 3\n{escape}\n"));
    add("metaimage", "data file", readers::metaimage("8 8 8", "MET_UCHAR", "").replace("LOCAL", escape));
    add("nrrd", "type", readers::nrrd("8 8 8", escape, "raw"));
    add("nrrd", "sizes", readers::nrrd(escape, "uint8", "raw"));
    add("nrrd", "encoding", readers::nrrd("8 8 8", "uint8", escape));
    add("nrrd", "line", format!("NRRD0004\n{escape}\n\n"));
    add("nrrd", "data file", format!("{}\ndata file: {escape}\n\n", readers::nrrd("8 8 8", "uint8", "raw").trim_end()));
    let vti = String::from_utf8(RIGHT.of("vti")).unwrap();
    add("vti", "type", vti.replace("\"ImageData\" byte", "\"&#27;[2J&#x202e;\" byte"));
    add("vti", "array", vti.replace("UInt8", "&#27;[2J").replace("Name=\"d\"", "Name=\"&#155;&#10;\""));
    add("vti", "format", vti.replace("ascii", "&#27;[2J"));
    add("vti", "extent", vti.replace("0 7 0 7 0 7", "&#27;[2J"));
    add("vti", "value", vti.replacen("ascii\">", "ascii\">\u{9b}2J ", 1));
    add("launch", "key", "schema = 1\n\"\\u001b[2J\\u202e\" = 1\n[service.a]\nexec = \"/bin/true\"\n".to_owned());
    add("launch", "service", "schema = 1\n[service.\"\\u001b[2J\\n\"]\nexec = \"/bin/true\"\n".to_owned());
    add("launch", "executable", "schema = 1\n[service.a]\nexec = \"./\\u001b[2J\\n\\u202e\"\n".to_owned());
    add(
        "launch",
        "after",
        "schema = 1\n[service.a]\nexec = \"/bin/true\"\nafter = { \"\\u001b[2J\" = \"ready\" }\n".to_owned(),
    );
    add("launch", "comment", "schema = 1 # \u{202e}\u{2066}\n[service.a]\nexec = 3 # \u{202e}\u{2066}\n".to_owned());
    add("launch", "role", "schema = 1\n[service.a]\nexec = \"/bin/true\"\nrole = \"\\u001b[2J\"\n".to_owned());
    add("script", "key", "[[step]]\n\"\\u001b[2J\\n\" = 1\n".to_owned());
    add("script", "picture", "[[step]]\ncapture = \"\\u001b[2J\\n\"\n".to_owned());
    add("script", "strokes", "[[step]]\nstrokes = \"\\u001b[2J\\n\"\n".to_owned());
    // Words of the command line that come from names, such as those of `*` in a shell.
    for words in [
        &["scene", "info", "--\u{1b}[2J"][..],
        &["render", "a.ply", "--out", "\u{1b}[2J"],
        &["\u{1b}[2J\u{202e}"],
        &["check", "none", "--set", "\u{1b}[2J"],
    ] {
        cases.push(
            Case::new("names inside", format!("word {:?}", words.last().unwrap()), words).ending(Ending::Mistakes),
        );
    }
    cases
}
