//! Costs of a guest to its host: memory, barriers, compilation.

use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::Host;
use crate::embed::watch::Barrier;
use crate::embed::{SIZE, adopt, assert_same, expected, scene, view, watch, wrap};
use ash::vk::{self, AccessFlags2 as Access, PipelineStageFlags2 as Stage};
use ashfall::gpu::{Caps, STAGING_BYTES};
use ashfall::kernels::scan_apply;
use ashfall::render::{Model, RenderOptions, Renderer};
use ashfall::scene::Splats;

const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// `count` splats of degree 3, without regard to their looks: 240 bytes each on the device.
fn many(count: usize) -> Splats {
    Splats {
        mean: vec![[0.0, 0.0, 1e6]; count],
        quaternion: vec![[1.0, 0.0, 0.0, 0.0]; count],
        log_scale: vec![[-3.0; 3]; count],
        opacity_logit: vec![0.0; count],
        sh: vec![0.5; 48 * count],
        sh_degree: 3,
        ..Splats::default()
    }
}

/// A host that streams scenes gets the memory of their uploads back as soon as the commands have run.
#[test]
fn an_uploads_staging_memory_goes_back() {
    let scene = scene();
    let host = Host::new();
    let frames = [0, 1].map(|_| Frame::new(&host, FORMAT, SIZE));
    let gpu = adopt(&host, false, true);
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    frames[0].begin();
    let mut commands = wrap(&frames[0]);
    let before = gpu.memory_in_use();
    let model = renderer.record_upload(&mut commands, &many(280_000)).unwrap();
    let uploaded = gpu.memory_in_use() - before;
    renderer.reserve(&model, &scene.camera, 1 << 12).unwrap();
    frames[0].hand_over();
    frames[0].submit();
    let bytes: u64 = model.params.iter().map(|plane| plane.bytes()).sum();
    assert!(bytes >= 64 << 20, "{bytes} bytes");
    assert!(
        uploaded >= 2 * bytes,
        "{uploaded} bytes for {bytes} and their staging memory"
    );
    for i in 1..=2 {
        let frame = &frames[i % 2];
        frame.begin();
        let target = frame.target(CLEARED, COPYABLE);
        renderer
            .record(&mut wrap(frame), &model, &scene.camera, &view(&scene), &target)
            .unwrap();
        frame.submit();
        frame.pixels::<f32>();
    }
    let by_name = gpu.memory_by_name();
    let in_use = |name: &str| {
        by_name
            .iter()
            .find(|(known, _)| known == name)
            .map_or(0, |(_, memory)| memory.bytes)
    };
    let transfer = in_use("staging") + in_use("readback");
    assert!(transfer < 1 << 19, "{transfer} bytes of {}", gpu.memory_in_use());
}

/// An upload in parts has the bits of a whole one, and staging memory for a part.
#[test]
fn uploads_in_parts_have_the_bits_of_whole_ones() {
    const PART: usize = 100_000;
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    // Two degrees, so that slots have an order of their own.
    let mut splats = many(40_000);
    for (i, sh) in splats.sh.chunks_mut(48).enumerate() {
        sh.iter_mut().for_each(|value| *value = i as f32);
        if i % 2 == 0 {
            sh[3..].fill(0.0);
        }
    }
    let options = RenderOptions {
        frames_in_flight: 1,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    let whole = Model::upload(&gpu, &splats).unwrap();
    assert!(whole.is_indexed());
    let mut upload = renderer.begin_upload(&splats).unwrap();
    let staging = |gpu: &ashfall::Gpu| {
        let by_name = gpu.memory_by_name();
        let found = by_name.iter().find(|(known, _)| known == "staging");
        found.map_or(0, |(_, memory)| memory.bytes)
    };
    let before = staging(&gpu);
    let (mut parts, mut found) = (0, None);
    while found.is_none() {
        frame.begin();
        found = renderer.record_part(&mut wrap(&frame), &mut upload, PART).unwrap();
        assert!(staging(&gpu) - before <= PART as u64 + 2 * STAGING_BYTES as u64);
        frame.hand_over();
        frame.submit();
        frame.pixels::<f32>();
        parts += 1;
    }
    let found = found.unwrap();
    let bytes: u64 = found.params.iter().map(|plane| plane.bytes()).sum();
    assert!(
        parts > bytes / PART as u64 && parts < 2 * bytes / PART as u64,
        "{parts} parts"
    );
    for (a, b) in found.params.iter().zip(&whole.params) {
        let [a, b] = [a, b].map(|buffer| gpu.download(buffer, 0..buffer.len()).unwrap());
        assert!(
            a.iter()
                .flatten()
                .map(|x| x.to_bits())
                .eq(b.iter().flatten().map(|x| x.to_bits()))
        );
    }
    for (a, b) in found.splat_from_slot.iter().zip(&whole.splat_from_slot) {
        let [a, b] = [a, b].map(|buffer| gpu.download(buffer, 0..buffer.len()).unwrap());
        assert_eq!(a, b);
    }
    assert_eq!(host.messages(), Vec::<String>::new());
}

/// True for a barrier between commands of the guest, or from and to states of the host's images.
fn is_narrow(barrier: &Barrier) -> bool {
    let own = Stage::COMPUTE_SHADER | Stage::ALL_TRANSFER | Stage::DRAW_INDIRECT;
    let memory = Access::MEMORY_READ | Access::MEMORY_WRITE;
    let is_own = |(stage, access): (Stage, Access)| own.contains(stage) && !access.intersects(memory);
    let states = [CLEARED, COPYABLE].map(|state| (state.stage, state.access));
    let is_of_host = |scope| barrier.is_of_image && states.contains(&scope);
    is_for_host(barrier)
        || [barrier.from, barrier.to]
            .iter()
            .all(|&scope| is_own(scope) || is_of_host(scope))
}

/// True for the barrier before the host's reading of a copy.
fn is_for_host(barrier: &Barrier) -> bool {
    let (from, to) = ((Stage::COPY, Access::TRANSFER_WRITE), (Stage::HOST, Access::HOST_READ));
    (barrier.from, barrier.to) == (from, to)
}

/// Two pictures in one command buffer for each of `left_out`, the index of a barrier that is left out: barriers and
/// messages, up to the first without messages.
fn record_twice(left_out: &[Option<usize>]) -> Vec<(Vec<Barrier>, Vec<String>)> {
    let scene = scene();
    let host = Host::new();
    let frames = [0, 1].map(|_| Frame::new(&host, FORMAT, SIZE));
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let [left, right] = &frames;
    let mut recorded = Vec::new();
    for &left_out in left_out {
        left.begin();
        right.make_copyable();
        let mut commands = wrap(left);
        watch::keep_barriers(left_out);
        for (before, frame) in [(CLEARED, left), (COPYABLE, right)] {
            let (target, view) = (frame.target(before, COPYABLE), view(&scene));
            renderer
                .record(&mut commands, &model, &scene.camera, &view, &target)
                .unwrap();
        }
        let barriers = watch::barriers();
        left.submit();
        left.pixels::<f32>();
        right.resubmit();
        right.pixels::<f32>();
        let messages = host.messages();
        let is_last = messages.is_empty();
        recorded.push((barriers, messages));
        if is_last {
            break;
        }
    }
    recorded
}

/// Those of the barriers that may be left out without a message. Validation reports no more than ten messages of a kind
/// on a device, so that a barrier without one is the first of the next device.
fn spare_barriers(mut barriers: Vec<usize>) -> Vec<usize> {
    let mut spare = Vec::new();
    while !barriers.is_empty() {
        let left_out: Vec<_> = barriers.iter().map(|&index| Some(index)).collect();
        let recorded = record_twice(&left_out);
        match recorded.iter().filter(|(_, messages)| !messages.is_empty()).count() {
            0 => spare.push(barriers.remove(0)),
            reported => drop(barriers.drain(..reported)),
        }
    }
    spare
}

/// Barriers that seem spare to validation (1.3.239): it does not see writes through two views of one binding, as
/// `scan_apply` makes them where an invocation takes a chunk, before `sort_scatter` of each pass by depth and by tile.
fn unseen_barriers(caps: &Caps) -> usize {
    match scan_apply::Choice::prefer(caps).variant {
        scan_apply::Variant::Base => 4 + 1,
        scan_apply::Variant::Workgroup => 0,
    }
}

/// No barrier waits for, or holds up, the host's graphics or everything; and each one of a picture is needed: left out,
/// it is reported. Not so the one before the host's reading of a copy, which validation does not follow.
#[test]
fn barriers_are_narrow_and_none_is_spare() {
    let (barriers, messages) = record_twice(&[None]).remove(0);
    assert_eq!(messages, Vec::<String>::new());
    let wide: Vec<_> = barriers.iter().filter(|barrier| !is_narrow(barrier)).collect();
    assert!(wide.is_empty(), "{wide:?}");
    // A picture has one at its beginning, those between its commands, two of the image and one for the host.
    let each = barriers.len() / 2;
    assert!(each > 20 && barriers.iter().filter(|barrier| barrier.is_of_image).count() == 4);
    let spare = spare_barriers((each..barriers.len()).collect());
    let (last, unseen) = spare.split_last().unwrap();
    assert_eq!(
        (*last, unseen.len()),
        (barriers.len() - 1, unseen_barriers(crate::common::device::gpu().caps())),
        "{spare:?}: {barriers:?}"
    );
    assert!(is_for_host(&barriers[barriers.len() - 1]));
}

/// A model of several degrees needs kernels of its own. A frame refuses it until they are compiled, and compiles
/// nothing.
#[test]
fn kernels_are_compiled_outside_of_frames() {
    let scene = scene();
    let mut splats = many(200_000);
    for sh in splats.sh.chunks_mut(48).take(100_000) {
        sh[3..].fill(0.0);
    }
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let (plain, mixed) = (Model::upload(&gpu, &scene.splats), Model::upload(&gpu, &splats));
    let (plain, mixed) = (plain.unwrap(), mixed.unwrap());
    assert!(mixed.is_indexed());
    let mut options = RenderOptions::default();
    options.capacity.splats = mixed.splat_count;
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    renderer.reserve(&plain, &scene.camera, 1 << 16).unwrap();
    frame.begin();
    let target = frame.target(CLEARED, COPYABLE);
    let refused = renderer.record(&mut wrap(&frame), &mixed, &scene.camera, &view(&scene), &target);
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("call prepare first"), "{refused}");
    frame.submit();
    frame.pixels::<f32>();
    renderer.prepare(&mixed).unwrap();
    for model in [&mixed, &plain] {
        frame.begin();
        watch::calls();
        renderer
            .record(&mut wrap(&frame), model, &scene.camera, &view(&scene), &target)
            .unwrap();
        let calls = watch::calls();
        let compiled = |call: &&str| call.contains("Pipeline") || call.contains("ShaderModule");
        assert!(!calls.iter().any(compiled), "{calls:?}");
        frame.submit();
        frame.pixels::<f32>();
    }
    assert_same(&frame.pixels(), &expected(&scene, 1)[0]);
}

/// A guest that only records has no command pool, semaphore or query pool of its own.
#[test]
fn a_guest_that_only_records_makes_nothing_for_submissions() {
    let host = Host::new();
    let gpu = adopt(&host, false, true);
    watch::calls();
    let _renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let calls = watch::calls();
    let of_submissions = |call: &&str| ["Semaphore", "Command", "Query"].iter().any(|kind| call.contains(kind));
    assert!(calls.len() > 10 && !calls.iter().any(of_submissions), "{calls:?}");
}

/// Types of a renderer may move to and, as far as they are shared, be used by a host's threads.
#[test]
fn types_move_between_threads() {
    fn moves<T: Send>() {}
    fn is_shared<T: Send + Sync>() {}
    is_shared::<ashfall::Gpu>();
    is_shared::<Model>();
    moves::<Renderer>();
}

/// Times of the stages come with the statistics, frames later, without a wait.
#[test]
fn stages_of_a_hosts_pictures_are_timed() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let options = RenderOptions {
        frames_in_flight: 1,
        with_timings: true,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let mut found = Vec::new();
    for pictures in [1, 2, 1] {
        frame.begin();
        let mut commands = wrap(&frame);
        watch::calls();
        for at in 0..pictures {
            let before = if at == 0 { CLEARED } else { COPYABLE };
            let target = frame.target(before, COPYABLE);
            let drawn = renderer.record(&mut commands, &model, &scene.camera, &view(&scene), &target);
            drawn.unwrap();
        }
        let calls = watch::calls();
        assert!(!calls.iter().any(|call| call.contains("Wait")), "{calls:?}");
        found.push(renderer.host_timings().to_vec());
        frame.submit();
        frame.pixels::<f32>();
    }
    let labels = |stages: &[(&'static str, f64)]| stages.iter().map(|(label, _)| *label).collect::<Vec<_>>();
    let one = [
        "project",
        "sort_depth",
        "expand",
        "sort_tile",
        "rasterize",
        "present",
        "outputs",
    ];
    assert!(found[0].is_empty(), "{found:?}");
    assert_eq!(labels(&found[1]), one);
    assert_eq!(labels(&found[2]), [&one[..], &["between"]].concat());
    for stages in &found[1..] {
        assert!(stages.iter().all(|(_, ns)| *ns >= 0.0) && stages.iter().any(|(_, ns)| *ns > 0.0));
    }
    assert_eq!(host.messages(), Vec::<String>::new());
}
