//! How many samples are taken at a time.

/// Samples in a packet.
pub(crate) const LANES: usize = 8;

/// Packets in a chunk.
pub(crate) const PACKETS: usize = 4;

/// Samples in a chunk.
pub(crate) const CHUNK: usize = LANES * PACKETS;

/// One number for each sample of a packet.
pub(crate) type Packet = [f32; LANES];
