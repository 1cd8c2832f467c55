//! Why a brick is wanted: what decides in which order bricks are read, and which of them hold slots.

/// Why a brick is wanted. Bricks of earlier tiers are read first, and evict those of later tiers that are fetched ahead. (Next time steps
/// would come after `Visible`.)
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Tier {
    Cover,
    Visible,
    Predicted,
    Ring,
}

impl Tier {
    /// How many of `slots` slots the bricks of this tier may hold.
    pub(crate) fn slots(self, slots: usize) -> usize {
        match self {
            Self::Cover | Self::Visible => slots,
            Self::Predicted => slots / 8,
            Self::Ring => slots / 16,
        }
    }

    /// Whether bricks of this tier are fetched ahead: the view itself does not need them.
    pub(crate) fn is_ahead(self) -> bool {
        self > Self::Visible
    }
}
