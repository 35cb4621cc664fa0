//! Seeded random scenes, for the oracle's own tests and for comparisons of kernels with it.
//!
//! All numbers are exact in `f32`, cameras included, so that device and oracle have equal inputs.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

pub use ashfall::lab::bench::input::pack::in_order;
pub use ashfall::lab::bench::input::random::{Random, single};
pub use ashfall::lab::bench::input::scene::{Scene, Sketch, push};
use ashfall::reference::Options;
use ashfall::scene::{Camera, Photo, PhotoSource, Primitive, ScreenFilter, Splats, View, sh_coefficient_count};
use glam::{DMat3, DVec2, DVec3};

/// A camera about four units from the origin, directed at it, with unequal focal lengths and a principal point off the
/// centre.
pub fn camera(random: &mut Random, width: u32, height: u32) -> Camera {
    let size = f64::from(width.max(height));
    let focal = DVec2::new(random.between(0.9, 1.2), random.between(0.9, 1.2)) * size;
    let center = DVec2::new(
        f64::from(width) * random.between(0.4, 0.6),
        f64::from(height) * random.between(0.4, 0.6),
    );
    let direction = DVec3::new(random.normal(), random.normal(), random.normal());
    let position = (direction.normalize_or(DVec3::X) * 4.0).to_array().map(single);
    let upright = Camera {
        width,
        height,
        focal: DVec2::new(single(focal.x), single(focal.y)),
        center: DVec2::new(single(center.x), single(center.y)),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    };
    let aimed = upright.look_at(position.into(), DVec3::ZERO, DVec3::new(0.3, 0.9, 0.2));
    Camera {
        rotation: DMat3::from_cols_array(&aimed.rotation.to_cols_array().map(single)),
        ..aimed
    }
}

/// A moderate, certainly visible splat; `rank` of `count` orders the depths without ties.
fn moderate(camera: &Camera, rank: usize, count: usize, random: &mut Random) -> Sketch {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let pixel = DVec2::new(width * random.between(0.05, 0.95), height * random.between(0.05, 0.95));
    let largest = (0.12 * width.min(height)).max(2.0);
    let sigma = random.log_between(1.0, largest);
    Sketch {
        pixel,
        depth: 2.0 + 4.0 * (rank as f64 + random.between(0.2, 0.8)) / count as f64,
        sigma: [0; 3].map(|_| sigma * random.log_between(0.6, 1.6)),
        opacity_logit: random.between(-2.0, 3.0),
        color: [0; 3].map(|_| random.between(0.25, 0.9)),
    }
}

fn empty(random: &mut Random, width: u32, height: u32, sh_degree: u32) -> Scene {
    let background = [0; 3].map(|_| random.between(0.0, 1.0));
    Scene {
        splats: Splats {
            sh_degree,
            filter: ScreenFilter::Classic,
            ..Splats::default()
        },
        camera: camera(random, width, height),
        options: Options {
            background,
            near: single(0.05),
            sh_degree,
            ..Options::default()
        },
    }
}

/// `count` well-conditioned splats before a camera: rounded, half transparent, no channel near black, depths as far
/// apart as `count` allows.
pub fn gentle(seed: u64, count: usize, width: u32, height: u32, sh_degree: u32) -> Scene {
    let random = &mut Random::new(seed);
    let mut scene = empty(random, width, height, sh_degree);
    for rank in random.permutation(count) {
        let sketch = moderate(&scene.camera, rank, count, random);
        push(&mut scene.splats, &scene.camera, &sketch, random);
    }
    scene
}

/// The difficulty of a splat of [`hard`]; splat `i` is of kind `Trouble::ALL[i % ALL.len()]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// An ordinary splat.
    None,
    /// The centre lies outside the limits of the Jacobian, the tails reach into the image.
    Clamped,
    /// Opacity logit up to 12.
    Saturated,
    /// One axis a hundred times the others.
    Needle,
    /// Behind the camera.
    Behind,
    /// Opacity below 1/255.
    Invisible,
    /// Covers the whole image, faintly.
    Huge,
    /// Much smaller than a pixel.
    Tiny,
    /// Two channels negative before clamping.
    Dark,
}

impl Trouble {
    /// All kinds.
    pub const ALL: [Trouble; 9] = [
        Trouble::None,
        Trouble::Clamped,
        Trouble::Saturated,
        Trouble::Needle,
        Trouble::Behind,
        Trouble::Invisible,
        Trouble::Huge,
        Trouble::Tiny,
        Trouble::Dark,
    ];

    /// The kind of splat `index` of a hard scene.
    pub fn of(index: usize) -> Trouble {
        Trouble::ALL[index % Trouble::ALL.len()]
    }

    fn apply(self, sketch: &mut Sketch, camera: &Camera, random: &mut Random) {
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        match self {
            Trouble::None => {}
            Trouble::Clamped => {
                // Beyond the right or left limit, 15 % of the width outside the image.
                let beyond = size.x * random.between(0.2, 0.5);
                sketch.pixel.x = if random.below(2) == 0 { size.x + beyond } else { -beyond };
                sketch.sigma = [0; 3].map(|_| size.x * random.between(0.2, 0.35));
            }
            Trouble::Saturated => sketch.opacity_logit = random.between(6.0, 12.0),
            Trouble::Needle => {
                let thin = random.log_between(0.05, 0.3);
                sketch.sigma = [thin, 100.0 * thin, thin];
            }
            Trouble::Behind => sketch.depth = -sketch.depth,
            Trouble::Invisible => sketch.opacity_logit = random.between(-9.0, -5.7),
            Trouble::Huge => {
                sketch.sigma = [0; 3].map(|_| size.max_element() * random.between(0.5, 0.8));
                sketch.opacity_logit = random.between(-3.0, -1.0);
            }
            Trouble::Tiny => sketch.sigma = [0; 3].map(|_| random.log_between(0.01, 0.1)),
            Trouble::Dark => sketch.color = [random.between(0.3, 0.9), -0.5, -0.3],
        }
    }
}

/// As [`gentle`], but every splat has the [`Trouble`] of its index.
pub fn hard(seed: u64, count: usize, width: u32, height: u32, sh_degree: u32) -> Scene {
    let random = &mut Random::new(seed ^ 0x6861_7264);
    let mut scene = empty(random, width, height, sh_degree);
    for (index, rank) in random.permutation(count).into_iter().enumerate() {
        let mut sketch = moderate(&scene.camera, rank, count, random);
        Trouble::of(index).apply(&mut sketch, &scene.camera, random);
        push(&mut scene.splats, &scene.camera, &sketch, random);
    }
    scene
}

/// The scene with its splats as surfels.
pub fn flattened(mut scene: Scene, filter: ScreenFilter) -> Scene {
    scene.splats.primitive = Primitive::Surfel;
    scene.splats.filter = filter;
    scene.splats.set_thickness();
    scene
}

/// Standard deviations of 3D smoothing filters, world units: from a thirtieth to three times the splat's own; 0 for
/// every fifth splat.
pub fn filters(splats: &Splats, seed: u64) -> Vec<f32> {
    let random = &mut Random::new(seed ^ 0x6d69_7000);
    let filter = |(index, log_scale): (usize, &[f32; 3])| {
        let own = (log_scale.iter().sum::<f32>() / 3.0).exp();
        let ratio = random.log_between(0.03, 3.0) as f32;
        if index % 5 == 0 { 0.0 } else { own * ratio }
    };
    splats.log_scale.iter().enumerate().map(filter).collect()
}

/// A generated photograph: a gradient with noise, 256 levels.
pub fn photo(seed: u64, width: u32, height: u32) -> Vec<[u8; 3]> {
    let random = &mut Random::new(seed ^ 0x7068_6f74);
    let slope = [0; 3].map(|_| [random.between(-0.5, 0.5), random.between(-0.5, 0.5)]);
    let mut pixels = Vec::with_capacity((width * height) as usize);
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (f64::from(x) / f64::from(width), f64::from(y) / f64::from(height));
            let shade = slope.map(|[a, b]| 0.5 + a * (u - 0.5) + b * (v - 0.5));
            pixels.push(shade.map(|s| ((s + random.between(-0.1, 0.1)) * 255.0).round() as u8));
        }
    }
    pixels
}

/// A view with a generated photograph, whose alpha is given by pixel.
pub fn photographed(camera: Camera, alpha: impl Fn(usize) -> u8) -> View {
    let Camera { width, height, .. } = camera;
    let rgb = photo(7, width, height);
    let rgba = rgb
        .iter()
        .enumerate()
        .map(|(i, &[r, g, b])| [r, g, b, alpha(i)])
        .collect();
    View {
        name: "view".into(),
        camera,
        photo: PhotoSource::Memory(Photo { width, height, rgba }),
    }
}

/// A photograph's values, 0 to 1.
pub fn photo_values(photo: &[[u8; 3]]) -> Vec<[f64; 3]> {
    photo.iter().map(|rgb| rgb.map(|c| f64::from(c) / 255.0)).collect()
}

/// SH coefficient `coefficient` (RGB) of a splat, asserted to be within the degree.
pub fn coefficient(splats: &mut Splats, splat: usize, coefficient: usize) -> &mut [f32] {
    assert!(
        coefficient < sh_coefficient_count(splats.sh_degree),
        "no such coefficient"
    );
    let stride = splats.sh_stride();
    &mut splats.sh[splat * stride + coefficient * 3..][..3]
}

/// Special values for parameters: NaN, infinities, zeros, subnormals, and values near numeric limits.
pub const POISON: [f32; 30] = [
    f32::NAN,
    -f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    -0.0,
    f32::MIN_POSITIVE,
    1e-40,
    -1e-40,
    f32::EPSILON,
    1e38,
    -1e38,
    f32::MAX,
    f32::MIN,
    1e20,
    -1e20,
    1.0,
    -1.0,
    0.01,
    1e10,
    1.0 / 255.0,
    16.0,
    16_777_217.0,
    2_147_483_648.0,
    3e9,
    65_536.0,
    88.73,
    -87.34,
    -104.0,
    17.4,
];

/// A random permutation of the numbers below `count`, uncorrelated with other orders.
pub fn shuffled(count: usize) -> Vec<u32> {
    let random = &mut Random::new(count as u64);
    let mut keyed: Vec<(u64, u32)> = (0..count as u32)
        .map(|i| (random.between(0.0, 1e15) as u64, i))
        .collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}
