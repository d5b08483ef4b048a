//! Where limbs would pass through the trunk or each other, and which way out.
//!
//! Forearms and hands are bars with round ends; so is the trunk, as three bars across it at belly,
//! waist and bust. Bars that overlap are drawn apart along the shortest way. A picture says least
//! about depth, so that is what gives way.

use crate::fold::{Folded, N_MARKERS, RIBS};
use crate::guess::Placed;
use glam::DVec3;
use muslin_geom::closest::on_segments;

/// A wish about a mean of markers: that `along · Σ w x` [m] changes by minus `miss` spreads.
#[derive(Debug, Clone)]
pub struct Tie {
    /// Markers and their weights.
    pub ends: Vec<(usize, f64)>,
    /// Direction, in the camera's frame.
    pub along: DVec3,
    /// What is left to do, in standard deviations.
    pub miss: f64,
    /// One standard deviation [m].
    pub spread: f64,
}

/// A bar between two means of markers.
#[derive(Debug, Clone)]
struct Bar {
    ends: [Vec<(usize, f64)>; 2],
    /// Half its thickness [m].
    radius: f64,
}

/// Bars of one body, and which of them keep apart.
#[derive(Debug, Clone, Default)]
pub struct Touch {
    bars: Vec<Bar>,
    pairs: Vec<[usize; 2]>,
}

/// Half the thickness of an upper arm, a forearm, a hand and a thumb [m].
const UPPER_ARM: f64 = 0.042;
const FOREARM: f64 = 0.035;
const HAND: f64 = 0.022;
const THUMB: f64 = 0.014;
/// Room for cloth on the trunk [m].
const ROOM: f64 = 0.008;
/// How exactly bars keep apart [m].
const SPREAD: f64 = 0.01;
/// Shoulder, elbow, wrist, knuckles of little finger, index and thumb; left, then right.
const ARMS: [[usize; 6]; 2] = [[5, 7, 9, 23, 25, 27], [6, 8, 10, 24, 26, 28]];
/// Forearms, hands and thumbs among the bars, left and right, then upper arms, then the trunk.
const LIMBS: [[usize; 3]; 2] = [[0, 1, 2], [4, 5, 6]];
const UPPER: [usize; 2] = [3, 7];
const TRUNK: usize = 8;

impl Touch {
    /// The bars of the body that has these features at rest.
    pub fn new(folded: &Folded, features: &[DVec3]) -> Touch {
        let mut bars = Vec::new();
        for [shoulder, elbow, wrist, little, index, thumb] in ARMS {
            // Elbows may rest on the trunk; fingers reach as far again as the knuckles.
            let forearm = [vec![(elbow, 0.8), (wrist, 0.2)], vec![(wrist, 1.0)]];
            let tip = vec![(wrist, -0.6), (little, 0.8), (index, 0.8)];
            let hand = [vec![(wrist, 1.0)], tip];
            bars.push(Bar {
                ends: forearm,
                radius: FOREARM,
            });
            bars.push(Bar {
                ends: hand,
                radius: HAND,
            });
            bars.push(Bar {
                ends: [
                    vec![(wrist, 0.5), (thumb, 0.5)],
                    vec![(wrist, -0.6), (thumb, 1.6)],
                ],
                radius: THUMB,
            });
            bars.push(Bar {
                ends: [vec![(shoulder, 0.7), (elbow, 0.3)], vec![(elbow, 1.0)]],
                radius: UPPER_ARM,
            });
        }
        for level in 0..RIBS.len() {
            let end = |side: usize| vec![(N_MARKERS + 2 * level + side, 1.0)];
            bars.push(Bar {
                ends: [end(0), end(1)],
                radius: folded.half_depth(features, level) + ROOM,
            });
        }
        let mut pairs = Vec::new();
        for (side, limbs) in LIMBS.iter().enumerate() {
            for &limb in limbs {
                pairs.extend((0..RIBS.len()).map(|rib| [limb, TRUNK + rib]));
                pairs.push([limb, UPPER[1 - side]]);
            }
        }
        pairs.extend(LIMBS[0].iter().flat_map(|&l| LIMBS[1].map(|r| [l, r])));
        Touch { bars, pairs }
    }

    /// One wish for each pair that overlaps.
    pub fn ties(&self, placed: &Placed) -> Vec<Tie> {
        let mean = |end: &[(usize, f64)]| {
            let share = |&(k, w): &(usize, f64)| w * placed.markers[k];
            end.iter().map(share).sum::<DVec3>()
        };
        let at: Vec<[DVec3; 2]> = self
            .bars
            .iter()
            .map(|b| b.ends.each_ref().map(|e| mean(e)))
            .collect();
        let tie = |&[a, b]: &[usize; 2]| {
            let near = on_segments(at[a], at[b]);
            let over = self.bars[a].radius + self.bars[b].radius - near.distance;
            if over <= 0.0 {
                return None;
            }
            let mut ends = Vec::new();
            for (bar, t, sign) in [(a, near.at[0], -1.0), (b, near.at[1], 1.0)] {
                for (end, share) in self.bars[bar].ends.iter().zip([1.0 - t, t]) {
                    ends.extend(end.iter().map(|&(k, w)| (k, sign * share * w)));
                }
            }
            Some(Tie {
                ends,
                // Bars whose axes meet part towards the camera.
                along: near.gap.try_normalize().unwrap_or(DVec3::Z),
                miss: over / SPREAD,
                spread: SPREAD,
            })
        };
        self.pairs.iter().filter_map(tie).collect()
    }
}
