//! GLSL text of one kernel with all its includes, for the line numbers and comments that SPIR-V lacks. Not a GLSL
//! parser; declarations are found by their punctuation.

use std::fmt::Display;

/// One file.
pub(crate) struct File {
    /// Path in messages: `glsl/ranges.comp`.
    path: String,
    /// As written.
    lines: Vec<String>,
    /// The text with comments blanked out.
    code: String,
}

impl File {
    pub(crate) fn new(path: &str, text: &str) -> File {
        File {
            path: path.to_owned(),
            lines: text.lines().map(str::to_owned).collect(),
            code: without_comments(text),
        }
    }

    /// The comment at the end of a line (counted from 0), else the ones directly above it, as one line.
    pub(crate) fn comment_at(&self, line: usize) -> Option<String> {
        if let Some((_, comment)) = self.lines.get(line)?.split_once("//") {
            return Some(comment.trim().to_owned());
        }
        let above = self.lines.get(..line)?.iter().rev();
        let mut comments: Vec<&str> = above
            .map_while(|text| text.trim().strip_prefix("//"))
            .map(str::trim)
            .collect();
        comments.reverse();
        (!comments.is_empty()).then(|| comments.join(" "))
    }

    /// The lines with their comments blanked out, numbered from 0.
    pub(crate) fn code_lines(&self) -> impl Iterator<Item = (usize, &str)> {
        self.code.lines().enumerate()
    }

    /// `glsl/ranges.comp:12: message`, for a line counted from 0.
    pub(crate) fn fault(&self, line: usize, what: impl Display) -> String {
        format!("{}:{}: {what}", self.path, line + 1)
    }

    /// Line of a byte offset into `code`.
    fn line_of(&self, byte: usize) -> usize {
        self.code.bytes().take(byte).filter(|b| *b == b'\n').count()
    }

    /// The first line of code that uses `gl_WorkGroupSize` before the file declares a local size.
    fn early_size(&self) -> Option<usize> {
        self.code_lines()
            .take_while(|(_, text)| !text.contains("local_size_x"))
            .filter(|(_, text)| !text.trim_start().starts_with("#define"))
            .find(|(_, text)| text.contains("gl_WorkGroupSize"))
            .map(|(line, _)| line)
    }

    /// Every `layout(…) …` up to its `;` or `{`.
    fn declarations(&self) -> impl Iterator<Item = Declaration> {
        self.code.match_indices("layout").filter_map(|(start, _)| {
            let rest = self.code.get(start..)?;
            let inside = rest.strip_prefix("layout")?.trim_start();
            let (qualifiers, tail) = inside.strip_prefix('(')?.split_once(')')?;
            Some(Declaration {
                line: self.line_of(start),
                qualifiers: qualifiers.split_whitespace().collect(),
                what: tail.split([';', '{']).next()?.trim().to_owned(),
            })
        })
    }
}

/// A declaration `layout(qualifiers) …`.
struct Declaration {
    /// Counted from 0.
    line: usize,
    /// Without spaces.
    qualifiers: String,
    what: String,
}

impl Declaration {
    /// True if one of the qualifiers is `wanted`.
    fn says(&self, wanted: &str) -> bool {
        self.qualifiers.split(',').any(|said| said == wanted)
    }
}

/// Place of a fault.
#[derive(Clone, Copy, Debug)]
pub(crate) enum At<'a> {
    /// The kernel as a whole.
    Kernel,
    /// `layout(binding = …)`.
    Binding(u32),
    /// `layout(constant_id = …)`.
    Spec(u32),
    /// `layout(push_constant)`.
    Push,
    /// A struct's declaration.
    Struct(&'a str),
}

/// A kernel's file, first, and every file it includes.
pub(crate) struct Sources(Vec<File>);

impl Sources {
    pub(crate) fn new(files: Vec<File>) -> Sources {
        Sources(files)
    }

    /// `glsl/ranges.comp:12: message`, with the line of `at`.
    pub(crate) fn fault(&self, at: At<'_>, what: impl Display) -> String {
        match (self.find(at), self.0.first()) {
            (Some((file, line)), _) => file.fault(line, what),
            (None, Some(kernel)) => kernel.fault(0, what),
            (None, None) => what.to_string(),
        }
    }

    /// Comment at a place.
    pub(crate) fn comment(&self, at: At<'_>) -> Option<String> {
        let (file, line) = self.find(at)?;
        file.comment_at(line)
    }

    /// First paragraph of the comment at the beginning of the kernel's file.
    pub(crate) fn opening(&self) -> Option<String> {
        let lines = self.0.first()?.lines.iter();
        let text: Vec<&str> = lines
            .skip_while(|line| !line.starts_with("//"))
            .map_while(|line| line.strip_prefix("//"))
            .map(str::trim)
            .take_while(|line| !line.is_empty())
            .collect();
        (!text.is_empty()).then(|| text.join(" "))
    }

    /// The comment of a member of a struct or block.
    pub(crate) fn member_comment(&self, block: &str, member: &str) -> Option<String> {
        let (file, start) = self.find_block(block)?;
        let body = file.code.get(start..)?;
        let body = body.get(..body.find('}')?)?;
        let place = words(body)
            .filter(|(_, word)| *word == member)
            .find(|(at, word)| follows(body, at + word.len(), &[';', ',', '[']))?;
        file.comment_at(file.line_of(start + place.0))
    }

    fn find(&self, at: At<'_>) -> Option<(&File, usize)> {
        let wanted = match at {
            At::Kernel => return None,
            At::Struct(name) => {
                let (file, start) = self.find_block(name)?;
                return Some((file, file.line_of(start)));
            }
            At::Binding(binding) => format!("binding={binding}"),
            At::Spec(id) => format!("constant_id={id}"),
            At::Push => "push_constant".to_owned(),
        };
        self.0.iter().find_map(|file| {
            let found = file.declarations().find(|d| d.says(&wanted))?;
            Some((file, found.line))
        })
    }

    /// Byte offset of the name in `Name {`.
    fn find_block(&self, name: &str) -> Option<(&File, usize)> {
        self.0.iter().find_map(|file| {
            words(&file.code)
                .filter(|(_, word)| *word == name)
                .find(|(at, _)| follows(&file.code, at + name.len(), &['{']))
                .map(|(at, _)| (file, at))
        })
    }

    /// Rules about the text: the opening comment, and `scalar` on every block.
    pub(crate) fn check(&self) -> Vec<String> {
        let mut faults = Vec::new();
        if let Some(kernel) = self.0.first() {
            let code = kernel.code_lines().map(|(line, text)| (line, text.trim()));
            // Extensions have to precede the code that the prelude includes.
            let mut code = code.filter(|(_, text)| !text.is_empty() && !text.starts_with("#extension"));
            for wanted in ["#version 460", "#include \"shared/prelude.glsl\""] {
                let (line, text) = code.next().unwrap_or_default();
                if text != wanted {
                    let what = format!("expected `{wanted}`: version, extensions, then the prelude");
                    faults.push(kernel.fault(line, what));
                }
            }
        }
        for file in &self.0 {
            if let Some(line) = file.early_size() {
                let what = "before local_size is declared, gl_WorkGroupSize silently is 1: use a macro";
                faults.push(file.fault(line, what));
            }
            for declaration in file.declarations() {
                let block =
                    words(&declaration.what).any(|(_, word)| word == "buffer") || declaration.says("push_constant");
                if block && !declaration.says("scalar") {
                    let rule = "a block must say `scalar` in its layout(…), then a vec3 is [f32; 3]";
                    faults.push(file.fault(declaration.line, rule));
                }
                if declaration.qualifiers.contains("local_size_x_id=") && !declaration.says("local_size_x_id=0") {
                    let rule = "the workgroup's size in x is constant 0: local_size_x_id = 0";
                    faults.push(file.fault(declaration.line, rule));
                }
            }
        }
        faults
    }

    /// True if the workgroup size in x is specialisation constant 0.
    pub(crate) fn has_workgroup_constant(&self) -> bool {
        let mut all = self.0.iter().flat_map(File::declarations);
        all.any(|declaration| declaration.says("local_size_x_id=0"))
    }
}

/// Identifiers and numbers of a text with their byte offsets.
fn words(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_')
        .filter(|word| !word.is_empty())
        .map(|word| (word.as_ptr() as usize - text.as_ptr() as usize, word))
}

/// True if the next non-space character after `byte` is one of `wanted`.
fn follows(text: &str, byte: usize, wanted: &[char]) -> bool {
    text.get(byte..)
        .and_then(|rest| rest.trim_start().chars().next())
        .is_some_and(|next| wanted.contains(&next))
}

/// The text with `//` and `/* */` comments turned into spaces; newlines stay, so lines keep their numbers.
fn without_comments(text: &str) -> String {
    let mut code = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find("//").into_iter().chain(rest.find("/*")).min() {
        let (before, comment) = rest.split_at(start);
        let end = if comment.starts_with("//") {
            comment.find('\n')
        } else {
            comment.find("*/").map(|end| end + 2)
        };
        let (comment, after) = comment.split_at(end.unwrap_or(comment.len()));
        code.push_str(before);
        code.extend(comment.chars().map(|c| if c == '\n' { c } else { ' ' }));
        rest = after;
    }
    code.push_str(rest);
    code
}
