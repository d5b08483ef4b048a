//! A second thread that stays awake while a first one forks often and for short.
//!
//! A thread of the pool that finds nothing to do goes to sleep within some twenty microseconds, and to wake it takes as
//! long as many a piece of a step: a moving shirt of 5,000 vertices put one to sleep several hundred times a frame.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rayon::Yield;

/// Without work for so long it goes to sleep after all, so that it neither takes a core from others for long nor
/// waits for what cannot end before it does.
const PATIENCE: Duration = Duration::from_millis(2);

/// Looks that are skipped between one look for work and the next.
const SKIPPED: usize = 32;

/// Runs `work` in the pool, where a fork costs next to nothing (from outside it wakes threads each time), while another
/// thread looks for what it forks.
pub(crate) fn awake<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    let over = AtomicBool::new(false);
    let first = || {
        let _end = End(&over);
        work()
    };
    rayon::join(first, || look_for_work(&over)).0
}

/// Says that it is over, however it ends.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

fn look_for_work(over: &AtomicBool) {
    let mut since = Instant::now();
    while !over.load(Ordering::Acquire) {
        match rayon::yield_now() {
            Some(Yield::Executed) => since = Instant::now(),
            Some(Yield::Idle) if since.elapsed() < PATIENCE => {
                (0..SKIPPED).for_each(|_| std::hint::spin_loop());
            }
            _ => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    /// Many small forks, one after the other, in two that are awake within another.
    fn forks() -> u64 {
        let one = || {
            awake(|| {
                (0..50u64)
                    .map(|k| (0..k).into_par_iter().sum::<u64>())
                    .sum()
            })
        };
        let (a, b): (u64, u64) = awake(|| rayon::join(one, one));
        a + b
    }

    #[test]
    fn work_ends_whoever_else_works() {
        // Sums of the numbers below each k: k (k - 1) / 2, twice.
        let exact = 2 * (0..50u64).map(|k| k * k.saturating_sub(1) / 2).sum::<u64>();
        assert_eq!(forks(), exact);
        for threads in [1, 2, 3, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.expect("threads can be started");
            assert_eq!(pool.install(forks), exact, "{threads} threads");
            // Two at once from outside, each of which may end up waiting on the other's thread.
            std::thread::scope(|scope| {
                let all = [(); 2].map(|()| scope.spawn(|| pool.install(forks)));
                for one in all {
                    assert_eq!(one.join().expect("it ends"), exact, "{threads} threads");
                }
            });
        }
    }

    #[test]
    fn what_breaks_off_keeps_nobody_awake() {
        let broken = std::panic::catch_unwind(|| awake(|| panic!("as asked")));
        assert!(broken.is_err());
        assert_eq!(awake(|| 3), 3);
    }
}
