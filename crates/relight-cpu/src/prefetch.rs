//! Asking memory ahead: random lookups wait for memory, unless it was asked early enough.

/// Asks memory for an entry that will be wanted soon, where processors can be asked.
#[inline(always)]
pub fn ask<E>(entries: &[E], index: usize) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a hint, which reads nothing and is harmless whatever the address.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(entries.as_ptr().wrapping_add(index).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (entries, index);
}
