//! The choice of functions for this machine and a layer's codes.

use crate::sample::{Code, Code8, Code16, Float32};
#[cfg(target_arch = "x86_64")]
use crate::unit::Avx2;
use crate::unit::{Portable, Unit};
use brickyard_volume::{SlotEncoding, SlotFormat};

/// Functions that exist for every vector unit and every kind of codes.
pub(crate) trait Choice: Sized {
    type Chosen;

    fn of<C: Code, U: Unit>(self) -> Self::Chosen;

    /// The functions for this machine.
    fn for_machine(self, encoding: &SlotEncoding) -> Self::Chosen {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return self.for_unit::<Avx2>(encoding);
        }
        self.for_unit::<Portable>(encoding)
    }

    fn for_unit<U: Unit>(self, encoding: &SlotEncoding) -> Self::Chosen {
        match (encoding.format, encoding.has_invalid) {
            (SlotFormat::U8, false) => self.of::<Code8<false>, U>(),
            (SlotFormat::U8, true) => self.of::<Code8<true>, U>(),
            (SlotFormat::U16, false) => self.of::<Code16<false>, U>(),
            (SlotFormat::U16, true) => self.of::<Code16<true>, U>(),
            (SlotFormat::F32, _) => self.of::<Float32, U>(),
        }
    }
}
