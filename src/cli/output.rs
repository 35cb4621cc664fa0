//! Output of a running command: a progress bar on a terminal, occasional lines in a log file, JSON lines for machines.

use crate::Result;
use crate::io::atomic::write_atomically;
use crate::metrics::MeanScore;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::Value;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::time::{Duration, Instant};

pub(super) use crate::lab::page::grouped;

/// Output mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Output {
    /// JSON lines on standard output instead of text.
    pub json: bool,
}

impl Output {
    /// A result: a JSON line (the object of `event`), or the text.
    pub(crate) fn result(self, text: impl std::fmt::Display, event: impl FnOnce() -> Value) {
        let mut stdout = std::io::stdout().lock();
        // A closed pipe is not an error.
        _ = match self.json {
            true => writeln!(stdout, "{}", event()),
            false => writeln!(stdout, "{text}"),
        };
    }

    /// An event, printed only as JSON.
    pub(crate) fn event(self, event: impl FnOnce() -> Value) {
        if self.json {
            self.result("", event);
        }
    }

    /// A remark on standard error, printed only as text.
    pub(crate) fn remark(self, text: impl std::fmt::Display) {
        if !self.json {
            eprintln!("{text}");
        }
    }

    /// A bar of `length` steps, or a line every [`LINE_EVERY`] if standard error is not a terminal.
    pub(crate) fn bar(self, length: u64, name: &'static str) -> ProgressBar {
        if self.json {
            return ProgressBar::hidden();
        }
        let target = terminal();
        let is_hidden = target.is_hidden();
        let bar = ProgressBar::with_draw_target(Some(length), target);
        let template = "{prefix} {bar:16} {pos}/{len} · {eta} left {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        if is_hidden {
            write_lines(&bar, name, LINE_EVERY, |line| eprintln!("{line}"));
        }
        bar.with_prefix(name)
    }

    /// A sign of life on a terminal during work of unknown length.
    pub(crate) fn spinner(self, name: &'static str) -> ProgressBar {
        if self.json {
            return ProgressBar::hidden();
        }
        let spinner = ProgressBar::with_draw_target(None, terminal()).with_message(name);
        spinner.enable_steady_tick(Duration::from_millis(100));
        spinner
    }
}

/// Standard error if it is a terminal.
fn terminal() -> ProgressDrawTarget {
    match std::io::stderr().is_terminal() {
        // Ten frames a second: drawing more often costs steps on a slow machine.
        true => ProgressDrawTarget::stderr_with_hz(10),
        false => ProgressDrawTarget::hidden(),
    }
}

/// Time between two lines of progress.
const LINE_EVERY: Duration = Duration::from_secs(30);

/// Writes a progress line at intervals of `every` until the bar is dropped.
fn write_lines(bar: &ProgressBar, name: &'static str, every: Duration, write: impl Fn(String) + Send + 'static) {
    let bar = bar.downgrade();
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(every);
            match bar.upgrade() {
                Some(bar) if !bar.is_finished() => {
                    let (done, all) = (bar.position(), bar.length().unwrap_or(0));
                    write(format!("{name} {done} of {all} {}", bar.message()));
                }
                _ => return,
            }
        }
    });
}

/// Rate limiter.
#[derive(Debug)]
pub(super) struct Pace {
    every: Duration,
    last: Option<Instant>,
}

impl Pace {
    /// At most once in `every`; due at once the first time.
    pub(crate) fn new(every: Duration) -> Pace {
        Pace { every, last: None }
    }

    /// True at most once per interval.
    pub(crate) fn is_due(&mut self) -> bool {
        let due = self.last.is_none_or(|last| last.elapsed() >= self.every);
        if due {
            self.last = Some(Instant::now());
        }
        due
    }
}

/// A mean score as text.
pub(super) fn score_text(score: &MeanScore) -> String {
    format!(
        "{} dB, SSIM {} over {} views (8-bit: {} dB, {})",
        figure(score.psnr_db, 2),
        figure(score.ssim, 4),
        score.views,
        figure(score.psnr_db_8bit, 2),
        figure(score.ssim_8bit, 4),
    )
}

/// A number with so many decimals, or a dash.
pub(super) fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".into(), |value| format!("{value:.digits$}"))
}

/// Writes a text atomically.
pub(super) fn write_text(path: &Path, text: &str) -> Result<()> {
    write_atomically(path, |file| file.write_all(text.as_bytes()))
}

/// Bytes with a unit, in at most four digits.
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

/// A view's name as a file name: no folder, no extension, no path separators.
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
        assert_eq!(score_text(&none), "– dB, SSIM – over 0 views (8-bit: – dB, –)");
    }

    #[test]
    fn file_names_stay_in_their_folder() {
        assert_eq!(file_stem("images/0007.png"), "images_0007");
        assert_eq!(file_stem("../../etc/passwd"), "_.._etc_passwd");
        assert_eq!(file_stem("a b\u{e9}.JPG"), "a_b_");
        assert_eq!(file_stem(".."), "view");
    }

    #[test]
    fn lines_are_written_until_the_bar_is_gone() {
        let (send, receive) = std::sync::mpsc::channel();
        let bar = ProgressBar::hidden();
        bar.set_length(9);
        bar.set_position(4);
        bar.set_message("· loss 0.1");
        write_lines(&bar, "training", Duration::from_millis(1), move |line| {
            _ = send.send(line);
        });
        assert_eq!(receive.recv().as_deref(), Ok("training 4 of 9 · loss 0.1"));
        drop(bar);
        // The thread ends and drops the sender.
        assert_eq!(receive.iter().filter(|line| line.is_empty()).count(), 0);
    }

    #[test]
    fn a_pace_lets_the_first_through() {
        let mut pace = Pace::new(Duration::from_secs(3_600));
        assert!(pace.is_due() && !pace.is_due());
    }
}
