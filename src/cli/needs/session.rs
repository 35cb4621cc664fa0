//! A survey in progress: each run is written as it ends.

use super::NeedsArgs;
use crate::cli::Outcome;
use crate::cli::eval::write_comparison;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{Output, grouped, write_text};
use crate::gpu::Gpu;
use crate::lab::page::Fact;
use crate::lab::survey::runner::{Task, built_in};
use crate::lab::survey::{self, Recipe, SurveyRun, page, record};
use crate::lab::synth::Kind;
use crate::render::ViewEvaluation;
use crate::scene::Dataset;
use crate::train::TrainConfig;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Scenes, recipes and runs of a survey.
pub(super) struct SurveySession<'a> {
    args: &'a NeedsArgs,
    gpu: &'a Gpu,
    output: Output,
    /// Scenes by name.
    scenes: Vec<(String, Dataset)>,
    recipes: Vec<Recipe>,
    /// Settings of constants of parsimony at other values.
    variations: Vec<String>,
    runs: Vec<SurveyRun>,
    /// Runs done, in this session or before.
    done: usize,
}

impl<'a> SurveySession<'a> {
    /// Makes and opens the scenes, and reads the runs of an earlier session. Writes nothing.
    ///
    /// # Errors
    /// Two scenes of one name, a data set that cannot be read, or runs of another survey in the folder.
    pub(super) fn begin(args: &'a NeedsArgs, gpu: &'a Gpu, output: Output) -> Result<SurveySession<'a>> {
        let mut scenes = Vec::new();
        for given in &args.data {
            let (name, path) = named(given);
            let is_taken = |(other, _): &(String, Dataset)| *other == name;
            if Kind::ALL.iter().any(|kind| kind.name() == name) || scenes.iter().any(is_taken) {
                let what = format!("another scene is called {name}, too: give NAME=DATA");
                return Err(Error::file(&path, what));
            }
            scenes.push((name, args.options.open(&path, true)?));
        }
        let is_asked = |kind: &Kind| match &args.scenes {
            Some(kinds) => kinds.contains(&Some(*kind)),
            None => !kind.is_for_geometry(),
        };
        let kinds = Kind::ALL.into_iter().filter(is_asked);
        let made = kinds.map(|kind| {
            output.remark(format_args!("photographing {}", kind.name()));
            (kind.name().to_owned(), built_in(kind, args.width))
        });
        scenes = made.chain(std::mem::take(&mut scenes)).collect();
        if scenes.is_empty() {
            return Err(Error::Config("there is no scene to train".into()));
        }
        let wanted = |recipe: &Recipe| match &args.recipes {
            Some(chosen) => chosen.contains(recipe),
            None => Recipe::USUAL.contains(recipe),
        };
        let usual = TrainConfig::for_iterations(args.iterations);
        let variations = args.vary.iter().map(|name| survey::variations(&usual, name));
        let variations = variations.collect::<std::result::Result<Vec<_>, _>>();
        let mut session = SurveySession {
            args,
            variations: variations
                .map_err(|why| Error::Config(format!("--vary: {why}")))?
                .concat(),
            gpu,
            output,
            recipes: Recipe::ALL.into_iter().filter(wanted).collect(),
            scenes,
            runs: Vec::new(),
            done: 0,
        };
        if !args.overwrite {
            session.runs = session.earlier()?;
        }
        Ok(session)
    }

    /// Earlier runs in the folder.
    fn earlier(&self) -> Result<Vec<SurveyRun>> {
        let path = self.args.out.join("needs.csv");
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(Error::io(&path)(error)),
        };
        let runs = record::read(&path, &text)?;
        for (scene, dataset) in &self.scenes {
            let planned = self.task((scene, dataset), self.recipes[0], 0, "");
            let planned = planned.planned(self.gpu);
            if let Some(conflict) = runs.iter().find_map(|run| run.conflict(&planned)) {
                let what = format!(
                    "has runs of another survey ({conflict}): choose another --out, or begin anew with --overwrite"
                );
                return Err(Error::file(&path, what));
            }
        }
        Ok(runs)
    }

    fn task<'b>(&self, (scene, dataset): (&str, &'b Dataset), recipe: Recipe, seed: u64, setting: &str) -> Task<'b> {
        Task {
            dataset,
            settings: SurveyRun {
                scene: scene.into(),
                recipe,
                seed,
                iterations: self.args.iterations,
                loss_db: self.args.loss,
                setting: setting.into(),
                ..SurveyRun::default()
            },
        }
    }

    /// Does the missing runs, seed by seed over all scenes.
    pub(super) fn run(&mut self, interrupt: &Interrupt) -> Result<Outcome> {
        let scenes = std::mem::take(&mut self.scenes);
        let usual = self.recipes.iter().map(|recipe| (*recipe, String::new()));
        let varied = self.variations.drain(..).map(|setting| (Recipe::Parsimony, setting));
        let variants: Vec<(Recipe, String)> = usual.chain(varied).collect();
        let mut is_warm = false;
        for seed in 0..self.args.seeds {
            for (scene, dataset) in &scenes {
                for (recipe, setting) in &variants {
                    let mut task = self.task((scene, dataset), *recipe, seed, setting);
                    if matches!(recipe, Recipe::Mcmc | Recipe::McmcRates) {
                        task.settings.max_splats = Some(self.count(scene, seed)?);
                    }
                    self.done += 1;
                    if self.has(&task) {
                        continue;
                    }
                    if !is_warm {
                        task.warm_up(self.gpu)?;
                        is_warm = true;
                    }
                    let of = scenes.len() * variants.len() * self.args.seeds as usize;
                    if self.add(&task, of, interrupt)? == Outcome::Interrupted {
                        return Ok(Outcome::Interrupted);
                    }
                }
            }
        }
        Ok(Outcome::Done)
    }

    /// Limit of the splat count of MCMC.
    fn count(&self, scene: &str, seed: u64) -> Result<u32> {
        let key = (scene, Recipe::Parsimony, seed, "");
        let run = self.runs.iter().find(|run| run.key() == key);
        let run = run.ok_or_else(|| {
            let what = "MCMC takes the count of a parsimony run, and there is none: add parsimony to --recipes";
            Error::Config(what.into())
        })?;
        Ok(u32::try_from(run.splats).unwrap_or(u32::MAX).max(1))
    }

    /// True if the run is done and not to be repeated.
    fn has(&self, task: &Task<'_>) -> bool {
        let settings = &task.settings;
        let found = self.runs.iter().find(|run| run.key() == settings.key());
        let is_again = self.args.again.contains(&settings.recipe);
        found.is_some_and(|run| run.max_splats == settings.max_splats && !is_again)
    }

    /// Does a run and writes the survey.
    fn add(&mut self, task: &Task<'_>, of: usize, interrupt: &Interrupt) -> Result<Outcome> {
        let (scene, recipe, seed, setting) = task.settings.key();
        let title = [scene, recipe.title(), setting]
            .into_iter()
            .filter(|part| !part.is_empty());
        let title = title.collect::<Vec<_>>().join(" · ");
        let title = format!("{title} · seed {seed} · run {} of {of}", self.done);
        let bar = self.output.bar(u64::from(task.settings.iterations), "training");
        bar.set_message(format!("· {title}"));
        let mut progress = |iteration: u32| {
            bar.set_position(u64::from(iteration));
            !interrupt.is_requested()
        };
        let pictures = self.args.pictures.then(|| {
            let name = [scene, recipe.name(), &seed.to_string(), setting].join("-");
            let name = name.trim_end_matches('-').replace(['/', '\\'], "_");
            self.args.out.join("pictures").join(name)
        });
        let show = |evaluated: ViewEvaluation<'_>| match &pictures {
            Some(folder) => {
                std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
                write_comparison(folder, evaluated)
            }
            None => Ok(()),
        };
        let run = task.run(self.gpu, &self.args.out, &mut progress, &show)?;
        bar.finish_and_clear();
        let Some(run) = run else {
            return Ok(Outcome::Interrupted);
        };
        self.output.remark(format_args!(
            "{title}: {} splats, {:.2} dB, {:.0} s",
            grouped(run.splats),
            run.psnr_db.unwrap_or(f64::NAN),
            run.train_seconds
        ));
        match self.runs.iter_mut().find(|known| known.key() == run.key()) {
            Some(known) => *known = run,
            None => self.runs.push(run),
        }
        self.write()?;
        Ok(Outcome::Done)
    }

    /// Runs as CSV.
    pub(super) fn csv(&self) -> Result<String> {
        record::write(&self.runs)
    }

    /// Writes the page and the CSV.
    pub(super) fn write(&self) -> Result<()> {
        let out = &self.args.out;
        write_text(&out.join("needs.csv"), &self.csv()?)?;
        write_text(&out.join("needs.html"), &page::html(&self.facts(), &self.runs)?)
    }

    /// Facts at the top of the page.
    fn facts(&self) -> Vec<Fact> {
        let dates = || self.runs.iter().map(|run| run.date.as_str());
        let dates = match (dates().min(), dates().max()) {
            (Some(first), Some(last)) if first != last => format!("{first} to {last}"),
            (first, _) => first.unwrap_or_default().to_owned(),
        };
        let rows = [
            ("scenes", scenes(&self.runs)),
            ("trained", format!("{} steps a run", self.args.iterations)),
            ("loss allowed", format!("{} dB of held-out views", self.args.loss)),
            ("device", self.gpu.caps().name.to_owned()),
            ("date", dates),
            ("version", format!("ashfall {}", env!("CARGO_PKG_VERSION"))),
        ];
        rows.map(|(name, value)| (name.to_owned(), value)).to_vec()
    }
}

/// Names of the scenes, grouped by the number and size of their photographs.
fn scenes(runs: &[SurveyRun]) -> String {
    let mut groups: Vec<(String, Vec<&str>)> = Vec::new();
    for name in survey::scenes(runs) {
        let Some(run) = runs.iter().find(|run| run.scene == name) else {
            continue;
        };
        let (all, test) = (run.train_views + run.test_views, run.test_views);
        let (width, height) = (run.width, run.height);
        let alike = format!("{all} views, {test} held out, {width} × {height}");
        match groups.iter_mut().find(|(known, _)| *known == alike) {
            Some((_, names)) => names.push(name),
            None => groups.push((alike, vec![name])),
        }
    }
    let group = |(alike, names): (String, Vec<&str>)| format!("{}: {alike}", names.join(", "));
    groups.into_iter().map(group).collect::<Vec<_>>().join("; ")
}

/// Name and path of a data set given as NAME=DATA, or named by its last folder.
fn named(given: &Path) -> (String, PathBuf) {
    let text = given.to_str().filter(|_| !given.exists());
    if let Some((name, path)) = text.and_then(|text| text.split_once('='))
        && !name.is_empty()
        && !name.contains(['/', '\\'])
    {
        return (safe(name), path.into());
    }
    let whole = std::path::absolute(given).unwrap_or_else(|_| given.to_owned());
    let folder = match whole.parent() {
        Some(folder) if whole.is_file() => folder,
        _ => &whole,
    };
    let last = folder.components().next_back();
    let last = last.map(|part| part.as_os_str().to_string_lossy().into_owned());
    (safe(&last.unwrap_or_default()), given.to_owned())
}

/// A name without separators.
fn safe(name: &str) -> String {
    let is_bad = |c: char| c.is_control() || [',', ';', '"', ' '].contains(&c);
    name.replace(is_bad, "_")
}

#[cfg(test)]
mod tests {
    use super::named;
    use std::path::{Path, PathBuf};

    #[test]
    fn a_data_set_is_named_by_its_last_folder() {
        let name = |text| named(Path::new(text)).0;
        assert_eq!(name("/somewhere/private/fox/"), "fox");
        assert_eq!(name("/somewhere/a b,c"), "a_b_c");
        assert_eq!(name("fox"), "fox");
    }

    #[test]
    fn data_sets_can_be_given_names() {
        let found = named(Path::new("fox=/some=where/colmap"));
        assert_eq!(found, ("fox".into(), PathBuf::from("/some=where/colmap")));
        let unnamed = named(Path::new("/some=where/colmap"));
        assert_eq!(unnamed, ("colmap".into(), PathBuf::from("/some=where/colmap")));
        assert_eq!(named(Path::new("=x")).0, "=x");
    }
}
