//! Many images, a few threads.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;

/// How far a long job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Images done.
    pub done: usize,
    /// Images in all.
    pub all: usize,
}

/// Works on `0..all`, as many at a time as the current rayon pool has threads; none if `progress` asks to stop. `start` makes
/// what a thread keeps from one to the next.
///
/// The threads are not those of the pool: one of these, waiting for a part of an image, would begin another image and hold both.
pub(crate) fn in_parallel<S, T: Send>(
    all: usize,
    start: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize) -> T + Sync,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Option<Vec<T>> {
    let (next, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let (sender, receiver) = mpsc::channel();
    let mut results: Vec<Option<T>> = (0..all).map(|_| None).collect();
    thread::scope(|scope| {
        for _ in 0..rayon::current_num_threads().min(all) {
            let sender = sender.clone();
            let (next, stopped, start, work) = (&next, &stopped, &start, &work);
            scope.spawn(move || {
                let mut state = start();
                while !stopped.load(Ordering::Relaxed) {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= all || sender.send((index, work(&mut state, index))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut tell = |done| {
            if !stopped.load(Ordering::Relaxed) && progress(Progress { done, all }).is_break() {
                stopped.store(true, Ordering::Relaxed);
            }
        };
        tell(0);
        for (before, (index, result)) in receiver.into_iter().enumerate() {
            results[index] = Some(result);
            tell(before + 1);
        }
    });
    if stopped.into_inner() { None } else { results.into_iter().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_order_and_progress_reaches_the_end() {
        let mut told = Vec::new();
        let squares = in_parallel(100, || (), |(), i| i * i, &mut |progress| {
            told.push(progress.done);
            ControlFlow::Continue(())
        });
        assert_eq!(squares, Some((0..100).map(|i| i * i).collect()));
        assert_eq!(told, (0..=100).collect::<Vec<_>>());
        assert_eq!(in_parallel(0, || (), |(), i| i, &mut |_| ControlFlow::Continue(())), Some(vec![]));
    }

    #[test]
    fn a_stop_is_heeded() {
        let mut stop_at_three = |progress: Progress| {
            if progress.done < 3 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        assert_eq!(in_parallel(1000, || (), |(), i| i, &mut stop_at_three), None);
    }
}
