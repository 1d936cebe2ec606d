//! Jobs side by side, each on its share of the cores.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use rayon::ThreadPoolBuilder;

/// How a job ended.
#[derive(Debug)]
pub enum Ended<T> {
    /// It is done.
    Done(T),
    /// It was stopped, and can go on later.
    Stopped,
    /// It failed, for this reason.
    Failed(String),
}

/// Does the jobs numbered 0 to `jobs`, `together` at once, the first ones first; each works on its share of `threads`
/// (whoever calls rayon in it has as many). `ended` is told of each at its end, one after another. One that fails, or even
/// panics, stops no other. Once `cancel` is set no further one is begun.
pub fn side_by_side<T: Send>(
    jobs: usize,
    together: usize,
    threads: usize,
    cancel: &AtomicBool,
    work: impl Fn(usize) -> Ended<T> + Sync,
    ended: impl FnMut(usize, Ended<T>) + Send,
) {
    let together = together.clamp(1, jobs.max(1));
    let next = AtomicUsize::new(0);
    let ended = std::sync::Mutex::new(ended);
    let worker = || {
        let pool = ThreadPoolBuilder::new().num_threads((threads / together).max(1)).build();
        while !cancel.load(Ordering::Relaxed) {
            let job = next.fetch_add(1, Ordering::Relaxed);
            if job >= jobs {
                break;
            }
            let result =
                match &pool {
                    Ok(pool) => catch_unwind(AssertUnwindSafe(|| pool.install(|| work(job)))).unwrap_or_else(
                        |panic| Ended::Failed(format!("a fault of the program: {}", told(&*panic))),
                    ),
                    Err(error) => Ended::Failed(format!("no threads to work with: {error}")),
                };
            let mut ended = ended.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            (*ended)(job, result);
        }
    };
    thread::scope(|scope| {
        for _ in 0..together {
            scope.spawn(worker);
        }
    });
}

/// What a panic says.
fn told(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no more is known")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Barrier;

    use super::*;

    /// How each job ended.
    fn run(
        jobs: usize,
        together: usize,
        threads: usize,
        work: impl Fn(usize) -> Ended<usize> + Sync,
    ) -> BTreeMap<usize, String> {
        let mut results = BTreeMap::new();
        let cancel = AtomicBool::new(false);
        side_by_side(jobs, together, threads, &cancel, work, |job, ended| {
            assert!(results.insert(job, format!("{ended:?}")).is_none(), "job {job} twice");
        });
        results
    }

    #[test]
    fn every_job_is_done_once_with_its_share_of_threads() {
        let results = run(7, 3, 6, |job| Ended::Done(10 * job + rayon::current_num_threads()));
        let expected = (0..7).map(|job| (job, format!("Done({})", 10 * job + 2))).collect();
        assert_eq!(results, expected);
        assert_eq!(run(2, 5, 1, |_| Ended::Done(rayon::current_num_threads())).len(), 2);
        assert!(run(0, 5, 4, |_| Ended::Stopped).is_empty());
    }

    #[test]
    fn jobs_run_at_the_same_time() {
        // Each waits for the other: one after the other they would never end.
        let both = Barrier::new(2);
        let results = run(2, 2, 2, |job| {
            both.wait();
            Ended::Done(job)
        });
        assert_eq!(results.len(), 2);
    }

    #[test]
    fn a_failure_and_a_panic_stop_no_other() {
        let results = run(4, 1, 1, |job| match job {
            0 => Ended::Failed("no scene".into()),
            1 => panic!("number {job}"),
            _ => Ended::Done(job),
        });
        assert_eq!(results[&0], "Failed(\"no scene\")");
        assert!(results[&1].contains("number 1"), "{}", results[&1]);
        assert_eq!((&results[&2], &results[&3]), (&"Done(2)".into(), &"Done(3)".into()));
    }

    #[test]
    fn after_a_cancel_no_job_is_begun() {
        let cancel = AtomicBool::new(false);
        let mut told = Vec::new();
        let work = |job| {
            cancel.store(job == 1, Ordering::Relaxed);
            Ended::<()>::Stopped
        };
        side_by_side(5, 1, 1, &cancel, work, |job, _| told.push(job));
        assert_eq!(told, [0, 1]);
    }
}
