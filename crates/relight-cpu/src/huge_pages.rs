//! Room for arrays that are read in no order.
//!
//! Processors keep at hand where some thousand pages of memory lie. What is spread over more pages of 4 kB than those waits for
//! the page as well as for the line; of 2 MB, a few dozen hold all that a field has. Linux gives them where it is asked.

/// Bytes of a huge page, on most machines; smaller arrays are not worth the asking.
const HUGE: usize = 2 << 20;

/// All that `things` yield, in huge pages as far as the system has some.
pub fn collect<T>(things: impl ExactSizeIterator<Item = T>) -> Vec<T> {
    let mut room = Vec::with_capacity(things.len());
    ask_for(&mut room);
    room.extend(things);
    room
}

#[cfg(target_os = "linux")]
fn ask_for<T>(room: &mut Vec<T>) {
    use rustix::mm::{Advice, madvise};
    let free = room.spare_capacity_mut();
    let (start, bytes, page): (*mut u8, _, _) =
        (free.as_mut_ptr().cast(), size_of_val(free), rustix::param::page_size());
    let skipped = start.align_offset(page);
    let whole = bytes.saturating_sub(skipped) / page * page;
    if whole >= HUGE {
        // SAFETY: these pages lie within the vector's own room, and that they may become larger changes nothing of what is in
        // them. Without huge pages they stay as they are.
        let _ = unsafe { madvise(start.wrapping_add(skipped).cast(), whole, Advice::LinuxHugepage) };
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for<T>(_: &mut Vec<T>) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_come_in_order() {
        for n in [0, 1, 1000, HUGE] {
            assert!(collect(0..n).into_iter().eq(0..n));
        }
    }

    /// What the system says of the memory about an address: flags of its mapping.
    #[cfg(target_os = "linux")]
    fn flags(address: usize) -> Option<String> {
        let maps = std::fs::read_to_string("/proc/self/smaps").ok()?;
        let mut here = false;
        maps.lines().find_map(|line| {
            if let Some((start, end)) = line.split_once(' ').and_then(|(range, _)| range.split_once('-')) {
                let number = |text| usize::from_str_radix(text, 16).ok();
                here = number(start)? <= address && address < number(end)?;
            }
            here.then(|| line.strip_prefix("VmFlags:")).flatten().map(str::to_owned)
        })
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn large_arrays_ask_for_huge_pages() {
        if !std::path::Path::new("/sys/kernel/mm/transparent_hugepage").exists() {
            return;
        }
        let zeros = || std::iter::repeat_n(0u8, 4 * HUGE);
        let (plain, huge): (Vec<u8>, _) = (zeros().collect(), collect(zeros()));
        let asked = |array: &[u8]| {
            let flags = flags(array.as_ptr() as usize + 2 * HUGE)?;
            Some(flags.split(' ').any(|flag| flag == "hg"))
        };
        // Some systems do not tell.
        if let (Some(huge), Some(plain)) = (asked(&huge), asked(&plain)) {
            assert!(huge && !plain);
        }
    }
}
