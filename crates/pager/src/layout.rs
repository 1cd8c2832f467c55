//! How bricks lie in host memory: cores in the RAM cache, padded bricks in staging.
//!
//! A cached core is followed by a copy of its first and last columns along x, as many as the apron is wide. They are what
//! neighbours along x need, and in the core itself every one of them lies on a cache line of its own: reading them from
//! there touches the whole core again, from main memory, and costs more than all other sides of an apron together. The
//! copy is made while the decoded core is still in the processor's cache, and takes `2 * apron / edge` more memory.

use brickyard_volume::SlotEncoding;

/// Sizes of one source's bricks, all in slot codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Voxels along a core's edge.
    pub(crate) edge: usize,
    /// Voxels of apron on each side.
    pub(crate) apron: usize,
    /// Bytes of a code.
    pub(crate) code_bytes: usize,
}

impl Layout {
    pub(crate) fn new(edge: u32, apron: u32, encoding: &SlotEncoding) -> Self {
        Self { edge: edge as usize, apron: apron as usize, code_bytes: encoding.format.bytes() }
    }

    /// Codes along a padded brick's edge.
    pub(crate) fn padded(&self) -> usize {
        self.edge + 2 * self.apron
    }

    pub(crate) fn padded_bytes(&self) -> usize {
        self.padded().pow(3) * self.code_bytes
    }

    /// Bytes of a core's own codes, x fastest.
    pub(crate) fn core_bytes(&self) -> usize {
        self.edge.pow(3) * self.code_bytes
    }

    /// Bytes of one side's columns: `apron` codes for each row of the core.
    fn columns_bytes(&self) -> usize {
        self.edge.pow(2) * self.apron * self.code_bytes
    }

    /// Bytes of a cached core with its columns.
    pub(crate) fn cached_bytes(&self) -> usize {
        self.core_bytes() + 2 * self.columns_bytes()
    }

    /// Copies the first and last columns of a cached core to its end.
    pub(crate) fn copy_columns(&self, cached: &mut [u8]) {
        let (core, columns) = cached.split_at_mut(self.core_bytes());
        let (first, last) = columns.split_at_mut(self.columns_bytes());
        let (row, run) = (self.edge * self.code_bytes, self.apron * self.code_bytes);
        let sides = first.chunks_exact_mut(run).zip(last.chunks_exact_mut(run));
        for (row, (first, last)) in core.chunks_exact(row).zip(sides) {
            copy_run(&row[..run], first);
            copy_run(&row[row.len() - run..], last);
        }
    }

    /// The codes of a cached core that a padded brick takes from it, and how many each row has: the columns at its end for
    /// the neighbour before along x (`dx` 0), all of it for the brick itself or above, below and so on (1), the columns at
    /// its beginning for the neighbour after (2).
    pub(crate) fn part<'a>(&self, cached: &'a [u8], dx: usize) -> (&'a [u8], usize) {
        let (core, columns) = cached.split_at(self.core_bytes());
        let (first, last) = columns.split_at(self.columns_bytes());
        [(last, self.apron), (core, self.edge), (first, self.apron)][dx]
    }
}

/// A copy for which the usual lengths (an apron's width, a core's row) cost no call.
#[inline(always)]
pub(crate) fn copy_run(from: &[u8], to: &mut [u8]) {
    macro_rules! fixed {
        ($($length:literal),*) => {
            match from.len() {
                $($length => to[..$length].copy_from_slice(&from[..$length]),)*
                _ => to.copy_from_slice(from),
            }
        };
    }
    fixed!(1, 2, 4, 64, 128);
}
