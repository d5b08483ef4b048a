//! How long a training takes yet.

use std::collections::VecDeque;
use std::time::Instant;

/// Steps whose time is remembered: the first look at every pose costs more than all that follow.
const REMEMBERED: usize = 64;

/// When steps were done.
pub(super) struct Pace(VecDeque<(u64, Instant)>);

impl Pace {
    /// Begins at that step.
    pub fn new(step: u64) -> Self {
        Self(VecDeque::from([(step, Instant::now())]))
    }

    /// Seconds until `steps` are done, and as many more that take `after` times as long each.
    pub fn left(&mut self, done: u64, steps: u64, after: f64) -> f64 {
        self.left_at((done, Instant::now()), steps, after)
    }

    fn left_at(&mut self, (done, now): (u64, Instant), steps: u64, after: f64) -> f64 {
        self.0.push_back((done, now));
        if self.0.len() > REMEMBERED {
            self.0.pop_front();
        }
        let (first, since) = self.0[0];
        let each = (now - since).as_secs_f64() / done.saturating_sub(first).max(1) as f64;
        each * ((steps - done) as f64 + after * steps as f64)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn what_is_left_goes_by_the_last_steps_and_counts_what_comes_after() {
        let mut pace = Pace::new(0);
        let (start, mut at) = (pace.0[0].1, 0.0);
        let mut left = 0.0;
        for step in 1..=200 {
            // The first hundred cost ten times as much.
            at += if step <= 100 { 5.0 } else { 0.5 };
            let now = start + Duration::from_secs_f64(at);
            left = pace.left_at((step, now), 1000, 0.0);
            if step == 50 {
                assert!((left - 950.0 * 5.0).abs() < 1e-6, "{left}");
            }
        }
        assert!((left - 800.0 * 0.5).abs() < 1e-6, "{left}");
        let now = start + Duration::from_secs_f64(at + 0.5);
        let both = pace.left_at((201, now), 1000, 4.0);
        assert!((both - (799.0 + 4000.0) * 0.5).abs() < 1e-6, "{both}");
    }

    #[test]
    fn a_training_that_went_back_still_has_a_pace() {
        let mut pace = Pace::new(100);
        let later = pace.0[0].1 + Duration::from_secs(10);
        assert!(pace.left_at((50, later), 100, 0.0).is_finite());
    }
}
