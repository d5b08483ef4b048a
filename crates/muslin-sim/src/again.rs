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
}

/// What is known of frames before.
#[derive(Default)]
pub(crate) struct Again {
    /// Whether shorter steps did not help the last frame, so that this one is not asked.
    hopeless: bool,
}

impl Again {
    /// Goes on to the next frame, and makes it clean. Where that leaves cloth beyond its limit or in the body, it is
    /// gone again in steps half as long, as often as that may help; but not where that did not help the frame before.
    pub fn live(
        &mut self,
        stage: &mut Stage<'_>,
        body: &Frame,
        stride: &Stride,
    ) -> Result<Tidy, SimError> {
        let start = stage.mark();
        let halvings = if self.hopeless { 0 } else { HALVINGS };
        let mut best: Option<(Trouble, Mark, Tidy)> = None;
        for halved in 0..=halvings {
            if halved > 0 {
                stage.back(&start);
            }
            match stage.live(&body.skin, &Stride { halved, ..*stride }) {
                Err(_) if best.is_some() => break,
                led => led?,
            }
            let tidy = clean::tidy(stage, &body.cores);
            let trouble = Trouble {
                left: tidy.left,
                beyond: stage.wedged(),
            };
            if trouble.left == 0 && trouble.beyond < WEDGED {
                self.hopeless = false;
                return Ok(tidy);
            }
            let less = best.as_ref().is_none_or(|b| trouble.is_less_than(&b.0));
            if !less && trouble.left == 0 {
                break;
            }
            if less {
                self.hopeless = halved == 0;
                best = Some((trouble, stage.mark(), tidy));
            }
        }
        let (_, mark, tidy) = best.expect("the first way counts unless a later one is better");
        stage.back(&mark);
        Ok(tidy)
    }
}
