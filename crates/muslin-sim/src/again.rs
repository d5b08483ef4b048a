//! A frame of moving cloth that ends in trouble, gone again in shorter steps.

use std::cmp::Ordering;

use crate::{
    clean::{self, Tidy},
    cloth::SimError,
    relief::Frame,
    stage::{LOWERED, Mark, Stage, Stride},
};

/// How often the steps of a frame are halved at most, and the stretch beyond the limit that asks for it.
const HALVINGS: usize = 2;
const WEDGED: f64 = 0.009;
/// No frame is gone again in which there were more steps: they are short enough.
const MOST: usize = 32;
/// Trouble so many times as much as what could not be helped is another.
const MUCH: f64 = 1.5;

/// What is wrong with a frame: pairs of triangles of cloth and body that meet, and how far the worst face is beyond
/// its limit.
struct Trouble {
    left: usize,
    beyond: f64,
}

impl Trouble {
    fn is_less_than(&self, other: &Trouble) -> bool {
        match self.left.cmp(&other.left) {
            Ordering::Equal => self.beyond < LOWERED * other.beyond,
            order => order.is_lt(),
        }
    }

    fn is_much_more_than(&self, other: &Trouble) -> bool {
        match self.left.cmp(&other.left) {
            Ordering::Equal => self.beyond > MUCH * other.beyond,
            _ => self.left as f64 > MUCH * other.left as f64,
        }
    }
}

/// What is known of frames before.
#[derive(Default)]
pub(crate) struct Again {
    /// The trouble of late that shorter steps did not help.
    hopeless: Option<Trouble>,
}

impl Again {
    /// Goes on to the next frame, and makes it clean. Where that leaves cloth beyond its limit or in the body, it is
    /// gone again in steps half as long, as often as that may help; but not where that did not help in frames before,
    /// until there is much more of it.
    pub fn live(
        &mut self,
        stage: &mut Stage<'_>,
        body: &Frame,
        stride: &Stride,
    ) -> Result<Tidy, SimError> {
        let start = stage.mark();
        let mut best: Option<(Trouble, Mark, Tidy)> = None;
        let mut helped = false;
        for halved in 0..=HALVINGS {
            if halved > 0 {
                stage.back(&start);
            }
            let steps = match stage.live(&body.skin, stride, halved) {
                Err(_) if best.is_some() => break,
                led => led?,
            };
            let tidy = clean::tidy(stage, &body.cores);
            let trouble = Trouble {
                left: tidy.left,
                beyond: stage.wedged(),
            };
            if trouble.left == 0 && trouble.beyond < WEDGED {
                self.hopeless = None;
                return Ok(tidy);
            }
            let in_vain = self.is_in_vain(&trouble);
            if best.as_ref().is_none_or(|b| trouble.is_less_than(&b.0)) {
                helped = halved > 0;
                best = Some((trouble, stage.mark(), tidy));
            }
            if in_vain || steps > MOST {
                break;
            }
        }
        let (trouble, mark, tidy) =
            best.expect("the first way counts unless a later one is better");
        stage.back(&mark);
        self.learn(trouble, helped);
        Ok(tidy)
    }

    /// Whether shorter steps did not help with as much trouble before.
    fn is_in_vain(&self, trouble: &Trouble) -> bool {
        let known = self.hopeless.as_ref();
        known.is_some_and(|h| !trouble.is_much_more_than(h))
    }

    /// Remembers what is left of the trouble of a frame.
    fn learn(&mut self, trouble: Trouble, helped: bool) {
        if helped {
            self.hopeless = None;
        } else if !self.is_in_vain(&trouble) {
            self.hopeless = Some(trouble);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_could_not_be_helped_is_not_asked_again_until_there_is_much_more_of_it() {
        let stretched = |beyond: f64| Trouble { left: 0, beyond };
        let mut again = Again::default();
        assert!(!again.is_in_vain(&stretched(0.02)));
        again.learn(stretched(0.02), false);
        assert!(again.is_in_vain(&stretched(0.02)));
        assert!(again.is_in_vain(&stretched(0.025)));
        assert!(!again.is_in_vain(&stretched(0.04)));
        // What is less is not remembered in its place.
        again.learn(stretched(0.01), false);
        assert!(again.is_in_vain(&stretched(0.025)));
        again.learn(stretched(0.04), false);
        assert!(again.is_in_vain(&stretched(0.05)));
        // Meeting the body is more trouble than any stretch.
        let meets = |left: usize| Trouble { left, beyond: 0.0 };
        assert!(!again.is_in_vain(&meets(1)));
        again.learn(meets(10), false);
        assert!(again.is_in_vain(&meets(12)) && again.is_in_vain(&stretched(0.5)));
        assert!(!again.is_in_vain(&meets(20)));
        again.learn(meets(10), true);
        assert!(!again.is_in_vain(&meets(1)));
    }
}
