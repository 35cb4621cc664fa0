//! SH reduction at the start of the last fit.
//!
//! Removed coefficients are fitted into the remaining ones by least squares: on the fox, 55 % of the floats then cost a
//! twentieth of the loss without a fit, before any step (`2026-11-24-harmonics.csv`).

use super::CountController;
use super::survey::Survey;
use crate::Result;
use crate::render::apart;
use crate::simplify::history::{Act, HistoryEntry, ReducedScene};
use crate::simplify::loss::{QualityLoss, lost};
use crate::simplify::sh_fit::Fits;
use crate::train::Trainer;

/// Shares of the floats of full SH, of which the smallest allowed one is chosen; the first is degree 0 everywhere.
const SHARES: [f64; 6] = [1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0, 3.0 / 8.0, 1.0 / 2.0, 3.0 / 4.0];

/// Maximum number of views that reduced colours are fitted to.
const FITTED_VIEWS: usize = 64;

impl<'a> CountController<'a> {
    /// Lowers the SH degrees of splats to the smallest share of the floats that costs the views, before the last fit,
    /// no more than is allowed.
    pub(super) fn reduce_sh(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let splats = trainer.splats()?;
        let views = self.all();
        let step = views.len().div_ceil(FITTED_VIEWS).max(1);
        let views: Vec<usize> = views.into_iter().step_by(step).collect();
        let seen = Survey::begin(&self.kernels, trainer, self.dataset)?.seen(&views)?;
        let fits = Fits::new(&splats, &seen);
        let scores = self.scores(&splats)?;
        for share in SHARES {
            let floats = (share * splats.sh.len() as f64) as usize;
            let degrees = fits.degrees(floats, apart(splats.len()));
            let less = fits.applied(&splats, &degrees);
            let without = self.scores(&less)?;
            let loss = QualityLoss::of(&lost(&scores, &without, &Default::default()));
            if loss.share(&self.history.config).0 > 1.0 {
                continue;
            }
            let ([scores, _], [without, _]) = (scores, without);
            self.history.entries.push(HistoryEntry {
                iteration: trainer.iteration(),
                act: Act::ShReduced,
                splats: splats.len(),
                scores,
                reduced: Some(ReducedScene {
                    splats: splats.len(),
                    scores: without,
                    loss,
                }),
            });
            if self.history.keeps_sh {
                return Ok(());
            }
            let mut state = trainer.download()?;
            state.recolor(&less);
            state.lower_degrees(&degrees);
            return trainer.replace(&state);
        }
        Ok(())
    }
}
