//! Why a brick is wanted: what decides in which order bricks are read, and which of them hold slots.

/// Why a brick is wanted. Bricks of earlier tiers are read first, and evict those of later tiers that are fetched ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Tier {
    Cover,
    Visible,
    /// A brick of a view that comes next: of a later time step.
    Coming,
    Predicted,
    Ring,
}

impl Tier {
    /// How many of `slots` slots the bricks of this tier may hold. What is coming may hold all that the view itself leaves.
    pub(crate) fn slots(self, slots: usize) -> usize {
        match self {
            Self::Cover | Self::Visible | Self::Coming => slots,
            Self::Predicted => slots / 8,
            Self::Ring => slots / 16,
        }
    }

    /// How many of `staged` padded bricks on their way may be of this tier or later ones.
    pub(crate) fn staged(self, staged: usize) -> usize {
        match self {
            Self::Cover | Self::Visible => staged,
            // Some are kept for the view itself: the first brick of a plan that a flip or a turn makes does not wait.
            Self::Coming => staged - staged / 8,
            Self::Predicted | Self::Ring => staged.div_ceil(4),
        }
    }

    /// Whether bricks of this tier are fetched ahead: the view itself does not need them.
    pub(crate) fn is_ahead(self) -> bool {
        self > Self::Visible
    }
}
