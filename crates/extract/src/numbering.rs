//! Vertex numbers across blocks, without a table of all vertices.
//!
//! A block sees its own vertices and, one layer further down each axis, those of its predecessors. Along each axis a vertex is in the layer of the
//! *previous* block, in the block's *last* layer, or *inner*. A predecessor sees the same vertices of a shared layer in the same order, so the rank
//! among those of one class names a vertex for both. A block's numbers are those before it, then its eight groups by axes in the last layer.

use crate::block_grid::BlockIndex;
use std::collections::BTreeMap;

/// Layers of a vertex along the three axes: three states each, as the digits of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Class(u8);

/// Number of classes.
pub(crate) const CLASSES: usize = 27;

const INNER: u8 = 1;

impl Class {
    /// The class of a place from `first` (the previous block's layer) to `last`; along `inner`, if given, there are no layers.
    pub(crate) fn of(place: [i64; 3], first: [i64; 3], last: [i64; 3], inner: Option<usize>) -> Self {
        let state = |a: usize| match place[a] {
            _ if inner == Some(a) => INNER,
            at if at == first[a] => 0,
            at if at == last[a] => 2,
            _ => INNER,
        };
        Self(state(0) + 3 * state(1) + 9 * state(2))
    }

    pub(crate) fn index(self) -> usize {
        self.0.into()
    }

    fn states(self) -> [u8; 3] {
        [self.0 % 3, self.0 / 3 % 3, self.0 / 9]
    }

    /// Whether the vertex belongs to the block itself.
    pub(crate) fn is_own(self) -> bool {
        self.states().iter().all(|state| *state > 0)
    }

    /// The vertex's group in its own block: bit `a` is set in the last layer of axis `a`.
    fn group(self) -> usize {
        let [x, y, z] = self.states().map(|state| usize::from(state != INNER));
        x | y << 1 | z << 2
    }

    /// The vertex's own block, seen from a block; `None` before the first one.
    fn owner(self, [z, y, x]: BlockIndex) -> Option<BlockIndex> {
        let back = self.states().map(|state| u32::from(state == 0));
        Some([z.checked_sub(back[2])?, y.checked_sub(back[1])?, x.checked_sub(back[0])?])
    }
}

/// Counts of vertices by class, for ranks.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ranks([u32; CLASSES]);

impl Ranks {
    /// The rank of the next vertex of a class.
    pub(crate) fn next(&mut self, class: Class) -> u32 {
        let count = &mut self.0[class.index()];
        *count += 1;
        *count - 1
    }

    /// Number of the block's own vertices by group.
    fn own(&self) -> [u32; 8] {
        let mut own = [0; 8];
        for (class, count) in (0..).map(Class).zip(self.0).filter(|(class, _)| class.is_own()) {
            own[class.group()] += count;
        }
        own
    }
}

/// The numbers given so far.
#[derive(Default)]
pub(crate) struct Numbers {
    next: u64,
    /// The first number of each group, of blocks that others can still refer to.
    starts: BTreeMap<BlockIndex, [u64; 8]>,
}

impl Numbers {
    /// Numbers a block's own vertices, after those of all its predecessors. Returns the first number of each class that the block sees.
    pub(crate) fn add(&mut self, block: BlockIndex, ranks: &Ranks) -> [u64; CLASSES] {
        // Blocks are numbered tile by tile, so those of the tile's layers and of the one before are still needed.
        let oldest = [(block[0] & !1).saturating_sub(1), 0, 0];
        if self.starts.first_key_value().is_some_and(|(first, _)| *first < oldest) {
            self.starts = self.starts.split_off(&oldest);
        }
        let mut starts = [0; 8];
        for (start, count) in starts.iter_mut().zip(ranks.own()) {
            *start = self.next;
            self.next += u64::from(count);
        }
        self.starts.insert(block, starts);
        std::array::from_fn(|class| {
            let class = Class(class as u8);
            let starts = class.owner(block).and_then(|owner| self.starts.get(&owner));
            starts.map_or(u64::MAX, |starts| starts[class.group()])
        })
    }

    /// Number of vertices so far.
    pub(crate) fn count(&self) -> u64 {
        self.next
    }
}
