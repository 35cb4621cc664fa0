//! A host's device: its features, versions, limits and caches.

use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::{Creation, Host};
use crate::embed::{SIZE, adopt, assert_near, assert_same, expected, scene, view, watch, wrap};
use ash::vk;
use ashfall::gpu::{Gpu, GpuOptions, HostDevice, HostFeatures};
use ashfall::render::{Model, RenderOptions, Renderer};

/// Adopts a device and returns the refusal.
fn refused(host: HostDevice) -> String {
    // SAFETY: the handles belong together; the guest is refused.
    unsafe { Gpu::adopt(host) }.unwrap_err().to_string()
}

/// Neither `maintenance4` nor `shaderStorageImageWriteWithoutFormat` is enabled there. Objects have names and
/// dispatches have labels, of which validation checks the calls.
#[test]
fn a_device_with_the_features_of_wgpu_draws_the_same_picture() {
    let scene = scene();
    let expected = expected(&scene, 1).remove(0);
    let host = Host::of(Creation::Wgpu);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    for format in [
        vk::Format::R32G32B32A32_SFLOAT,
        vk::Format::R8G8B8A8_UNORM,
        vk::Format::B8G8R8A8_UNORM,
    ] {
        let frame = Frame::new(&host, format, SIZE);
        frame.begin();
        let target = frame.target(CLEARED, COPYABLE);
        let drawn = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), &target);
        drawn.unwrap();
        frame.submit();
        match format {
            vk::Format::R32G32B32A32_SFLOAT => assert_same(&frame.pixels(), &expected),
            vk::Format::R8G8B8A8_UNORM => assert_near(&frame.pixels(), &expected),
            _ => {
                let swapped: Vec<[u8; 4]> = frame.pixels().iter().map(|&[b, g, r, a]| [r, g, b, a]).collect();
                assert_near(&swapped, &expected);
            }
        }
    }
}

#[test]
fn everything_that_a_device_lacks_is_named_at_once() {
    let host = Host::new();
    let bare = HostDevice {
        api_version: vk::API_VERSION_1_2,
        enabled: HostFeatures::default(),
        ..host.introduce(true, true)
    };
    assert_eq!(
        refused(bare),
        "unsupported: the host's device lacks Vulkan 1.3 (1.2 offered); the feature scalarBlockLayout; \
         the feature timelineSemaphore; the feature synchronization2"
    );
    let bare = HostDevice {
        enabled: HostFeatures {
            scalar_block_layout: true,
            ..HostFeatures::default()
        },
        ..host.introduce(true, true)
    };
    let refusal = refused(bare);
    let missing = "lacks the feature timelineSemaphore; the feature synchronization2";
    assert!(refusal.ends_with(missing), "{refusal}");
    let mut caps = adopt(&host, true, true).caps().clone();
    caps.api = (1, 2, 0);
    caps.max_storage_buffers = 8;
    caps.max_push_constants = 64;
    caps.max_shared = 1024;
    assert_eq!(
        ashfall::REQUIRED.unmet(&caps),
        [
            "Vulkan 1.3 (1.2 offered)",
            "14 storage buffers of a kernel (8 offered)",
            "128 bytes of push constants (64 offered)",
            "16384 bytes of shared memory (1024 offered)",
        ]
    );
}

/// The functions of Vulkan 1.3 do not exist there, and calling one aborts the process.
#[test]
fn an_instance_of_vulkan_1_2_is_refused() {
    let host = Host::of(Creation::Version12);
    let refusal = refused(host.introduce(true, true));
    assert!(refusal.contains("Vulkan 1.3 (1.2 offered)"), "{refusal}");
}

/// Under any limit, a scene is drawn or refused, and the ledger stays within the limit.
#[test]
fn a_guest_stays_within_its_memory_limit() {
    let scene = scene();
    let expected = expected(&scene, 1).remove(0);
    let host = Host::new();
    let (mut drawn, mut refusals) = (0, 0);
    for limit in (12..28).map(|bits| 1u64 << bits) {
        let frame = Frame::new(&host, vk::Format::R32G32B32A32_SFLOAT, SIZE);
        let lent = HostDevice {
            memory_limit: Some(limit),
            ..host.introduce(true, true)
        };
        // SAFETY: as in `adopt`.
        let gpu = unsafe { Gpu::adopt(lent) }.unwrap();
        frame.begin();
        let target = frame.target(CLEARED, COPYABLE);
        // A picture hands the image over, drawn or not.
        let mut is_over = false;
        let mut draw = || {
            let model = Model::upload(&gpu, &scene.splats)?;
            let mut renderer = Renderer::new(&gpu, RenderOptions::default())?;
            renderer.reserve(&model, &scene.camera, 1 << 12)?;
            is_over = true;
            let stats = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), &target)?;
            Ok((stats, renderer))
        };
        let result: ashfall::Result<_> = draw();
        assert!(gpu.memory_peak() <= limit, "{} of {limit} bytes", gpu.memory_peak());
        match result {
            Ok(_) => drawn += 1,
            Err(ashfall::Error::OutOfMemory { .. }) => refusals += 1,
            Err(error) => panic!("{error}"),
        }
        if !is_over {
            frame.hand_over();
        }
        frame.submit();
        let pixels = frame.pixels();
        if result.is_ok() {
            assert_same(&pixels, &expected);
        }
    }
    assert!(drawn > 2 && refusals > 2, "{drawn} drawn, {refusals} refused");
}

/// A budget, which other users of the device share, bounds a guest where the host has enabled its extension.
#[test]
fn a_guest_stays_within_the_drivers_budget() {
    let host = Host::of(Creation::Wgpu);
    let lend = |memory_budget| HostDevice {
        instance: watch::with_budget(&host.entry, &host.instance, 1 << 20),
        enabled: HostFeatures {
            memory_budget,
            ..host.enabled
        },
        ..host.introduce(true, true)
    };
    // SAFETY: as in `adopt`.
    let (bounded, free) = unsafe { (Gpu::adopt(lend(true)).unwrap(), Gpu::adopt(lend(false)).unwrap()) };
    bounded.buffer::<u8>("within", 1 << 20).unwrap();
    let refusal = bounded
        .buffer::<u8>("beyond", (1 << 20) + 4096)
        .unwrap_err()
        .to_string();
    assert!(refusal.contains("beyond"), "{refusal}");
    free.buffer::<u8>("beyond", (1 << 20) + 4096).unwrap();
}

#[test]
fn pipelines_are_made_with_the_hosts_cache() {
    let host = Host::new();
    let info = vk::PipelineCacheCreateInfo::default();
    // SAFETY: a plain cache.
    let cache = unsafe { host.device.create_pipeline_cache(&info, None) }.unwrap();
    let lent = HostDevice {
        pipeline_cache: cache,
        ..host.introduce(true, true)
    };
    // SAFETY: as in `adopt`.
    let gpu = unsafe { Gpu::adopt(lent) }.unwrap();
    watch::pipeline_caches();
    let renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let caches = watch::pipeline_caches();
    assert!(
        caches.len() > 10 && caches.iter().all(|&used| used == cache),
        "{caches:?}"
    );
    drop((renderer, gpu));
    // SAFETY: the guest is gone.
    unsafe { host.device.destroy_pipeline_cache(cache, None) };
}

/// A device gives out its compiled pipelines and takes them back; bytes that no driver wrote are ignored.
#[test]
fn an_own_devices_pipelines_outlive_it() {
    let _turn = crate::common::device::turn();
    let create = |pipeline_cache: Vec<u8>| {
        let options = GpuOptions {
            pipeline_cache,
            ..crate::common::device::options()
        };
        Gpu::create(&options).unwrap()
    };
    let gpu = create(Vec::new());
    let renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let bytes = gpu.pipeline_cache().unwrap();
    // The header of Vulkan's version one: its length, the version, vendor, device and an identifier.
    assert_eq!(bytes[..8], [32, 0, 0, 0, 1, 0, 0, 0]);
    drop((renderer, gpu));
    let gpu = create(bytes);
    Renderer::new(&gpu, RenderOptions::default()).unwrap();
    assert_eq!(gpu.validation_messages(), Vec::<String>::new());
}
