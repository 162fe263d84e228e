//! Paths at which no regular file with a content stands.

use crate::case::{Case, Content};
use crate::readers::READERS;

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let zero = || Content::Link("/dev/zero".to_owned());
    for reader in READERS {
        let file = reader.file();
        let case = |name: &str| reader.case("not regular", name, &file);
        // A link leads on from its own folder.
        let (folder, last) = file.split_at(file.rfind('/').map_or(0, |at| at + 1));
        let pipe = format!("{folder}pipe");
        cases.extend([
            case("nothing"),
            case("a pipe").with(&file, Content::Pipe),
            case("a socket").with(&file, Content::Socket),
            case("a folder").with(&file, Content::Folder),
            case("endless zeros").with(&file, zero()),
            case("a terminal").with(&file, Content::Link("/dev/tty".to_owned())),
            case("a link to a pipe").with(&pipe, Content::Pipe).with(&file, Content::Link("pipe".to_owned())),
            case("a link to itself").with(&file, Content::Link(last.to_owned())),
            case("a link to nothing").with(&file, Content::Link("none".to_owned())),
            case("a file of holes").with(&file, Content::Holes(1 << 40)),
            case("another process' memory").with(&file, Content::Link("/proc/self/mem".to_owned())),
            case("an empty file").bytes(&file, []).ending(reader.mistakes()),
        ]);
    }
    // `.splat` has no header: an empty one is an empty scene. A palette may be absent.
    let right = ["splat: an empty file", "palette: nothing", "palette: a link to nothing", "palette: a link to itself"];
    cases.retain(|c| !right.contains(&c.name.as_str()));
    // SQLite takes a file that the kernel does not let it read for a defect of the disk: exit status 1.
    cases.retain(|c| !(c.name.ends_with("another process' memory") && c.words.iter().any(|w| w.ends_with(".sgproj"))));
    // Files that a file names.
    for (name, content) in [
        ("a pipe", Content::Pipe),
        ("endless zeros", zero()),
        ("holes", Content::Holes(1 << 40)),
        ("a socket", Content::Socket),
    ] {
        let scene = Case::new("not regular", format!("unit of a scene: {name}"), &["scene", "info", "scene.toml"]);
        cases.push(scene.bytes("scene.toml", crate::readers::scene_file(&["u.ply"])).with("u.ply", content.clone()));
        let data = Case::new(
            "not regular",
            format!("data of a NRRD: {name}"),
            &["fit", "a.nhdr", "--initial-only", "--out", "to"],
        );
        let header = format!("{}\ndata file: d.raw\n", crate::readers::nrrd("8 8 8", "uint8", "raw").trim_end());
        cases.push(data.bytes("a.nhdr", header).with("d.raw", content.clone()));
        let folder = Case::new("not regular", format!("scene.toml of a folder: {name}"), &["scene", "info", "."]);
        cases.push(folder.with("scene.toml", content.clone()));
        let strokes = Case::new(
            "not regular",
            format!("strokes of a script: {name}"),
            &["demo", "a.ply", "--script", "s.toml", "--out", "to"],
        );
        let right = crate::readers::RIGHT.of("ply");
        cases.push(
            strokes
                .bytes("a.ply", right)
                .bytes("s.toml", "[[step]]\nstrokes = \"s.json\"\n")
                .with("s.json", content.clone()),
        );
        for command in ["demo", "open"] {
            for ending in [".nrrd", ".ply"] {
                let file = format!("in{ending}");
                let opened = Case::new("not regular", format!("{command} {file}: {name}"), &[command, &file]);
                // The holes have the length of a file, and only their reader knows more.
                if !matches!(content, Content::Holes(_)) {
                    cases.push(opened.with(&file, content.clone()));
                }
            }
        }
        for command in ["up", "graph"] {
            let launch = Case::new("not regular", format!("{command}: {name}"), &[command, "l.toml"]);
            cases.push(launch.with("l.toml", content.clone()));
        }
    }
    cases
}
