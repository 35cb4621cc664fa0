//! What follows when the machine fails: the device, its memory, the disk, the power. Names begin with the number of
//! the kind of failure in the project's catalogue: 103 checkpoints, 106 lost devices, 107 memory, 102 full disks.
//!
//! A failure is had at a moment of choice (`gpu::Faults`, a limit on the size of files, `kill -9`) in a short
//! training, which must end in an error, leave nothing half-written, leak nothing, and go on from its last
//! checkpoint to the bytes of the run that nothing happened to. Tests that try every moment take minutes and are
//! ignored: `make soak` runs them; here a spread of moments is tried.

mod devices;
mod disks;
mod files;
mod kills;
mod poison;
mod run;
mod soak;
