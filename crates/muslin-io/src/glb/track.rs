//! A garment as a whole: where its middle is and how it is turned.

use glam::{DQuat, DVec3};
use muslin_geom::best_turn;

use super::bin::bounds;

/// Cells of the grid to either side of the middle: differences of two must fit into 16 bits.
const CELLS: f64 = 16_383.0;

/// Where a garment is as a whole, frame by frame.
pub struct Track {
    /// Its middles [m].
    pub middles: Vec<DVec3>,
    /// Its turns from frame 0.
    pub turns: Vec<DQuat>,
    /// A cell [m].
    pub step: f32,
}

impl Track {
    /// The track of these frames.
    pub fn of(frames: &[Vec<DVec3>]) -> Self {
        let middle = |x: &[DVec3]| {
            let (low, high) = bounds(x);
            // As the file stores it.
            (0.5 * (low + high)).as_vec3().as_dvec3()
        };
        let middles: Vec<DVec3> = frames.iter().map(|x| middle(x)).collect();
        let mut turns = vec![DQuat::IDENTITY];
        for t in 1..frames.len() {
            let last = turns[t - 1];
            let mut turn = best_turn((&frames[0], middles[0]), (&frames[t], middles[t]), last);
            if turn.dot(last) < 0.0 {
                turn = -turn;
            }
            // As the file stores it.
            turns.push(turn.as_quat().as_dquat().normalize());
        }
        let reach = |t: usize| {
            frames[t]
                .iter()
                .map(|x| (turns[t].inverse() * (*x - middles[t])).abs().max_element())
                .fold(0.0, f64::max)
        };
        let reach = (0..frames.len()).map(reach).fold(0.0, f64::max);
        Self {
            step: ((reach / CELLS) as f32).next_up().max(1e-7),
            middles,
            turns,
        }
    }

    /// A point of frame `t` in the node's own frame [m].
    pub fn local(&self, t: usize, x: DVec3) -> DVec3 {
        self.turns[t].inverse() * (x - self.middles[t])
    }

    /// The same in cells, unrounded.
    pub fn in_cells(&self, t: usize, x: DVec3) -> DVec3 {
        self.local(t, x) / f64::from(self.step)
    }

    /// The same in cells.
    pub fn cell(&self, t: usize, x: DVec3) -> [i16; 3] {
        let cells = self.in_cells(t, x);
        cells.to_array().map(|c| c.round() as i16)
    }

    /// Where the cell of a point is [m].
    pub fn stored(&self, t: usize, x: DVec3) -> DVec3 {
        self.middles[t] + self.turns[t] * (whole(self.cell(t, x)) * f64::from(self.step))
    }
}

/// Cells in full.
pub fn whole(cell: [i16; 3]) -> DVec3 {
    DVec3::from_array(cell.map(f64::from))
}
