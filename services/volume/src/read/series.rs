//! Files that name the time steps of a series: ParaView collections (`.pvd`) and ParaView's JSON (`.vtk.series`, `.vtu.series`,
//! `.vti.series`).
//!
//! Both name files beside themselves. A name leads to a file below the folder of the series, links followed: a series from
//! elsewhere reads nothing else.

use std::io;
use std::path::{Component, Path, PathBuf};

use quick_xml::events::Event;
use quick_xml::reader::Reader;
use serde::Deserialize;
use sg_input::{file, limits};

use super::error::ReadError;
use super::source::{Limits, Source};
use super::vtk_xml::Attributes;

/// Endings of files that name time steps, in lower case.
pub const SERIES_ENDINGS: [&str; 2] = [".pvd", ".series"];
/// Most time steps of a series.
pub const MAX_STEPS: usize = 10_000;

/// One time step of a series.
#[derive(Debug, Clone, PartialEq)]
pub struct SeriesStep {
    /// Its file.
    pub path: PathBuf,
    /// Its time, in the unit of whoever wrote the series; `None` where the series does not tell it.
    pub time: Option<f64>,
}

/// Whether the name of a file is that of a series.
#[must_use]
pub fn is_series_path(path: &Path) -> bool {
    let name = lower_case_name(path);
    SERIES_ENDINGS.iter().any(|ending| name.ends_with(ending))
}

/// Reads the time steps of a series, in the order of their times. Steps without a time come as they stand. Their files are there,
/// but not read.
///
/// # Errors
/// [`ReadError`]: one line with the file, the place in it and a remedy. Also for a time twice (parts of one step), more than
/// [`MAX_STEPS`], and a name that leads out of the folder of the series.
pub fn read_series(path: &Path) -> Result<Vec<SeriesStep>, ReadError> {
    let source = Source {
        path,
        limits: Limits { own_folder: true, ..Limits::default() },
        variable: None,
        preferred: None,
        series: None,
    };
    let text = file::read_text(path, limits::TEXT_BYTES).map_err(|e| source.io(e))?;
    let named = if lower_case_name(path).ends_with(".pvd") { collection(source, &text)? } else { list(source, &text)? };
    if named.is_empty() {
        return Err(source.format("content", "no time step", "name one file at least"));
    }
    if named.len() > MAX_STEPS {
        let what = format!("{} time steps; the limit is {MAX_STEPS}", named.len());
        return Err(source.format("content", what, "divide the series"));
    }
    let mut steps = Vec::with_capacity(named.len());
    for (name, time) in named {
        if time.is_some_and(|time| !time.is_finite()) {
            return Err(source.format(name, "its time is not finite", "correct it"));
        }
        steps.push(SeriesStep { path: below(source, &name)?, time });
    }
    // A stable order: equal times are neighbours, whatever stands between them in the file.
    steps.sort_by(|a: &SeriesStep, b| match (a.time, b.time) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        _ => std::cmp::Ordering::Equal,
    });
    let twice = steps.windows(2).find(|pair| pair[0].time.is_some() && pair[0].time == pair[1].time);
    if let Some([first, second]) = twice {
        let what = format!(
            "{} and {} have the same time {}",
            first.path.display(),
            second.path.display(),
            first.time.unwrap_or_default()
        );
        return Err(source.format("time", what, "give one file for each time step; join parts in ParaView"));
    }
    Ok(steps)
}

fn lower_case_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// The file of a name, below the folder of the series.
fn below(source: Source<'_>, name: &str) -> Result<PathBuf, ReadError> {
    let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if name.is_empty() || !Path::new(name).components().all(inside) {
        let what = "a name that leads out of the folder of the series";
        return Err(source.format(
            format!("`{name}`"),
            what,
            "put the files beside the series and name them from there",
        ));
    }
    let path = source.beside(name)?;
    if path.is_dir() {
        return Err(ReadError::Io { path, source: io::ErrorKind::IsADirectory.into() });
    }
    Ok(path)
}

/// The data sets of a ParaView collection.
fn collection(source: Source<'_>, text: &str) -> Result<Vec<(String, Option<f64>)>, ReadError> {
    let mut reader = Reader::from_str(text);
    let mut found = Vec::new();
    let mut is_collection = false;
    loop {
        let event = reader
            .read_event()
            .map_err(|e| source.format(format!("byte {}", reader.error_position()), e.to_string(), "repair the XML"))?;
        let after = reader.buffer_position() as usize;
        let element = match &event {
            Event::Start(element) | Event::Empty(element) => element,
            Event::Eof => break,
            _ => continue,
        };
        match element.name().as_ref() {
            "VTKFile" => {
                let own = Attributes::of(source, element, after)?;
                let kind = own.get("type").unwrap_or_default();
                if kind != "Collection" {
                    let what = format!("a VTKFile of type `{kind}`");
                    return Err(source.format("VTKFile", what, "give a file of type Collection"));
                }
                is_collection = true;
            }
            "DataSet" if is_collection => {
                let own = Attributes::of(source, element, after)?;
                let place = format!("DataSet {}", found.len());
                let Some(name) = own.get("file") else {
                    return Err(source.format(place, "no file", "name it with `file`"));
                };
                let time = own.get("timestep").map(|text| {
                    let wrong = || source.format(place, format!("the timestep `{text}` is no number"), "correct it");
                    text.trim().parse::<f64>().map_err(|_| wrong())
                });
                found.push((name.to_owned(), time.transpose()?));
            }
            _ => {}
        }
    }
    if is_collection {
        return Ok(found);
    }
    Err(source.format("XML", "no VTKFile element", "give a ParaView collection"))
}

/// The files of ParaView's JSON.
#[derive(Deserialize)]
struct List {
    files: Vec<ListedFile>,
}

#[derive(Deserialize)]
struct ListedFile {
    name: String,
    time: Option<f64>,
}

fn list(source: Source<'_>, text: &str) -> Result<Vec<(String, Option<f64>)>, ReadError> {
    let List { files } = serde_json::from_str(text).map_err(|e| {
        let place = format!("line {}, column {}", e.line(), e.column());
        source.format(place, e.to_string(), "give {\"files\": [{\"name\": FILE, \"time\": NUMBER}, …]}")
    })?;
    Ok(files.into_iter().map(|ListedFile { name, time }| (name, time)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(steps: &[SeriesStep]) -> Vec<String> {
        steps.iter().map(|step| step.path.file_name().unwrap().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn both_kinds_name_their_steps_by_time() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::create_dir(at("data")).unwrap();
        for name in ["data/a b&c.vti", "b.vti", "c.vti"] {
            std::fs::write(at(name), "").unwrap();
        }
        let collection = r#"<?xml version="1.0"?><VTKFile type="Collection" version="0.1"><Collection>
            <DataSet timestep="2.5e0" group="" part="0" file="b.vti"/>
            <DataSet timestep=" 0.5 " file="data/a b&amp;c.vti"></DataSet>
            <DataSet timestep="1" file="./c.vti"/></Collection></VTKFile>"#;
        std::fs::write(at("flow.PVD"), collection).unwrap();
        let steps = read_series(&at("flow.PVD")).unwrap();
        assert_eq!(names(&steps), ["a b&c.vti", "c.vti", "b.vti"]);
        assert_eq!(steps.iter().map(|step| step.time).collect::<Vec<_>>(), [Some(0.5), Some(1.0), Some(2.5)]);
        let list = r#"{"file-series-version": "1.0", "files": [{"name": "c.vti", "time": 3}, {"name": "b.vti", "time": -1.5}]}"#;
        std::fs::write(at("flow.vti.series"), list).unwrap();
        assert_eq!(names(&read_series(&at("flow.vti.series")).unwrap()), ["b.vti", "c.vti"]);
        // Without times they come as they stand.
        std::fs::write(at("plain.series"), r#"{"files": [{"name": "c.vti"}, {"name": "b.vti"}]}"#).unwrap();
        assert_eq!(names(&read_series(&at("plain.series")).unwrap()), ["c.vti", "b.vti"]);
        assert!(is_series_path(Path::new("x.vtu.series")) && !is_series_path(Path::new("x.vtu")));
    }

    #[test]
    fn a_series_reads_nothing_outside_its_folder_and_errors_are_one_line() {
        let (dir, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("a.vti"), "").unwrap();
        std::fs::create_dir(at("folder")).unwrap();
        let secret = other.path().join("secret.vti");
        std::fs::write(&secret, "").unwrap();
        std::os::unix::fs::symlink(&secret, at("link.vti")).unwrap();
        let pvd = |inner: &str| format!("<VTKFile type=\"Collection\"><Collection>{inner}</Collection></VTKFile>");
        let data = |file: &str| pvd(&format!("<DataSet timestep=\"0\" file=\"{file}\"/>"));
        let many = pvd(&"<DataSet file=\"a.vti\"/>".repeat(MAX_STEPS + 1));
        for (name, text, part) in [
            ("x.pvd", data(secret.to_str().unwrap()), "leads out of the folder"),
            ("x.pvd", data("../x.vti"), "leads out of the folder"),
            ("x.pvd", data("folder/../../x.vti"), "leads out of the folder"),
            ("x.pvd", data(""), "leads out of the folder"),
            ("x.pvd", data("link.vti"), "outside the folder"),
            ("x.pvd", data("folder"), "is a directory"),
            ("x.pvd", data("none.vti"), "none.vti: No such file"),
            ("x.pvd", pvd("<DataSet timestep=\"one\" file=\"a.vti\"/>"), "DataSet 0: the timestep `one` is no number"),
            ("x.pvd", pvd("<DataSet timestep=\"nan\" file=\"a.vti\"/>"), "not finite"),
            ("x.pvd", pvd("<DataSet timestep=\"0\"/>"), "DataSet 0: no file"),
            ("x.pvd", pvd(""), "no time step"),
            ("x.pvd", pvd(&"<DataSet timestep=\"4\" file=\"a.vti\"/>".repeat(2)), "same time 4"),
            ("x.pvd", many, "10001 time steps"),
            ("x.pvd", "<VTKFile type=\"ImageData\"></VTKFile>".to_owned(), "type `ImageData`"),
            ("x.pvd", "<VTKFile type=\"Coll".to_owned(), "repair the XML"),
            ("x.pvd", "<a/>".to_owned(), "no VTKFile element"),
            ("x.series", "{\"files\": [{\"name\": 3}]}".to_owned(), "line 1"),
            ("x.series", "{\"files\": [{\"name\": \"../x.vti\"}]}".to_owned(), "leads out of the folder"),
            ("x.series", "[]".to_owned(), "line 1"),
        ] {
            std::fs::write(at(name), &text).unwrap();
            let error = read_series(&at(name)).unwrap_err().to_string();
            assert!(error.contains(part) && error.lines().count() == 1, "{text}: {error}");
        }
    }
}
