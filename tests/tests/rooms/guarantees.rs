//! `docs/guarantees.md` names only tests that exist.

use super::{File, tracked_files};

const PAGE: &str = "docs/guarantees.md";

/// The names in backquotes in the second column of the page's tables of promises.
fn named_tests(page: &str) -> Vec<&str> {
    let rows = page.lines().filter(|line| line.starts_with("| ") && line.matches('|').count() == 3);
    let columns = rows.filter_map(|row| row.split('|').nth(2));
    columns.flat_map(|column| column.split('`').skip(1).step_by(2)).filter(|name| name.contains('_')).collect()
}

fn complaints(files: &[File]) -> Vec<String> {
    let Some(page) = files.iter().find(|file| file.path == PAGE) else { return vec![format!("{PAGE} is missing")] };
    let exists = |name: &str| {
        let declaration = format!("fn {name}(");
        files.iter().any(|file| file.is_rust() && file.text.contains(&declaration))
    };
    let missing = named_tests(&page.text).into_iter().filter(|name| !exists(name));
    missing.map(|name| format!("{PAGE}: no test `{name}`")).collect()
}

#[test]
fn every_test_of_the_guarantees_exists() {
    let Some(files) = tracked_files() else { return };
    let page = files.iter().find(|file| file.path == PAGE).map_or("", |file| file.text.as_str());
    assert!(named_tests(page).len() > 20, "{:?}", named_tests(page));
    assert_eq!(complaints(&files), Vec::<String>::new());
}

#[test]
fn a_missing_test_is_found() {
    let files = [
        File::new(PAGE, "| promise | test |\n| --- | --- |\n| It holds. | `it_holds`, `it_is_gone` |\n"),
        File::new("tests/tests/a.rs", "#[test]\nfn it_holds() {}\n"),
    ];
    assert_eq!(complaints(&files), [format!("{PAGE}: no test `it_is_gone`")]);
}
