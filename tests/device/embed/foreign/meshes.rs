//! Meshes that wgpu draws, and the textures that the guest shares.

use crate::embed::SIZE;
use crate::embed::foreign::device::WgpuHost;
use ash::vk;
use ashfall::gpu::{HostImage, HostImageDesc, ImageState};
use wgpu::TextureUsages as Usage;
use wgpu::hal::api::Vulkan;

/// Near plane of the projection, which is reversed and infinite: stored depths are `NEAR / z`.
pub(crate) const NEAR: f32 = 0.05;

/// Layout of wgpu's `STORAGE_WRITE_ONLY`.
pub(crate) const SHARED: vk::ImageLayout = vk::ImageLayout::GENERAL;

const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
const EXTENT: wgpu::Extent3d = wgpu::Extent3d {
    width: SIZE[0],
    height: SIZE[1],
    depth_or_array_layers: 1,
};

/// A long triangle from front to back, and a small one before everything. `%` are depths.
const SHADER: &str = "
struct Corner { @builtin(position) clip: vec4f, @location(0) color: vec3f }
@vertex fn corner(@builtin(vertex_index) index: u32) -> Corner {
    var corners = array(vec3f(-1.3, -1.2, %0), vec3f(1.3, -1.1, %1), vec3f(0.1, 0.7, %1),
        vec3f(0.3, 0.1, %2), vec3f(0.8, 0.2, %2), vec3f(0.5, 0.9, %2));
    var colors = array(vec3f(0.1, 0.8, 0.2), vec3f(0.3, 0.3, 0.9), vec3f(0.9, 0.7, 0.1));
    let at = corners[index];
    return Corner(vec4f(at.xy * at.z, %n, at.z), colors[index % 3]);
}
@fragment fn shade(corner: Corner) -> @location(0) vec4f { return vec4f(corner.color, 1.0); }
";

/// Pipeline of meshes among splats of these depths.
pub(crate) fn pipeline(host: &WgpuHost, (nearest, farthest): (f64, f64)) -> wgpu::RenderPipeline {
    let mut text = SHADER.replace("%n", &format!("{NEAR:?}"));
    for (name, depth) in [("%0", nearest), ("%1", farthest), ("%2", 0.9 * nearest)] {
        text = text.replace(name, &format!("{depth:?}"));
    }
    let module = host.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(text.into()),
    });
    let desc = wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            targets: &[Some(COLOR.into())],
        }),
        multiview_mask: None,
        cache: None,
    };
    host.device.create_render_pipeline(&desc)
}

/// State of a texture for the shaders of wgpu, and of its guest.
fn shared(layout: vk::ImageLayout, access: vk::AccessFlags2) -> ImageState {
    use vk::PipelineStageFlags2 as Stage;
    let stage = Stage::VERTEX_SHADER | Stage::FRAGMENT_SHADER | Stage::COMPUTE_SHADER;
    ImageState { layout, stage, access }
}

/// Textures of one frame in flight.
pub(crate) struct MeshTarget {
    pub(crate) color: wgpu::Texture,
    color_view: wgpu::TextureView,
    depth: wgpu::Texture,
    depth_view: wgpu::TextureView,
}

impl MeshTarget {
    pub(crate) fn new(host: &WgpuHost) -> MeshTarget {
        let texture = |format, usage| {
            host.device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: EXTENT,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: Usage::RENDER_ATTACHMENT | Usage::TEXTURE_BINDING | Usage::COPY_SRC | usage,
                view_formats: &[],
            })
        };
        let (color, depth) = (texture(COLOR, Usage::STORAGE_BINDING), texture(DEPTH, Usage::empty()));
        MeshTarget {
            color_view: color.create_view(&Default::default()),
            depth_view: depth.create_view(&Default::default()),
            color,
            depth,
        }
    }

    /// Clears both textures and draws meshes. Nothing is drawn without a pipeline.
    pub(crate) fn draw(&self, encoder: &mut wgpu::CommandEncoder, pipeline: Option<&wgpu::RenderPipeline>) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.color_view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::WHITE),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth_view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        if let Some(pipeline) = pipeline {
            pass.set_pipeline(pipeline);
            pass.draw(0..6, 0..1);
        }
    }

    /// Brings the textures into the states in which the guest finds and leaves them, so that wgpu's tracking is right.
    pub(crate) fn hand_over(&self, encoder: &mut wgpu::CommandEncoder) {
        let states = [
            (&self.color, wgpu::TextureUses::STORAGE_WRITE_ONLY),
            (&self.depth, wgpu::TextureUses::RESOURCE),
        ];
        let transitions = states.map(|(texture, state)| wgpu::TextureTransition {
            texture,
            selector: None,
            state,
        });
        encoder.transition_resources([].into_iter(), transitions.into_iter());
    }

    /// Colour, in a layout, and depth as the engine's images; not within `guest_commands`, which locks wgpu's textures.
    pub(crate) fn images(&self, color_layout: vk::ImageLayout) -> [HostImage; 2] {
        use vk::{AccessFlags2 as Access, Format, ImageLayout as Layout};
        let color = shared(color_layout, Access::SHADER_WRITE);
        let depth = shared(Layout::DEPTH_STENCIL_READ_ONLY_OPTIMAL, Access::SHADER_READ);
        [
            (&self.color, &self.color_view, Format::R32G32B32A32_SFLOAT, color),
            (&self.depth, &self.depth_view, Format::D32_SFLOAT, depth),
        ]
        .map(|(texture, view, format, state)| {
            // SAFETY: the handle is used while the texture lives.
            let image = unsafe { texture.as_hal::<Vulkan>().unwrap().raw_handle() };
            // SAFETY: as above.
            let view = unsafe { view.as_hal::<Vulkan>().unwrap().raw_handle() };
            let desc = HostImageDesc {
                image,
                view,
                format,
                extent: SIZE,
                before: state,
                after: state,
            };
            // SAFETY: the textures outlive the frame, and `hand_over` brings them into these states.
            unsafe { HostImage::wrap(desc) }
        })
    }

    /// Copies of colour and depth.
    pub(crate) fn copy(&self, host: &WgpuHost, encoder: &mut wgpu::CommandEncoder) -> [TextureCopy; 2] {
        [(&self.color, 16), (&self.depth, 4)].map(|(texture, pixel_bytes)| {
            let row = (SIZE[0] * pixel_bytes).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
            let buffer = host.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: u64::from(row * SIZE[1]),
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            let to = wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            };
            encoder.copy_texture_to_buffer(texture.as_image_copy(), to, EXTENT);
            TextureCopy {
                buffer,
                row: row as usize,
            }
        })
    }
}

/// Copy of a texture in rows with gaps.
pub(crate) struct TextureCopy {
    buffer: wgpu::Buffer,
    row: usize,
}

impl TextureCopy {
    /// The pixels, once the copy has been submitted.
    pub(crate) fn pixels<T: bytemuck::Pod>(&self, host: &WgpuHost) -> Vec<T> {
        self.buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
        host.wait(None);
        let bytes = self.buffer.get_mapped_range(..).unwrap();
        let used = SIZE[0] as usize * size_of::<T>();
        bytes
            .chunks(self.row)
            .flat_map(|row| bytemuck::pod_collect_to_vec::<u8, T>(&row[..used]))
            .collect()
    }
}
