//! Layers: the modules that each module may import, and files of a folder that import each other in a circle.

use crate::tidy::source::{File, code};
use std::collections::{BTreeMap, BTreeSet};

/// Modules that a module may import. The laboratory is ranked by its parts.
const RANKS: &[(&str, &str)] = &[
    ("error", ""),
    ("layout", ""),
    ("shader", ""),
    ("stats", ""),
    ("scene", "error layout"),
    ("gpu", "shader error"),
    ("io", "scene stats error"),
    ("metrics", "scene error"),
    ("mesh", "scene stats error"),
    ("kernels", "gpu layout shader error"),
    ("render", "kernels gpu scene io metrics layout error"),
    ("train", "render kernels gpu scene io metrics stats layout error"),
    (
        "simplify",
        "train render kernels gpu scene io metrics stats layout error",
    ),
    ("export", "simplify render gpu scene io metrics error"),
    ("capi", "render gpu scene io error"),
    ("reference", "scene layout"),
    ("lab::synth", "scene stats error"),
    ("lab::page", "stats error"),
    ("lab::evaluator", "lab::bench ENGINE"),
    ("lab::bench", "reference ENGINE"),
    ("lab::baseline", "lab::bench reference ENGINE"),
    (
        "lab::chart",
        "lab::bench lab::evaluator lab::page lab::synth reference ENGINE",
    ),
    ("lab::report", "lab::page ENGINE"),
    (
        "lab::survey",
        "lab::bench lab::evaluator lab::page lab::synth reference ENGINE",
    ),
    ("lab::stress", "lab::bench lab::page reference ENGINE"),
];

/// Modules that are built without the feature `lab`: `ENGINE` in the table above.
const ENGINE: &str = "error layout shader stats scene gpu io metrics mesh kernels render train simplify export";

/// Imports point down.
pub(crate) fn ranks_hold(files: &[File]) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in sources(files) {
        let module = ranked(&module_of(path));
        if ["", "lab", "main", "cli"].contains(&module.as_str()) {
            continue;
        }
        let Some((_, allowed)) = RANKS.iter().find(|(name, _)| *name == module) else {
            faults.push(format!("{path}: the module {module} has no rank"));
            continue;
        };
        let allowed = allowed.replace("ENGINE", ENGINE);
        let imports: BTreeSet<String> = imports(path, &code(text)).iter().map(|p| ranked(p)).collect();
        for import in imports {
            if import != module && !allowed.split(' ').any(|name| name == import) {
                faults.push(format!("{path}: {module} must not import {import}"));
            }
        }
    }
    faults
}

/// Finds circular imports between files and folders of a folder. Items re-exported by `mod.rs` count as imports of the
/// file that defines them; tests inside a file do not count.
pub(crate) fn folders_have_no_circles(files: &[File]) -> Vec<String> {
    let product = |text: &str| {
        let code = code(text);
        let end = text.find("#[cfg(test)]\nmod tests {").unwrap_or(text.len());
        code.chars().take(text[..end].chars().count()).collect::<String>()
    };
    let modules: BTreeMap<Vec<String>, (&str, String)> = sources(files)
        .map(|(path, text)| (module_of(path), (path, product(text))))
        .collect();
    // Edges between siblings, by parent module.
    let mut edges: BTreeMap<Vec<String>, BTreeMap<String, BTreeSet<String>>> = BTreeMap::new();
    for (module, (path, code)) in &modules {
        for import in imports(path, code) {
            let common = module.iter().zip(&import).take_while(|(a, b)| a == b).count();
            let Some(from) = module.get(common) else {
                continue;
            };
            let parent = &module[..common];
            let Some(name) = import.get(common) else {
                continue;
            };
            let target = match modules.contains_key(&import[..=common]) {
                true => Some(name.clone()),
                false => modules.get(parent).and_then(|(_, text)| definer(text, name)),
            };
            if let Some(target) = target.filter(|target| target != from) {
                edges
                    .entry(parent.to_vec())
                    .or_default()
                    .entry(from.clone())
                    .or_default()
                    .insert(target);
            }
        }
    }
    let mut faults = Vec::new();
    for (parent, edges) in edges.iter().filter(|(parent, _)| !parent.is_empty()) {
        for name in edges.keys() {
            let circle: Vec<&str> = edges
                .keys()
                .filter(|other| reaches(edges, name, other) && reaches(edges, other, name))
                .map(String::as_str)
                .collect();
            if circle.first() == Some(&name.as_str()) {
                faults.push(format!("src/{}: a circle of {}", parent.join("/"), circle.join(", ")));
            }
        }
    }
    faults
}

fn reaches(edges: &BTreeMap<String, BTreeSet<String>>, from: &str, to: &str) -> bool {
    let mut found = BTreeSet::new();
    let mut open = vec![from];
    while let Some(name) = open.pop() {
        for next in edges.get(name).into_iter().flatten() {
            if next == to {
                return true;
            }
            if found.insert(next.as_str()) {
                open.push(next);
            }
        }
    }
    false
}

/// Child module from which a module's `use child::Name` takes a name.
fn definer(code: &str, name: &str) -> Option<String> {
    let uses = code
        .split(';')
        .filter_map(|statement| statement.trim().rsplit_once("use ").map(|(_, path)| path));
    uses.flat_map(expanded)
        .find(|path| path.len() > 1 && path.last().is_some_and(|last| last == name))
        .map(|path| path[0].clone())
        .filter(|first| !["crate", "super", "std"].contains(&first.as_str()))
}

fn sources(files: &[File]) -> impl Iterator<Item = (&str, &str)> {
    let sources = files
        .iter()
        .filter(|(path, _)| path.starts_with("src/") && path.ends_with(".rs"));
    sources.map(|(path, text)| (path.as_str(), text.as_str()))
}

/// Module path of a file below the crate: `render, forward`.
fn module_of(path: &str) -> Vec<String> {
    let path = path.trim_start_matches("src/").trim_end_matches(".rs");
    let path = path.trim_end_matches("/mod");
    path.split('/')
        .filter(|part| !["lib", "main"].contains(part))
        .map(str::to_owned)
        .collect()
}

/// Ranked module: the first component, in the laboratory the first two.
fn ranked(module: &[String]) -> String {
    match module {
        [first, second, ..] if first == "lab" => format!("lab::{second}"),
        [first, ..] if ["Error", "Result"].contains(&first.as_str()) => "error".to_owned(),
        [first, ..] => first.clone(),
        [] => String::new(),
    }
}

/// Paths below the crate in code: after `crate::` and `super::`, the latter outside of indented blocks of `use`, which
/// are those of inline modules.
fn imports(path: &str, code: &str) -> Vec<Vec<String>> {
    let module = module_of(path);
    let mut found = Vec::new();
    for root in ["crate::", "super::"] {
        for (at, _) in code.match_indices(root) {
            let line = code[..at].rfind('\n').map_or(0, |end| end + 1);
            let before = &code[line..at];
            let is_part = before.ends_with("::") || before.ends_with("pub(in ");
            let is_nested = before.starts_with(' ') && before.contains("use ") && root == "super::";
            if !is_part && !is_nested {
                let is_use = before.contains("use ");
                let inside = |c: char| c.is_alphanumeric() || "_:".contains(c);
                let end = match is_use {
                    true => code[at..].find(';'),
                    false => code[at..].find(|c| !inside(c)),
                };
                found.extend(expanded(&code[at..end.map_or(code.len(), |end| at + end)]));
            }
        }
    }
    let absolute = |path: Vec<String>| {
        let supers = path.iter().take_while(|part| *part == "super").count();
        match path[0].as_str() {
            "crate" => Some(path[1..].to_vec()),
            _ if supers <= module.len() => Some([&module[..module.len() - supers], &path[supers..]].concat()),
            _ => None,
        }
    };
    let absolute = found.into_iter().filter_map(absolute);
    absolute.filter(|path| !path.is_empty() && path[0] != "*").collect()
}

/// `a::{b, c::d}` as the paths `a::b` and `a::c::d`.
fn expanded(path: &str) -> Vec<Vec<String>> {
    let path = path.trim().split(" as ").next().unwrap_or_default();
    let Some((head, group)) = path.split_once('{') else {
        return vec![
            path.split("::")
                .map(|part| part.trim().to_owned())
                .filter(|part| !part.is_empty())
                .collect(),
        ];
    };
    let head: Vec<String> = head
        .split("::")
        .map(|part| part.trim().to_owned())
        .filter(|part| !part.is_empty())
        .collect();
    let group = group.rsplit_once('}').map_or(group, |(group, _)| group);
    let (mut depth, mut from, mut parts) = (0, 0, Vec::new());
    for (i, c) in group.char_indices() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ',' && depth == 0 {
            parts.push(&group[from..i]);
            from = i + 1;
        }
    }
    parts.push(&group[from..]);
    let parts = parts.into_iter().filter(|part| !part.trim().is_empty());
    parts
        .flat_map(expanded)
        .map(|tail| [head.clone(), tail].concat())
        .collect()
}
