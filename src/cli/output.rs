//! What a command says while it works: a progress bar for people, JSON lines for machines, silence for
//! log files.

use crate::metrics::MeanScore;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::Value;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::time::{Duration, Instant};

pub(super) use crate::lab::page::grouped;

/// How a command speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Output {
    /// JSON lines on standard output instead of text.
    pub json: bool,
}

impl Output {
    /// A result: a JSON line (the object of `event`), or the text.
    pub(crate) fn result(self, text: impl std::fmt::Display, event: impl FnOnce() -> Value) {
        let mut stdout = std::io::stdout().lock();
        // A reader that has gone away is no reason to fail.
        _ = match self.json {
            true => writeln!(stdout, "{}", event()),
            false => writeln!(stdout, "{text}"),
        };
    }

    /// An event for machines only.
    pub(crate) fn event(self, event: impl FnOnce() -> Value) {
        if self.json {
            self.result("", event);
        }
    }

    /// A remark for people, on standard error.
    pub(crate) fn remark(self, text: impl std::fmt::Display) {
        if !self.json {
            eprintln!("{text}");
        }
    }

    /// A bar of `length` steps, drawn only on a terminal.
    pub(crate) fn bar(self, length: u64, what: &'static str) -> ProgressBar {
        if self.json || !std::io::stderr().is_terminal() {
            return ProgressBar::hidden();
        }
        // Ten frames a second: drawing more often costs steps on a slow machine.
        let target = ProgressDrawTarget::stderr_with_hz(10);
        let bar = ProgressBar::with_draw_target(Some(length), target);
        let template = "{prefix} {bar:16} {pos}/{len} · {eta} left {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.with_prefix(what)
    }
}

/// Lets something happen at most every so often.
#[derive(Debug)]
pub(super) struct Pace {
    every: Duration,
    last: Option<Instant>,
}

impl Pace {
    /// At most once in `every`; the first time at once.
    pub(crate) fn new(every: Duration) -> Pace {
        Pace { every, last: None }
    }

    /// Whether it is time again.
    pub(crate) fn is_due(&mut self) -> bool {
        let due = self.last.is_none_or(|last| last.elapsed() >= self.every);
        if due {
            self.last = Some(Instant::now());
        }
        due
    }
}

/// A mean score in words.
pub(super) fn score_text(score: &MeanScore) -> String {
    let figure = |value: Option<f64>, digits: usize, unit: &str| match value {
        Some(value) => format!("{value:.digits$}{unit}"),
        None => format!("–{unit}"),
    };
    format!(
        "{}, SSIM {} over {} views (8-bit: {}, {})",
        figure(score.psnr_db, 2, " dB"),
        figure(score.ssim, 4, ""),
        score.views,
        figure(score.psnr_db_8bit, 2, " dB"),
        figure(score.ssim_8bit, 4, ""),
    )
}

/// Bytes in the unit that leaves at most four digits.
pub(super) fn bytes(count: u64) -> String {
    let mut value = count as f64;
    for unit in ["B", "KiB", "MiB", "GiB"] {
        if value < 1024.0 {
            let digits = usize::from(unit != "B");
            return format!("{value:.digits$} {unit}");
        }
        value /= 1024.0;
    }
    format!("{value:.1} TiB")
}

/// A view's name as a file name: no folder, no extension, nothing that leads elsewhere.
pub(super) fn file_stem(view_name: &str) -> String {
    let stem = Path::new(view_name).with_extension("");
    let safe = |c: char| match c {
        'a'..='z' | 'A'..='Z' | '0'..='9' | '-' | '_' | '.' => c,
        _ => '_',
    };
    let name: String = stem.to_string_lossy().chars().map(safe).collect();
    match name.trim_start_matches('.') {
        "" => "view".into(),
        name => name.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(bytes(0), "0 B");
        assert_eq!(bytes(1 << 20), "1.0 MiB");
        assert_eq!(bytes(u64::MAX), "16777216.0 TiB");
        let none = MeanScore::default();
        assert_eq!(
            score_text(&none),
            "– dB, SSIM – over 0 views (8-bit: – dB, –)"
        );
    }

    #[test]
    fn file_names_stay_in_their_folder() {
        assert_eq!(file_stem("images/0007.png"), "images_0007");
        assert_eq!(file_stem("../../etc/passwd"), "_.._etc_passwd");
        assert_eq!(file_stem("a b\u{e9}.JPG"), "a_b_");
        assert_eq!(file_stem(".."), "view");
    }

    #[test]
    fn a_pace_lets_the_first_through() {
        let mut pace = Pace::new(Duration::from_secs(3_600));
        assert!(pace.is_due() && !pace.is_due());
    }
}
