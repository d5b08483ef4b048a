//! One guess of the solver: camera, stance and shape, and where that puts the markers.

use crate::fold::Folded;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Everything that the solver may change.
#[derive(Debug, Clone)]
pub struct Guess {
    /// Head of the root in the camera's frame [m].
    pub root: DVec3,
    /// One rotation per joint group; every bone of the group has it.
    pub turns: Vec<DQuat>,
    /// Logarithm of the focal length [px].
    pub log_focal: f64,
    /// Where the origin of the world hints is in the camera's frame [m].
    pub origin: DVec3,
    /// Logarithm of the size of the body over that of the world hints.
    pub log_scale: f64,
    /// Values of the free shape parameters.
    pub shape: Vec<f64>,
}

/// Where the unknowns stand in the vector of steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Columns {
    /// Joint groups, three columns each, after three for the root.
    pub n_groups: usize,
    /// Free shape parameters.
    pub n_shape: usize,
}

impl Columns {
    /// First column of joint group `g`.
    pub fn turn(&self, g: usize) -> usize {
        3 + 3 * g
    }

    /// Column of the focal length.
    pub fn focal(&self) -> usize {
        3 + 3 * self.n_groups
    }

    /// First column of the hints' origin.
    pub fn origin(&self) -> usize {
        self.focal() + 1
    }

    /// Column of the hints' scale.
    pub fn scale(&self) -> usize {
        self.origin() + 3
    }

    /// First column of the shape.
    pub fn shape(&self) -> usize {
        self.scale() + 1
    }

    /// How many columns there are.
    pub fn len(&self) -> usize {
        self.shape() + self.n_shape
    }
}

impl Guess {
    /// This guess after a step; rotations move along their own axes.
    ///
    /// A longer focal length takes the body (and the hints' origin) away with it, so that
    /// it stays as large in the picture: else the two would have to step together.
    pub fn step(&self, columns: &Columns, d: &[f64]) -> Guess {
        let vector = |at: usize| DVec3::from_slice(&d[at..at + 3]);
        let turn = |(g, q): (usize, &DQuat)| {
            (*q * DQuat::from_scaled_axis(vector(columns.turn(g)))).normalize()
        };
        let shape = self.shape.iter().zip(&d[columns.shape()..]);
        let away = self.root * d[columns.focal()].exp_m1();
        Guess {
            root: self.root + away + vector(0),
            turns: self.turns.iter().enumerate().map(turn).collect(),
            log_focal: self.log_focal + d[columns.focal()],
            origin: self.origin + away + vector(columns.origin()),
            log_scale: self.log_scale + d[columns.scale()],
            shape: shape.map(|(s, d)| s + d).collect(),
        }
    }
}

/// Where a point of the camera's frame appears, from the picture's middle, y up [px].
///
/// With its slopes by the point's x, y and z. A point nearer than a centimetre, or behind the
/// camera, is taken as a centimetre away.
pub fn view(x: DVec3, focal: f64) -> (DVec2, [DVec2; 3]) {
    let depth = (-x.z).max(0.01);
    let k = focal / depth;
    let pixel = DVec2::new(x.x, x.y) * k;
    (
        pixel,
        [DVec2::new(k, 0.0), DVec2::new(0.0, k), pixel / depth],
    )
}

/// Joints and markers in the camera's frame.
#[derive(Debug, Clone)]
pub struct Placed {
    /// Rotation of every joint.
    pub turns: Vec<DMat3>,
    /// Head of every joint [m].
    pub heads: Vec<DVec3>,
    /// Every share `R l + c p` [m, weighted].
    shares: Vec<DVec3>,
    /// Every marker [m], and after them the ends of the trunk's bars.
    pub markers: Vec<DVec3>,
}

impl Placed {
    /// Joints and markers of the body whose features are `features`.
    pub fn new(folded: &Folded, features: &[DVec3], guess: &Guess) -> Placed {
        let local: Vec<DMat3> = guess.turns.iter().map(|q| DMat3::from_quat(*q)).collect();
        let n = folded.joints.len();
        let (mut turns, mut heads) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (j, joint) in folded.joints.iter().enumerate() {
            let (turn, head): (DMat3, DVec3) = match joint.parent {
                None => (local[joint.group], guess.root),
                Some(p) => {
                    let parent: DMat3 = turns[p];
                    let head = heads[p] + parent * (features[j] - features[p]);
                    (parent * local[joint.group], head)
                }
            };
            turns.push(turn);
            heads.push(head);
        }
        let share = |(s, a): (&crate::fold::Share, &DVec3)| {
            let arm = *a - s.weight * features[s.joint];
            turns[s.joint] * arm + s.weight * heads[s.joint]
        };
        let shares: Vec<DVec3> = folded
            .shares
            .iter()
            .zip(&features[n..])
            .map(share)
            .collect();
        let sum = |k: usize| shares[folded.starts[k]..folded.starts[k + 1]].iter().sum();
        let markers = (0..folded.starts.len() - 1).map(sum).collect();
        Placed {
            turns,
            heads,
            shares,
            markers,
        }
    }

    /// `∂ marker k / ∂ turn` for every joint group that moves it, as three columns.
    ///
    /// A turn δ about a joint's own axes moves what hangs from it by `(R δ) × (x − p)`.
    pub fn turn_slopes(&self, folded: &Folded, k: usize, out: &mut Vec<(usize, DMat3)>) {
        out.clear();
        for s in folded.starts[k]..folded.starts[k + 1] {
            let share = folded.shares[s];
            let mut at = Some(share.joint);
            while let Some(j) = at {
                let lever = self.shares[s] - share.weight * self.heads[j];
                let turn = self.turns[j];
                let slope = DMat3::from_cols(
                    turn.x_axis.cross(lever),
                    turn.y_axis.cross(lever),
                    turn.z_axis.cross(lever),
                );
                let group = folded.joints[j].group;
                match out.iter_mut().find(|(g, _)| *g == group) {
                    Some((_, sum)) => *sum += slope,
                    None => out.push((group, slope)),
                }
                at = folded.joints[j].parent;
            }
        }
    }

    /// `∂ markers / ∂ shape parameter`, where `slope` is that of the features.
    pub fn shape_slope(&self, folded: &Folded, slope: &[DVec3]) -> Vec<DVec3> {
        let n = folded.joints.len();
        let mut heads = vec![DVec3::ZERO; n];
        for (j, joint) in folded.joints.iter().enumerate() {
            if let Some(p) = joint.parent {
                heads[j] = heads[p] + self.turns[p] * (slope[j] - slope[p]);
            }
        }
        let share = |s: usize| {
            let share = folded.shares[s];
            let arm = slope[n + s] - share.weight * slope[share.joint];
            self.turns[share.joint] * arm + share.weight * heads[share.joint]
        };
        (0..folded.starts.len() - 1)
            .map(|k| (folded.starts[k]..folded.starts[k + 1]).map(share).sum())
            .collect()
    }
}
