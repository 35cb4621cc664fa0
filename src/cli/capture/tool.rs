//! Programs of the machine: finding them, running them, following what they say.

use crate::cli::output::Output;
use crate::{Error, Result};
use serde_json::json;
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A program on the search path.
#[derive(Clone, Debug)]
pub(super) struct Tool {
    name: &'static str,
    path: PathBuf,
}

/// Lines of the log that an error shows.
const LAST_LINES: usize = 4;

impl Tool {
    /// Finds a program.
    ///
    /// # Errors
    /// Names the Debian package if it is not there.
    pub(super) fn find(name: &'static str, package: &str) -> Result<Tool> {
        let folders = std::env::var_os("PATH").unwrap_or_default();
        let mut candidates = std::env::split_paths(&folders).map(|folder| folder.join(name));
        match candidates.find(|path| path.is_file()) {
            Some(path) => Ok(Tool { name, path }),
            None => Err(Error::Config(format!(
                "the program {name} is not installed: `apt install {package}` on Debian and Ubuntu, or put it on the PATH"
            ))),
        }
    }

    /// A command with a subcommand; `label` names the stage.
    pub(super) fn command(&self, label: &'static str, subcommand: &str) -> ToolCommand<'_> {
        ToolCommand {
            tool: self,
            label,
            words: vec![subcommand.to_owned()],
            progress: "",
        }
    }

    /// Refuses another program of COLMAP's name.
    pub(super) fn check_colmap(&self) -> Result<()> {
        match self.help(&["-h"])?.contains("COLMAP ") {
            true => Ok(()),
            false => Err(Error::file(&self.path, "does not answer -h as COLMAP does")),
        }
    }

    /// The first of two groups of options whose `use_gpu` a subcommand offers: COLMAP has renamed them.
    pub(super) fn group(&self, subcommand: &str, names: [&'static str; 2]) -> Result<&'static str> {
        let said = self.help(&[subcommand, "-h"])?;
        Ok(names[usize::from(!said.contains(&format!("{}.use_gpu", names[0])))])
    }

    fn help(&self, words: &[&str]) -> Result<String> {
        let said = Command::new(&self.path)
            .args(words)
            .env("QT_QPA_PLATFORM", "offscreen")
            .output();
        let said = said.map_err(Error::io(&self.path))?;
        Ok(String::from_utf8_lossy(&[said.stdout, said.stderr].concat()).into_owned())
    }

    /// Standard error of a run that is expected to fail or not.
    pub(super) fn errors_of(&self, words: &[&str]) -> Result<String> {
        let said = Command::new(&self.path).args(words).stdin(Stdio::null()).output();
        Ok(String::from_utf8_lossy(&said.map_err(Error::io(&self.path))?.stderr).into_owned())
    }
}

/// A command to run.
#[derive(Clone, Debug)]
pub(super) struct ToolCommand<'a> {
    tool: &'a Tool,
    label: &'static str,
    words: Vec<String>,
    /// Begin of the lines that each stand for one photograph.
    progress: &'static str,
}

impl ToolCommand<'_> {
    pub(super) fn option(mut self, name: &str, value: &str) -> Self {
        self.words.extend([name.to_owned(), value.to_owned()]);
        self
    }

    pub(super) fn path(self, name: &str, path: &Path) -> Self {
        self.option(name, &path.to_string_lossy())
    }

    pub(super) fn word(mut self, word: &str) -> Self {
        self.words.push(word.to_owned());
        self
    }

    /// Lines that begin so are counted.
    pub(super) fn progress(mut self, begin: &'static str) -> Self {
        self.progress = begin;
        self
    }

    /// Runs the command; its output goes to `capture.log` in `folder`.
    ///
    /// # Errors
    /// The command's last lines if it fails.
    pub(super) fn run(&self, count: usize, folder: &Path, output: Output) -> Result<()> {
        let line = format!("{} {}", self.tool.name, self.words.join(" "));
        output.remark(format_args!("$ {line}"));
        output.event(|| json!({"event": "command", "stage": self.label, "command": line}));
        let path = folder.join("capture.log");
        let log = File::options().create(true).append(true).open(&path);
        let mut log = log.map_err(Error::io(&path))?;
        writeln!(log, "$ {line}").map_err(Error::io(&path))?;
        let errors = log.try_clone().map_err(Error::io(&path))?;
        let mut child = Command::new(&self.tool.path)
            .args(&self.words)
            .env("QT_QPA_PLATFORM", "offscreen")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(errors)
            .spawn()
            .map_err(Error::io(&self.tool.path))?;
        let bar = output.bar(count as u64, self.label);
        if let Some(stdout) = child.stdout.take() {
            for said in BufReader::new(stdout).split(b'\n').map_while(std::io::Result::ok) {
                let said = String::from_utf8_lossy(&said).into_owned();
                if said.trim_start().starts_with(self.progress) && !self.progress.is_empty() {
                    bar.inc(1);
                }
                writeln!(log, "{said}").map_err(Error::io(&path))?;
            }
        }
        let status = child.wait().map_err(Error::io(&self.tool.path))?;
        bar.finish_and_clear();
        if status.success() {
            return Ok(());
        }
        let said = std::fs::read_to_string(&path).unwrap_or_default();
        let lines: Vec<&str> = said.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        let last = lines[lines.len().saturating_sub(LAST_LINES)..].join(" | ");
        Err(Error::Config(format!(
            "{} {} failed ({status}); the same command goes on from here. Its last lines: {last}",
            self.tool.name, self.words[0]
        )))
    }
}
