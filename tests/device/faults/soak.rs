//! Long runs, and runs of odd configurations: memory stays flat, quaternions normalized, numbers finite.

use crate::common::device;
use crate::faults::run::dataset;
use ashfall::gpu::{Gpu, GpuOptions};
use ashfall::train::{HostState, StepReport, StrategyKind, TrainConfig, Trainer};
use serde_json::Value;

/// Resident memory of this process in bytes, as reported by Linux.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    let kilobytes = line.split_whitespace().nth(1).unwrap();
    1024 * kilobytes.parse::<u64>().unwrap()
}

/// The largest deviation of a quaternion's length from 1.
fn drift(state: &HostState) -> f64 {
    let length = |q: &[f32; 4]| q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
    let lengths = state.params[1].iter().map(|q| (length(q) - 1.0).abs());
    lengths.fold(0.0, f64::max)
}

#[track_caller]
fn all_finite(state: &HostState, what: &str) {
    for (part, planes) in [
        ("parameter", &state.params),
        ("first moment", &state.m),
        ("second moment", &state.v),
    ] {
        for (plane, rows) in planes.iter().enumerate() {
            let odd = rows.iter().position(|four| !four.iter().all(|v| v.is_finite()));
            let four = odd.map(|splat| (splat, rows[splat]));
            assert_eq!(four, None, "{what}: a {part} of plane {plane} is none");
        }
    }
}

fn sound(report: &StepReport, what: &str) {
    assert!(
        report.loss.is_finite(),
        "{what}: the loss of iteration {}",
        report.iteration
    );
    assert_eq!(
        report.poisoned, 0,
        "{what}: gradients of iteration {}",
        report.iteration
    );
}

/// Trains and samples the memory of process and device every tenth of the iterations. The process's memory is compared
/// only if `is_alone`: no other test runs in it, and the validation layer, which keeps a kilobyte per submission, is
/// off.
fn soak(gpu: &Gpu, iterations: u32, is_alone: bool) {
    let mut config = TrainConfig::for_iterations(iterations);
    config.sh_degree = 1;
    config.max_splats = Some(400);
    let mut trainer = Trainer::new(gpu, dataset(), config).unwrap();
    let tenth = iterations / 10;
    let mut seen = Vec::new();
    while !trainer.is_done() {
        if let Some(report) = trainer.step().unwrap() {
            sound(&report, "soak");
        }
        if trainer.iteration().is_multiple_of(tenth) {
            let state = trainer.download().unwrap();
            all_finite(&state, "soak");
            let look = (resident(), gpu.memory_in_use(), drift(&state));
            println!(
                "iteration {}: {} splats, {:.1} MiB resident, {:.2} MiB on the device, quaternions {:.1e} off",
                trainer.iteration(),
                state.len(),
                look.0 as f64 / 1048576.0,
                look.1 as f64 / 1048576.0,
                look.2
            );
            seen.push(look);
        }
    }
    for report in trainer.finish().unwrap() {
        sound(&report, "soak");
    }
    // Density control stops after three quarters: from then on sizes are constant.
    let (settled, last) = (seen[seen.len() - 3], seen[seen.len() - 1]);
    assert!(
        !is_alone || last.0 <= settled.0 + (4 << 20),
        "{} bytes resident became {}",
        settled.0,
        last.0
    );
    assert_eq!(last.1, settled.1, "bytes on the device");
    // Rounding of the division by the length and of the length itself: a few ULPs at any time.
    assert!(
        seen.iter().all(|look| look.2 < 8.0 * 2f64.powi(-24)),
        "quaternions drift"
    );
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Scales numbers of a configuration by up to a factor of 1000 either way, and replaces a few.
fn shake(random: &mut Random, value: &mut Value) {
    match value {
        Value::Object(map) => map.values_mut().for_each(|v| shake(random, v)),
        Value::Array(list) => list.iter_mut().for_each(|v| shake(random, v)),
        Value::Number(number) if random.uniform() < 0.3 => {
            let factor = 10f64.powf(6.0 * random.uniform() - 3.0);
            let old = number.as_f64().unwrap_or(0.0);
            let new = match random.next() % 6 {
                0 => 0.0,
                1 => 1.0,
                2 => 1.0 - old,
                _ => old * factor,
            };
            *value = match number.is_f64() {
                true => new.into(),
                false => (new.abs().min(1e9) as u64).into(),
            };
        }
        Value::Bool(flag) => *flag ^= random.uniform() < 0.5,
        _ => {}
    }
}

/// A configuration that passes its own validation, small enough to run here.
fn odd(random: &mut Random) -> TrainConfig {
    loop {
        let strategy = [StrategyKind::Adc, StrategyKind::Mcmc][random.next() as usize % 2];
        let config = TrainConfig::for_iterations(30).with_strategy(strategy);
        let mut value = serde_json::to_value(&config).unwrap();
        shake(random, &mut value);
        let Ok(mut config) = serde_json::from_value::<TrainConfig>(value) else {
            continue;
        };
        config.iterations = 30;
        config.max_splats = Some(config.max_splats.unwrap_or(300).clamp(1, 300));
        config.refine.every = config.refine.every.clamp(1, 10);
        config.init.random_count = config.init.random_count.min(300);
        if config.validate().is_ok() {
            return config;
        }
    }
}

fn odd_trainings(gpu: &Gpu, count: u64) {
    for seed in 0..count {
        let config = odd(&mut Random(seed));
        let what = format!("configuration {seed}: {config:?}");
        let mut trainer = match Trainer::new(gpu, dataset(), config) {
            Ok(trainer) => trainer,
            Err(ashfall::Error::Config(_)) => continue,
            Err(error) => panic!("{what}: {error}"),
        };
        while !trainer.is_done() {
            trainer.step().unwrap_or_else(|error| panic!("{what}: {error}"));
        }
        for report in trainer.finish().unwrap() {
            assert!(report.loss.is_finite(), "{what}: the loss");
        }
        all_finite(&trainer.download().unwrap(), &what);
    }
    println!("{count} odd configurations");
}

#[test]
fn a_few_hundred_iterations_leave_the_device_s_memory_flat_and_quaternions_short() {
    soak(&device::gpu(), 300, false);
}

#[test]
fn odd_configurations_train_without_a_number_that_is_none() {
    odd_trainings(&device::gpu(), 12);
}

#[test]
#[ignore = "30,000 iterations: minutes; `make soak`"]
fn thirty_thousand_iterations_leave_memory_flat() {
    let options = GpuOptions {
        device: Some("0".into()),
        ..GpuOptions::default()
    };
    let _turn = device::turn();
    soak(&Gpu::create(&options).unwrap(), 30_000, true);
}

#[test]
#[ignore = "30,000 iterations: minutes; `make soak`"]
fn thirty_thousand_iterations_leave_the_validation_layer_silent() {
    soak(&device::gpu(), 30_000, false);
}

#[test]
#[ignore = "a hundred trainings: minutes; `make soak`"]
fn a_hundred_odd_configurations_train_without_a_number_that_is_none() {
    odd_trainings(&device::gpu(), 100);
}
