//! A stream through gzip, by all threads: pieces are compressed apart and joined into one member, as pigz does, since some readers stop at the first
//! one. Each piece ends at a whole byte (Deflate's sync flush). A thread holds its piece, compressed, and Deflate's state.

use flate2::{Compress, Compression, Crc, FlushCompress, Status};
use rayon::prelude::*;
use std::io::{self, Write};

/// Bytes of a piece: its start, without the window of the one before, costs less than a hundredth.
pub(crate) const PIECE_BYTES: usize = 1 << 20;

/// Memory of a thread: a piece of noise, with the flushes' bytes, and the state of Deflate.
pub(crate) const THREAD_BYTES: u64 = (PIECE_BYTES as u64) + (1 << 19);

/// A head without name or time: the same voxels give the same file.
const HEAD: [u8; 10] = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255];

/// The last block, of nothing.
const END: [u8; 2] = [3, 0];

/// A compressed piece, and the checksum of its bytes.
struct Piece {
    bytes: Vec<u8>,
    crc: Crc,
}

/// A writer of one member.
pub(crate) struct Gzip<W> {
    out: W,
    crc: Crc,
    /// The length, modulo 2^32, as the format counts.
    length: u32,
}

impl<W: Write> Gzip<W> {
    pub(crate) fn new(mut out: W) -> io::Result<Self> {
        out.write_all(&HEAD)?;
        Ok(Self { out, crc: Crc::new(), length: 0 })
    }

    /// Compresses parts of the stream, in order, on the current threads, and writes them.
    pub(crate) fn write(&mut self, parts: &[&[u8]]) -> io::Result<()> {
        let pieces: Vec<&[u8]> = parts.iter().flat_map(|part| part.chunks(PIECE_BYTES)).collect();
        // Not all at once: memory is counted by threads.
        for wave in pieces.chunks(rayon::current_num_threads().max(1)) {
            let packed: Vec<Piece> = wave.par_iter().map(|piece| packed(piece)).collect::<io::Result<_>>()?;
            for (piece, plain) in packed.iter().zip(wave) {
                self.out.write_all(&piece.bytes)?;
                self.crc.combine(&piece.crc);
                self.length = self.length.wrapping_add(plain.len() as u32);
            }
        }
        Ok(())
    }

    /// Ends the member.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        self.out.write_all(&END)?;
        self.out.write_all(&self.crc.sum().to_le_bytes())?;
        self.out.write_all(&self.length.to_le_bytes())?;
        self.out.flush()
    }
}

fn packed(piece: &[u8]) -> io::Result<Piece> {
    let mut crc = Crc::new();
    crc.update(piece);
    // The fastest level, as nibabel writes: others take several times as long for a few hundredths.
    let mut deflate = Compress::new(Compression::fast(), false);
    let mut bytes = Vec::with_capacity(piece.len() + piece.len() / 1000 + 64);
    loop {
        let read = deflate.total_in() as usize;
        let status = deflate.compress_vec(&piece[read..], &mut bytes, FlushCompress::Sync)?;
        let is_done = deflate.total_in() as usize == piece.len() && bytes.len() < bytes.capacity();
        if is_done {
            return Ok(Piece { bytes, crc });
        }
        if status == Status::StreamEnd {
            return Err(io::Error::other("Deflate ended before its bytes"));
        }
        bytes.reserve(piece.len() / 8 + 64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    /// A decoder of one member alone reads all of it, and its checksum.
    #[test]
    fn pieces_join_into_one_member() {
        let noise: Vec<u8> =
            (0..5 * PIECE_BYTES / 2).map(|i| ((i as u32).wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        let smooth: Vec<u8> = (0..3 * PIECE_BYTES).map(|i| (i / 4000) as u8).collect();
        for parts in [vec![], vec![&noise[..]], vec![&smooth[..], &[], &noise[..7], &noise[9..], &smooth[..1]]] {
            let mut out = Vec::new();
            let mut gzip = Gzip::new(&mut out).unwrap();
            gzip.write(&parts).unwrap();
            gzip.finish().unwrap();
            let mut found = Vec::new();
            let mut decoder = flate2::bufread::GzDecoder::new(&out[..]);
            decoder.read_to_end(&mut found).unwrap();
            assert!(found == parts.concat());
            assert!(decoder.into_inner().is_empty(), "nothing follows the member");
        }
    }
}
