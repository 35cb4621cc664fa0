//! HTML pages: document, facts, tables, figures and number formats. A page is one file without scripts or references
//! to other files.

mod labels;
pub(crate) mod plot;
pub(crate) mod scale;
pub(crate) mod scatter;

use crate::Result;
use crate::stats::Interval;

const STYLE: &str = include_str!("page.css");

/// Name and value of a line in the list at the top of a page.
pub(crate) type Fact = (String, String);

/// A page from its title and body.
pub(crate) fn document(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>ashfall: {}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escaped(title)
    )
}

/// List of names and values.
pub(crate) fn facts(facts: &[Fact]) -> String {
    let line = |(name, value): &Fact| {
        let [name, value] = [name, value].map(|text| escaped(text));
        format!("<dt>{name}</dt><dd>{value}</dd>\n")
    };
    let lines: String = facts.iter().map(line).collect();
    format!("<dl class=\"facts\">\n{lines}</dl>\n")
}

/// Summary of the checks of a page, with a line for each broken one.
pub(crate) fn verdict(summary: &str, broken: &[String]) -> String {
    let line = |text: &String| format!("<br>{}", escaped(text));
    let (summary, lines) = (escaped(summary), broken.iter().map(line).collect::<String>());
    match broken.is_empty() {
        true => format!("<p class=\"verdict\">{summary}</p>\n"),
        false => format!("<p class=\"verdict broken\"><strong>{summary}</strong>{lines}</p>\n"),
    }
}

/// Table from its head and rows of text, with a flag for each row to be marked as broken.
pub(crate) fn table(class: &str, head: &[&str], rows: impl IntoIterator<Item = (bool, Vec<String>)>) -> String {
    let head: String = head.iter().map(|name| format!("<th>{}</th>", escaped(name))).collect();
    let mut text = format!("<div class=\"scroll\">\n<table class=\"{class}\">\n<tr>{head}</tr>\n");
    for (is_broken, cells) in rows {
        let class = if is_broken { " class=\"broken\"" } else { "" };
        let cells: String = cells.iter().map(|cell| format!("<td>{}</td>", escaped(cell))).collect();
        text += &format!("<tr{class}>{cells}</tr>\n");
    }
    text + "</table>\n</div>\n"
}

/// Figure of a drawing and its caption, which is HTML; `class` is `wide` or `half`.
pub(crate) fn figure(class: &str, svg: &str, caption: &str) -> String {
    let caption = match caption {
        "" => String::new(),
        caption => format!("<figcaption>{caption}</figcaption>\n"),
    };
    format!("<figure class=\"{class}\">\n{svg}{caption}</figure>\n")
}

/// Glyphs and names of the series of a page's figures.
pub(crate) fn legend<'a>(series: impl IntoIterator<Item = (usize, &'a str)>) -> Result<String> {
    let mut text = String::from("<ul class=\"legend\">\n");
    for (index, name) in series {
        text += &format!("<li>{}{}</li>\n", plot::glyph(index)?, escaped(name));
    }
    Ok(text + "</ul>\n")
}

/// Distinct names in the order of their first places.
pub(crate) fn distinct<'a>(names: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let mut found = Vec::new();
    for name in names {
        if !found.contains(&name) {
            found.push(name);
        }
    }
    found
}

/// Text with the special characters of HTML escaped.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A count with thousands separators: 1,234,567.
pub(crate) fn grouped(count: usize) -> String {
    let digits = count.to_string();
    let mut text = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number with `digits` decimals; a dash for `None`.
pub(crate) fn decimals(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".into(), |value| format!("{value:.digits$}"))
}

/// A value and half the width of its interval.
pub(crate) fn interval(interval: &Interval, digits: usize) -> String {
    let half = 0.5 * (interval.high - interval.low);
    match half > 0.0 {
        true => format!("{:.digits$} ± {half:.digits$}", interval.value),
        false => format!("{:.digits$}", interval.value),
    }
}

/// A number in about three significant digits; `none` for NaN and infinities.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    match value.fract() == 0.0 {
        _ if !size.is_finite() => "none".into(),
        true if size < 1e6 => {
            let sign = if value < 0.0 { "-" } else { "" };
            format!("{sign}{}", grouped(size as usize))
        }
        false if size >= 100.0 => format!("{value:.0}"),
        false if size >= 0.01 => {
            let text = format!("{value:.3}");
            text.trim_end_matches('0').to_owned()
        }
        _ => format!("{value:.1e}"),
    }
}

/// As [`number`], with `1e6` for `1.0e6`.
pub(crate) fn short_number(value: f64) -> String {
    number(value).replace(".0e", "e")
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// True for a page without scripts and references to other files; the only addresses are XML namespaces.
    pub(crate) fn is_alone(page: &str) -> bool {
        let all = |mark, start| page.match_indices(mark).all(|(at, _)| page[at..].starts_with(start));
        all("http", "http://www.w3.org/") && all(" src=", " src=\"data:image/png;base64,") && !page.contains("<script")
    }

    #[test]
    fn text_is_escaped_everywhere() -> Result<()> {
        let bad = || "<a & \"b\">".to_owned();
        let page = [
            facts(&[(bad(), bad())]),
            verdict(&bad(), &[bad()]),
            table("", &[&bad()], [(true, vec![bad()])]),
            legend([(0, bad().as_str())])?,
        ]
        .concat();
        let page = document(&bad(), &page);
        assert_eq!(page.matches("&lt;a &amp; &quot;b&quot;&gt;").count(), 8);
        assert!(!page.contains("<a ") && page.contains("<tr class=\"broken\">"));
        assert!(is_alone(&page));
        Ok(())
    }

    #[test]
    fn counts_have_thousands_separators() {
        let counts = [0, 999, 1_000, 1_234_567].map(grouped);
        assert_eq!(counts, ["0", "999", "1,000", "1,234,567"]);
    }

    #[test]
    fn numbers_have_about_three_significant_digits() {
        let whole = [0.0, 65_535.0, -1234.0, 4_194_304.0].map(number);
        assert_eq!(whole, ["0", "65,535", "-1,234", "4.2e6"]);
        assert_eq!([0.5, 1.25, 123.4].map(number), ["0.5", "1.25", "123"]);
        let powers = [3e-7, 2.5e-4, 1e6].map(number);
        assert_eq!(powers, ["3.0e-7", "2.5e-4", "1.0e6"]);
        let short = [1e6, 0.03, 2.5e-4].map(short_number);
        assert_eq!(short, ["1e6", "0.03", "2.5e-4"]);
        assert_eq!(number(f64::NAN), "none");
    }

    #[test]
    fn intervals_show_half_their_width() {
        assert_eq!(interval(&Interval::new(2.0, 1.5, 2.5, 3), 2), "2.00 ± 0.50");
        assert_eq!(interval(&Interval::new(2.0, 2.0, 2.0, 1), 1), "2.0");
        assert_eq!(decimals(None, 1), "–");
    }
}
