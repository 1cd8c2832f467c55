//! Draws a volume into a part of the program's own texture, on its own wgpu device, beside its own triangles: `cargo
//! run --release -p brickyard --example embed -- OUT.png [SECONDS]`.
//!
//! The example flies around for the given seconds, prints frame times, and writes the last frame. After the first step
//! no call of the session waits for the GPU; the program itself waits for its frame before the last, like one with a
//! window.

mod gyroid;

use brickyard::render::{Gpu, Target, wgpu};
use brickyard::volume::Picture;
use brickyard::{Session, SessionOptions, picture_file};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

const SIZE_PX: (u32, u32) = (480, 320);
/// Area of the volume: x, y, width, height. The triangles have the rest.
const AREA_PX: [u32; 4] = [0, 0, 320, 320];
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Most frames in flight.
const MOST_BEHIND: usize = 2;

const TRIANGLES: &str = "
    @vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
        let place = array(vec2f(0.4, -0.8), vec2f(0.95, -0.8), vec2f(0.67, -0.1), vec2f(0.4, 0.8), vec2f(0.95, 0.8), vec2f(0.67, 0.1));
        return vec4f(place[i], 0.5, 1.0);
    }
    @fragment fn orange() -> @location(0) vec4f { return vec4f(1.0, 0.5, 0.0, 1.0); }";

/// The program's device, pipeline and texture.
struct Application {
    adapter: wgpu::Adapter,
    device: wgpu::Device,
    queue: wgpu::Queue,
    triangles: wgpu::RenderPipeline,
    texture: wgpu::Texture,
    /// Frames in flight.
    under_way: VecDeque<wgpu::SubmissionIndex>,
}

impl Application {
    fn new() -> Fallible<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
        // The session's needs; a program may add its own.
        let (device, queue) = pollster::block_on(adapter.request_device(&Gpu::required(&adapter)))?;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(TRIANGLES.into()),
        });
        let triangles = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("triangles"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("orange"),
                compilation_options: Default::default(),
                targets: &[Some(FORMAT.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("the window"),
            size: wgpu::Extent3d { width: SIZE_PX.0, height: SIZE_PX.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        Ok(Self { adapter, device, queue, triangles, texture, under_way: VecDeque::new() })
    }

    /// Draws the program's own part of a frame.
    fn draw_triangles(&self, view: &wgpu::TextureView, encoder: &mut wgpu::CommandEncoder) {
        let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store };
        let attachment = wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("triangles"),
            color_attachments: &[Some(attachment)],
            ..Default::default()
        });
        pass.set_pipeline(&self.triangles);
        pass.draw(0..6, 0..1);
    }

    /// Submits a frame, and waits for the one before the last.
    fn present(&mut self, encoder: wgpu::CommandEncoder) -> Fallible<()> {
        self.under_way.push_back(self.queue.submit([encoder.finish()]));
        if self.under_way.len() > MOST_BEHIND {
            let submission_index = self.under_way.pop_front();
            self.device.poll(wgpu::PollType::Wait { submission_index, timeout: None })?;
        }
        Ok(())
    }

    /// Reads back the texture.
    fn picture(&self) -> Fallible<Picture> {
        let (width, height) = SIZE_PX;
        let row_bytes = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row_bytes * height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(self.texture.as_image_copy(), to, self.texture.size());
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("the buffer is mapped"));
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        let bytes = buffer.get_mapped_range(..)?;
        let rows = bytes.chunks_exact(row_bytes as usize).map(|row| &row[..4 * width as usize]);
        let rgb = rows.flat_map(|row| row.chunks_exact(4)).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        Ok(Picture { width, height, rgb })
    }
}

fn main() -> Fallible<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (output, seconds) = match &arguments[..] {
        [output] => (output, 2.0),
        [output, seconds] => (output, seconds.parse()?),
        _ => return Err("expected OUT.png [SECONDS]".into()),
    };
    let mut application = Application::new()?;
    let view = application.texture.create_view(&Default::default());
    let target = Target { view: &view, format: FORMAT, area_px: Some(AREA_PX) };
    let gpu = Gpu::from_device(&application.adapter, application.device.clone(), application.queue.clone())?;
    let options = SessionOptions { live: true, ..SessionOptions::default() };
    let mut session = Session::on_gpu(vec![gyroid::volume()], options, gpu);
    let mut scene = gyroid::scene();
    let start = session.resolve(&scene, (AREA_PX[2], AREA_PX[3]))?.camera;
    let (mut times, mut waited) = (Vec::new(), Duration::ZERO);
    let begun = Instant::now();
    loop {
        let flown = begun.elapsed().as_secs_f64().min(seconds);
        // The camera returns to its start.
        scene.camera = Some(start.orbited(360.0 * flown / seconds));
        let frame_begun = Instant::now();
        let frame = session.step(&scene, (AREA_PX[2], AREA_PX[3]))?;
        let mut encoder = application.device.create_command_encoder(&Default::default());
        application.draw_triangles(&view, &mut encoder);
        let is_this = session.draw_to(&frame, &target, &mut encoder)?;
        let in_calls = frame_begun.elapsed();
        application.present(encoder)?;
        let longest_wait = session.take_longest_gpu_wait()?;
        if times.is_empty() {
            println!("the first frame makes slots, and waits for that {:.1} ms", ms(longest_wait));
        } else {
            waited = waited.max(longest_wait);
        }
        times.push([frame_begun.elapsed(), in_calls]);
        if flown >= seconds && is_this && frame.status.settled {
            break;
        }
    }
    for (what, which) in [("frames", 0), ("in the session's calls", 1)] {
        let mut sorted: Vec<Duration> = times.iter().skip(1).map(|times| times[which]).collect();
        sorted.sort();
        let (median, most) = (sorted[sorted.len() / 2], sorted[sorted.len() - 1]);
        println!("{} {what}: {:.1} ms, at most {:.1} ms", sorted.len(), ms(median), ms(most));
    }
    println!("waited for the GPU in these calls: at most {:.1} ms", ms(waited));
    picture_file::write_png(output.as_ref(), &application.picture()?, &[])?;
    Ok(())
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
