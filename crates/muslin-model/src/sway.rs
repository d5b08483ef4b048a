//! What a model knows of how its cloth swings.

/// Swings of cloth about where it would rest: its slowest shapes of vibration, and a few points whose
/// motion stands for that of the whole.
///
/// `x = skin(still + Φ q)`, and `q` obeys Newton's law for that `x`: inertia of the points, stiffness
/// `ω²` and damping of each swing. Nothing swings without motion, and nothing depends on the way the
/// body faces or on where it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sway {
    /// `Φ` [m at a code of one], around the body at rest: for every coordinate of every vertex a row
    /// with one entry per swing. Of unit mass: `Φᵀ M Φ` is the identity.
    pub shapes: Vec<f32>,
    /// `ω²` of each swing [1/s²].
    pub stiffness: Vec<f32>,
    /// How fast each swing dies away [1/s].
    pub damping: Vec<f32>,
    /// Vertices whose motion stands for that of the cloth around them.
    pub samples: Vec<u32>,
    /// Mass of the cloth that each stands for [kg].
    pub masses: Vec<f32>,
    /// Its mean share in the swings: like `shapes`, for every coordinate of every sample a row.
    pub means: Vec<f32>,
    /// Vertices that the skin below them holds back.
    pub walls: Vec<u32>,
    /// Of each of them the way out of the skin, around the body at rest, and how far it may swing the other way [m].
    pub rooms: Vec<[f32; 4]>,
}

/// Swings at most: playing them inverts a matrix of this size.
const MOST: usize = 256;

impl Sway {
    /// How many swings there are.
    pub fn len(&self) -> usize {
        self.stiffness.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.stiffness.is_empty()
    }

    /// Whether the arrays fit each other and a cloth of `n` vertices, and hold what they may.
    pub fn fits(&self, n: usize) -> bool {
        let (k, m) = (self.len(), self.samples.len());
        let all = [
            &self.shapes,
            &self.stiffness,
            &self.damping,
            &self.masses,
            &self.means,
        ];
        k <= MOST
            && self.shapes.len() == 3 * n * k
            && self.means.len() == 3 * m * k
            && self.damping.len() == k
            && self.masses.len() == m
            && self.samples.iter().all(|v| (*v as usize) < n)
            && self.rooms.len() == self.walls.len()
            && self.walls.iter().all(|v| (*v as usize) < n)
            && self
                .rooms
                .iter()
                .all(|r| r.iter().all(|x| x.is_finite()) && r[3] >= 0.0)
            && all.iter().all(|a| a.iter().all(|x| x.is_finite()))
            && [&self.stiffness, &self.damping, &self.masses]
                .iter()
                .all(|a| a.iter().all(|x| *x >= 0.0))
            && (k == 0 || self.masses.iter().any(|m| *m > 0.0))
    }
}
