//! What the GPU says of pictures: how bricks were entered, how many layers of meshes there are, and how long it took. Nobody waits for it: a
//! few answers may be under way, each on a sheet (a buffer) of its own, and each says which picture it is about.

use crate::buffers::buffer;
use crate::error::GpuError;
use crate::gpu::Gpu;
use crate::mapping::Mapping;
use crate::memory::{ANSWERS, COUNTS_BYTES, TIMESTAMP_BYTES};
use std::collections::VecDeque;
use wgpu::BufferUsages;

/// An answer about a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The picture's number, as its caller gave it.
    pub picture: u64,
    /// Layer by layer, of all that the renderer was made for, for each entry of the list drawn, in its order, the greatest transmittance
    /// with which a ray entered it: see [`GpuRenderer::visibility`](crate::GpuRenderer::visibility). `None` where that is not known.
    pub visibility: Option<Vec<Vec<f32>>>,
    /// Milliseconds that the picture took on the GPU, where it has timestamps.
    pub gpu_ms: Option<f64>,
}

/// What is asked about a picture.
#[derive(Clone, Debug)]
pub(crate) struct Question {
    /// The picture's number; none where somebody waits for it.
    pub(crate) picture: u64,
    /// The layers drawn, and how many cells of each are marked; none where bricks are not.
    pub(crate) marked: Option<Vec<(usize, usize)>>,
    /// Layers of meshes that were looked for without waiting for what was found.
    pub(crate) peeled: u32,
}

/// Where a sheet's counts and marks lie, behind two timestamps.
pub(crate) const COUNTS_AT: u64 = TIMESTAMP_BYTES;
pub(crate) const MARKS_AT: u64 = COUNTS_AT + COUNTS_BYTES;

/// What has been read of a sheet.
pub(crate) struct Said {
    pub(crate) question: Question,
    pub(crate) ticks: [u64; 2],
    /// Fragments of each layer of meshes that was looked for.
    pub(crate) counts: Vec<u64>,
    /// Steps with which cells were entered.
    pub(crate) marks: Vec<u32>,
}

/// Sheets, free and under way.
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

    /// A sheet for a picture; none while all are under way.
    pub(crate) fn take_sheet(&mut self) -> Option<wgpu::Buffer> {
        self.free.pop()
    }

    /// Whether all are under way.
    pub(crate) fn is_full(&self) -> bool {
        self.free.is_empty()
    }

    /// The last submission has written a sheet.
    pub(crate) fn ask(&mut self, question: Question, sheet: wgpu::Buffer) {
        self.under_way.push_back((question, Mapping::begin(sheet)));
    }

    /// What has been said, the oldest first, as far as the device has been looked at.
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
