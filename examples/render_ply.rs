//! Renders a scene file to a PNG, seen from outside along the z axis.
//!
//!     cargo run --release --example render_ply SCENE.ply OUT.png

use ashfall::{Camera, Gpu, GpuOptions, Model, RenderOptions, Renderer, ViewOptions, io, read_splats};
use glam::{DMat3, DVec2, DVec3};
use std::error::Error;
use std::path::PathBuf;

const SIZE: [u32; 2] = [640, 480];

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1).map(PathBuf::from);
    let (Some(scene), Some(out)) = (args.next(), args.next()) else {
        return Err("usage: render_ply SCENE.ply OUT.png".into());
    };
    let loaded = read_splats(scene.as_path())?;
    for warning in &loaded.warnings {
        eprintln!("warning: {warning}");
    }
    let splats = loaded.splats;
    let means = || splats.mean.iter().map(|mean| DVec3::from(mean.map(f64::from)));
    let center = means().sum::<DVec3>() / splats.len().max(1) as f64;
    let mut distances: Vec<f64> = means().map(|mean| mean.distance(center)).collect();
    distances.sort_by(f64::total_cmp);
    // Radius around 90 % of the splats; the rest may be background.
    let radius = distances.get(distances.len() * 9 / 10).copied().unwrap_or(1.0);

    let camera = Camera {
        width: SIZE[0],
        height: SIZE[1],
        focal: DVec2::splat(f64::from(SIZE[1])),
        center: DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) / 2.0,
        rotation: DMat3::IDENTITY,
        position: center - 2.5 * radius * DVec3::Z,
    };
    let view = ViewOptions {
        background: [0.0; 3],
        near: (0.01 * radius) as f32,
        filter: splats.filter,
    };
    let gpu = Gpu::create(&GpuOptions::default())?;
    let model = Model::upload(&gpu, &splats)?;
    let options = RenderOptions {
        primitive: splats.primitive,
        ..RenderOptions::default()
    };
    let picture = Renderer::new(&gpu, options)?.render(&model, &camera, &view)?;
    io::png::write_rgb(&out, picture.width, picture.height, &picture.rgb)?;
    println!("{} splats: {}", splats.len(), out.display());
    Ok(())
}
