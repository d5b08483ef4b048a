//! How long a training takes yet.

use std::collections::VecDeque;
use std::ops::Range;
use std::time::Instant;

use muslin_train::Training;

/// Steps of a kind whose time is remembered: what is done now and then, such as factoring, is among so many.
const REMEMBERED: usize = 160;

/// How long the last steps took, those that follow what is near cloth and those that look for it.
pub(super) struct Pace {
    since: Instant,
    took: [VecDeque<f64>; 2],
}

impl Pace {
    pub fn new() -> Self {
        Self {
            since: Instant::now(),
            took: [VecDeque::new(), VecDeque::new()],
        }
    }

    /// Takes in that a step was taken; gives the seconds until `steps` are, and as many more that take `after` times as long
    /// each. None before it is known how long a step takes of each kind that is to come.
    pub fn left(&mut self, trainer: &dyn Training, steps: u64, after: f64) -> Option<f64> {
        let looks = |range| trainer.looks(range);
        self.left_at((trainer.steps(), Instant::now()), (&looks, steps), after)
    }

    fn left_at(
        &mut self,
        (done, now): (u64, Instant),
        (looks, steps): (&dyn Fn(Range<u64>) -> u64, u64),
        after: f64,
    ) -> Option<f64> {
        let kind = usize::from(looks(done.saturating_sub(1)..done) > 0);
        let took = &mut self.took[kind];
        took.push_back((now - self.since).as_secs_f64());
        self.since = now;
        if took.len() > REMEMBERED {
            took.pop_front();
        }
        let all = |range: Range<u64>| {
            let looks = looks(range.clone());
            [range.end - range.start - looks, looks]
        };
        let (here, there) = (all(done.min(steps)..steps), all(0..steps));
        let mut left = 0.0;
        for (k, took) in self.took.iter().enumerate() {
            let n = here[k] as f64 + after * there[k] as f64;
            if n > 0.0 && took.is_empty() {
                return None;
            }
            left += n * took.iter().sum::<f64>() / took.len().max(1) as f64;
        }
        Some(left)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Steps 0 to 9 of every hundred look: ten of them take as long as all others.
    fn looks(steps: Range<u64>) -> u64 {
        steps.filter(|s| s % 100 < 10).count() as u64
    }

    #[test]
    fn what_is_left_knows_both_kinds_of_steps_and_counts_what_comes_after() {
        let mut pace = Pace::new();
        let (start, mut at) = (pace.since, 0.0);
        for done in 1..=1000 {
            at += if (done - 1) % 100 < 10 { 0.9 } else { 0.1 };
            let now = start + Duration::from_secs_f64(at);
            let left = pace.left_at((done, now), (&looks, 1000), 2.0);
            // A thousand steps take 180 s.
            let want = (done > 10).then_some(180.0 - at + 360.0);
            match (left, want) {
                (Some(left), Some(want)) => assert!((left - want).abs() < 1e-6, "{done}: {left}"),
                (left, want) => assert_eq!(left, want, "{done}"),
            }
        }
    }

    #[test]
    fn a_training_that_went_back_or_goes_beyond_still_has_a_pace() {
        let mut pace = Pace::new();
        let mut left = |done, seconds| {
            let now = pace.since + Duration::from_secs(seconds);
            pace.left_at((done, now), (&|_| 0, 100), 0.0)
        };
        assert_eq!([left(60, 2), left(50, 4)], [Some(80.0), Some(150.0)]);
        assert_eq!(left(101, 1), Some(0.0));
    }
}
