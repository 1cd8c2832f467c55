//! Tiers of bricks, which decide the order of reading and the use of slots.

/// Reason to want a brick. Bricks of earlier tiers are read first, and evict prefetched bricks of later tiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Tier {
    Cover,
    Visible,
    /// A brick for the coming view of a later time step.
    Coming,
    Predicted,
    Ring,
}

impl Tier {
    /// Most of `slots` slots for bricks of this tier. Coming bricks may hold all that the view itself leaves.
    pub(crate) fn slots(self, slots: usize) -> usize {
        match self {
            Self::Cover | Self::Visible | Self::Coming => slots,
            Self::Predicted => slots / 8,
            Self::Ring => slots / 16,
        }
    }

    /// Most of `staged` padded bricks in flight for this tier and later ones.
    pub(crate) fn staged(self, staged: usize) -> usize {
        match self {
            Self::Cover | Self::Visible => staged,
            // Some are reserved for the view itself, so a new plan's first brick does not wait after a flip or a turn.
            Self::Coming => staged - staged / 8,
            Self::Predicted | Self::Ring => staged.div_ceil(4),
        }
    }

    pub(crate) fn is_ahead(self) -> bool {
        self > Self::Visible
    }
}
