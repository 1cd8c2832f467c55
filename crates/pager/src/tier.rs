//! Why a brick is wanted: what decides in which order bricks are read, and which of them hold slots.

/// Why a brick is wanted; earlier tiers are served first, and evict later ones. (Next time steps would come after `Visible`.)
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Tier {
    Cover,
    Visible,
    Predicted,
    Ring,
}

impl Tier {
    /// The number of slots, of so many, that bricks of this tier may hold.
    pub(crate) fn slots(self, slots: usize) -> usize {
        match self {
            Self::Cover | Self::Visible => slots,
            Self::Predicted => slots / 8,
            Self::Ring => slots / 16,
        }
    }

    /// Whether the view can do without.
    pub(crate) fn is_ahead(self) -> bool {
        self > Self::Visible
    }
}
