//! Per-thread compression contexts and buffers: decoding does not allocate.

use crate::error::CodecError;
use std::cell::RefCell;
use std::io::Cursor;

/// Working memory for encoding and decoding: Zstandard contexts and two buffers, reused from brick to brick.
#[derive(Default)]
pub struct Scratch {
    compressor: zstd::bulk::Compressor<'static>,
    /// The compressor's current level.
    level: Option<i32>,
    decompressor: zstd::bulk::Decompressor<'static>,
    /// A buffer for shuffled voxels.
    pub(crate) bytes: Vec<u8>,
    /// A buffer for an encoded brick read from a file rather than mapped.
    pub(crate) encoded: Vec<u8>,
}

impl Scratch {
    /// Runs `work` with this thread's scratch.
    ///
    /// # Panics
    /// If `work` itself calls [`Scratch::with`].
    pub fn with<R>(work: impl FnOnce(&mut Scratch) -> R) -> R {
        thread_local!(static SCRATCH: RefCell<Scratch> = RefCell::default());
        SCRATCH.with_borrow_mut(work)
    }

    /// Compresses `data` to one Zstandard frame, content size included, and appends it to `out`.
    pub(crate) fn compress(&mut self, level: i32, data: &[u8], out: &mut Vec<u8>) {
        if self.level != Some(level) {
            self.compressor.set_compression_level(level).expect("levels are checked when a codec is parsed");
            self.level = Some(level);
        }
        let start = out.len();
        out.reserve(zstd::zstd_safe::compress_bound(data.len()));
        let mut end = Cursor::new(out);
        end.set_position(start as u64);
        self.compressor.compress_to_buffer(data, &mut end).expect("a frame fits its own bound");
    }

    /// Decompresses a Zstandard frame into `out`, which it must fill exactly.
    pub(crate) fn decompress(&mut self, data: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
        let expected = out.len() as u64;
        let found = self
            .decompressor
            .decompress_to_buffer(data, out)
            .map_err(|e| CodecError::Malformed(format!("zstd: {e}")))? as u64;
        if found == expected { Ok(()) } else { Err(CodecError::Length { expected, found }) }
    }
}
