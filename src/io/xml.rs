//! Elements of XML documents, by name, with faults that name the element.

use super::check::Check;
use super::reader::{excerpt, parse_number};
use crate::error::{Error, Result};
use roxmltree::{Document, Node};
use std::path::Path;

/// Deepest nesting of elements: the parser's stack grows with it.
const DEPTH_MAX: usize = 64;

/// The document of a file; document type definitions are refused.
pub(super) fn parse<'a>(path: &Path, bytes: &'a [u8]) -> Result<Document<'a>> {
    let fault = |what: &str| Error::file(path, format!("cannot be parsed as XML: {what}"));
    let text = std::str::from_utf8(bytes).map_err(|_| fault("it is not UTF-8 text"))?;
    let text = text.trim_start_matches('\u{feff}');
    if nesting(text) > DEPTH_MAX {
        return Err(fault(&format!("elements are nested more than {DEPTH_MAX} deep")));
    }
    Document::parse(text).map_err(|e| fault(&plain(&e.to_string())))
}

/// At most 200 characters of a message with parts of the file, without control characters.
fn plain(message: &str) -> String {
    let printable = message.chars().filter(|c| !c.is_control());
    printable.take(200).collect()
}

/// Most elements that are open at once, up to the first place that is no XML.
fn nesting(text: &str) -> usize {
    let (mut depth, mut most, mut rest) = (0_usize, 0, text);
    while let Some(at) = rest.find('<') {
        rest = &rest[at..];
        let apart = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((begin, end)) = apart.into_iter().find(|(begin, _)| rest.starts_with(begin)) {
            rest = after(&rest[begin.len()..], end);
            continue;
        }
        let tag = &rest[..tag_length(rest)];
        match tag.starts_with("</") {
            true => depth = depth.saturating_sub(1),
            false if tag.ends_with('/') => most = most.max(depth + 1),
            false => depth += 1,
        }
        most = most.max(depth);
        rest = &rest[tag.len()..];
    }
    most
}

fn after<'a>(text: &'a str, end: &str) -> &'a str {
    text.find(end).map_or("", |at| &text[at + end.len()..])
}

/// Bytes of a tag before its `>`; those in quotes do not end it.
fn tag_length(text: &str) -> usize {
    let mut quote = None;
    for (at, c) in text.char_indices() {
        match (quote, c) {
            (None, '>') => return at,
            (None, '"' | '\'') => quote = Some(c),
            (Some(open), c) if open == c => quote = None,
            _ => {}
        }
    }
    text.len()
}

pub(super) fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// A finite number in a child element; `None` without the element.
pub(super) fn number(node: Node<'_, '_>, name: &str) -> Check<Option<f64>> {
    child(node, name)
        .map(|child| numbers::<1>(child).map(|[value]| value))
        .transpose()
}

/// `N` finite numbers, the text of an element.
pub(super) fn numbers<const N: usize>(node: Node<'_, '_>) -> Check<[f64; N]> {
    let name = node.tag_name().name();
    let words: Vec<&str> = node.text().unwrap_or_default().split_whitespace().collect();
    if words.len() != N {
        return Err(format!("<{name}> holds {} numbers in place of {N}", words.len()));
    }
    let mut values = [0.0; N];
    for (value, word) in values.iter_mut().zip(words) {
        let number = parse_number(word).filter(|number| number.is_finite());
        *value = number.ok_or_else(|| format!("<{name}> holds {}, not a finite number", excerpt(word)))?;
    }
    Ok(values)
}

/// A whole number in an attribute that must be there.
pub(super) fn whole(node: Node<'_, '_>, name: &str) -> Check<u64> {
    let element = node.tag_name().name();
    let text = node
        .attribute(name)
        .ok_or_else(|| format!("<{element}> has no {name}"))?;
    let value = text.trim().parse().ok();
    value.ok_or_else(|| format!("{name} of <{element}> is {}, not a whole number", excerpt(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nesting_is_counted_as_the_parser_opens_elements() {
        for (text, depth) in [
            ("<a/>", 1),
            ("<a><b><c/></b><b/></a>", 3),
            (r#"<a b="/>"><a b='/>'><a c="</a>"></a></a></a>"#, 3),
            ("<?xml version='1.0'?><!-- <a><a> --><a><![CDATA[</a><a>]]></a>", 1),
            ("<a><!--></a>--><b/></a>", 2),
        ] {
            assert_eq!(nesting(text), depth, "{text}");
        }
        let deep = "<a>".repeat(1_000_000);
        let fault = parse("x.xml".as_ref(), deep.as_bytes()).err().map(|e| e.to_string());
        assert!(fault.unwrap_or_default().contains("64 deep"));
    }
}
