//! Cloth that hardly moves on a body that stands still sleeps until the body moves.
//!
//! What is led to the least of an energy creeps along its flat valleys for long; in cloth, yarns hold on to each
//! other, and folds stay where they are.

use glam::DVec3;

/// Mean speed of cloth that falls asleep [m/s], and how long it is as slow before [s].
const DROWSY: f64 = 1e-3;
const DOZING: f64 = 0.25;
/// A body of which no vertex goes farther than this stands still [m].
const STANDS: f64 = 1e-6;

/// How long the cloth has been slow on a body that stands.
#[derive(Debug, Default)]
pub(crate) struct Sleep {
    /// The body where it began to stand [m].
    skin: Vec<DVec3>,
    /// In seconds.
    slow: f64,
}

impl Sleep {
    /// Whether cloth sleeps through a frame of the body.
    pub fn lasts(&mut self, skin: &[DVec3]) -> bool {
        let near = |(a, b): (&DVec3, &DVec3)| a.distance_squared(*b) <= STANDS * STANDS;
        let stands = self.skin.len() == skin.len() && self.skin.iter().zip(skin).all(near);
        if !stands {
            self.skin = skin.to_vec();
            self.slow = 0.0;
        }
        self.is_deep()
    }

    /// After a frame of `time` [s] in which cloth went `far` [m], on the mean; whether it sleeps from now on.
    pub fn falls(&mut self, far: f64, time: f64) -> bool {
        self.slow = match far < DROWSY * time {
            true => self.slow + time,
            false => 0.0,
        };
        self.is_deep()
    }

    fn is_deep(&self) -> bool {
        self.slow >= DOZING
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_falls_asleep_when_all_is_slow_for_long_and_wakes_when_the_body_goes() {
        let mut sleep = Sleep::default();
        let (here, there) = (vec![DVec3::ZERO; 3], vec![DVec3::X * 2e-6; 3]);
        let (time, slow) = (1.0 / 32.0, 2e-5);
        let frames = |sleep: &mut Sleep, skin: &[DVec3], far: f64| {
            let one = |_: &usize| !sleep.lasts(skin) && !sleep.falls(far, time);
            (0..20).take_while(one).count()
        };
        assert_eq!(frames(&mut sleep, &here, 2.0 * slow), 20);
        assert_eq!(frames(&mut sleep, &here, slow), 7);
        assert!(sleep.lasts(&here));
        // A body that creeps is awake as soon as it is away from where it stood.
        assert!(!sleep.lasts(&there));
        assert_eq!(frames(&mut sleep, &there, slow), 7);
    }
}
