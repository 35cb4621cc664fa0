//! From options to a [`TrainConfig`].

use super::parse;
use crate::gpu::DeviceKind;
use crate::scene::{Primitive, ScreenFilter};
use crate::train::{Background, ExposureModel, StrategyKind, TrainConfig};
use crate::{Error, Result};
use clap::{Args, ValueEnum};

/// Default iterations: as published, and about an hour of a CPU.
const ITERATIONS: u32 = 30_000;
const ITERATIONS_SOFTWARE: u32 = 2_000;

/// The options that make up the configuration.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Training")]
pub(in crate::cli) struct ConfigArgs {
    /// Optimisation steps, one photograph each; schedules scale with them [default: 30000, or 2000 on a CPU device]
    #[arg(long, value_name = "N")]
    pub iterations: Option<u32>,
    /// Seed of all random numbers: the same data, seed and device give the same scene.ply [default: 0]
    #[arg(long, value_name = "S")]
    pub seed: Option<u64>,
    /// Densification strategy [default: adc]
    #[arg(long, value_name = "NAME")]
    pub strategy: Option<StrategyArg>,
    /// Kind of the splats [default: 3d]
    #[arg(long, value_name = "KIND")]
    pub kind: Option<KindArg>,
    /// Rendering mode; `render` and `eval` read it from scene.ply [default: default; with surfels: mip]
    #[arg(long, value_name = "MODE")]
    pub mode: Option<ModeArg>,
    /// Apply remedies against these (comma-separated); constants given by --set come after
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub against: Vec<AgainstArg>,
    /// Limit of the splat count [default: none with adc; 1,000,000 with mcmc]
    #[arg(long, value_name = "N")]
    pub max_splats: Option<u32>,
    /// Degree of the view-dependent colour, 0 to 3 [default: 3]
    #[arg(long, value_name = "D")]
    pub sh_degree: Option<u32>,
    /// Colour behind the splats: black, white, R,G,B (0 to 1), or random, another one at each step [default: black]
    #[arg(long, value_name = "COLOR", value_parser = parse::background)]
    pub background: Option<Background>,
    /// Give each photograph and channel a gain, so that the scene keeps one exposure: from the tracks of the points,
    /// then from the renderings. scene.ply has the mean exposure; exposures.json has the gains
    #[arg(long)]
    pub exposure: bool,
    /// Move the poses of the photographs along with the splats, where the reconstruction is imprecise; refined/ has the
    /// reconstruction with the refined poses, poses.json how far each has moved. Exact poses hardly move
    #[arg(long)]
    pub refine_poses: bool,
    /// Begin with a far shell of splats where the photographs show no point, so that the sky is drawn there and not by
    /// haze before the cameras; with adc
    #[arg(long)]
    pub sky: bool,
    /// Set any constant by its name in report.json's "config", e.g. adc.grad_threshold=4e-4 (repeatable)
    #[arg(long = "set", value_name = "NAME=VALUE")]
    pub settings: Vec<String>,
}

/// Densification strategy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum StrategyArg {
    /// Clone, split and prune by gradient (3DGS)
    Adc,
    /// Move dead splats and grow to --max-splats (MCMC)
    Mcmc,
}

/// Kind of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum KindArg {
    /// 3D Gaussians (3DGS)
    #[value(name = "3d")]
    Gaussian3d,
    /// Flat Gaussians, for surfaces and meshes (2DGS)
    Surfel,
}

impl From<KindArg> for Primitive {
    fn from(kind: KindArg) -> Primitive {
        match kind {
            KindArg::Gaussian3d => Primitive::Gaussian3d,
            KindArg::Surfel => Primitive::Surfel,
        }
    }
}

/// Rendering mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum ModeArg {
    /// As 3DGS: splats never get thinner than half a pixel, but brighter from afar
    Default,
    /// Mip-Splatting: the right picture from nearer and farther than the photographs, too
    Mip,
}

/// Defect of a scene with a remedy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum AgainstArg {
    /// Splats in free space: cull the first points by views and by distance, prune below an opacity of 0.01,
    /// let size cost
    Floaters,
    /// Splats much longer than thick: none of more than 10 to 1
    Needles,
    /// Good pictures from the photographs' places alone, where few photographs show each part: random splats are left
    /// out of each step, and normals follow depths
    Overfitting,
    /// Passers-by: patches of a photograph that only it shows are left out; ignored/ has them, transients.json their
    /// shares
    Transients,
}

impl ConfigArgs {
    /// Configuration from the options, validated.
    pub(crate) fn config(&self, device: DeviceKind) -> Result<TrainConfig> {
        self.config_from(device, |config| config)
    }

    /// Configuration that starts from `other` of the defaults; the options override it.
    pub(crate) fn config_from(
        &self,
        device: DeviceKind,
        other: impl FnOnce(TrainConfig) -> TrainConfig,
    ) -> Result<TrainConfig> {
        let usual = match device {
            DeviceKind::Cpu => ITERATIONS_SOFTWARE,
            _ => ITERATIONS,
        };
        let strategy = match self.strategy {
            None | Some(StrategyArg::Adc) => StrategyKind::Adc,
            Some(StrategyArg::Mcmc) => StrategyKind::Mcmc,
        };
        let config = TrainConfig::for_iterations(self.iterations.unwrap_or(usual)).with_strategy(strategy);
        // Before, for constants that others are derived from; and after, for the derived ones.
        let config = self.with_settings(config)?;
        let kind = self.kind.map_or(config.kind, Primitive::from);
        let mut config = other(config.with_kind(kind));
        for against in &self.against {
            config = match against {
                AgainstArg::Floaters => config.against_floaters(),
                AgainstArg::Needles => config.against_needles(),
                AgainstArg::Overfitting => config.against_overfitting(1.0),
                AgainstArg::Transients => config.against_transients(),
            };
        }
        config.seed = self.seed.unwrap_or(config.seed);
        config.filter = match self.mode {
            None => config.filter,
            Some(ModeArg::Default) => ScreenFilter::Classic,
            Some(ModeArg::Mip) => ScreenFilter::Mip,
        };
        config.max_splats = self.max_splats;
        config.sh_degree = self.sh_degree.unwrap_or(config.sh_degree);
        config.background = self.background.unwrap_or(config.background);
        if self.exposure {
            config.exposure = ExposureModel::Gain;
        }
        config.refine_poses |= self.refine_poses;
        config.sky |= self.sky;
        let config = self.with_settings(config)?;
        config.validate()?;
        Ok(config)
    }

    fn with_settings(&self, config: TrainConfig) -> Result<TrainConfig> {
        let refuse = |why| Error::Config(format!("--set {why}"));
        config.with_settings(&self.settings).map_err(refuse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(settings: &[&str]) -> std::result::Result<TrainConfig, String> {
        let args = ConfigArgs {
            iterations: Some(100),
            settings: settings.iter().map(|s| s.to_string()).collect(),
            ..ConfigArgs::default()
        };
        args.config(DeviceKind::Cpu).map_err(|e| e.to_string())
    }

    #[test]
    fn any_constant_can_be_set_by_name() -> std::result::Result<(), String> {
        let config = with(&["adc.grad_threshold=4e-4", "strategy=mcmc", "refine.every = 20"])?;
        assert_eq!(config.adc.grad_threshold, 4e-4);
        assert_eq!(config.strategy, StrategyKind::Mcmc);
        assert_eq!(config.refine.every, 20);
        let config = with(&["background={\"fixed\": [1, 0, 0.5]}", "sh_degree_from=[1,2,3]"])?;
        assert_eq!(config.background, Background::Fixed([1.0, 0.0, 0.5]));
        assert_eq!(config.sh_degree_from, [1, 2, 3]);
        Ok(())
    }

    #[test]
    fn remedies_are_taken_together_and_settings_come_after() -> std::result::Result<(), String> {
        let args = ConfigArgs {
            against: vec![AgainstArg::Floaters, AgainstArg::Needles],
            mode: Some(ModeArg::Mip),
            settings: vec!["max_aspect=20".into()],
            ..ConfigArgs::default()
        };
        let config = args.config(DeviceKind::Cpu).map_err(|e| e.to_string())?;
        let wanted = TrainConfig::for_iterations(ITERATIONS_SOFTWARE).against_floaters();
        assert_eq!(config.init, wanted.init);
        assert_eq!((config.max_aspect, config.filter), (20.0, ScreenFilter::Mip));
        assert_eq!((config.size_penalty, config.adc.prune_opacity), (1e-4, 0.01));
        Ok(())
    }

    #[test]
    fn a_kind_has_its_filter_and_the_mode_comes_before_it() -> std::result::Result<(), String> {
        let filter = |kind, mode| {
            let args = ConfigArgs {
                kind,
                mode,
                ..ConfigArgs::default()
            };
            args.config(DeviceKind::Cpu).map(|config| config.filter)
        };
        let (surfel, classic) = (Some(KindArg::Surfel), Some(ModeArg::Default));
        let cases = [
            (None, None, ScreenFilter::Classic),
            (surfel, None, ScreenFilter::Mip),
            (surfel, classic, ScreenFilter::Classic),
            (None, Some(ModeArg::Mip), ScreenFilter::Mip),
        ];
        for (kind, mode, expected) in cases {
            assert_eq!(filter(kind, mode).map_err(|e| e.to_string())?, expected);
        }
        Ok(())
    }

    #[test]
    fn a_wrong_setting_is_named() {
        let message = |setting| with(&[setting]).err().unwrap_or_default();
        assert!(
            message("adc.gradthreshold=1")
                .starts_with("--set adc.gradthreshold=1: there is no such constant in adc; there are dense_fraction,")
        );
        assert!(message("foo=1").contains("there are accuracy, adam, adc, auto, background"));
        assert!(message("seed").contains("NAME=VALUE"));
        assert!(message("seed=-1").contains("--set seed=-1: invalid value"));
        assert!(message("sh_degree=7").contains("must be from 0 to 3"));
    }

    #[test]
    fn the_usual_length_depends_on_the_device() {
        let iterations = |device| {
            let config = ConfigArgs::default().config(device);
            config.map(|c| c.iterations).unwrap_or_default()
        };
        assert_eq!([DeviceKind::Other, DeviceKind::Cpu].map(iterations), [30_000, 2_000]);
    }
}
