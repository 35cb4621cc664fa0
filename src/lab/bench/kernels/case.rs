//! One kernel on one input: its commands, and the comparison of their outputs with the reference.

use super::read;
use crate::Result;
use crate::gpu::{Buffer, Caps, Frames, Gpu, Recorder};
use crate::kernels::Kernel;
use crate::lab::bench::check::{Output, UNWRITTEN, words};
use crate::lab::bench::session::device_times;
use crate::lab::bench::{Case, Subject, Work};
use crate::shader::KernelInfo;
use bytemuck::Pod;

type Tune<'a, C> = Box<dyn Fn(&mut C) + 'a>;
type Prepare<'a, K> = Box<dyn Fn(&mut Recorder<'_>, &K) + 'a>;
type Commands<'a, K> = Box<dyn Fn(&mut Recorder<'_>, &K, &<K as Kernel>::Choice) + 'a>;
type CaseOutputs<'a> = Box<dyn Fn(&Gpu) -> Result<Vec<Output>> + 'a>;

/// A kernel on an input.
pub struct KernelCase<'a, K: Kernel> {
    /// Work of one run.
    pub work: Work,
    tune: Option<Tune<'a, K::Choice>>,
    without: Option<&'static str>,
    prepare: Vec<Prepare<'a, K>>,
    prepare_timing: Option<Prepare<'a, K>>,
    commands: Commands<'a, K>,
    outputs: Vec<CaseOutputs<'a>>,
}

impl<'a, K: Kernel> KernelCase<'a, K> {
    /// A case without commands or outputs yet.
    pub fn new(work: Work) -> KernelCase<'a, K> {
        KernelCase {
            work,
            tune: None,
            without: None,
            prepare: Vec::new(),
            prepare_timing: None,
            commands: Box::new(|_, _, _| {}),
            outputs: Vec::new(),
        }
    }

    /// Commands of one run.
    #[must_use]
    pub fn commands(mut self, record: impl Fn(&mut Recorder<'_>, &K, &K::Choice) + 'a) -> Self {
        self.commands = Box::new(record);
        self
    }

    /// Sets specialisation constants.
    #[must_use]
    pub fn tune(mut self, tune: impl Fn(&mut K::Choice) + 'a) -> Self {
        self.tune = Some(Box::new(tune));
        self
    }

    /// Commands before every run, which are not timed.
    #[must_use]
    pub fn before(mut self, prepare: impl Fn(&mut Recorder<'_>, &K) + 'a) -> Self {
        self.prepare.push(Box::new(prepare));
        self
    }

    /// Commands before every timed run in place of those before a checked one.
    #[must_use]
    pub fn before_timing(mut self, prepare: impl Fn(&mut Recorder<'_>, &K) + 'a) -> Self {
        self.prepare_timing = Some(Box::new(prepare));
        self
    }

    /// Outputs to compare.
    #[must_use]
    pub fn judge(mut self, of: impl Fn(&Gpu) -> Result<Vec<Output>> + 'a) -> Self {
        self.outputs.push(Box::new(of));
        self
    }

    /// Outputs of a buffer, which is erased before every run, and before the preparations that follow.
    #[must_use]
    pub fn compare<T: Pod>(self, buffer: &Buffer<T>, of: impl Fn(Vec<T>) -> Vec<Output> + 'a) -> Self {
        let found = buffer.clone();
        self.erase(buffer).judge(move |gpu| Ok(of(read(gpu, &found)?)))
    }

    /// [`KernelCase::compare`] of words that must be equal; elements beyond the expected ones must stay erased.
    #[must_use]
    pub fn exact<T: Pod>(self, name: &'static str, buffer: &Buffer<T>, expected: Vec<f64>) -> Self {
        self.compare(buffer, move |found| {
            let found = words(&found);
            let mut expected = expected.clone();
            expected.resize(found.len().max(expected.len()), f64::NAN);
            vec![Output::exact(name, found, expected)]
        })
    }

    /// Fills a buffer with [`UNWRITTEN`] before every run.
    #[must_use]
    pub fn erase<T: Pod>(self, buffer: &Buffer<T>) -> Self {
        self.fill(buffer, UNWRITTEN)
    }

    /// Fills a buffer before every run.
    #[must_use]
    pub fn fill<T: Pod>(self, buffer: &Buffer<T>, word: u32) -> Self {
        let buffer = buffer.clone();
        self.before(move |rec, _| rec.fill(&buffer, word))
    }

    /// Copies a buffer to another one before every run.
    #[must_use]
    pub fn copy<T: Pod>(self, from: &Buffer<T>, to: &Buffer<T>) -> Self {
        let (from, to) = (from.clone(), to.clone());
        self.before(move |rec, _| rec.copy(&from, 0..from.len(), &to, 0))
    }

    /// Leaves out a variant that cannot do the case.
    #[must_use]
    pub fn without(mut self, variant: &'static str) -> Self {
        self.without = Some(variant);
        self
    }

    /// A choice with the case's specialisation constants.
    pub fn tuned(&self, mut choice: K::Choice) -> K::Choice {
        self.tune.iter().for_each(|tune| tune(&mut choice));
        choice
    }

    /// False if the choice's variant is left out.
    pub fn takes(&self, choice: &K::Choice) -> bool {
        self.without != Some(K::info(choice).variant)
    }

    /// Runs the kernel once.
    ///
    /// # Errors
    /// Those of a submission.
    pub fn run(&self, gpu: &Gpu, kernel: &K, choice: &K::Choice) -> Result<()> {
        gpu.run(|rec| {
            self.prepare.iter().for_each(|prepare| prepare(rec, kernel));
            (self.commands)(rec, kernel, choice);
        })
    }

    /// Outputs of the last run beside the expected ones.
    ///
    /// # Errors
    /// Those of transfers.
    pub fn outputs(&self, gpu: &Gpu) -> Result<Vec<Output>> {
        let outputs: Result<Vec<_>> = self.outputs.iter().map(|of| of(gpu)).collect();
        Ok(outputs?.into_iter().flatten().collect())
    }

    /// The kernel in a choice, checked once, to be timed under a name.
    ///
    /// # Errors
    /// A wrong result; errors of Vulkan.
    pub fn subject<'b>(&'b self, gpu: &Gpu, named: Case, choice: K::Choice) -> Result<Subject<'b>>
    where
        K: 'b,
    {
        let choice = self.tuned(choice);
        let kernel = K::compile(gpu, choice)?;
        self.run(gpu, &kernel, &choice)?;
        named.judge(&self.outputs(gpu)?)?;
        let mut frames = Frames::new(gpu, 1, true)?;
        let run = move || {
            let prepare = |rec: &mut Recorder<'_>| match &self.prepare_timing {
                Some(prepare) => prepare(rec, &kernel),
                None => self.prepare.iter().for_each(|prepare| prepare(rec, &kernel)),
            };
            device_times(&mut frames, prepare, |rec| (self.commands)(rec, &kernel, &choice))
        };
        Ok(Subject {
            case: named,
            run: Box::new(run),
        })
    }
}

/// Sizes of workgroups that a kernel is tried with.
#[derive(Clone, Copy)]
pub struct Workgroups {
    sizes: &'static [u32],
    fits: fn(&Caps, &KernelInfo, u32) -> bool,
}

impl Workgroups {
    /// For kernels whose workgroup is fixed.
    pub const FIXED: Workgroups = Workgroups::any(&[0]);

    /// Sizes of any kind.
    pub const fn any(sizes: &'static [u32]) -> Workgroups {
        Workgroups {
            sizes,
            fits: |_, _, _| true,
        }
    }

    /// Sizes of kernels with a workgroup a tile: those that use subgroups have all lanes in one, or blocks.
    pub const fn lanes(sizes: &'static [u32]) -> Workgroups {
        Workgroups {
            sizes,
            fits: |caps, info, size| match info.variant {
                "blocks" => size > 16 && caps.fills_subgroups(size),
                _ => size <= 32 && caps.lanes_fit(info, size),
            },
        }
    }

    /// Sizes of kernels that have full subgroups, where they use them.
    pub const fn subgroups(sizes: &'static [u32]) -> Workgroups {
        Workgroups {
            sizes,
            fits: |caps, info, size| !info.uses_subgroups() || caps.fills_subgroups(size),
        }
    }

    /// Choices of a kernel that the device can run, with their sizes.
    pub fn choices<K: Kernel>(&self, caps: &Caps) -> Vec<(K::Choice, u32)> {
        let mut choices = Vec::new();
        for variant in 0..K::choices(0).len() {
            for &size in self.sizes {
                let choice = K::choices(size)[variant];
                let info = K::info(&choice);
                let runs = caps.supports(info).is_ok() && size <= caps.max_workgroup;
                if runs && (self.fits)(caps, info, size) {
                    choices.push((choice, size));
                }
            }
        }
        choices
    }
}
