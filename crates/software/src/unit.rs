//! The vector units that loops are compiled for.

/// The kind of machine a function is compiled for.
pub(crate) trait Unit {
    /// Whether the machine is known to have AVX2.
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code, reason = "nobody asks where no machine can have it"))]
    const AVX2: bool;

    /// Does some work, compiled for this unit, by a call of its own. The closure must be `#[inline(always)]`, like all
    /// that it calls: else it is compiled for any machine. A pair of arguments and two captured references go through
    /// registers; with more of either, the optimiser loses sight of what they refer to.
    fn call<A, R>(args: A, work: impl FnOnce(A) -> R) -> R;
}

pub(crate) struct Portable;

#[cfg(target_arch = "x86_64")]
pub(crate) struct Avx2;

impl Unit for Portable {
    const AVX2: bool = false;

    #[inline(never)]
    fn call<A, R>(args: A, work: impl FnOnce(A) -> R) -> R {
        work(args)
    }
}

#[cfg(target_arch = "x86_64")]
impl Unit for Avx2 {
    const AVX2: bool = true;

    #[inline(always)]
    fn call<A, R>(args: A, work: impl FnOnce(A) -> R) -> R {
        // SAFETY: this unit is chosen on machines with AVX2 alone.
        unsafe { call_avx2(args, work) }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline(never)]
fn call_avx2<A, R>(args: A, work: impl FnOnce(A) -> R) -> R {
    work(args)
}

/// Does some work like [`Unit::call`], compiled for this machine.
#[inline(always)]
pub(crate) fn call<A, R>(args: A, work: impl FnOnce(A) -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        return Avx2::call(args, work);
    }
    Portable::call(args, work)
}
