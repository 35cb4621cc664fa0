//! Language: rates of relative pronouns in comments, first lines, and names of types.

use crate::tidy::rules::words;
use crate::tidy::source::{File, code};
use std::collections::BTreeMap;

/// Most occurrences in 1,000 words of comment, over all sources together.
const PRONOUNS_MAX: f64 = 2.0;
/// Relative pronouns that stand in place of a noun.
const PRONOUNS: [&str; 4] = ["what", "whatever", "whoever", "whose"];
/// First words of a header that does not begin with the noun.
const OPENINGS: [&str; 6] = ["What", "Which", "How", "Whether", "Where", "Who"];
/// Most type names that are defined more than once.
const DUPLICATES_MAX: usize = 15;
/// Participles without the ending `ed`, and everyday words.
const PLAIN_WORDS: [&str; 16] = [
    "Begun", "Chosen", "Cut", "Drawn", "Found", "Given", "Held", "Judge", "Kept", "Known", "Lost", "Made", "Seen",
    "Shown", "Taken", "Trail",
];

fn is_source(path: &str) -> bool {
    let ends = [".rs", ".comp", ".glsl"];
    let folders = ["src/", "glsl/", "build/", "tests/", "build.rs"];
    ends.iter().any(|end| path.ends_with(end)) && folders.iter().any(|folder| path.starts_with(folder))
}

/// Texts of the lines of comment.
fn comments(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| line.trim_start().strip_prefix("//"))
}

/// Finds too many relative pronouns in place of nouns.
pub(crate) fn comments_name_things(files: &[File]) -> Vec<String> {
    let (mut all, mut found) = (0, Vec::new());
    for (path, text) in files.iter().filter(|(path, _)| is_source(path)) {
        for word in comments(text).flat_map(str::split_whitespace) {
            all += 1;
            let is_pronoun = |word: &str| PRONOUNS.contains(&word.to_lowercase().as_str());
            if words(word).any(is_pronoun) {
                found.push(format!("{path}: {word}"));
            }
        }
    }
    let rate = 1000.0 * found.len() as f64 / f64::from(all.max(1));
    if rate > PRONOUNS_MAX {
        return [vec![format!("{rate:.1} in 1,000 words")], found].concat();
    }
    Vec::new()
}

/// Finds headers of modules that begin with a question word.
pub(crate) fn headers_begin_with_a_noun(files: &[File]) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in files.iter().filter(|(path, _)| is_source(path)) {
        let first = text.lines().find(|line| line.starts_with("//")).unwrap_or_default();
        let opening = words(first).next().unwrap_or_default();
        if OPENINGS.contains(&opening) {
            faults.push(format!("{path}: begins with {opening}"));
        }
    }
    faults
}

/// Names of types defined in a text, but for associated ones.
fn types(code: &str) -> Vec<&str> {
    let mut names = Vec::new();
    for line in code.lines() {
        let mut words = words(line).skip_while(|word| ["pub", "crate", "super", "in"].contains(word));
        let (keyword, name) = (words.next().unwrap_or_default(), words.next());
        let is_alias = keyword == "type" && !line.starts_with(' ');
        if is_alias || ["struct", "enum", "trait", "union"].contains(&keyword) {
            names.extend(name.filter(|name| name.starts_with(char::is_uppercase)));
        }
    }
    names
}

/// Finds type names that are defined too often, and those that are participles.
pub(crate) fn types_have_names_of_their_own(files: &[File]) -> Vec<String> {
    let mut places: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for (path, text) in files {
        if path.starts_with("src/") && path.ends_with(".rs") {
            for name in types(&code(text)) {
                places.entry(name.to_owned()).or_default().push(path);
            }
        }
    }
    let is_participle = |name: &str| {
        let is_one_word = name.chars().filter(|c| c.is_uppercase()).count() == 1;
        is_one_word && name.ends_with("ed") && !name.ends_with("eed") || PLAIN_WORDS.contains(&name)
    };
    let mut faults: Vec<String> = places
        .iter()
        .filter(|(name, _)| is_participle(name))
        .map(|(name, paths)| format!("{}: {name} names no thing", paths.join(", ")))
        .collect();
    let duplicates: Vec<_> = places.iter().filter(|(_, paths)| paths.len() > 1).collect();
    if duplicates.len() > DUPLICATES_MAX {
        let line = |(name, paths): &(&String, &Vec<&str>)| format!("{name}: {}", paths.join(", "));
        faults.extend(duplicates.iter().map(line));
    }
    faults
}
