//! A buffer on its way to the CPU: mapped after the submissions before it, read once, and reused.

use crate::{Gpu, GpuError};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use wgpu::{BufferAsyncError, MapMode};

/// A buffer on its way to being mapped.
#[derive(Debug)]
pub(crate) struct Mapping {
    buffer: wgpu::Buffer,
    mapped: Receiver<Result<(), BufferAsyncError>>,
    is_there: bool,
}

impl Mapping {
    /// Begins to map a buffer written by the last submission.
    pub(crate) fn begin(buffer: wgpu::Buffer) -> Self {
        let (send, mapped) = channel();
        buffer.map_async(MapMode::Read, .., move |result| {
            // The receiver is gone if nobody waits for the answer any more.
            let _ = send.send(result);
        });
        Self { buffer, mapped, is_there: false }
    }

    /// Whether the buffer is mapped. Does not poll the device.
    ///
    /// # Errors
    /// If the device is lost, and the buffer will never be mapped.
    pub(crate) fn is_there(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        if !self.is_there {
            match self.mapped.try_recv() {
                Ok(Ok(())) => self.is_there = true,
                Ok(Err(error)) => return Err(gpu.lost(&error)),
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => return Err(gpu.lost(&"a requested buffer never arrived")),
            }
        }
        Ok(self.is_there)
    }

    /// Reads a mapped buffer, and returns the result and the unmapped buffer.
    ///
    /// # Errors
    /// If the buffer is not mapped yet, or the device is lost.
    pub(crate) fn read<T>(mut self, gpu: &Gpu, read: impl FnOnce(&[u8]) -> T) -> Result<(T, wgpu::Buffer), GpuError> {
        if !self.is_there(gpu)? {
            return Err(GpuError::Refused("a buffer is not mapped after the work before it".into()));
        }
        let bytes = self.buffer.get_mapped_range(..).map_err(|error| gpu.lost(&error))?;
        let found = read(&bytes);
        drop(bytes);
        self.buffer.unmap();
        Ok((found, self.buffer))
    }
}
