//! What the GPU says of pictures: how bricks were entered, how many layers of meshes there are, and how long it took. Nobody waits for it: a
//! few answers may be under way, each on a sheet (a buffer) of its own, and each says which picture it is about.

use crate::buffers::buffer;
use crate::error::GpuError;
use crate::gpu::Gpu;
use crate::mapping::Mapping;
use crate::memory::{ANSWERS, COUNTS_BYTES, TIMESTAMP_BYTES};
use std::collections::VecDeque;
use wgpu::BufferUsages;

/// What the GPU says about a picture that was shown, some frames later.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The picture's number, as the caller of [`GpuRenderer::show`](crate::GpuRenderer::show) gave it.
    pub picture: u64,
    /// For each layer that the renderer was made for, and each entry of its draw list, the greatest transmittance with
    /// which a ray entered the entry's cell: see [`GpuRenderer::visibility`](crate::GpuRenderer::visibility). `None` if
    /// that is not known.
    pub visibility: Option<Vec<Vec<f32>>>,
    /// Milliseconds that the picture took on the GPU; `None` if the device has no timestamps.
    pub gpu_ms: Option<f64>,
}

/// What is asked about a picture.
#[derive(Clone, Debug)]
pub(crate) struct Question {
    /// The picture's number; `u64::MAX` for a picture that is waited for.
    pub(crate) picture: u64,
    /// The layers drawn, and how many cells of each are marked; `None` if cells are not marked.
    pub(crate) marked: Option<Vec<(usize, usize)>>,
    /// Number of mesh layers that were peeled without waiting for what each had.
    pub(crate) peeled: u32,
    /// Whether it was drawn at a time.
    pub(crate) is_timed: bool,
}

/// Byte at which the counts of mesh layers begin on a sheet, after two timestamps.
pub(crate) const COUNTS_AT: u64 = TIMESTAMP_BYTES;
/// Byte at which the marks of cells begin on a sheet, after the counts.
pub(crate) const MARKS_AT: u64 = COUNTS_AT + COUNTS_BYTES;

/// What has been read from a sheet: the answer to a question.
pub(crate) struct Said {
    pub(crate) question: Question,
    pub(crate) ticks: [u64; 2],
    /// Fragments of each mesh layer that was peeled, from the nearest on.
    pub(crate) counts: Vec<u64>,
    /// For each marked cell the greatest transmittance with which a ray entered it, in steps of 1/255.
    pub(crate) marks: Vec<u32>,
}

/// The sheets on which answers come back: those that are free, and those under way.
#[derive(Debug)]
pub(crate) struct Answers {
    free: Vec<wgpu::Buffer>,
    under_way: VecDeque<(Question, Mapping)>,
}

impl Answers {
    pub(crate) fn new(gpu: &Gpu, marks_bytes: u64) -> Result<Self, GpuError> {
        let bytes = MARKS_AT + marks_bytes;
        let usage = BufferUsages::COPY_DST | BufferUsages::MAP_READ;
        gpu.allocate("answers", ANSWERS * bytes, |device| {
            let sheet = |_| buffer(device, "answer", bytes, usage);
            Self { free: (0..ANSWERS).map(sheet).collect(), under_way: VecDeque::new() }
        })
    }

    /// Takes a free sheet for a picture; `None` while all sheets are under way.
    pub(crate) fn take_sheet(&mut self) -> Option<wgpu::Buffer> {
        self.free.pop()
    }

    /// Whether all sheets are under way.
    pub(crate) fn is_full(&self) -> bool {
        self.free.is_empty()
    }

    /// Begins to bring the answer to a question to the CPU. The last submission must be the one that writes the sheet.
    pub(crate) fn ask(&mut self, question: Question, sheet: wgpu::Buffer) {
        self.under_way.push_back((question, Mapping::begin(sheet)));
    }

    /// Takes the answers that have come, the oldest first. Does not poll the device.
    ///
    /// # Errors
    /// If the device is lost.
    pub(crate) fn take_said(&mut self, gpu: &Gpu) -> Result<Vec<Said>, GpuError> {
        let mut said = Vec::new();
        while let Some((_, mapping)) = self.under_way.front_mut()
            && mapping.is_there(gpu)?
            && let Some((question, mapping)) = self.under_way.pop_front()
        {
            let cells = question.marked.iter().flatten().map(|(_, cells)| cells).sum::<usize>();
            let (found, buffer) = mapping.read(gpu, |bytes| {
                let (head, marks) = bytes.split_at(MARKS_AT as usize);
                let numbers: Vec<u64> = bytemuck::pod_collect_to_vec(head);
                let counts = numbers[2..2 + question.peeled as usize].to_vec();
                let marks = bytemuck::pod_collect_to_vec(&marks[..cells * size_of::<u32>()]);
                ([numbers[0], numbers[1]], counts, marks)
            })?;
            self.free.push(buffer);
            let (ticks, counts, marks) = found;
            said.push(Said { question, ticks, counts, marks });
        }
        Ok(said)
    }
}
