//! wgpu's device, made by wgpu with the features that the engine requires, and the messages of wgpu and its validation.

use crate::common::device::{Turn, turn};
use crate::embed::host::assert_lacks_two;
use ash::vk;
use ashfall::gpu::{Gpu, HostCommands, HostDevice, HostFeatures, REQUIRED};
use std::future::Future;
use std::pin::pin;
use std::rc::Rc;
use std::sync::{Mutex, Once};
use std::task::{Context, Poll, Waker};
use wgpu::hal::vulkan::CreateDeviceCallback;
use wgpu::hal::{OpenDevice, api::Vulkan};

static MESSAGES: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Beginning of the lines that list a message's objects.
const OBJECTS: &str = "\t";
/// The layer (1.3.239) does not know the language of wgpu's own shaders.
const OLD_LAYER: &str = "Invalid source language operand: 10";

/// Logger that keeps the warnings and errors of wgpu, among them those of the validation layer.
struct WgpuLog;

impl log::Log for WgpuLog {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= log::Level::Warn && metadata.target().starts_with("wgpu")
    }

    fn log(&self, record: &log::Record<'_>) {
        let text = record.args().to_string();
        if self.enabled(record.metadata()) && !text.starts_with(OBJECTS) && !text.contains(OLD_LAYER) {
            MESSAGES.lock().unwrap().push(text);
        }
    }

    fn flush(&self) {}
}

/// Messages since the last call.
fn messages() -> Vec<String> {
    std::mem::take(&mut MESSAGES.lock().unwrap())
}

pub(crate) struct WgpuHost {
    pub(crate) queue: wgpu::Queue,
    pub(crate) device: wgpu::Device,
    enabled: HostFeatures,
    adapter: wgpu::Adapter,
    _instance: wgpu::Instance,
    _turn: Rc<Turn>,
}

impl WgpuHost {
    pub(crate) fn new() -> WgpuHost {
        let turn = turn();
        static LOGGER: Once = Once::new();
        LOGGER.call_once(|| {
            log::set_logger(&WgpuLog).unwrap();
            log::set_max_level(log::LevelFilter::Warn);
        });
        messages();
        let mut desc = wgpu::InstanceDescriptor::new_without_display_handle();
        desc.backends = wgpu::Backends::VULKAN;
        // Without DEBUG wgpu hears no messages of the layer's.
        desc.flags = wgpu::InstanceFlags::VALIDATION | wgpu::InstanceFlags::DEBUG;
        let instance = wgpu::Instance::new(desc);
        let adapter = at_once(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).unwrap();
        let (opened, enabled) = open(&adapter);
        let desc = wgpu::DeviceDescriptor::default();
        // SAFETY: the device is of this adapter, with the default features.
        let (device, queue) = unsafe { adapter.create_device_from_hal(opened, &desc) }.unwrap();
        WgpuHost {
            queue,
            device,
            enabled,
            adapter,
            _instance: instance,
            _turn: turn,
        }
    }

    /// The engine as a guest without a queue: wgpu's is locked by wgpu alone.
    pub(crate) fn adopt(&self) -> Gpu {
        // SAFETY: the handles are only used while the host lives.
        let (adapter, device) = unsafe { (self.adapter.as_hal::<Vulkan>(), self.device.as_hal::<Vulkan>()) };
        let (adapter, device) = (adapter.unwrap(), device.unwrap());
        let instance = adapter.shared_instance();
        let host = HostDevice {
            instance: instance.raw_instance().clone(),
            physical_device: adapter.raw_physical_device(),
            device: device.raw_device().clone(),
            queue_family: device.queue_family_index(),
            queue: None,
            api_version: instance
                .instance_api_version()
                .min(adapter.physical_device_capabilities().properties().api_version),
            enabled: self.enabled,
            allocator: None,
            memory_limit: None,
            pipeline_cache: vk::PipelineCache::null(),
        };
        // SAFETY: REQUIRED is enabled, and every test drops the guest before its host.
        unsafe { Gpu::adopt(host) }.unwrap()
    }

    /// Commands that a guest records, and nobody else: an encoder of wgpu takes wgpu's calls or Vulkan's.
    pub(crate) fn guest_commands(&self, record: impl FnOnce(&mut HostCommands)) -> wgpu::CommandBuffer {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let on_raw = |encoder: Option<&mut wgpu::hal::vulkan::CommandEncoder>| {
            // SAFETY: the buffer is recording, and is submitted once, in order, to the only queue.
            record(&mut unsafe { HostCommands::wrap(encoder.unwrap().raw_handle()) });
        };
        // SAFETY: the handle is not destroyed, the recording not ended.
        unsafe { encoder.as_hal_mut::<Vulkan, _, _>(on_raw) };
        encoder.finish()
    }

    /// Destroys device and instance; returns all messages. Those of another test come after this one's turn.
    pub(crate) fn close(self) -> Vec<String> {
        let _turn = self._turn.clone();
        drop(self);
        messages()
    }

    /// Waits for a submission, or for all.
    pub(crate) fn wait(&self, submission_index: Option<wgpu::SubmissionIndex>) {
        let wait = wgpu::PollType::Wait {
            submission_index,
            timeout: None,
        };
        self.device.poll(wait).unwrap();
    }
}

/// Result of a future that never waits, as those of wgpu on Vulkan.
fn at_once<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("wgpu waits for something"),
    }
}

/// The device as wgpu makes it by default, and two structures more.
fn open(adapter: &wgpu::Adapter) -> (OpenDevice<Vulkan>, HostFeatures) {
    // SAFETY: the physical device is only read.
    let hal = unsafe { adapter.as_hal::<Vulkan>() }.unwrap();
    let (mut scalar, mut synchronization) = Default::default();
    let enabled = {
        // The chain that wgpu is going to make.
        let extensions = hal.required_device_extensions(wgpu::Features::empty());
        let mut features = hal.physical_device_features(&extensions, wgpu::Features::empty());
        let info = features.add_to_device_create(vk::DeviceCreateInfo::default());
        let mut chain = vk::PhysicalDeviceFeatures2 {
            p_next: info.p_next.cast_mut(),
            ..Default::default()
        };
        // SAFETY: the structures of the chain are alive.
        let missing = unsafe { REQUIRED.enable(&mut chain) };
        assert_lacks_two(&missing);
        let mut chain = chain
            .push_next::<vk::PhysicalDeviceScalarBlockLayoutFeatures<'_>>(&mut scalar)
            .push_next::<vk::PhysicalDeviceSynchronization2Features<'_>>(&mut synchronization);
        // SAFETY: as above.
        let (missing, enabled) = unsafe { (REQUIRED.enable(&mut chain), HostFeatures::of_chain(&chain)) };
        assert_eq!(missing, []);
        enabled
    };
    let mut scalar = vk::PhysicalDeviceScalarBlockLayoutFeatures::default().scalar_block_layout(true);
    let mut synchronization = vk::PhysicalDeviceSynchronization2Features::default().synchronization2(true);
    let (scalar, synchronization) = (&mut scalar, &mut synchronization);
    let add: Box<CreateDeviceCallback<'_>> = Box::new(move |args| {
        let info = std::mem::take(args.create_info);
        *args.create_info = info.push_next(scalar).push_next(synchronization);
    });
    let (features, limits) = (wgpu::Features::empty(), wgpu::Limits::default());
    // SAFETY: the features are supported, and none is removed.
    let opened = unsafe { hal.open_with_callback(features, &limits, &Default::default(), Some(add)) };
    (opened.unwrap(), enabled)
}
