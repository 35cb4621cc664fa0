//! Failures of the machine: the device, its memory, the disk, the power. Names begin with the number of the failure in
//! the project's catalogue: 103 checkpoints, 106 lost devices, 107 memory, 102 full disks.
//!
//! A failure is injected at a chosen moment (`gpu::Faults`, a limit on file size, `kill -9`) of a short training, which
//! must end in an error, leave no partial file, leak nothing, and resume from its last checkpoint to the bytes of the
//! undisturbed run. Tests of every moment take minutes and are ignored: `make soak` runs them; here a spread of moments
//! is tried.

mod devices;
mod disks;
mod files;
mod kills;
mod poison;
mod run;
mod soak;
