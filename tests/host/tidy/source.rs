//! Text files of the repository, and extraction of their code.

use std::path::Path;

/// Path from the repository's root, with `/`, and text of a file.
pub(crate) type File = (String, String);

/// All text files of the repository: those of the root and of the source folders.
pub(crate) fn repository() -> Vec<File> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    read(root, "", false, &mut files);
    for folder in [
        ".ci", ".cargo", "benches", "build", "examples", "glsl", "scripts", "src", "tests",
    ] {
        read(&root.join(folder), &format!("{folder}/"), true, &mut files);
    }
    files.sort();
    files
}

fn read(folder: &Path, prefix: &str, deep: bool, files: &mut Vec<File>) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() && deep {
            read(&path, &format!("{prefix}{name}/"), true, files);
        } else if name == ".git" {
            // The history of a work tree is no source.
        } else if let (true, Ok(text)) = (path.is_file(), std::fs::read_to_string(&path)) {
            files.push((format!("{prefix}{name}"), text));
        }
    }
}

/// The text with comments and the contents of literals replaced by spaces; line numbers are unchanged.
pub(crate) fn code(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let mut at = 0;
    while at < chars.len() {
        let end = skip(&chars, at);
        if end == at {
            out.push(chars[at]);
            at += 1;
        } else {
            let blank = chars[at..end].iter().map(|&c| if c == '\n' { c } else { ' ' });
            out.extend(blank);
            at = end;
        }
    }
    out
}

/// The end of the comment or literal that begins at `at`, or `at` if there is none.
fn skip(chars: &[char], at: usize) -> usize {
    let starts = |text: &str| text.chars().enumerate().all(|(i, c)| chars.get(at + i) == Some(&c));
    let find = |from: usize, text: &str| {
        let text: Vec<char> = text.chars().collect();
        let found = (from..chars.len()).find(|&i| chars[i..].starts_with(&text));
        found.map_or(chars.len(), |i| i + text.len())
    };
    let word = |c: &char| c.is_alphanumeric() || *c == '_';
    if starts("//") {
        return find(at, "\n") - 1;
    } else if starts("/*") {
        return find(at + 2, "*/");
    } else if starts("r\"") || starts("r#") {
        let hashes = chars[at + 1..].iter().take_while(|&&c| c == '#').count();
        let inside_word = at > 0 && word(&chars[at - 1]);
        if !inside_word && chars.get(at + 1 + hashes) == Some(&'"') {
            return find(at + 2 + hashes, &format!("\"{}", "#".repeat(hashes)));
        }
    } else if starts("\"") {
        return quoted(chars, at, '"');
    } else if starts("'") {
        // A character, unless it is a lifetime: 'a, 'static.
        if chars.get(at + 1) == Some(&'\\') || chars.get(at + 2) == Some(&'\'') {
            return quoted(chars, at, '\'');
        }
    }
    at
}

fn quoted(chars: &[char], at: usize, quote: char) -> usize {
    let mut end = at + 1;
    while end < chars.len() && chars[end] != quote {
        end += if chars[end] == '\\' { 2 } else { 1 };
    }
    (end + 1).min(chars.len())
}

/// Name, first line (from 1) and number of lines of each function. Expects code without comments.
pub(crate) fn functions(code: &str, rust: bool) -> Vec<(String, usize, usize)> {
    let mut functions = Vec::new();
    let (mut depth, mut line) = (0_usize, 1);
    // Text since the last statement ended, and the open functions.
    let (mut statement, mut start) = (String::new(), 1);
    let mut open: Vec<(String, usize, usize)> = Vec::new();
    for c in code.chars() {
        match c {
            '{' => {
                if let Some(name) = function_name(&statement, rust, depth) {
                    open.push((name, start, depth));
                }
                depth += 1;
            }
            '}' => {
                depth = depth.saturating_sub(1);
                if let Some((name, start, _)) = open.pop_if(|function| function.2 == depth) {
                    functions.push((name, start, line + 1 - start));
                }
            }
            _ => {}
        }
        match c {
            '\n' => line += 1,
            // `[f32; 3]` ends no statement.
            '{' | '}' => statement.clear(),
            ';' if statement.matches(['(', '[']).count() == statement.matches([')', ']']).count() => {
                statement.clear();
            }
            _ => {}
        }
        if !matches!(c, '{' | '}' | ';') || !statement.is_empty() {
            if statement.is_empty() && !c.is_whitespace() {
                start = line;
            }
            if !(statement.is_empty() && c.is_whitespace()) {
                statement.push(c);
            }
        }
    }
    functions
}

/// The name of the function declared by `head`, if it is one.
fn function_name(head: &str, rust: bool, depth: usize) -> Option<String> {
    let name = |text: &str| {
        let words: Vec<&str> = text.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        words.into_iter().rfind(|word| !word.is_empty()).map(str::to_owned)
    };
    if rust {
        let is_word_start = |at: usize| !head[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let at = head
            .match_indices("fn ")
            .map(|(at, _)| at)
            .find(|&at| is_word_start(at))?;
        let rest = &head[at + 3..];
        return name(&rest[..rest.find(['(', '<'])?]);
    }
    // GLSL: at the outermost level, only functions have a body after a closing parenthesis.
    let head = head.trim_end();
    (depth == 0 && head.ends_with(')'))
        .then(|| name(&head[..head.find('(')?]))
        .flatten()
}
