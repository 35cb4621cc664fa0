//! Projects splats: ellipse, colour and depth on the screen, and number of tiles touched.

pub use super::generated::project::*;

impl Choice {
    /// Choice for splats of `sh_degree`, the same on all devices.
    pub fn of_degree(sh_degree: u32) -> Choice {
        let mut choice = Choice::default();
        choice.spec.sh_degree = sh_degree;
        choice
    }
}
