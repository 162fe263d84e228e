//! No circles between modules: a file imports only files that do not, by any way, import it.
//!
//! Imports are read off the text: paths that begin with `crate`, `super` or `self`. A module and the modules inside it are
//! one subject; imports between them do not count.

use std::collections::{BTreeMap, BTreeSet};

use super::File;

/// A module of a package: its path from the crate root, such as `["bus", "config"]`.
type Module = Vec<String>;

/// One line for every circle between modules of one package.
pub(crate) fn complaints(files: &[File]) -> Vec<String> {
    let mut packages: BTreeMap<&str, Vec<(Module, &File)>> = BTreeMap::new();
    for file in files.iter().filter(|f| f.is_rust()) {
        if let Some((package, inside)) = file.path.split_once("/src/") {
            packages.entry(package).or_default().push((module_of(inside), file));
        }
    }
    packages.into_iter().flat_map(|(package, modules)| circles_of(package, &modules)).collect()
}

fn module_of(inside: &str) -> Module {
    let mut parts: Vec<String> = inside.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
    if matches!(parts.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        parts.pop();
    }
    parts
}

fn circles_of(package: &str, modules: &[(Module, &File)]) -> Vec<String> {
    let known: BTreeSet<&Module> = modules.iter().map(|(module, _)| module).collect();
    let mut imports: BTreeMap<&Module, BTreeSet<&Module>> = BTreeMap::new();
    for (module, file) in modules {
        let code: Vec<&str> = file.code().map(|(_, line)| line).collect();
        for path in paths(&code.join("\n"), module) {
            let file_of = (0..=path.len()).rev().find_map(|n| known.get(&path[..n].to_vec()).copied());
            let Some(target) = file_of else { continue };
            if !target.starts_with(module) && !module.starts_with(target) {
                imports.entry(module).or_default().insert(target);
            }
        }
    }
    let reached = |from: &Module| {
        let mut found: BTreeSet<&Module> = BTreeSet::new();
        let mut open: Vec<&Module> = imports.get(from).into_iter().flatten().copied().collect();
        while let Some(module) = open.pop() {
            if found.insert(module) {
                open.extend(imports.get(module).into_iter().flatten());
            }
        }
        found
    };
    let reach: BTreeMap<&Module, BTreeSet<&Module>> = imports.keys().map(|m| (*m, reached(m))).collect();
    let mut named = BTreeSet::new();
    let mut complaints = Vec::new();
    for (module, from_here) in &reach {
        if !from_here.contains(*module) || named.contains(module) {
            continue;
        }
        let back = |other: &&&Module| reach.get(**other).is_some_and(|r| r.contains(*module));
        let circle: Vec<&Module> = from_here.iter().filter(back).copied().collect();
        named.extend(circle.iter().copied());
        let names: Vec<String> = circle.iter().map(|m| m.join("::")).collect();
        complaints.push(format!("{package}: modules import each other in a circle: {}", names.join(", ")));
    }
    complaints
}

/// All paths that `text` names, from the crate root.
fn paths(text: &str, module: &Module) -> Vec<Module> {
    let mut found = Vec::new();
    for root in ["crate", "super", "self"] {
        for (at, _) in text.match_indices(&format!("{root}::")) {
            let before = text[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':' || c == '$') {
                continue;
            }
            let mut base = if root == "crate" { Vec::new() } else { module.clone() };
            if root == "super" {
                base.pop();
            }
            expand(&text[at + root.len() + 2..], base, &mut found);
        }
    }
    found
}

/// Reads one path, or a group of them in braces, and adds what it names; returns how many bytes were read.
fn expand(text: &str, mut base: Module, found: &mut Vec<Module>) -> usize {
    let mut at = 0;
    loop {
        let rest = &text[at..];
        if rest.starts_with('{') {
            at += 1;
            loop {
                at += text[at..].len() - text[at..].trim_start().len();
                match text[at..].chars().next() {
                    Some('}') | None => return at + 1,
                    Some(',') => at += 1,
                    Some(c) if c.is_alphanumeric() || c == '_' || c == '{' => {
                        at += expand(&text[at..], base.clone(), found);
                    }
                    Some(c) => at += c.len_utf8(),
                }
            }
        }
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        match &rest[..end] {
            "super" => drop(base.pop()),
            "self" | "" => {}
            name => base.push(name.to_owned()),
        }
        at += end;
        if text[at..].starts_with("::") {
            at += 2;
        } else {
            found.push(base);
            return at;
        }
        if text[at..].starts_with('<') {
            found.push(base);
            return at;
        }
    }
}
