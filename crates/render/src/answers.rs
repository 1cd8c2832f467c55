//! Feedback from the GPU about pictures: visibility of bricks, layers of meshes, and time taken. Nobody waits for it: a
//! few answers may be in flight, each on its own sheet (a buffer), labelled with its picture.

use crate::buffers::TIMESTAMP_BYTES;
use crate::buffers::buffer;
use crate::mapping::Mapping;
use crate::memory::{ANSWERS, COUNTS_BYTES};
use crate::{Gpu, GpuError};
use std::collections::VecDeque;
use wgpu::BufferUsages;

/// The GPU's feedback about a shown picture, some frames later.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The picture's number, as given to [`GpuRenderer::show`](crate::GpuRenderer::show).
    pub picture: u64,
    /// For each of the renderer's layers and draw list entries, the greatest transmittance with which a ray entered the
    /// cell: see [`GpuRenderer::visibility`](crate::GpuRenderer::visibility). `None` if unknown.
    pub visibility: Option<Vec<Vec<f32>>>,
    /// GPU time of the picture, milliseconds; `None` if the device has no timestamps.
    pub gpu_ms: Option<f64>,
}

/// A request for feedback about a picture.
#[derive(Clone, Debug)]
pub(crate) struct Question {
    /// `u64::MAX` for a picture whose caller waits.
    pub(crate) picture: u64,
    /// The drawn layers and the number of marked cells of each; `None` if cells are not marked.
    pub(crate) marked: Option<Vec<(usize, usize)>>,
    /// Mesh layers peeled without waiting for their counts.
    pub(crate) peeled: u32,
    /// Whether the picture was drawn in one go, which makes its time meaningful.
    pub(crate) is_timed: bool,
}

/// Start of the mesh layers' counts on a sheet, after two timestamps, bytes.
pub(crate) const COUNTS_AT: u64 = TIMESTAMP_BYTES;
/// Start of the cells' marks on a sheet, after the counts, bytes.
pub(crate) const MARKS_AT: u64 = COUNTS_AT + COUNTS_BYTES;

/// The contents of a sheet: the answer to a question.
pub(crate) struct Said {
    pub(crate) question: Question,
    pub(crate) ticks: [u64; 2],
    /// Fragments of each peeled mesh layer, nearest first.
    pub(crate) counts: Vec<u64>,
    /// For each marked cell the greatest transmittance of entering rays, in steps of 1/255.
    pub(crate) marks: Vec<u32>,
}

/// Sheets for the GPU's answers, free and in flight.
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

    /// Takes a free sheet; `None` while all are in flight.
    pub(crate) fn take_sheet(&mut self) -> Option<wgpu::Buffer> {
        self.free.pop()
    }

    pub(crate) fn is_full(&self) -> bool {
        self.free.is_empty()
    }

    /// Starts bringing an answer to the CPU. The last submission must be the one that writes the sheet.
    pub(crate) fn ask(&mut self, question: Question, sheet: wgpu::Buffer) {
        self.under_way.push_back((question, Mapping::begin(sheet)));
    }

    /// Takes the answers received so far, oldest first. Does not poll the device.
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
