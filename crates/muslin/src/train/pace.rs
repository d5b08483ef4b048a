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
        let now = Instant::now();
        self.0.push_back((done, now));
        if self.0.len() > REMEMBERED {
            self.0.pop_front();
        }
        let (first, since) = self.0[0];
        let each = (now - since).as_secs_f64() / (done.saturating_sub(first)).max(1) as f64;
        each * ((steps - done) as f64 + after * steps as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_goes_by_the_last_steps_and_counts_what_comes_after() {
        let mut pace = Pace::new(0);
        for step in 1..=200 {
            pace.left(step, 1000, 0.0);
        }
        assert_eq!(pace.0.len(), REMEMBERED);
        assert_eq!(pace.0[0].0, 137);
        // A minute for the steps that are remembered.
        pace.0[0].1 = pace.0[0]
            .1
            .checked_sub(std::time::Duration::from_secs(63))
            .expect("a while ago");
        let left = pace.left(200, 1000, 0.0);
        assert!((left / 800.0 - 63.0 / 62.0).abs() < 0.1, "{left}");
        let both = pace.left(200, 1000, 4.0);
        assert!(both > 4.0 * left, "{both} {left}");
    }
}
