//! Trains the built-in scene for some steps; writes it with a rendering of a held-out view.
//!
//!     cargo run --release --example train_builtin [OUT.png] [ITERATIONS]

use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::{Evaluator, Gpu, GpuOptions, Run, Split, TrainConfig, ViewOptions, io, write_splats};
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let out = PathBuf::from(args.next().unwrap_or("trained.png".into()));
    let iterations = args.next().map_or(Ok(300), |text| text.parse())?;

    let gpu = Gpu::create(&GpuOptions::default())?;
    let dataset = scene(Kind::Demo).dataset(&SynthOptions::default());
    let mut run = Run::new(&gpu, &dataset, TrainConfig::for_iterations(iterations))?;
    while !run.is_done() {
        if let Some(report) = run.step()?
            && report.iteration % 50 == 0
        {
            let (step, splats) = (report.iteration, report.splat_count);
            println!("step {step}: loss {:.4}, {splats} splats", report.loss);
        }
    }
    run.finish()?;

    let splats = run.splats()?;
    let view = ViewOptions {
        background: run.config().evaluation_background(),
        near: run.config().near(dataset.extent()),
        filter: splats.filter,
    };
    let mut evaluator = Evaluator::new(&gpu, &dataset, &dataset.split(Split::Test), view);
    let pictures = evaluator.map(&splats, |evaluated| Ok((evaluated.score(), evaluated.rendered.clone())))?;
    let (score, picture) = pictures.first().ok_or("no view is held out")?;
    println!("{}: {:.2} dB", score.name, score.psnr_db.unwrap_or(f64::NAN));
    io::png::write_rgb(&out, picture.width, picture.height, &picture.rgb)?;
    let scene = out.with_extension("ply");
    write_splats(&scene, &splats)?;
    println!("{}, {}", out.display(), scene.display());
    Ok(())
}
