//! Projection of parameters to ellipse, colour and number of tiles.

use crate::common::check::*;
use crate::common::pack::Splat2d;
use crate::common::{device, scenes};
use ashfall::gpu::Gpu;
use ashfall::kernels::Kernel;
use ashfall::kernels::project::{Choice, Project};
use ashfall::lab::bench::input::lists::view;
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::project::{ProjectOutputs, commands, orthographic, planes, project};
use ashfall::reference::dropout::Dropout;
use ashfall::render::planes_from_splats;
use ashfall::scene::ScreenFilter;
use scenes::Scene;

fn mip(mut scene: Scene) -> Scene {
    scene.splats.filter = ScreenFilter::Mip;
    scene
}

/// A name, a scene, and the 3D filter of each of its splats.
type Case = (&'static str, Scene, Vec<f32>);

fn cases(sh_degree: u32) -> Vec<Case> {
    let plain = |(name, scene): (&'static str, Scene)| {
        let none = vec![0.0; scene.splats.len()];
        (name, scene, none)
    };
    let smooth = |(name, scene): (&'static str, Scene)| {
        let filters = scenes::filters(&scene.splats, 1);
        (name, mip(scene), filters)
    };
    let plain = plain_scenes(sh_degree).into_iter().map(plain);
    let smoothed = [
        ("smoothed", scenes::gentle(10, 100, 97, 129, sh_degree)),
        ("smoothed, hard", scenes::hard(11, 270, 97, 129, sh_degree)),
    ];
    plain.chain(smoothed.map(smooth)).collect()
}

fn plain_scenes(sh_degree: u32) -> Vec<(&'static str, Scene)> {
    vec![
        ("nothing to draw", scenes::gentle(1, 0, 33, 47, sh_degree)),
        ("one", scenes::gentle(2, 1, 33, 47, sh_degree)),
        ("2^6 + 1", scenes::gentle(3, 65, 80, 61, sh_degree)),
        ("hard", scenes::hard(4, 270, 97, 129, sh_degree)),
        ("one pixel", scenes::hard(5, 90, 1, 1, sh_degree)),
        ("wide", scenes::hard(6, 270, 500, 20, sh_degree)),
        ("mip", mip(scenes::gentle(7, 100, 97, 129, sh_degree))),
        ("mip, hard", mip(scenes::hard(8, 270, 97, 129, sh_degree))),
    ]
}

#[test]
fn splats_are_projected() {
    let gpu = device::gpu();
    let mut check = Check::new("project");
    for degree in 0..=3 {
        let case = |(name, scene, filters): Case| {
            let case = project(&gpu, &scene, &filters, Dropout::default());
            (name, case.unwrap())
        };
        let mut cases: Vec<_> = cases(degree).into_iter().map(case).collect();
        let (dropped, share) = (scenes::hard(12, 270, 97, 129, degree), 1 << 30);
        let dropout = Dropout { share, key: 77 };
        cases.push(("dropout", project(&gpu, &dropped, &[], dropout).unwrap()));
        check.cases(&gpu, Workgroups::any(&[8, 64]), &cases);
    }
    check.finish();
}

#[test]
fn splats_are_projected_along_parallel_rays() {
    let gpu = device::gpu();
    let mut check = Check::new("project");
    let case = |(name, mut scene): (&'static str, Scene)| {
        // The scenes lie around 4 units before the camera.
        scene.camera.focal /= 4.0;
        (name, orthographic(&gpu, &scene).unwrap())
    };
    let cases: Vec<_> = plain_scenes(3).into_iter().map(case).collect();
    check.cases(&gpu, Workgroups::any(&[8, 64]), &cases);
    check.finish();
}

#[test]
fn planes_of_splats_are_found() {
    let gpu = device::gpu();
    let mut check = Check::new("project");
    let case = |(name, scene, filters): Case| (name, planes(&gpu, &scene, &filters).unwrap());
    let cases: Vec<_> = cases(0).into_iter().map(case).collect();
    check.cases(&gpu, Workgroups::any(&[8, 64]), &cases);
    check.finish();
}

/// Records and tile counts of a scene with these parameters.
fn run(gpu: &Gpu, scene: &Scene, planes: &[[f32; 4]], index: Option<&[u32]>) -> (Vec<Splat2d>, Vec<u32>) {
    let outputs = ProjectOutputs::new(gpu, scene.splats.len()).unwrap();
    let case = commands(gpu, (scene, view(scene)), planes, index, &outputs).unwrap();
    let choice = case.tuned(Choice::default());
    case.run(gpu, &Project::compile(gpu, choice).unwrap(), &choice).unwrap();
    outputs.read(gpu).unwrap()
}

#[test]
fn slots_may_lie_in_any_order() {
    let gpu = device::gpu();
    let scene = scenes::hard(4, 270, 97, 129, 3);
    let planes = planes_from_splats(&scene.splats);
    let index = scenes::shuffled(270);
    let moved = scenes::in_order(&planes, &index);
    // As text: records of splats that are not drawn are NaNs.
    let run = |planes: &[[f32; 4]], index| format!("{:?}", run(&gpu, &scene, planes, index));
    let ordered = run(&planes, None);
    assert!(run(&moved, Some(&index)) == ordered, "not in their places");
    assert!(run(&moved, None) != ordered, "the order makes no difference");
}

#[test]
fn poison_is_not_drawn_and_harms_nobody() {
    let gpu = device::gpu();
    let scene = scenes::gentle(9, 3, 33, 47, 3);
    let clean = planes_from_splats(&scene.splats);
    let run = |planes: &[[f32; 4]]| run(&gpu, &scene, planes, None);
    let (records, tiles) = run(&clean);
    let places = (0..clean.len() / 3).map(|plane| (plane, plane % 3));
    // The smoothing filter; one that is no number is none.
    for (plane, lane) in places.chain([(2, 3)]) {
        for poison in scenes::POISON.iter().step_by(3) {
            let mut planes = clean.clone();
            planes[plane * 3 + 1][lane] = *poison;
            let (found, counts) = run(&planes);
            for i in [0, 2] {
                assert_eq!((found[i], counts[i]), (records[i], tiles[i]), "{poison:e}");
            }
            let drawn = counts[1] > 0;
            assert!(
                !drawn || poison.is_finite() || lane == 3,
                "{poison:e} in plane {plane} is drawn"
            );
            let Splat2d { shape, tone, rest } = found[1];
            let sound = [&shape[..], &tone, &rest].concat();
            assert!(
                !drawn || sound.iter().all(|x| x.is_finite()),
                "{poison:e} in plane {plane}: {:?}",
                found[1]
            );
            assert!(counts[1] <= 5 * 3, "{poison:e}: {} tiles", counts[1]);
        }
    }
}
